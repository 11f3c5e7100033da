"""`vgroove study impact`: one cycle of the impact tool: hammer displacement, rotation, motor
current and speed, phases of the blow.
"""

from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from vgroove.errors import VgrooveError
from vgroove.page import Picture, Table, style
from vgroove.rig import Rig
from vgroove.study.impact_runs import RPM, hits_between, simulate
from vgroove.study.report import Study

TRACE_STEP_S = 5e-6
MARGIN = 0.04  # of the cycle, shown before and after it
PHASES = {
    "blow": "the hammer lug drives the anvil",
    "rebound": "below the lug height, moving back",
    "over": "above the lugs, moving back",
    "return": "above the lugs, moving forward",
    "stroke": "below the lug height, moving forward",
}
COLOURS = {
    "blow": "rgba(209,73,91,0.28)",
    "rebound": "rgba(237,174,73,0.22)",
    "over": "rgba(0,121,140,0.16)",
    "return": "rgba(102,161,130,0.20)",
    "stroke": "rgba(120,120,160,0.20)",
}
MOST_PHASES = 20  # a regular cycle has five
LINES = ("#30343b", "#d1495b", "#00798c")


def find_cycle(rig: Rig, duration_s: float, duty: float) -> tuple[float, float]:
    """The last whole cycle from blow to blow that ends 5 ms before the run does: start, end;
    VgrooveError when there is none.
    """
    rows = simulate([rig], duration_s, duty)
    blows = hits_between(rows["blows"][0], 0.0, duration_s - 5e-3)
    first = blows["time_s"][blows["kind"] == 0]
    if len(first) < 3:
        raise VgrooveError(
            f"{rig.name or 'the rig'}: fewer than three blows in {duration_s:g} s at duty {duty:g}: there is no cycle to show"
        )
    return float(first[-2]), float(first[-1])


def phases_of(
    time_s: np.ndarray, lug_nm: np.ndarray, hammer_m: np.ndarray, lug_height_m: float
) -> list[tuple[str, float, float]]:
    """(phase, start, end) along a cycle from blow to blow: contact, then by the hammer's height and
    the sign of its motion.
    """
    rising = np.gradient(hammer_m, time_s) >= 0.0
    above = hammer_m >= lug_height_m
    names = np.where(
        lug_nm != 0.0,
        "blow",
        np.where(above, np.where(rising, "over", "return"), np.where(rising, "rebound", "stroke")),
    )
    touching = np.flatnonzero(
        (lug_nm != 0.0) & (time_s < time_s[0] + 3e-3)
    )  # rebounds within 3 ms belong to the blow (physics.md section 4)
    if touching.size:
        names[: touching[-1] + 1] = "blow"
    starts = np.flatnonzero(np.r_[True, names[1:] != names[:-1]])
    ends = np.r_[starts[1:], len(names) - 1]
    return [
        (str(names[a]), float(time_s[a]), float(time_s[b]))
        for a, b in zip(starts, ends, strict=True)
    ]


def cycle(rig: Rig, duration_s: float, duty: float) -> dict[str, Any]:
    """A settled cycle: columns over time from its blow, phases, and the figures of it."""
    start, end = find_cycle(rig, duration_s, duty)
    margin = round(MARGIN * (end - start) / TRACE_STEP_S)
    time_s = start + TRACE_STEP_S * np.arange(-margin, round((end - start) / TRACE_STEP_S) + margin)
    trace = simulate([rig], duration_s, duty, trace_s=time_s)["trace"]
    inside = (time_s >= start) & (time_s <= end)
    height = rig.mechanism["lug_height_m"]
    columns = {
        "time_ms": 1e3 * (time_s - start),
        "hammer_mm": 1e3 * trace["hammer_m"],
        "hammer_deg": np.degrees(trace["hammer_rad"]),
        "spindle_rpm": trace["speed_rad_s"] / rig.gearbox["ratio"] * RPM,
        "hammer_rpm": trace["hammer_rad_s"] * RPM,
        "current_a": trace["current_a"],
        "joint_nm": trace["anvil_torque_nm"],
        "anvil_deg": np.degrees(trace["anvil_angle_rad"]),
        "head_deg": np.degrees(trace["head_rad"]),
    }
    for name in ("hammer_deg", "anvil_deg", "head_deg"):
        columns[name] = columns[name] - np.interp(0.0, columns["time_ms"], columns[name])
    phases = phases_of(
        time_s[inside], trace["lug_torque_nm"][inside], trace["hammer_m"][inside], height
    )
    if len(phases) > MOST_PHASES:
        raise VgrooveError(
            f"{rig.name or 'the rig'}: {len(phases)} phases between two blows: this load makes no impact cycle to show"
        )
    return {
        "columns": columns,
        "start_s": start,
        "period_s": end - start,
        "lug_height_mm": 1e3 * height,
        "phases": [
            {"phase": name, "start_ms": 1e3 * (a - start), "end_ms": 1e3 * (b - start)}
            for name, a, b in phases
        ],
    }


