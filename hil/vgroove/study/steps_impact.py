"""The impact tool's part of `vgroove study steps`: step size of the variable-step solver over the
cycle, and what shrinks it.
"""

from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from vgroove import _core
from vgroove.page import Picture, Table, style
from vgroove.rig import Rig
from vgroove.study.command import Tick
from vgroove.study.impact_runs import JOINT_WORDS, JOINTS, hits_between, simulate, with_joint
from vgroove.study.report import Study
from vgroove.study.steps import event_rows, event_summary, micro

LOADS = ("locked", "slip_60", "hard_joint")
DURATION_S, FROM_S = 0.8, 0.5
COLOURS = {"locked": "#30343b", "slip_60": "#d1495b", "hard_joint": "#00798c"}
TRACE_STEP_S = 2e-5
STEP_FLOOR_US = 0.1  # what is shorter is drawn here


def impact_history(rig: Rig, load: str, tolerance: float) -> dict[str, Any]:
    """Step history of one joint from FROM_S on, and its last cycle; rows as long as the run: only
    accuracy and events set the step.
    """
    tool = with_joint(rig, JOINTS[load])
    time_s = np.arange(FROM_S, DURATION_S, TRACE_STEP_S)
    run = simulate(
        [tool], DURATION_S, 1.0, row_s=DURATION_S, history=True, tolerance=tolerance, trace_s=time_s
    )
    late = run["history"][run["history"]["time_s"] >= FROM_S]
    marks = ["none" if n < 0 else _core.IMPACT_EVENTS[n] for n in late["event"]]
    blows = hits_between(run["blows"][0], FROM_S, DURATION_S)
    first = blows["time_s"][blows["kind"] == 0]
    return {
        "load": load,
        "time_s": late["time_s"].copy(),
        "length_s": late["step_s"].copy(),
        "mark": marks,
        "cycle": (first[-2], first[-1]),
        "trace_s": time_s,
        "hammer_mm": 1e3 * run["trace"]["hammer_m"],
        "rejected": int(run["statistics"][0]["rejected"]),
    }


def impact_steps(rig: Rig, tolerance: float, tick: Tick) -> Study:
    """Histories of the three joints; ticks once each."""
    histories = []
    for load in LOADS:
        histories.append(impact_history(rig, load, tolerance))
        tick(f"impact cycle: {JOINT_WORDS[load]}")
    events = [
        {"load": h["load"], **row}
        for h in histories
        for row in event_summary(event_rows(h["time_s"], h["length_s"], h["mark"]))
    ]
    cycles = [cycle_row(h) for h in histories]
    tables = [cycle_table(cycles), impact_event_table(events)]
    data = {
        "rig": rig.name,
        "tolerance": tolerance,
        "from_s": FROM_S,
        "duration_s": DURATION_S,
        "cycles": cycles,
        "events": events,
    }
    return Study(
        "steps",
        "Step sizes over the impact cycle",
        [impact_line(events)],
        tables,
        [cycle_steps_picture(histories, tolerance)],
        {"impact": data},
    )


def impact_line(events: list[dict[str, Any]]) -> str:
    """The event that shrinks the step most, in a sentence."""
    worst = min(events, key=lambda r: r["smallest_after_s"])
    return (
        f"Over the impact cycle the step falls most after '{worst['event']}' ({JOINT_WORDS[worst['load']]}): "
        f"from {worst['before_s'] * 1e6:.3g} us to {worst['smallest_after_s'] * 1e6:.3g} us."
    )


def cycle_row(h: dict[str, Any]) -> dict[str, Any]:
    """Steps of the last whole cycle."""
    start, end = h["cycle"]
    inside = (h["time_s"] > start) & (h["time_s"] <= end)
    length = h["length_s"][inside]
    chosen = h["length_s"][inside & (np.array(h["mark"]) == "none")]  # not cut short by an event
    return {
        "load": h["load"],
        "period_ms": 1e3 * (end - start),
        "steps": len(length),
        "smallest_s": float(chosen.min()),
        "median_s": float(np.median(length)),
        "largest_s": float(length.max()),
    }


