"""Tables and figures of the drill driver's part of `vgroove study steps`."""

from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from vgroove.html_page import Picture, Table, style
from vgroove.result_files import Report
from vgroove.study.drill import DURATION_S, GRID_S, MODES, PARAMETER_STEPS, SOLVERS
from vgroove.study.step_events import (
    EVENT_HEADER,
    NO_EVENT,
    STEP_HEADER,
    event_cells,
    in_micro,
    step_cells,
)
from vgroove.study.steps import DESIGN_STEPS_S, MAX_SPEED_ERROR, DrillSteps

EVENT_TICK_US = 3e5  # where events are marked: above every step
LEAST_PERCENT = 1e-6  # a smaller error is drawn here, since the axis is logarithmic
SOLVER_COLOURS = {"euler": "#d1495b", "rk4": "#edae49", "real_time": "#00798c"}
STEP_COLOURS = {1: "#d1495b", 2: "#edae49", 3: "#00798c"}
STEP_DASHES = {1: "solid", 2: "dash", 3: "dot"}


def drill_report(found: DrillSteps) -> Report:
    """The drill driver's part as a report."""
    data = found.data
    return Report(
        "steps",
        "Step sizes of the drill driver",
        drill_lines(data["largest"], data["execution"]),
        [
            variable_table(data["variable"]),
            event_table(data["events"]),
            fixed_table(data["sweep"]),
            largest_table(data["largest"]),
            execution_table(data["execution"]),
        ],
        [history_picture(found.histories, data["tolerance"]), sweep_picture(data["sweep"])],
        {"drill": data},
    )


def drill_lines(largest: list[dict[str, Any]], timing: list[dict[str, Any]]) -> list[str]:
    """The findings in sentences."""
    lines = []
    for solver, name in SOLVERS.items():
        rows = [row for row in largest if row["solver"] == solver and row["mode"] == "pulse"]
        found = ", ".join(
            f"{step_text(row['speed_s'])} in parameter step {row['parameter_step']}" for row in rows
        )
        lines.append(f"Largest step under 1 % speed error in pulse mode, {name}: {found}.")
    worst = max(
        (row for row in timing if row["solver"] == "real_time"), key=lambda r: r["worst_ns"]
    )
    lines.append(
        f"In real time a step of {worst['step_s'] * 1e6:g} us takes at most "
        f"{worst['worst_ns'] / 1e3:.1f} us on this machine."
    )
    return lines


def step_text(step_s: float | None) -> str:
    """A step of the sweep with its unit."""
    if step_s is None:
        return "none of the sweep"
    return f"{step_s * 1e6:g} us" if step_s < 1e-3 else f"{step_s * 1e3:g} ms"


def variable_table(rows: list[dict[str, Any]]) -> Table:
    """Steps of the variable-step solver for each mode and parameter step."""
    keys = ("mode", "parameter_step", "steps", "rejected")
    return Table(
        "variable",
        "Variable-step solver (RODAS 4(3), events located)",
        ["mode", "param. step", "steps", "rejected", *STEP_HEADER],
        [[*(r[key] for key in keys), *step_cells(r)] for r in rows],
    )


def event_table(rows: list[dict[str, Any]]) -> Table:
    """Events that shrink the step, and the recovery."""
    return Table(
        "events",
        "Events that shrink the step, and the time until half of the step before is reached again "
        "(medians)",
        ["mode", "param. step", *EVENT_HEADER],
        [[r["mode"], r["parameter_step"], *event_cells(r)] for r in rows],
    )


def fixed_table(sweep: list[dict[str, Any]]) -> Table:
    """Errors of DESIGN_STEPS_S against the reference."""
    wanted = {round(step / GRID_S) for step in DESIGN_STEPS_S}
    rows = sorted(
        (r for r in sweep if round(r["step_s"] / GRID_S) in wanted),
        key=lambda r: (r["mode"], r["parameter_step"], -r["step_s"]),
    )
    keys = list(dict.fromkeys((r["mode"], r["parameter_step"], r["step_s"]) for r in rows))
    by = {(r["mode"], r["parameter_step"], r["step_s"], r["solver"]): r for r in rows}
    errors = [(solver, key) for solver in SOLVERS for key in ("speed_error", "chuck_error")]
    cells = [
        [m, p, in_micro(s), *(error_cell(by[m, p, s, solver][key]) for solver, key in errors)]
        for m, p, s in keys
    ]
    header = [f"{name}: {what} in %" for name in SOLVERS.values() for what in ("speed", "chuck")]
    return Table(
        "fixed",
        "Fixed steps of 70, 40 and 35 us: largest difference from the reference, of the no-load "
        "speed",
        ["mode", "param. step", "step in us", *header],
        cells,
    )


def error_cell(error: float | None) -> float | str:
    """A speed error in %."""
    return "diverges" if error is None else 100 * error