def figures_of(found: dict[str, Any]) -> dict[str, float]:
    """Figures of the cycle."""
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


def impact_study(rig: Rig, joint: str, duration_s: float, duty: float) -> Study:
    """The cycle of one tool on one joint."""
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
            name: [round(float(v), 6) for v in values[::10]]
            for name, values in found["columns"].items()
        },
    }
    lines = [
        f"{figures['blows_per_min']:.0f} blows per minute ({figures['period_ms']:.2f} ms), {figures['joint_peak_nm']:.1f} N m peaks, "
        f"{figures['current_mean_a']:.1f} A mean, hammer back {figures['hammer_max_mm']:.2f} mm, "
        f"{figures['hammer_max_rpm']:.0f} rpm of the hammer at the blow."
    ]
    tables = [
        Table(
            "phases",
            "Phases of the cycle",
            ["phase", "what happens", "start in ms", "end in ms", "length in ms", "share in %"],
            [
                [
                    p["phase"],
                    PHASES[p["phase"]],
                    p["start_ms"],
                    p["end_ms"],
                    p["end_ms"] - p["start_ms"],
                    100 * (p["end_ms"] - p["start_ms"]) / figures["period_ms"],
                ]
                for p in found["phases"]
            ],
        ),
        Table("figures", "Figures of the cycle", ["figure", "value"], list(figures.items())),
    ]
    title = f"Impact cycle, joint: {joint}, {rig.supply['voltage_v']:g} V, duty {100 * duty:g} %"
    return Study("impact", title, lines, tables, [cycle_picture(found)], data)


def cycle_picture(found: dict[str, Any]) -> Picture:
    """Five panels over the time from the blow, phases shaded."""
    panels = (
        ("hammer back in mm", [("hammer_mm", "hammer displacement")]),
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
    figure = make_subplots(rows=len(panels), cols=1, shared_xaxes=True, vertical_spacing=0.025)
    time = found["columns"]["time_ms"]
    for row, (words, curves) in enumerate(panels, 1):
        for n, (key, name) in enumerate(curves):
            figure.add_trace(
                go.Scatter(
                    x=time,
                    y=found["columns"][key],
                    name=name,
                    mode="lines",
                    line={"color": LINES[n], "width": 1.8},
                    showlegend=len(curves) > 1,
                ),
                row=row,
                col=1,
            )
        figure.update_yaxes(title_text=words, row=row, col=1)
    figure.add_hline(
        y=found["lug_height_mm"],
        line={"color": "#888", "dash": "dash", "width": 1},
        annotation_text="lug height",
        row=1,
        col=1,
    )
    shade(figure, found)
    figure.update_xaxes(title_text="time from the blow in ms", row=len(panels), col=1)
    figure.update_xaxes(range=[time[0], time[-1]])
    note = (
        "Shaded: "
        + "; ".join(
            f"{name}: {words}"
            for name, words in PHASES.items()
            if any(p["phase"] == name for p in found["phases"])
        )
        + "."
    )
    return Picture("One cycle from blow to blow", style(figure, 1000), note)


def shade(figure: go.Figure, found: dict[str, Any]) -> None:
    """Phases behind all panels, named above the first where there is room; the blow is named to the
    left of its beginning.
    """
    for p in found["phases"]:
        look = {
            "x0": p["start_ms"],
            "x1": p["end_ms"],
            "fillcolor": COLOURS[p["phase"]],
            "line_width": 0,
            "layer": "below",
        }
        blow = p["phase"] == "blow"
        wide = p["end_ms"] - p["start_ms"] > 60 * found["period_s"] or blow
        named = (
            {
                "annotation_text": p["phase"],
                "annotation_position": "top left",
                "annotation_yshift": 20,
            }
            if wide
            else {}
        )
        named |= {"annotation_xanchor": "right" if blow else "left"} if wide else {}
        figure.add_vrect(**look, **named, row=1, col=1)
        for row in range(2, 6):
            figure.add_vrect(**look, row=row, col=1)
