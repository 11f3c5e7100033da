"""Fixed point against floating point: the same filters and controllers, compiled from one source
with integers and with floating point, stepped through the inputs of recorded runs.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from difflib import SequenceMatcher
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from vgroove.html_page import Picture, Table, style, table_from_dicts, thin
from vgroove.lockstep import Profile
from vgroove.progress import Tick
from vgroove.reference.joints import REFERENCE_JOINTS
from vgroove.reference.rigs import LOW_GEAR, reference_rig, with_load
from vgroove.result_files import Report
from vgroove.scenario import Command, Scenario, without_board_effects
from vgroove.study.replay import (
    CURRENT,
    DOUBLE,
    FIXED,
    REQUESTED,
    SPEED,
    STATE,
    AvrReplay,
    Records,
    control_records,
    filter_records,
    native_ns,
    record_ticks,
    replay,
    replay_on_avr,
)

HIGH_GEAR = "drill_driver_high"
BARE = "double_bare"  # without the range checks of the casts
MODES = ("duty", "sync", "screwing", "vibration", "torque", "drill")
IMPACT_MODES = MODES[1:5]
DRILL = MODES.index("drill")
LEAST_RATIO = 3.0  # of cycles, floating over fixed point, that the design demands
TICK_SHARE = 0.99  # of the state changes that must fall within one tick of each other
AVR_STEPS = 1500  # records of a run that the simulated AVR replays
LSB = {"current": 2.0**-9, "speed": 0.5, "duty": 2.0**-15}
COLOURS = {"fixed": "#00798c", "double": "#d1495b"}


@dataclass(frozen=True)
class StateChange:
    """A change of a controller's state: in which step of the drive, and into which state."""

    step: int
    state: int


@dataclass(frozen=True)
class RunResult:
    """One run: the recorded ticks, and the answers of both kinds to the same inputs."""

    name: str
    mode: int
    ticks: np.ndarray
    control: Records
    fixed: np.ndarray
    double: np.ndarray
    filters: Records
    filters_fixed: np.ndarray
    filters_double: np.ndarray


def mode_commands(mode: int) -> tuple[Command, ...]:
    """The command that selects a mode."""
    return (Command(0.02, "SET_MODE", {"mode_request": mode}),) if mode else ()


def impact_scenario(mode: int, joint: str, travel: float, volts: float, seed: int) -> Scenario:
    """The impact tool on a joint: run-up, impacts, release."""
    rig = with_load(reference_rig(), REFERENCE_JOINTS[joint].load, {"supply.voltage_v": volts})
    points = ((0.0, 0.0), (0.3, 0.0), (0.35, travel), (1.3, travel), (1.35, 0.0))
    return _scenario(rig, points, mode, seed, 1.5)


def drill_scenario(gear: str, load_nm: float, travel: float, volts: float, seed: int) -> Scenario:
    """The drill driver: run-up, a load at the chuck, release."""
    rig = reference_rig(gear).with_values({"supply.voltage_v": volts})
    points = ((0.0, 0.0), (0.3, 0.0), (0.5, travel), (1.8, travel), (1.85, 0.0))
    scenario = _scenario(rig, points, DRILL, seed, 2.2)
    load = ((0.0, 0.0), (1.1, 0.0), (1.15, load_nm))
    return replace(scenario, profile=replace(scenario.profile, load_nm=load))


def _scenario(
    rig: Any, points: tuple[tuple[float, float], ...], mode: int, seed: int, duration_s: float
) -> Scenario:
    return Scenario(
        rig,
        without_board_effects(rig),
        duration_s,
        Profile(travel=points),
        seed=seed,
        commands=mode_commands(mode),
        source=f"{MODES[mode]}, seed {seed}",
    )


