"""`vgroove study impact`: one cycle of the impact tool: hammer displacement, rotation, motor
current, speed, and the phases between two blows.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from vgroove.errors import VgrooveError
from vgroove.html_page import Picture, Table, legend_per_panel, style
from vgroove.result_files import Report
from vgroove.rig import Rig
from vgroove.study.impact_runs import last_cycle, simulate
from vgroove.units import RPM_PER_RAD_S

TRACE_STEP_S = 5e-6
MARGIN_SHARE = 0.04  # of the cycle, shown before and after it
END_S = 5e-3  # the cycle ends at least this long before the run does
CONTACT_S = 3e-3  # rebounds within it belong to the blow: docs/spec/model.md, section 4
MAX_PHASES = 20  # a regular cycle has five; with more there is no cycle
NAMED_SHARE = 0.06  # of the cycle: phases shorter than it are shaded without their name
JSON_EVERY = 10  # of the trace's samples go into the JSON
CURVE_COLOURS = ("#30343b", "#d1495b", "#00798c")


@dataclass(frozen=True)
class Phase:
    """A part of the cycle: what happens in it, and the colour that shades it."""

    text: str
    colour: str


PHASES = {
    "blow": Phase("the hammer lug drives the anvil", "rgba(209,73,91,0.28)"),
    "rebound": Phase("below the lug height, moving back", "rgba(237,174,73,0.22)"),
    "over": Phase("above the lugs, moving back", "rgba(0,121,140,0.16)"),
    "return": Phase("above the lugs, moving forward", "rgba(102,161,130,0.20)"),
    "stroke": Phase("below the lug height, moving forward", "rgba(120,120,160,0.20)"),
}
# Axis title, and the column and legend of each curve.
PANELS = (
    ("hammer in mm", [("hammer_mm", "hammer displacement")]),
    (
        "rotation in °",
        [
            ("hammer_deg", "hammer rotation"),
            ("anvil_deg", "anvil rotation"),
            ("head_deg", "screw head"),
        ],
    ),
    ("speed in rpm", [("hammer_rpm", "hammer speed"), ("spindle_rpm", "spindle speed")]),
    ("current in A", [("current_a", "motor current")]),
    ("torque in N m", [("joint_nm", "joint torque")]),
)


def find_cycle(rig: Rig, duration_s: float, duty: float) -> tuple[float, float]:
    """Start and end in s of the last whole cycle, from blow to blow, that ends END_S before the
    run.

    Raises VgrooveError where there is none.
    """
    blows = simulate([rig], duration_s, duty)["blows"][0]
    return last_cycle(rig, blows, 0.0, duration_s - END_S, duty)


def phases_of(
    time_s: np.ndarray, lug_nm: np.ndarray, hammer_m: np.ndarray, lug_height_m: float
) -> list[tuple[str, float, float]]:
    """(phase, start, end) of the parts of a cycle from blow to blow, from columns (n,) of the
    trace.

    The first phase is the contact; the others follow from the hammer's height and the sign of its
    motion.
    """
    rising = np.gradient(hammer_m, time_s) >= 0.0
    above = hammer_m >= lug_height_m
    names = np.where(
        lug_nm != 0.0,
        "blow",
        np.where(above, np.where(rising, "over", "return"), np.where(rising, "rebound", "stroke")),
    )
    touching = np.flatnonzero((lug_nm != 0.0) & (time_s < time_s[0] + CONTACT_S))
    if touching.size:
        names[: touching[-1] + 1] = "blow"
    starts = np.flatnonzero(np.r_[True, names[1:] != names[:-1]])
    ends = np.r_[starts[1:], len(names) - 1]
    return [
        (str(names[a]), float(time_s[a]), float(time_s[b]))
        for a, b in zip(starts, ends, strict=True)
    ]


def cycle_columns(
    rig: Rig, trace: dict[str, np.ndarray], time_from_blow_s: np.ndarray
) -> dict[str, np.ndarray]:
    """Columns (n,) of a trace in the units of the page; rotations count from the blow on."""
    columns = {
        "time_ms": 1e3 * time_from_blow_s,
        "hammer_mm": 1e3 * trace["hammer_m"],
        "hammer_deg": np.degrees(trace["hammer_rad"]),
        "spindle_rpm": trace["speed_rad_s"] / rig.gearbox["ratio"] * RPM_PER_RAD_S,
        "hammer_rpm": trace["hammer_rad_s"] * RPM_PER_RAD_S,
        "current_a": trace["current_a"],
        "joint_nm": trace["anvil_torque_nm"],
        "anvil_deg": np.degrees(trace["anvil_angle_rad"]),
        "head_deg": np.degrees(trace["head_rad"]),
    }
    for name in ("hammer_deg", "anvil_deg", "head_deg"):
        columns[name] = columns[name] - np.interp(0.0, columns["time_ms"], columns[name])
    return columns


def cycle(rig: Rig, duration_s: float, duty: float) -> dict[str, Any]:
    """A settled cycle: columns over the time from its blow, start, period, lug height, phases.

    Raises VgrooveError where there is no regular cycle.
    """
    start, end = find_cycle(rig, duration_s, duty)
    margin = round(MARGIN_SHARE * (end - start) / TRACE_STEP_S)
    time_s = start + TRACE_STEP_S * np.arange(-margin, round((end - start) / TRACE_STEP_S) + margin)
    trace = simulate([rig], duration_s, duty, trace_s=time_s)["trace"]
    inside = (time_s >= start) & (time_s <= end)
    height = rig.mechanism["lug_height_m"]
    phases = phases_of(
        time_s[inside], trace["lug_torque_nm"][inside], trace["hammer_m"][inside], height
    )
    if len(phases) > MAX_PHASES:
        raise VgrooveError(
            f"{rig.name or 'the rig'}: {len(phases)} phases between two blows: this load makes no "
            "impact cycle to show"
        )
    return {
        "columns": cycle_columns(rig, trace, time_s - start),
        "start_s": start,
        "period_s": end - start,
        "lug_height_mm": 1e3 * height,
        "phases": [
            {"phase": name, "start_ms": 1e3 * (a - start), "end_ms": 1e3 * (b - start)}
            for name, a, b in phases
        ],
    }


def figures_of(found: dict[str, Any]) -> dict[str, float]:
    """Figures of the cycle, from the blow to the next."""
    c = found["columns"]
    inside = (c["time_ms"] >= 0.0) & (c["time_ms"] <= 1e3 * found["period_s"])
    return {
        "period_ms": 1e3 * found["period_s"],
        "blows_per_min": 60.0 / found["period_s"],
        "hammer_max_mm": float(c["hammer_mm"][inside].max()),
        "joint_peak_nm": float(c["joint_nm"][inside].max()),
        "current_mean_a": float(c["current_a"][inside].mean()),
        "current_min_a": float(c["current_a"][inside].min()),
        "current_max_a": float(c["current_a"][inside].max()),
        "spindle_mean_rpm": float(c["spindle_rpm"][inside].mean()),
        "hammer_max_rpm": float(c["hammer_rpm"][inside].max()),
        "hammer_min_rpm": float(c["hammer_rpm"][inside].min()),
        "hammer_turn_deg": float(np.interp(1e3 * found["period_s"], c["time_ms"], c["hammer_deg"])),
        "head_turn_deg": float(np.interp(1e3 * found["period_s"], c["time_ms"], c["head_deg"])),
    }


def impact_study(rig: Rig, joint: str, duration_s: float, duty: float) -> Report:
    """The cycle of one tool on its joint, which `joint` names in the title."""
    found = cycle(rig, duration_s, duty)
    figures = figures_of(found)
    data = {
        "rig": rig.name,
        "load": rig.load,
        "duty": duty,
        "supply_v": rig.supply["voltage_v"],
        "figures": figures,
        "phases": found["phases"],
        "trace": {
            name: [round(float(v), 6) for v in values[::JSON_EVERY]]
            for name, values in found["columns"].items()
        },
    }
    tables = [
        phase_table(found["phases"], figures["period_ms"]),
        Table("figures", "Figures of the cycle", ["figure", "value"], list(figures.items())),
    ]
    title = f"Impact cycle, joint: {joint}, {rig.supply['voltage_v']:g} V, duty {100 * duty:g} %"
    return Report("impact", title, [impact_line(figures)], tables, [cycle_picture(found)], data)


def impact_line(figures: dict[str, float]) -> str:
    """The main figures in a sentence."""
    return (
        f"{figures['blows_per_min']:.0f} blows per minute ({figures['period_ms']:.2f} ms), "
        f"{figures['joint_peak_nm']:.1f} N m peaks, {figures['current_mean_a']:.1f} A mean, "
        f"hammer displaced by {figures['hammer_max_mm']:.2f} mm, "
        f"{figures['hammer_max_rpm']:.0f} rpm of the hammer at the blow."
    )


def phase_table(phases: list[dict[str, Any]], period_ms: float) -> Table:
    """Start, end and share of each phase."""
    return Table(
        "phases",
        "Phases of the cycle",
        ["phase", "what happens", "start in ms", "end in ms", "length in ms", "share in %"],
        [
            [
                p["phase"],
                PHASES[p["phase"]].text,
                p["start_ms"],
                p["end_ms"],
                p["end_ms"] - p["start_ms"],
                100 * (p["end_ms"] - p["start_ms"]) / period_ms,
            ]
            for p in phases
        ],
    )


def cycle_picture(found: dict[str, Any]) -> Picture:
    """Five panels over the time from the blow, phases shaded."""
    figure = make_subplots(rows=len(PANELS), cols=1, shared_xaxes=True, vertical_spacing=0.04)
    time = found["columns"]["time_ms"]
    for row, (title, curves) in enumerate(PANELS, 1):
        for n, (key, name) in enumerate(curves):
            figure.add_trace(
                go.Scatter(
                    x=time,
                    y=found["columns"][key],
                    name=name,
                    mode="lines",
                    line={"color": CURVE_COLOURS[n], "width": 1.8},
                    showlegend=len(curves) > 1,  # else the axis names the curve
                ),
                row=row,
                col=1,
            )
        figure.update_yaxes(title_text=title, row=row, col=1)
    figure.add_hline(
        y=found["lug_height_mm"],
        line={"color": "#888", "dash": "dash", "width": 1},
        annotation_text="lug height",
        row=1,
        col=1,
    )
    shade_phases(figure, found)
    figure.update_xaxes(title_text="time from the blow in ms", row=len(PANELS), col=1)
    figure.update_xaxes(range=[time[0], time[-1]])
    present = {p["phase"] for p in found["phases"]}
    texts = [f"{name}: {phase.text}" for name, phase in PHASES.items() if name in present]
    note = f"Shaded: {'; '.join(texts)}."
    return Picture("One cycle from blow to blow", legend_per_panel(style(figure, 1000)), note)


def shade_phases(figure: go.Figure, found: dict[str, Any]) -> None:
    """Shade the phases behind all panels; their names stand above the first panel."""
    for p in found["phases"]:
        look = {
            "x0": p["start_ms"],
            "x1": p["end_ms"],
            "fillcolor": PHASES[p["phase"]].colour,
            "line_width": 0,
            "layer": "below",
        }
        figure.add_vrect(**look, **phase_label(p, 1e3 * found["period_s"]), row=1, col=1)
        for row in range(2, len(PANELS) + 1):
            figure.add_vrect(**look, row=row, col=1)


def phase_label(phase: dict[str, Any], period_ms: float) -> dict[str, Any]:
    """The annotation that names a phase; a phase too short for its name has none, except the blow,
    whose name stands left of it.
    """
    blow = phase["phase"] == "blow"
    if not blow and phase["end_ms"] - phase["start_ms"] <= NAMED_SHARE * period_ms:
        return {}
    return {
        "annotation_text": phase["phase"],
        "annotation_position": "top left",
        "annotation_yshift": 20,
        "annotation_xanchor": "right" if blow else "left",
    }
