"""The impact tool's part of `vgroove study steps`: step size of the variable-step solver over the
impact cycle, and the events that shrink it.
"""

from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from vgroove import _core
from vgroove.html_page import Picture, Table, style
from vgroove.progress import Tick
from vgroove.reference.joints import REFERENCE_JOINTS
from vgroove.result_files import Report
from vgroove.rig import Rig
from vgroove.study.impact_runs import last_cycle, simulate, with_joint
from vgroove.study.step_events import (
    EVENT_HEADER,
    NO_EVENT,
    STEP_HEADER,
    event_cells,
    event_rows,
    event_summary,
    step_cells,
    step_figures,
)

JOINT_COLOURS = {"locked": "#30343b", "slip_60": "#d1495b", "hard_joint": "#00798c"}
DURATION_S, FROM_S = 0.8, 0.5  # of the run; start of the evaluated part, after the run-up
TRACE_STEP_S = 2e-5
MARGIN_S = 1e-3  # drawn before and after the cycle
STEP_FLOOR_US = 0.1  # shorter steps are drawn here


def impact_history(rig: Rig, joint: str, tolerance: float) -> dict[str, Any]:
    """Step history of one joint from FROM_S on, and its last cycle.

    The only row of the run is its end, so that accuracy and events alone set the step.
    """
    tool = with_joint(rig, joint)
    time_s = np.arange(FROM_S, DURATION_S, TRACE_STEP_S)
    run = simulate(
        [tool], DURATION_S, 1.0, row_s=DURATION_S, history=True, tolerance=tolerance, trace_s=time_s
    )
    late = run["history"][run["history"]["time_s"] >= FROM_S]
    return {
        "load": joint,
        "time_s": late["time_s"].copy(),
        "length_s": late["step_s"].copy(),
        "mark": [NO_EVENT if n < 0 else _core.IMPACT_EVENTS[n] for n in late["event"]],
        "cycle": last_cycle(tool, run["blows"][0], FROM_S, DURATION_S, 1.0),
        "trace_s": time_s,
        "hammer_mm": 1e3 * run["trace"]["hammer_m"],
        "rejected": int(run["statistics"][0]["rejected"]),
    }


def impact_steps(rig: Rig, tolerance: float, tick: Tick) -> Report:
    """Histories of the joints of JOINT_COLOURS; `tick` is called once a joint."""
    histories = []
    for joint in JOINT_COLOURS:
        histories.append(impact_history(rig, joint, tolerance))
        tick(f"impact cycle: {REFERENCE_JOINTS[joint].title}")
    events = [
        {"load": h["load"], **row}
        for h in histories
        for row in event_summary(event_rows(h["time_s"], h["length_s"], h["mark"]))
    ]
    cycles = [cycle_row(h) for h in histories]
    data = {
        "rig": rig.name,
        "tolerance": tolerance,
        "from_s": FROM_S,
        "duration_s": DURATION_S,
        "cycles": cycles,
        "events": events,
    }
    return Report(
        "steps",
        "Step sizes over the impact cycle",
        [impact_line(events)],
        [cycle_table(cycles), impact_event_table(events)],
        [cycle_steps_picture(histories, tolerance)],
        {"impact": data},
    )


def impact_line(events: list[dict[str, Any]]) -> str:
    """A sentence on the event that shrinks the step most."""
    worst = min(events, key=lambda r: r["smallest_after_s"])
    return (
        f"Over the impact cycle the step falls most after '{worst['event']}' "
        f"({REFERENCE_JOINTS[worst['load']].title}): from {worst['before_s'] * 1e6:.3g} us to "
        f"{worst['smallest_after_s'] * 1e6:.3g} us."
    )


def cycle_row(h: dict[str, Any]) -> dict[str, Any]:
    """Steps of the last whole cycle."""
    start, end = h["cycle"]
    inside = (h["time_s"] > start) & (h["time_s"] <= end)
    marks = np.array(h["mark"])[inside]
    figures = step_figures(h["length_s"][inside], list(marks))
    return {"load": h["load"], "period_ms": 1e3 * (end - start)} | figures


