"""Torque of the loads of `vgroove study load`: over the angle, and over the speed of a free
load.
"""

from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from vgroove import _core
from vgroove.html_page import Picture, Table, legend_per_panel, style
from vgroove.reference.joints import REFERENCE_JOINTS
from vgroove.reference.rigs import reference_rig
from vgroove.rig import Rig
from vgroove.study.impact_runs import with_joint
from vgroove.units import TURN_RAD

# Joints whose head turns: the turns that are drawn from the start of a run, and the colour.
CURVES = {
    "hard_joint": (0.15, "#30343b"),
    "disc_spring": (20.1, "#d1495b"),
    "m6": (25.5, "#edae49"),
    "m8": (15.5, "#00798c"),
    "m10": (10.5, "#66a182"),
}
CURVE_POINTS = 600
LOCKED_COLOUR, PENDULUM_COLOUR, FREE_COLOURS = "#30343b", "#d1495b", ("#00798c", "#66a182")
GRAVITY_M_S2 = 9.81

# Friction law of docs/spec/model.md, section 3: torques in N m, transition speed w_brk and
# threshold in rad/s, decay in s/rad; sizes estimated for a drum.
FREE = {"coulomb_nm": 0.5, "breakaway_nm": 0.6, "w_brk": 5.0, "threshold": 0.5, "decay": 0.3}


def free_nm(speed_rad_s: np.ndarray, exponential: bool = False) -> np.ndarray:
    """Friction in N m of a free load at speeds (n,), by docs/spec/model.md, section 3: the
    Stribeck law, or the exponential form.
    """
    tc, tbrk, w_brk = FREE["coulomb_nm"], FREE["breakaway_nm"], FREE["w_brk"]
    if exponential:
        at = np.maximum(np.abs(speed_rad_s), FREE["threshold"])
        torque = tc + (tbrk - tc) * np.exp(-FREE["decay"] * at)
        return (
            np.sign(speed_rad_s) * torque * np.minimum(np.abs(speed_rad_s) / FREE["threshold"], 1.0)
        )
    share = speed_rad_s / (np.sqrt(2) * w_brk)
    return np.sqrt(2 * np.e) * (tbrk - tc) * np.exp(-(share**2)) * share + tc * np.tanh(
        10 * speed_rad_s / w_brk
    )


def pendulum_nm(angle_rad: np.ndarray) -> np.ndarray:
    """Torque of the pendulum on the shaft at angles (n,) from its rest position."""
    load = reference_rig("pendulum").load
    return load["mass_kg"] * GRAVITY_M_S2 * load["length_m"] * np.sin(angle_rad)


def curve(rig: Rig, joint: str) -> dict[str, np.ndarray]:
    """Slip torque forwards and backwards over the turns of the head from the start of a run, (n,)
    each.
    """
    turns = np.linspace(0.0, CURVES[joint][0], CURVE_POINTS)
    tool = with_joint(rig, joint)
    forward, backward = _core.joint_slip_torques(
        tool.parameters(), tool.load["kind"], TURN_RAD * turns
    )
    return {"turns": turns, "forward_nm": forward, "backward_nm": backward}


def curve_row(joint: str, found: dict[str, np.ndarray]) -> dict[str, Any]:
    """Of a curve: the torque at its start, the largest torque, and the work up to it."""
    top = int(np.argmax(found["forward_nm"]))
    work = float(np.trapezoid(found["forward_nm"][: top + 1], TURN_RAD * found["turns"][: top + 1]))
    return {
        "joint": joint,
        "start_nm": float(found["forward_nm"][0]),
        "most_nm": float(found["forward_nm"][top]),
        "most_turns": float(found["turns"][top]),
        "work_j": work,
        "backward_share": float(found["backward_nm"][top] / found["forward_nm"][top]),
    }


def joint_table(rows: list[dict[str, Any]]) -> Table:
    """Start, maximum and work of the torque-angle curves."""
    return Table(
        "joints",
        "Torque over angle of the joints",
        [
            "joint",
            "torque at the start in N m",
            "most in N m",
            "reached after turns",
            "work until then in J",
            "backwards / forwards there",
        ],
        [
            [
                REFERENCE_JOINTS[r["joint"]].short,
                *(r[k] for k in ("start_nm", "most_nm", "most_turns", "work_j", "backward_share")),
            ]
            for r in rows
        ],
    )


def curve_picture(curves: dict[str, dict[str, np.ndarray]]) -> Picture:
    """Torque over turns: screws and springs in one panel, the hard joint over degrees in
    another.
    """
    figure = make_subplots(rows=1, cols=2, column_widths=[0.7, 0.3], horizontal_spacing=0.1)
    for joint, found in curves.items():
        hard, title, colour = joint == "hard_joint", REFERENCE_JOINTS[joint].title, CURVES[joint][1]
        x = 360 * found["turns"] if hard else found["turns"]
        forward = {"name": title, "line": {"color": colour, "width": 2}}
        backward = {
            "name": f"{title}, backwards",
            "showlegend": False,
            "line": {"color": colour, "width": 1.2, "dash": "dash"},
        }
        for key, look in (("forward_nm", forward), ("backward_nm", backward)):
            trace = go.Scatter(x=x, y=found[key], legendgroup=joint, **look)
            figure.add_trace(trace, row=1, col=2 if hard else 1)
    figure.update_xaxes(title_text="head angle in turns", row=1, col=1)
    figure.update_xaxes(title_text="head angle in °", row=1, col=2)
    figure.update_yaxes(title_text="slip torque in N m", col=1)
    note = (
        "Torque at which the head turns, from the start of a run (screws 12 turns deep, springs "
        "4 turns tight); dashed: backwards."
    )
    return Picture("Torque over angle", legend_per_panel(style(figure, 520)), note)


def other_picture() -> Picture:
    """Torque of loads that do not slip: locked joint over twist, pendulum over angle, free load
    over speed.
    """
    figure = make_subplots(rows=1, cols=3, horizontal_spacing=0.09)
    degrees, speed = np.linspace(-180.0, 180.0, 181), np.linspace(-30.0, 30.0, 601)
    twist = np.linspace(-3.0, 3.0, 61)
    stiffness = REFERENCE_JOINTS["locked"].load["stiffness_nm_per_rad"]
    locked = (f"locked joint, {stiffness:,} N m/rad", LOCKED_COLOUR, "solid")
    pendulum = ("pendulum, 0.49 kg at 0.1 m", PENDULUM_COLOUR, "solid")
    stribeck = ("free load, Stribeck", FREE_COLOURS[0], "solid")
    by_exponential = ("free load, exponential form", FREE_COLOURS[1], "dash")
    curves = (
        (1, twist, stiffness * np.radians(twist), locked),
        (2, degrees, pendulum_nm(np.radians(degrees)), pendulum),
        (3, speed, free_nm(speed), stribeck),
        (3, speed, free_nm(speed, exponential=True), by_exponential),
    )
    for col, x, y, (name, colour, dash) in curves:
        line = {"color": colour, "width": 2, "dash": dash}
        figure.add_trace(go.Scatter(x=x, y=y, name=name, mode="lines", line=line), row=1, col=col)
    for col, title in enumerate(("elastic twist in °", "angle in °", "speed in rad/s"), 1):
        figure.update_xaxes(title_text=title, row=1, col=col)
    figure.update_yaxes(title_text="torque in N m", col=1)
    note = "The friction of the free load depends on speed: 0.5 N m, breakaway torque 0.6 N m."
    return Picture(
        "Torque of the loads that do not slip", legend_per_panel(style(figure, 430)), note
    )
