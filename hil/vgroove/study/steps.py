"""`vgroove study steps`: what shrinks a variable-step solver's step, how fast it recovers; how long
a fixed step may be; what it costs.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from vgroove import _core
from vgroove.page import Picture, Table, style
from vgroove.study import drill
from vgroove.study.command import Tick
from vgroove.study.drill import DURATION_S, GRID_S, MODES, PARAMETER_STEPS, SOLVERS, Case
from vgroove.study.report import Study

DESIGN_STEPS_S = (70e-6, 40e-6, 35e-6)
SWEEP_S = (10e-6, 100e-3)
LIMIT = 0.01
EVENT_TICK_US = 3e5  # where events are marked, above every step
COLOURS = {"euler": "#d1495b", "rk4": "#edae49", "real_time": "#00798c"}
STEP_COLOURS = {1: "#d1495b", 2: "#edae49", 3: "#00798c"}
DASHES = {1: "solid", 2: "dash", 3: "dot"}
MODE_WORDS = {
    "normal": "normal mode",
    "pulse": "pulse mode",
    "slipping": "normal mode, clutch set to 4 N m: slips under the load",
}


def sweep_steps(points: int) -> np.ndarray:
    """Fixed steps (n,) from 10 us to 100 ms, multiples of the reference's grid, the design's three
    among them.
    """
    wanted = np.concatenate([np.geomspace(*SWEEP_S, points), DESIGN_STEPS_S])
    return np.unique(np.rint(wanted / GRID_S)) * (GRID_S * 1e6) / 1e6  # 35e-6 to the last bit


def history(case: Case, tolerance: float) -> dict[str, Any]:
    """The variable-step run: its accepted steps with what ended each."""
    run = _core.simulate_drill(
        case.parameters,
        duration_s=DURATION_S,
        tolerance=tolerance,
        columns=["time_s", "current_a", "chuck_rad_s"],
    )
    return {
        "case": case,
        "time_s": run["steps"]["time_s"],
        "length_s": run["steps"]["length_s"],
        "mark": run["steps"]["mark"],
        "rejected": run["rejected"],
        "current_a": run["current_a"][1:],
        "chuck_rad_s": run["chuck_rad_s"][1:],
    }


def event_rows(
    time_s: np.ndarray, length_s: np.ndarray, marks: Sequence[str]
) -> list[dict[str, Any]]:
    """Per event of a step history: the step before it (largest of five), and the smallest after it
    until half of that is reached again.

    Steps that an event cuts short are no choice of the solver: they do not count as smallest.
    `recovery_s` is the time until the step has recovered, later events or not; None when the run
    ends first.
    """
    rows = []
    chosen = np.where([mark == "none" for mark in marks], length_s, np.inf)
    for n in (n for n, mark in enumerate(marks) if mark != "none" and n + 1 < len(marks)):
        before = float(np.max(length_s[max(0, n - 4) : n + 1]))
        later = length_s[n + 1 :]
        recovered = np.flatnonzero(later >= 0.5 * before)
        last = int(recovered[0]) if recovered.size else len(later) - 1
        rows.append(
            {
                "time_s": float(time_s[n]),
                "event": marks[n],
                "before_s": before,
                "smallest_after_s": float(min(np.min(chosen[n + 1 : n + 2 + last]), later[last])),
                "recovery_s": float(time_s[n + 1 + last] - time_s[n]) if recovered.size else None,
            }
        )
    return rows


def event_summary(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Events of one kind together, in the order of their first appearance: medians, and the
    smallest step of all.
    """
    found = []
    for kind in dict.fromkeys(row["event"] for row in rows):
        same = [row for row in rows if row["event"] == kind]
        recovered = [row["recovery_s"] for row in same if row["recovery_s"] is not None]
        found.append(
            {
                "event": kind,
                "count": len(same),
                "before_s": float(np.median([r["before_s"] for r in same])),
                "smallest_after_s": min(r["smallest_after_s"] for r in same),
                "recovery_s": float(np.median(recovered)) if recovered else None,
            }
        )
    return found


def sweep_case(case: Case, steps_s: np.ndarray, tick: Tick) -> list[dict[str, Any]]:
    """Errors of every fixed-step solver at every step."""
    best = drill.reference(case)
    rows = []
    for solver in SOLVERS:
        for step_s in steps_s:
            errors = drill.speed_errors(case, drill.fixed(case, solver, float(step_s)), best)
            rows.append(
                {
                    "mode": case.mode,
                    "parameter_step": case.step,
                    "solver": solver,
                    "step_s": float(step_s),
                    "speed_error": errors["speed_rad_s"],
                    "chuck_error": errors["chuck_rad_s"],
                }
            )
        tick(f"{case.words}: {SOLVERS[solver]}")
    return rows