def design_scenarios() -> Iterator[tuple[str, int, Scenario]]:
    """Name, mode and scenario of the design's runs: each controller, and the plain mode."""
    for mode in range(DRILL):
        yield f"{MODES[mode]}, hard joint", mode, impact_scenario(mode, "hard_joint", 1.0, 18.0, 1)
    for gear, load_nm in ((LOW_GEAR, 6.0), (HIGH_GEAR, 2.0), (LOW_GEAR, 40.0)):
        name = "kickback" if load_nm == 40.0 else "load"
        yield f"drill, {gear}, {name}", DRILL, drill_scenario(gear, load_nm, 1.0, 18.0, 1)


def drawn_scenarios(count: int, seed: int) -> Iterator[tuple[str, int, Scenario]]:
    """`count` drawn runs of each controller: joint, gear, load, trigger, bus voltage, noise."""
    rng = np.random.default_rng(seed)
    joints = [name for name in REFERENCE_JOINTS if name != "locked"]
    for k in range(count):
        volts, travel = rng.uniform(16.0, 20.0), rng.uniform(0.4, 1.0)
        joint, run_seed = str(rng.choice(joints)), int(rng.integers(1, 2**31))
        for mode in range(1, DRILL):
            scenario = impact_scenario(mode, joint, travel, volts, run_seed)
            yield f"{MODES[mode]}, {joint}, drawn {k}", mode, scenario
        gear, load_nm = str(rng.choice([LOW_GEAR, HIGH_GEAR])), rng.uniform(0.0, 12.0)
        scenario = drill_scenario(gear, load_nm, travel, volts, run_seed)
        yield f"drill, {gear}, drawn {k}", DRILL, scenario


def run_both(name: str, mode: int, scenario: Scenario) -> RunResult:
    """Record the inputs of a run, and compute controllers and filters from them in fixed and in
    floating point.
    """
    ticks = record_ticks(scenario)
    control, filters = control_records(ticks), filter_records(ticks)
    return RunResult(
        name,
        mode,
        ticks,
        control,
        replay(FIXED, control),
        replay(DOUBLE, control),
        filters,
        replay(FIXED, filters),
        replay(DOUBLE, filters),
    )


def changes(states: np.ndarray) -> list[StateChange]:
    """Changes of the state (n,) from step to step."""
    at = np.flatnonzero(np.diff(states)) + 1
    return [StateChange(int(k), int(states[k])) for k in at]


def unmatched_changes(fixed: np.ndarray, double: np.ndarray) -> tuple[int, list[dict[str, Any]]]:
    """Number of the fixed point's state changes (states (n,) of both), and those that the floating
    point makes more than one tick apart or not at all; its own further changes are listed too.
    """
    a, b = changes(fixed), changes(double)
    matcher = SequenceMatcher(None, [c.state for c in a], [c.state for c in b], autojunk=False)
    partner: dict[int, int] = {}
    for block in matcher.get_matching_blocks():
        partner |= {block.a + k: block.b + k for k in range(block.size)}
    rest = []
    for k, change in enumerate(a):
        other = b[partner[k]].step if k in partner else None
        if other is None or abs(other - change.step) > 1:
            rest.append({"step": change.step, "state": change.state, "double_step": other})
    for k in sorted(set(range(len(b))) - set(partner.values())):
        rest.append({"step": None, "state": b[k].state, "double_step": b[k].step})
    return len(a), rest


def error_row(run: RunResult) -> dict[str, Any]:
    """Errors of one run in LSB (rms and largest), and its state changes."""
    row: dict[str, Any] = {"run": run.name, "steps": len(run.fixed)}
    both = (run.fixed[:, REQUESTED] >= 0) & (run.double[:, REQUESTED] >= 0)  # neither has ended
    pairs = {
        "current": (run.filters_fixed[:, CURRENT], run.filters_double[:, CURRENT]),
        "speed": (run.filters_fixed[:, SPEED], run.filters_double[:, SPEED]),
        "duty": (run.fixed[both, REQUESTED], run.double[both, REQUESTED]),
    }
    for name, (fixed, double) in pairs.items():
        error = double - fixed
        row[f"{name}_rms"] = float(np.sqrt(np.mean(error**2)))
        row[f"{name}_worst"] = float(np.max(np.abs(error), initial=0.0))
    count, rest = unmatched_changes(run.fixed[:, STATE], run.double[:, STATE])
    row |= {"changes": count, "apart": len(rest), "apart_list": rest}
    return row