def cycle_table(rows: list[dict[str, Any]]) -> Table:
    """Steps in a cycle of each joint."""
    return Table(
        "cycle",
        "Variable step over one impact cycle",
        ["joint", "cycle in ms", "steps", *STEP_HEADER],
        [
            [REFERENCE_JOINTS[r["load"]].title, r["period_ms"], r["steps"], *step_cells(r)]
            for r in rows
        ],
    )


def impact_event_table(rows: list[dict[str, Any]]) -> Table:
    """Events of the cycle and the recovery after each."""
    return Table(
        "impact_events",
        "Events of the impact cycle, and the time until half of the step before is reached again "
        "(medians)",
        ["joint", *EVENT_HEADER],
        [[REFERENCE_JOINTS[r["load"]].title, *event_cells(r)] for r in rows],
    )


def cycle_steps_picture(histories: list[dict[str, Any]], tolerance: float) -> Picture:
    """Step size and hammer displacement over one cycle; events are marks with their names."""
    figure = make_subplots(
        rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.05, row_heights=[0.7, 0.3]
    )
    for h in histories:
        for trace in step_traces(h):
            figure.add_trace(trace, row=1, col=1)
        figure.add_trace(hammer_trace(h), row=2, col=1)
    look = {"type": "log", "exponentformat": "power", "dtick": 1}
    figure.update_yaxes(
        title_text="step in µs", **look, range=[np.log10(STEP_FLOOR_US) - 0.2, 3], row=1, col=1
    )
    figure.update_yaxes(title_text="hammer in mm", row=2, col=1)
    figure.update_xaxes(title_text="time from the blow in ms", row=2, col=1)
    note = (
        f"Steps that the solver chose, tolerance {tolerance:g}; circles: steps that an event cut "
        f"short, at {STEP_FLOOR_US:g} µs where they are shorter."
    )
    return Picture("Step size over the impact cycle", style(figure, 640), note)


def step_traces(h: dict[str, Any]) -> tuple[go.Scatter, go.Scatter]:
    """Step size over the last cycle: the steps that the solver chose, and those cut by events."""
    start, end = h["cycle"]
    at = np.flatnonzero((h["time_s"] >= start - MARGIN_S) & (h["time_s"] <= end + MARGIN_S))
    time_ms, step_us = 1e3 * (h["time_s"][at] - start), 1e6 * h["length_s"][at]
    name, colour = REFERENCE_JOINTS[h["load"]].title, JOINT_COLOURS[h["load"]]
    marked = [n for n, k in enumerate(at) if h["mark"][k] != NO_EVENT]
    chosen = np.setdiff1d(np.arange(len(at)), marked)
    curve = go.Scatter(
        x=time_ms[chosen],
        y=step_us[chosen],
        name=name,
        legendgroup=name,
        mode="lines",
        line={"color": colour, "width": 1.4},
    )
    events = go.Scatter(
        x=time_ms[marked],
        y=np.maximum(step_us[marked], STEP_FLOOR_US),
        mode="markers",
        marker={"color": colour, "size": 6, "symbol": "circle-open"},
        text=[h["mark"][at[n]] for n in marked],
        name=f"{name}: event",
        legendgroup=name,
        showlegend=False,
    )
    return curve, events


def hammer_trace(h: dict[str, Any]) -> go.Scatter:
    """Hammer displacement over the last cycle."""
    start, end = h["cycle"]
    shown = (h["trace_s"] >= start - MARGIN_S) & (h["trace_s"] <= end + MARGIN_S)
    return go.Scatter(
        x=1e3 * (h["trace_s"][shown] - start),
        y=h["hammer_mm"][shown],
        mode="lines",
        line={"color": JOINT_COLOURS[h["load"]], "width": 1.4},
        legendgroup=REFERENCE_JOINTS[h["load"]].title,
        showlegend=False,
    )