def largest_below(rows: Sequence[dict[str, Any]], key: str) -> float | None:
    """The longest step up to which every shorter one stays under 1 %; None when the shortest
    already fails.
    """
    longest = None
    for row in sorted(rows, key=lambda r: r["step_s"]):
        if row[key] is None or row[key] >= LIMIT:
            return longest
        longest = row["step_s"]
    return longest


def largest_steps(sweep: Sequence[dict[str, Any]], chosen: Sequence[Case]) -> list[dict[str, Any]]:
    """Largest step under 1 % per case and solver, with the limit that linear stability sets to the
    explicit ones.
    """
    found = []
    for case in chosen:
        for solver in SOLVERS:
            rows = [
                r
                for r in sweep
                if (r["mode"], r["parameter_step"], r["solver"]) == (case.mode, case.step, solver)
            ]
            theory = None if solver == "real_time" else drill.stability_limit_s(case, solver)
            found.append(
                {
                    "mode": case.mode,
                    "parameter_step": case.step,
                    "solver": solver,
                    "speed_s": largest_below(rows, "speed_error"),
                    "chuck_s": largest_below(rows, "chuck_error"),
                    "stability_limit_s": theory,
                }
            )
    return found


def execution(case: Case, repeats: int, tick: Tick) -> list[dict[str, Any]]:
    """Execution time per step in ns. The run is deterministic: the least of `repeats` runs is what
    a step takes undisturbed.
    """
    rows = []
    for solver in SOLVERS:
        for step_s in DESIGN_STEPS_S:
            runs = np.array(
                [
                    drill.fixed(case, solver, step_s, timed=True)["execution_ns"]
                    for _ in range(repeats)
                ]
            )
            least = runs.min(axis=0)
            rows.append(
                {
                    "solver": solver,
                    "step_s": step_s,
                    "mean_ns": float(least.mean()),
                    "p999_ns": float(np.percentile(least, 99.9)),
                    "worst_ns": float(least.max()),
                    "worst_disturbed_ns": float(runs.max()),
                    "worst_share": float(least.max() * 1e-9 / step_s),
                }
            )
        tick(f"execution time: {SOLVERS[solver]}")
    return rows


def drill_steps(
    parameters: dict[str, float], points: int, tolerance: float, repeats: int, tick: Tick
) -> Study:
    """The drill driver's part of the study; ticks drill_ticks() times."""
    chosen = drill.cases(parameters)
    histories = []
    for case in chosen:
        histories.append(history(case, tolerance))
        tick(f"{case.words}: variable step")
    steps_s = sweep_steps(points)
    sweep = [row for case in chosen for row in sweep_case(case, steps_s, tick)]
    largest = largest_steps(sweep, chosen)
    timing = execution(next(c for c in chosen if c.mode == "pulse" and c.step == 1), repeats, tick)
    events = [
        {"mode": h["case"].mode, "parameter_step": h["case"].step, **row}
        for h in histories
        for row in event_summary(event_rows(h["time_s"], h["length_s"], h["mark"]))
    ]
    variable = [variable_row(h) for h in histories]
    data = {
        "parameters": parameters,
        "tolerance": tolerance,
        "variable": variable,
        "events": events,
        "sweep": sweep,
        "largest": largest,
        "execution": timing,
    }
    tables = [
        variable_table(variable),
        event_table(events),
        fixed_table(sweep),
        largest_table(largest),
        execution_table(timing),
    ]
    pictures = [history_picture(histories, tolerance), sweep_picture(sweep)]
    return Study(
        "steps",
        "Step sizes of the drill driver",
        drill_lines(largest, timing),
        tables,
        pictures,
        {"drill": data},
    )


def drill_ticks() -> int:
    """How often drill_steps() ticks."""
    count = len(MODES) * len(PARAMETER_STEPS)
    return count + count * len(SOLVERS) + len(SOLVERS)


def variable_row(h: dict[str, Any]) -> dict[str, Any]:
    """Figures of one step history."""
    length = h["length_s"]
    chosen = length[[mark == "none" for mark in h["mark"]]]
    return {
        "mode": h["case"].mode,
        "parameter_step": h["case"].step,
        "steps": len(length),
        "rejected": h["rejected"],
        "smallest_s": float(chosen.min()),
        "median_s": float(np.median(length)),
        "largest_s": float(length.max()),
    }