def cost_row(name: str, records: Records, repeats: int) -> dict[str, Any]:
    """Native time and AVR cycles of a step, for all kinds."""
    native = {kind: native_ns(kind, records, repeats) for kind in (FIXED, DOUBLE)}
    first = Records(records.parts[:AVR_STEPS])
    avr = {kind: replay_on_avr(kind, first) for kind in (FIXED, BARE, DOUBLE)}
    return {
        "step": name,
        "native_fixed_ns": native[FIXED],
        "native_double_ns": native[DOUBLE],
        **{f"{kind}_mean": found.mean_cycles for kind, found in avr.items()},
        **{f"{kind}_worst": found.worst_cycles for kind, found in avr.items()},
        "ratio": avr[BARE].mean_cycles / avr[FIXED].mean_cycles,
        "avr_equals_host": _equal_on_host(avr[FIXED], first),
    }


def _equal_on_host(avr: AvrReplay, records: Records) -> bool:
    """Whether the fixed point has the same answers on the AVR and on this computer."""
    host = replay(FIXED, records)
    known = ~np.isnan(avr.answers)
    return bool((host[known] == avr.answers[known]).all())


def fixed_point_study(draws: int, seed: int, repeats: int, tick: Tick) -> Report:
    """The study; `tick` is called once a run and once a cost row."""
    design, rows = [], []
    for name, mode, scenario in design_scenarios():
        design.append(run_both(name, mode, scenario))
        rows.append(error_row(design[-1]))
        tick(name)
    drawn = []
    for name, mode, scenario in drawn_scenarios(draws, seed):
        drawn.append(error_row(run_both(name, mode, scenario)))
        tick(name)
    costs = []
    for run in _one_a_mode(design):
        costs.append(cost_row(f"controller {MODES[run.mode]}", run.control, repeats))
        tick(run.name)
    costs.append(cost_row("filters (current, Hall speed)", design[1].filters, repeats))
    tick("filters")
    return _report(design, rows, drawn, costs)


def study_ticks(draws: int) -> int:
    """Number of calls of `tick`."""
    return len(list(design_scenarios())) + 5 * draws + len(MODES)


def _one_a_mode(runs: Sequence[RunResult]) -> list[RunResult]:
    """The first run of each controller."""
    return list({run.mode: run for run in reversed(runs) if run.mode}.values())[::-1]


def _report(
    design: list[RunResult],
    rows: list[dict[str, Any]],
    drawn: list[dict[str, Any]],
    costs: list[dict[str, Any]],
) -> Report:
    every = [*rows, *drawn]
    total, apart = sum(r["changes"] for r in every), sum(r["apart"] for r in every)
    data = {
        "design": rows,
        "drawn": drawn,
        "costs": costs,
        "changes": total,
        "changes_apart": apart,
        "within_share": 1.0 - apart / total if total else 1.0,
        "least_ratio": min(row["ratio"] for row in costs),
    }
    lines = study_lines(data, every)
    tables = [error_table("design", rows), cost_table(costs)]
    tables += [error_table("drawn", drawn)] if drawn else []
    title = "Fixed point against floating point of the same source"
    return Report("fixed_point", title, lines, tables, [trace_picture(design[1])], data)


