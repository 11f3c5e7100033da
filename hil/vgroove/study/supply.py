"""`vgroove study supply`: what the supply voltage does to rate, current, torque and synchronism of
the impact tool, on several joints.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from vgroove.page import Picture, Table, style
from vgroove.rig import Rig
from vgroove.study.command import Tick
from vgroove.study.impact_runs import (
    JOINT_SHORT,
    JOINT_WORDS,
    JOINTS,
    blow_figures,
    simulate,
    with_joint,
)
from vgroove.study.report import Study

LOADS = ("locked", "slip_60", "hard_joint", "slip_6", "m8")
COLOURS = dict(zip(LOADS, ("#30343b", "#d1495b", "#edae49", "#00798c", "#66a182"), strict=True))
SETTLE_S = 0.5
PANELS = (
    ("blows_per_min", "blows per minute"),
    ("current_a", "motor current in A"),
    ("torque_peak_nm", "peak torque in N m"),
    ("synchronism", "clean blows in %"),
)


def supply_voltages(low_v: float, high_v: float, step_v: float) -> np.ndarray:
    """From low to high, both among them."""
    return np.round(np.linspace(low_v, high_v, max(2, round((high_v - low_v) / step_v) + 1)), 6)


def supply_rows(
    rig: Rig, load: str, voltages: Sequence[float], duration_s: float, duty: float
) -> list[dict[str, Any]]:
    """Figures of one joint at every voltage, from SETTLE_S to the end of the run."""
    rigs = [with_joint(rig, JOINTS[load], {"supply.voltage_v": float(volts)}) for volts in voltages]
    rows = simulate(rigs, duration_s, duty)
    height = rig.mechanism["lug_height_m"]
    return [
        {"load": load, "supply_v": float(volts), **blow_figures(rows, n, SETTLE_S, height)}
        for n, volts in enumerate(voltages)
    ]


def supply_study(
    rig: Rig, voltages: np.ndarray, duration_s: float, duty: float, tick: Tick
) -> Study:
    """All joints at all voltages; ticks once a joint."""
    found: list[dict[str, Any]] = []
    for load in LOADS:
        found += supply_rows(rig, load, voltages, duration_s, duty)
        tick(JOINT_WORDS[load])
    data = {
        "rig": rig.name,
        "duty": duty,
        "duration_s": duration_s,
        "from_s": SETTLE_S,
        "rows": found,
    }
    title = f"Influence of the supply voltage, {rig.name or 'impact driver'}, duty {100 * duty:g} %"
    return Study(
        "supply", title, supply_lines(found), [supply_table(found)], [supply_picture(found)], data
    )


def supply_lines(found: list[dict[str, Any]]) -> list[str]:
    """What was found on each joint, in a sentence."""
    lines = []
    for load in LOADS:
        rows = [r for r in found if r["load"] == load and r["blows_per_min"]]
        if not rows:
            lines.append(f"{JOINT_WORDS[load]}: no impacts at any voltage.")
            continue
        best = max(rows, key=lambda r: r["blows_per_min"])
        clean = [f"{r['supply_v']:g}" for r in rows if r["synchronism"] >= 0.9]
        words = f"nine tenths of the blows are clean at {len(clean)} of {len(rows)} voltages" + (
            f" ({clean[0]} to {clean[-1]} V)" if clean else ""
        )
        lines.append(
            f"{JOINT_WORDS[load]}: at most {best['blows_per_min']:.0f} blows per minute, at {best['supply_v']:g} V; {words}."
        )
    return lines


def supply_table(found: list[dict[str, Any]]) -> Table:
    """Every figure of every run."""
    header = [
        "load",
        "supply in V",
        "blows/min",
        "spread in %",
        "current in A",
        "peak torque in N m",
        "engaged in %",
        "clean in %",
        "hammer in mm",
        "deg per blow",
    ]
    keys = (
        "blows_per_min",
        "period_spread_percent",
        "current_a",
        "torque_peak_nm",
        "engaged_percent",
    )
    rows = [
        [
            JOINT_SHORT[r["load"]],
            r["supply_v"],
            *(r[k] for k in keys),
            percent(r["synchronism"]),
            r["hammer_max_mm"],
            r["angle_per_blow_deg"],
        ]
        for r in found
    ]
    return Table("runs", "Impacts over the supply voltage", header, rows)


def percent(share: float | None) -> float | None:
    """A share as percent."""
    return None if share is None else 100.0 * share


def supply_picture(found: list[dict[str, Any]]) -> Picture:
    """Four panels over the voltage, a line for each joint."""
    figure = make_subplots(
        rows=2, cols=2, shared_xaxes=True, vertical_spacing=0.08, horizontal_spacing=0.1
    )
    for panel, (key, words) in enumerate(PANELS):
        at = {"row": panel // 2 + 1, "col": panel % 2 + 1}
        for load in LOADS:
            rows = [r for r in found if r["load"] == load]
            values = [percent(r[key]) if key == "synchronism" else r[key] for r in rows]
            figure.add_trace(
                go.Scatter(
                    x=[r["supply_v"] for r in rows],
                    y=values,
                    name=JOINT_WORDS[load],
                    legendgroup=load,
                    mode="lines+markers",
                    showlegend=panel == 0,
                    line={"color": COLOURS[load], "width": 1.8},
                    marker={"size": 5},
                ),
                **at,
            )
        figure.update_yaxes(title_text=words, **at)
    figure.update_xaxes(title_text="supply in V", row=2)
    note = (
        "A clean blow is no repeat, skips no lug, engages at least half of the lug height and comes within 10 % of the median period. "
        f"Means from {SETTLE_S:g} s on."
    )
    return Picture(
        "Rate, current, torque and synchronism over the supply voltage", style(figure, 760), note
    )