def drill_lines(largest: list[dict[str, Any]], timing: list[dict[str, Any]]) -> list[str]:
    """What was found, in sentences."""

    def word(step_s: float | None) -> str:
        return (
            "none of the sweep"
            if step_s is None
            else f"{step_s * 1e6:g} us"
            if step_s < 1e-3
            else f"{step_s * 1e3:g} ms"
        )

    lines = []
    for solver, name in SOLVERS.items():
        rows = [row for row in largest if row["solver"] == solver and row["mode"] == "pulse"]
        found = ", ".join(
            f"{word(row['speed_s'])} in parameter step {row['parameter_step']}" for row in rows
        )
        lines.append(f"Largest step under 1 % speed error in pulse mode, {name}: {found}.")
    worst = max(
        (row for row in timing if row["solver"] == "real_time"), key=lambda r: r["worst_ns"]
    )
    lines.append(
        f"In real time a step of {worst['step_s'] * 1e6:g} us takes at most {worst['worst_ns'] / 1e3:.1f} us on this machine."
    )
    return lines


def micro(value: float | None) -> float | None:
    """Seconds as microseconds."""
    return None if value is None else value * 1e6


def variable_table(rows: list[dict[str, Any]]) -> Table:
    """Steps of the variable-step solver per mode and parameter step."""
    return Table(
        "variable",
        "Variable-step solver (RODAS 4(3), events located)",
        [
            "mode",
            "param. step",
            "steps",
            "rejected",
            "smallest in us",
            "median in us",
            "largest in us",
        ],
        [
            [
                r["mode"],
                r["parameter_step"],
                r["steps"],
                r["rejected"],
                *(micro(r[k]) for k in ("smallest_s", "median_s", "largest_s")),
            ]
            for r in rows
        ],
    )


def event_table(rows: list[dict[str, Any]]) -> Table:
    """Events that shrink the step, and the recovery."""
    return Table(
        "events",
        "Events that shrink the step, and the time until half of the step before is reached again (medians)",
        [
            "mode",
            "param. step",
            "event",
            "count",
            "step before in us",
            "smallest after in us",
            "recovery in ms",
        ],
        [
            [
                r["mode"],
                r["parameter_step"],
                r["event"],
                r["count"],
                micro(r["before_s"]),
                micro(r["smallest_after_s"]),
                None if r["recovery_s"] is None else r["recovery_s"] * 1e3,
            ]
            for r in rows
        ],
    )


def fixed_table(sweep: list[dict[str, Any]]) -> Table:
    """The design's three steps against the reference."""
    wanted = {round(step / GRID_S) for step in DESIGN_STEPS_S}
    rows = sorted(
        (r for r in sweep if round(r["step_s"] / GRID_S) in wanted),
        key=lambda r: (r["mode"], r["parameter_step"], -r["step_s"]),
    )
    keys = list(dict.fromkeys((r["mode"], r["parameter_step"], r["step_s"]) for r in rows))
    by = {(r["mode"], r["parameter_step"], r["step_s"], r["solver"]): r for r in rows}

    def percent(value: float | None) -> float | str:
        return "diverges" if value is None else 100 * value

    cells = [
        [
            m,
            p,
            micro(s),
            *(
                percent(by[m, p, s, solver][key])
                for solver in SOLVERS
                for key in ("speed_error", "chuck_error")
            ),
        ]
        for m, p, s in keys
    ]
    header = [f"{name}: {what} in %" for name in SOLVERS.values() for what in ("speed", "chuck")]
    return Table(
        "fixed",
        "Fixed steps of 70, 40 and 35 us: largest difference from the reference, of the no-load speed",
        ["mode", "param. step", "step in us", *header],
        cells,
    )


def largest_table(rows: list[dict[str, Any]]) -> Table:
    """Largest step under 1 %."""
    return Table(
        "largest",
        "Largest step of the sweep (10 us to 100 ms) under 1 % speed error",
        [
            "mode",
            "param. step",
            "solver",
            "behind the gear in us",
            "at the chuck in us",
            "stability limit in us",
        ],
        [
            [
                r["mode"],
                r["parameter_step"],
                SOLVERS[r["solver"]],
                micro(r["speed_s"]),
                micro(r["chuck_s"]),
                micro(r["stability_limit_s"]),
            ]
            for r in rows
        ],
    )


def execution_table(rows: list[dict[str, Any]]) -> Table:
    """Execution time per step."""
    title = "Execution time per step, pulse mode, parameter step 1: least of the repeats; last column with what the operating system adds"
    return Table(
        "execution",
        title,
        [
            "solver",
            "step in us",
            "mean in ns",
            "99.9 % in ns",
            "worst in ns",
            "worst in % of the step",
            "worst as measured in ns",
        ],
        [
            [
                SOLVERS[r["solver"]],
                micro(r["step_s"]),
                r["mean_ns"],
                r["p999_ns"],
                r["worst_ns"],
                100 * r["worst_share"],
                r["worst_disturbed_ns"],
            ]
            for r in rows
        ],
    )