def cycle_table(rows: list[dict[str, Any]]) -> Table:
    """Steps in a cycle per joint."""
    return Table(
        "cycle",
        "Variable step over one impact cycle",
        ["joint", "cycle in ms", "steps", "smallest in us", "median in us", "largest in us"],
        [
            [
                JOINT_WORDS[r["load"]],
                r["period_ms"],
                r["steps"],
                *(micro(r[k]) for k in ("smallest_s", "median_s", "largest_s")),
            ]
            for r in rows
        ],
    )


def impact_event_table(rows: list[dict[str, Any]]) -> Table:
    """Events of the cycle and the recovery after each."""
    return Table(
        "impact_events",
        "Events of the impact cycle, and the time until half of the step before is reached again (medians)",
        ["joint", "event", "count", "step before in us", "smallest after in us", "recovery in ms"],
        [
            [
                JOINT_WORDS[r["load"]],
                r["event"],
                r["count"],
                micro(r["before_s"]),
                micro(r["smallest_after_s"]),
                None if r["recovery_s"] is None else 1e3 * r["recovery_s"],
            ]
            for r in rows
        ],
    )


def cycle_steps_picture(histories: list[dict[str, Any]], tolerance: float) -> Picture:
    """Step size and hammer displacement over one cycle; events as marks with their names."""
    figure = make_subplots(
        rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.05, row_heights=[0.7, 0.3]
    )
    for h in histories:
        start, end = h["cycle"]
        at = np.flatnonzero((h["time_s"] >= start - 1e-3) & (h["time_s"] <= end + 1e-3))
        time_ms, step_us = 1e3 * (h["time_s"][at] - start), 1e6 * h["length_s"][at]
        line = {"color": COLOURS[h["load"]], "width": 1.4}
        name = JOINT_WORDS[h["load"]]
        marked = [n for n, k in enumerate(at) if h["mark"][k] != "none"]
        chosen = np.setdiff1d(np.arange(len(at)), marked)
        curve = go.Scatter(
            x=time_ms[chosen],
            y=step_us[chosen],
            name=name,
            legendgroup=name,
            mode="lines",
            line=line,
        )
        figure.add_trace(curve, row=1, col=1)
        marker = {"color": COLOURS[h["load"]], "size": 6, "symbol": "circle-open"}
        figure.add_trace(
            go.Scatter(
                x=time_ms[marked],
                y=np.maximum(step_us[marked], STEP_FLOOR_US),
                mode="markers",
                marker=marker,
                text=[h["mark"][at[n]] for n in marked],
                name=f"{name}: event",
                legendgroup=name,
                showlegend=False,
            ),
            row=1,
            col=1,
        )
        shown = (h["trace_s"] >= start - 1e-3) & (h["trace_s"] <= end + 1e-3)
        figure.add_trace(
            go.Scatter(
                x=1e3 * (h["trace_s"][shown] - start),
                y=h["hammer_mm"][shown],
                mode="lines",
                line=line,
                legendgroup=name,
                showlegend=False,
            ),
            row=2,
            col=1,
        )
    look = {"type": "log", "exponentformat": "power", "dtick": 1}
    figure.update_yaxes(
        title_text="step in µs", **look, range=[np.log10(STEP_FLOOR_US) - 0.2, 3], row=1, col=1
    )
    figure.update_yaxes(title_text="hammer in mm", row=2, col=1)
    figure.update_xaxes(title_text="time from the blow in ms", row=2, col=1)
    note = (
        f"Steps that the solver chose, tolerance {tolerance:g}; circles: steps that an event cut short, at {STEP_FLOOR_US:g} µs where they "
        "are shorter still."
    )
    return Picture("Step size over the impact cycle", style(figure, 640), note)