def largest_table(rows: list[dict[str, Any]]) -> Table:
    """Largest step below the accepted error."""
    limits = ["behind the gear in us", "at the chuck in us", "stability limit in us"]
    keys = ("speed_s", "chuck_s", "stability_limit_s")
    return Table(
        "largest",
        "Largest step of the sweep (10 us to 100 ms) under 1 % speed error",
        ["mode", "param. step", "solver", *limits],
        [
            [r["mode"], r["parameter_step"], SOLVERS[r["solver"]], *(in_micro(r[k]) for k in keys)]
            for r in rows
        ],
    )


def execution_table(rows: list[dict[str, Any]]) -> Table:
    """Execution time per step."""
    return Table(
        "execution",
        "Execution time per step, pulse mode, parameter step 1: least of the repeats; last column "
        "with the interruptions of the operating system",
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
                in_micro(r["step_s"]),
                r["mean_ns"],
                r["p999_ns"],
                r["worst_ns"],
                100 * r["worst_share"],
                r["worst_disturbed_ns"],
            ]
            for r in rows
        ],
    )


def mode_panels(modes: list[str]) -> go.Figure:
    """A figure with a panel for each mode, the time or step axis in common."""
    return make_subplots(
        rows=len(modes),
        cols=1,
        shared_xaxes=True,
        vertical_spacing=0.05,
        subplot_titles=[MODES[m].title for m in modes],
    )


def history_picture(histories: list[dict[str, Any]], tolerance: float) -> Picture:
    """Step size over time, a panel for each mode; events are ticks above the curves."""
    modes = list(dict.fromkeys(h["case"].mode for h in histories))
    figure = mode_panels(modes)
    for h in histories:
        row, step = modes.index(h["case"].mode) + 1, h["case"].parameter_step
        curve = go.Scatter(
            x=h["time_s"],
            y=h["length_s"] * 1e6,
            name=f"parameter step {step}",
            mode="lines",
            line={"color": STEP_COLOURS[step], "width": 1.2},
            legendgroup=str(step),
            showlegend=row == 1,
        )
        figure.add_trace(curve, row=row, col=1)
        if step == 1:
            figure.add_trace(event_marks(h, row == 1), row=row, col=1)
    figure.update_yaxes(type="log", title_text="step in µs", exponentformat="power", dtick=2)
    figure.update_xaxes(range=[0, DURATION_S])
    figure.update_xaxes(title_text="time in s", row=len(modes), col=1)
    note = (
        f"Accepted steps of the variable-step solver, tolerance {tolerance:g}; ticks above: events "
        "of parameter step 1."
    )
    return Picture("Step size over the run", style(figure, 260 * len(modes) + 80), note)


def event_marks(h: dict[str, Any], legend: bool) -> go.Scatter:
    """Ticks at the times at which an event ended a step."""
    at = [n for n, mark in enumerate(h["mark"]) if mark != NO_EVENT]
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
    figure = mode_panels(modes)
    for row, mode in enumerate(modes, 1):
        here = [r for r in sweep if r["mode"] == mode]
        for solver in SOLVERS:
            for step in PARAMETER_STEPS:
                curve = error_curve(here, solver, step)
                figure.add_trace(curve.update(showlegend=row == 1), row=row, col=1)
        add_limits(figure, row)
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
        "Largest difference of the speed behind the gear from the reference, as a share of the "
        "no-load speed. A line that ends: the solver diverged. Grey: 35, 40 and 70 µs."
    )
    return Picture("Speed error over the fixed step", style(figure, 290 * len(modes) + 110), note)


def error_curve(rows: list[dict[str, Any]], solver: str, step: int) -> go.Scatter:
    """Speed error in % of one solver and parameter step over the fixed step."""
    points = [r for r in rows if (r["solver"], r["parameter_step"]) == (solver, step)]
    errors = [r["speed_error"] for r in points]
    return go.Scatter(
        x=[r["step_s"] for r in points],
        y=[None if e is None else max(100 * e, LEAST_PERCENT) for e in errors],
        name=f"{SOLVERS[solver]}, step {step}",
        mode="lines+markers",
        line={"color": SOLVER_COLOURS[solver], "dash": STEP_DASHES[step], "width": 1.6},
        marker={"size": 4},
        legendgroup=f"{solver}{step}",
    )


def add_limits(figure: go.Figure, row: int) -> None:
    """The accepted error and DESIGN_STEPS_S as lines across one panel."""
    limit = 100 * MAX_SPEED_ERROR
    figure.add_hline(y=limit, line={"color": "#30343b", "width": 1}, row=row, col=1)
    text = {"text": "1 %", "showarrow": False, "xanchor": "right", "yanchor": "bottom"}
    figure.add_annotation(x=np.log10(0.17), y=np.log10(limit), **text, row=row, col=1)
    for step_s in DESIGN_STEPS_S:
        figure.add_vline(x=step_s, line={"color": "#bbb", "width": 1}, row=row, col=1)