def history_picture(histories: list[dict[str, Any]], tolerance: float) -> Picture:
    """Step size over time, a row for each mode, events as ticks."""
    modes = list(dict.fromkeys(h["case"].mode for h in histories))
    figure = make_subplots(
        rows=len(modes),
        cols=1,
        shared_xaxes=True,
        vertical_spacing=0.05,
        subplot_titles=[MODE_WORDS[m] for m in modes],
    )
    for h in histories:
        row, step = modes.index(h["case"].mode) + 1, h["case"].step
        group = {"legendgroup": str(step), "showlegend": row == 1}
        line = {"color": STEP_COLOURS[step], "width": 1.2}
        figure.add_trace(
            go.Scatter(
                x=h["time_s"],
                y=h["length_s"] * 1e6,
                name=f"parameter step {step}",
                mode="lines",
                line=line,
                **group,
            ),
            row=row,
            col=1,
        )
        if step == 1:
            figure.add_trace(event_marks(h, row == 1), row=row, col=1)
    figure.update_yaxes(type="log", title_text="step in µs", exponentformat="power", dtick=2)
    figure.update_xaxes(range=[0, DURATION_S])
    figure.update_xaxes(title_text="time in s", row=len(modes), col=1)
    note = f"Accepted steps of the variable-step solver, tolerance {tolerance:g}; ticks above: events of parameter step 1."
    return Picture("Step size over the run", style(figure, 260 * len(modes) + 80), note)


def event_marks(h: dict[str, Any], legend: bool) -> go.Scatter:
    """When an event ended a step: ticks above the curves."""
    at = [n for n, mark in enumerate(h["mark"]) if mark != "none"]
    marker = {"color": "#30343b", "size": 9, "symbol": "line-ns-open", "line": {"width": 1.5}}
    return go.Scatter(
        x=h["time_s"][at],
        y=np.full(len(at), EVENT_TICK_US),
        name="event",
        mode="markers",
        marker=marker,
        text=[h["mark"][n] for n in at],
        legendgroup="event",
        showlegend=legend,
    )


def sweep_picture(sweep: list[dict[str, Any]]) -> Picture:
    """Speed error over the fixed step, a panel for each mode."""
    modes = list(dict.fromkeys(r["mode"] for r in sweep))
    figure = make_subplots(
        rows=len(modes),
        cols=1,
        shared_xaxes=True,
        vertical_spacing=0.05,
        subplot_titles=[MODE_WORDS[m] for m in modes],
    )
    for row, mode in enumerate(modes, 1):
        for solver, name in SOLVERS.items():
            for step in PARAMETER_STEPS:
                points = [
                    r
                    for r in sweep
                    if (r["mode"], r["solver"], r["parameter_step"]) == (mode, solver, step)
                ]
                shown = [
                    None if r["speed_error"] is None else max(100 * r["speed_error"], 1e-6)
                    for r in points
                ]
                line = {"color": COLOURS[solver], "dash": DASHES[step], "width": 1.6}
                trace = go.Scatter(
                    x=[r["step_s"] for r in points],
                    y=shown,
                    name=f"{name}, step {step}",
                    mode="lines+markers",
                    line=line,
                    marker={"size": 4},
                    legendgroup=f"{solver}{step}",
                    showlegend=row == 1,
                )
                figure.add_trace(trace, row=row, col=1)
        figure.add_hline(y=100 * LIMIT, line={"color": "#30343b", "width": 1}, row=row, col=1)
        words = {"text": "1 %", "showarrow": False, "xanchor": "right", "yanchor": "bottom"}
        figure.add_annotation(x=np.log10(0.17), y=np.log10(100 * LIMIT), **words, row=row, col=1)
        for step_s in DESIGN_STEPS_S:
            figure.add_vline(x=step_s, line={"color": "#bbb", "width": 1}, row=row, col=1)
    figure.update_yaxes(
        type="log", title_text="speed error in %", exponentformat="power", range=[-6.2, 2.5]
    )
    figure.update_xaxes(
        type="log",
        tickvals=[1e-5, 1e-4, 1e-3, 1e-2, 1e-1],
        ticktext=["10 µs", "100 µs", "1 ms", "10 ms", "100 ms"],
    )
    figure.update_xaxes(title_text="fixed step", row=len(modes), col=1)
    note = (
        "Largest difference of the speed behind the gear from the reference, as a share of the no-load speed. "
        "A line that ends: the solver diverged. Grey: 35, 40 and 70 µs."
    )
    return Picture("Speed error over the fixed step", style(figure, 290 * len(modes) + 110), note)
