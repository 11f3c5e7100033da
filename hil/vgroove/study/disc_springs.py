"""Disc springs of `vgroove study load`: the stack that the tool tightens against DIN EN 16984."""

import numpy as np
import plotly.graph_objects as go

from vgroove.html_page import Picture, Table, style, thin
from vgroove.reference.bolt import PITCH_M, lever_m
from vgroove.reference.joints import REFERENCE_JOINTS
from vgroove.rig import Rig
from vgroove.study.impact_runs import simulate, with_joint
from vgroove.units import TURN_RAD

# Steel and spring of docs/spec/model.md, section 6: 40 x 20.4 x 1.5, n = 4 parallel, i = 42 in
# series
YOUNG_PA, POISSON = 206e9, 0.3
DISC = {"outer_m": 40e-3, "inner_m": 20.4e-3, "thickness_m": 1.5e-3, "cone_m": 1.15e-3}
PARALLEL, SERIES = 4, 42
START_TURNS = (0.0, 5.0, 10.0, 15.0, 20.0)  # turns of the bolt at which a run begins
SAMPLE_S = 2e-5
SIMULATED, CALCULATED = "#00798c", "#d1495b"  # colours
TURNING_RAD_S = 2.0  # the head slips, and shows the slip torque, above this speed


def disc_force(deflection_m: np.ndarray) -> np.ndarray:
    """Force in N of one spring at deflections (n,), by the formula of DIN EN 16984 and without the
    plant's code.
    """
    outer, inner, t, h0 = (DISC[k] for k in ("outer_m", "inner_m", "thickness_m", "cone_m"))
    d = outer / inner
    k1 = ((d - 1) / d) ** 2 / ((d + 1) / (d - 1) - 2 / np.log(d)) / np.pi
    s = deflection_m
    return (
        4
        * YOUNG_PA
        / (1 - POISSON**2)
        * t**4
        / (k1 * outer**2)
        * (s / t)
        * ((h0 / t - s / t) * (h0 / t - s / (2 * t)) + 1)
    )


def simulated_stack(rig: Rig, duration_s: float) -> dict[str, np.ndarray]:
    """Force on the stack over its deflection, (n,) each, as the impact tool tightens it from
    START_TURNS: the joint's torque over the lever of the bolt.

    While the head turns, the joint's torque is its slip torque, so that each sample of a turning
    head is a point of the stack's curve.
    """
    load = REFERENCE_JOINTS["disc_spring"].load
    time_s = np.arange(SAMPLE_S, duration_s, SAMPLE_S)
    deflection, force = [], []
    for from_turns in START_TURNS:
        run = simulate(
            [with_joint(rig, "disc_spring", {"load.from_turns": from_turns})],
            duration_s,
            1.0,
            trace_s=time_s,
        )["trace"]
        speed = np.gradient(run["head_rad"], time_s)
        fast = speed > TURNING_RAD_S
        turning = fast & np.r_[fast[1:], False] & np.r_[False, fast[:-1]]
        deflection.append((from_turns + run["head_rad"][turning] / TURN_RAD) * PITCH_M)
        force.append(
            (run["anvil_torque_nm"][turning] - load["run_torque_nm"]) / lever_m(load["friction"])
        )
    order = np.argsort(np.concatenate(deflection))
    return {
        "deflection_mm": 1e3 * np.concatenate(deflection)[order],
        "force_n": np.concatenate(force)[order],
    }


def stack_figures(found: dict[str, np.ndarray]) -> dict[str, float]:
    """Agreement of the simulated and the calculated stack, and the force of a single spring."""
    calculated = PARALLEL * disc_force(found["deflection_mm"] * 1e-3 / SERIES)
    return {
        "single_at_0.75_n": float(disc_force(np.array([0.75 * DISC["cone_m"]]))[0]),
        "stack_length_mm": 1e3 * SERIES * (DISC["cone_m"] + PARALLEL * DISC["thickness_m"]),
        "samples": len(calculated),
        "deepest_mm": float(found["deflection_mm"][-1]),
        "deepest_n": float(calculated[-1]),
        "largest_difference_percent": float(
            100 * np.max(np.abs(found["force_n"] - calculated)) / calculated.max()
        ),
    }


def disc_table(figures: dict[str, float]) -> Table:
    """The figures of stack_figures."""
    names = {
        "single_at_0.75_n": "one spring at 0.75 h0 in N",
        "stack_length_mm": "free length of the stack in mm",
        "samples": "simulated samples",
        "deepest_mm": "deepest simulated deflection in mm",
        "deepest_n": "calculated force there in N",
        "largest_difference_percent": (
            "largest difference simulated - calculated in % of the largest force"
        ),
    }
    return Table(
        "disc_springs",
        "Disc springs 40 x 20.4 x 1.5, n = 4, i = 42: DIN EN 16984 against the simulated stack",
        ["figure", "value"],
        [[names[k], v] for k, v in figures.items()],
    )


def stack_picture(found: dict[str, np.ndarray]) -> Picture:
    """The calculated curve and the simulated points."""
    figure = go.Figure()
    deflection = np.linspace(0.0, SERIES * DISC["cone_m"], 200)
    x, y = thin(found["deflection_mm"], found["force_n"], points=600)
    figure.add_trace(
        go.Scatter(
            x=x,
            y=y,
            name="simulated tightening",
            mode="markers",
            marker={"color": SIMULATED, "size": 4},
        )
    )
    figure.add_trace(
        go.Scatter(
            x=1e3 * deflection,
            y=PARALLEL * disc_force(deflection / SERIES),
            name="DIN EN 16984",
            line={"color": CALCULATED, "width": 2},
        )
    )
    figure.update_xaxes(title_text="deflection of the stack in mm")
    figure.update_yaxes(title_text="force in N")
    note = (
        "Points: joint torque of the impact run while the head turns, over the bolt's lever at "
        "friction 0.12."
    )
    return Picture("Disc springs: calculation and simulation", style(figure, 460), note)
