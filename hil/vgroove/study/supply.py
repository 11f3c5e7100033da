"""`vgroove study supply`: impact rate, current, torque and synchronism over the supply voltage, on
several joints.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from vgroove.html_page import Picture, Table, style, table_from_dicts
from vgroove.progress import Tick
from vgroove.reference.joints import REFERENCE_JOINTS
from vgroove.result_files import Report
from vgroove.rig import Rig
from vgroove.study.impact_runs import blow_figures, simulate, with_joint

JOINT_COLOURS = {
    "locked": "#30343b",
    "slip_60": "#d1495b",
    "hard_joint": "#edae49",
    "slip_6": "#00798c",
    "m8": "#66a182",
}
SETTLE_S = 0.5  # figures are taken from here on
SYNCHRONOUS = 0.9  # share of clean blows from which a voltage counts as synchronous
PANELS = (
    ("blows_per_min", "blows per minute"),
    ("current_a", "motor current in A"),
    ("torque_peak_nm", "peak torque in N m"),
    ("synchronism", "clean blows in %"),
)
COLUMNS = (
    ("load", "joint"),
    ("supply in V", "supply_v"),
    ("blows/min", "blows_per_min"),
    ("spread in %", "period_spread_percent"),
    ("current in A", "current_a"),
    ("peak torque in N m", "torque_peak_nm"),
    ("engaged in %", "engaged_percent"),
    ("clean in %", "clean"),
    ("hammer in mm", "hammer_max_mm"),
    ("deg per blow", "angle_per_blow_deg"),
)


def supply_voltages(low_v: float, high_v: float, step_v: float) -> np.ndarray:
    """Voltages (n,) from low to high, both included, about step_v apart."""
    return np.round(np.linspace(low_v, high_v, max(2, round((high_v - low_v) / step_v) + 1)), 6)


def supply_rows(
    rig: Rig, load: str, voltages: Sequence[float], duration_s: float, duty: float
) -> list[dict[str, Any]]:
    """Figures of one joint at every voltage, from SETTLE_S to the end of the run."""
    rigs = [with_joint(rig, load, {"supply.voltage_v": float(volts)}) for volts in voltages]
    rows = simulate(rigs, duration_s, duty)
    height = rig.mechanism["lug_height_m"]
    return [
        {"load": load, "supply_v": float(volts), **blow_figures(rows, n, SETTLE_S, height)}
        for n, volts in enumerate(voltages)
    ]


def supply_study(
    rig: Rig, voltages: np.ndarray, duration_s: float, duty: float, tick: Tick
) -> Report:
    """All joints at all voltages; `tick` is called once a joint."""
    found: list[dict[str, Any]] = []
    for load in JOINT_COLOURS:
        found += supply_rows(rig, load, voltages, duration_s, duty)
        tick(REFERENCE_JOINTS[load].title)
    data = {
        "rig": rig.name,
        "duty": duty,
        "duration_s": duration_s,
        "from_s": SETTLE_S,
        "rows": found,
    }
    title = f"Influence of the supply voltage, {rig.name or 'impact driver'}, duty {100 * duty:g} %"
    return Report(
        "supply", title, supply_lines(found), [supply_table(found)], [supply_picture(found)], data
    )


def supply_lines(found: list[dict[str, Any]]) -> list[str]:
    """The findings, one sentence a joint."""
    return [
        supply_line(REFERENCE_JOINTS[load].title, [r for r in found if r["load"] == load])
        for load in JOINT_COLOURS
    ]


def supply_line(title: str, found: list[dict[str, Any]]) -> str:
    """Highest impact rate and synchronous voltages of one joint."""
    rows = [r for r in found if r["blows_per_min"]]
    if not rows:
        return f"{title}: no impacts at any voltage."
    best = max(rows, key=lambda r: r["blows_per_min"])
    clean = [f"{r['supply_v']:g}" for r in rows if r["synchronism"] >= SYNCHRONOUS]
    voltages = f" ({clean[0]} to {clean[-1]} V)" if clean else ""
    return (
        f"{title}: at most {best['blows_per_min']:.0f} blows per minute, at {best['supply_v']:g} V;"
        f" nine tenths of the blows are clean at {len(clean)} of {len(rows)} voltages{voltages}."
    )


def supply_table(found: list[dict[str, Any]]) -> Table:
    """Every figure of every run."""
    rows = [
        {**r, "joint": REFERENCE_JOINTS[r["load"]].short, "clean": percent(r["synchronism"])}
        for r in found
    ]
    return table_from_dicts("runs", "Impacts over the supply voltage", COLUMNS, rows)


def percent(share: float | None) -> float | None:
    """A share as percent."""
    return None if share is None else 100.0 * share


def supply_picture(found: list[dict[str, Any]]) -> Picture:
    """Four panels over the voltage, one curve a joint."""
    figure = make_subplots(
        rows=2, cols=2, shared_xaxes=True, vertical_spacing=0.08, horizontal_spacing=0.1
    )
    for panel, (key, title) in enumerate(PANELS):
        at = {"row": panel // 2 + 1, "col": panel % 2 + 1}
        for load, colour in JOINT_COLOURS.items():
            rows = [r for r in found if r["load"] == load]
            values = [percent(r[key]) if key == "synchronism" else r[key] for r in rows]
            figure.add_trace(
                go.Scatter(
                    x=[r["supply_v"] for r in rows],
                    y=values,
                    name=REFERENCE_JOINTS[load].title,
                    legendgroup=load,
                    mode="lines+markers",
                    showlegend=panel == 0,
                    line={"color": colour, "width": 1.8},
                    marker={"size": 5},
                ),
                **at,
            )
        figure.update_yaxes(title_text=title, **at)
    figure.update_xaxes(title_text="supply in V", row=2)
    note = (
        "A clean blow is no repeat, skips no lug, engages at least half of the lug height and is "
        f"within 10 % of the median period. Means from {SETTLE_S:g} s on."
    )
    return Picture(
        "Rate, current, torque and synchronism over the supply voltage", style(figure, 760), note
    )