def study_lines(data: dict[str, Any], rows: Sequence[dict[str, Any]]) -> list[str]:
    """The findings in sentences."""
    worst = {name: max(row[f"{name}_worst"] for row in rows) for name in LSB}
    lines = [
        f"Largest error of the current {worst['current']:.2f} LSB of 1.95 mA, of the speed "
        f"{worst['speed']:.2f} LSB of 0.5 rpm, of the controllers' duty {worst['duty']:.1f} LSB of "
        f"2^-15 ({100 * worst['duty'] * LSB['duty']:.2f} % of full duty).",
        f"{data['changes'] - data['changes_apart']} of {data['changes']} state changes fall within "
        f"one tick of each other ({100 * data['within_share']:.2f} %; {100 * TICK_SHARE:g} % are "
        "demanded).",
        f"On the AVR fixed point needs at least {data['least_ratio']:.1f} times fewer cycles a step"
        f" than floating point without range checks ({LEAST_RATIO:g} are demanded). double of "
        "avr-gcc 5.4 is single precision (32 bits); on this computer it has 64 bits.",
    ]
    rest = [(row["run"], one) for row in rows for one in row["apart_list"]]
    for name, one in rest[:20]:
        lines.append(
            f"apart: {name}: state {one['state']} at step {one['step']}, floating point at "
            f"{one['double_step']}."
        )
    return lines


def error_table(name: str, rows: list[dict[str, Any]]) -> Table:
    """Errors of runs in LSB."""
    columns = [("run", "run"), ("steps", "steps")]
    columns += [
        (f"{signal} {kind} in LSB", f"{signal}_{key}")
        for signal in LSB
        for kind, key in (("rms", "rms"), ("largest", "worst"))
    ]
    columns += [("state changes", "changes"), ("more than a tick apart", "apart")]
    return table_from_dicts(name, f"Errors of fixed point, {name} runs", columns, rows)


def cost_table(rows: list[dict[str, Any]]) -> Table:
    """Time and cycles of a step."""
    columns = [
        ("step", "step"),
        ("fixed in ns", "native_fixed_ns"),
        ("double in ns", "native_double_ns"),
        ("fixed, mean cycles", f"{FIXED}_mean"),
        ("worst", f"{FIXED}_worst"),
        ("float without range checks, mean", f"{BARE}_mean"),
        ("worst ", f"{BARE}_worst"),
        ("float, mean", f"{DOUBLE}_mean"),
        ("worst  ", f"{DOUBLE}_worst"),
        ("ratio of cycles", "ratio"),
    ]
    title = "Time of a step on this computer, cycles on the simulated ATmega2560"
    return table_from_dicts("costs", title, columns, rows)


def trace_picture(run: RunResult) -> Picture:
    """Current, speed and duty of a run with both kinds, and their differences."""
    panels = (
        ("current in A", LSB["current"], run.filters_fixed, run.filters_double, CURRENT),
        ("speed in rpm", LSB["speed"], run.filters_fixed, run.filters_double, SPEED),
        ("duty of the controller", LSB["duty"], run.fixed, run.double, REQUESTED),
    )
    titles = [text for label, *_ in panels for text in (label, "error in LSB")]
    figure = make_subplots(rows=6, cols=1, vertical_spacing=0.05, subplot_titles=titles)
    for row, (_, lsb, fixed, double, column) in enumerate(panels):
        a, b = fixed[:, column], double[:, column]
        time, *curves = thin(np.arange(len(a)) * 1e-3, a * lsb, b * lsb, b - a)
        for name, values in zip((*COLOURS, "error"), curves, strict=True):
            at = 2 * row + (2 if name == "error" else 1)
            line = {"color": COLOURS.get(name, "#555"), "width": 1}
            trace = go.Scatter(x=time, y=values, name=name, line=line, showlegend=row == 0)
            figure.add_trace(trace, row=at, col=1)
    figure.update_xaxes(title_text="time in s (duty: of the drive)", row=6)
    note = "Both kinds get the inputs of the recorded run, which fixed point has controlled."
    return Picture(f"Traces: {run.name}", style(figure, 1300), note)
