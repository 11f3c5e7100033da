"""Servos that move a pendulum, logged by a coarse angle alone. The effect of their friction on the
speed is smaller than the quantisation of differences of the angle between rows.

The servo is simulated here, not by the plant: LuGre friction (bristles) instead of Coulomb
friction, steps of 0.1 ms, and a position controller that holds its voltage for a row.
"""

from collections.abc import Callable

import numpy as np
import pytest

from made_log import MadeLog
from vgroove.gap import diagnose
from vgroove.rig import Rig, rig_from_dict

STEP_S, ROW_S, LOG_S, COUNTS = 1e-4, 0.005, 8.0, 4096
MOTOR = {
    "resistance_ohm": 2.0,
    "inductance_h": 1e-3,
    "torque_constant_nm_per_a": 1.6,
    "inertia_kg_m2": 0.012,
    "viscous_nm_s_per_rad": 0.05,
    "coulomb_nm": 0.02,
}
PENDULUM = {"kind": "pendulum", "mass_kg": 0.5, "length_m": 0.12}
BRISTLE, BRISTLE_DAMPING, BRISTLE_RAD_S = 4000.0, 1.0, 0.05
GAIN_V_PER_RAD, LIMIT_V = 30.0, 15.0


def servo_rig() -> Rig:
    """The servo with the frictions that its maker states, all at the output; gear ratio 1."""
    return rig_from_dict(
        {
            "schema": "vgroove.rig/1",
            "input": {"kind": "voltage_v"},
            "supply": {"voltage_v": LIMIT_V},
            "motor": MOTOR,
            "gearbox": {"ratio": 1, "output_inertia_kg_m2": 0.0},
            "mechanism": {"kind": "none"},
            "load": PENDULUM,
            "sensors": {"log_hz": 1.0 / ROW_S, "position_lsb_rad": 2.0 * np.pi / COUNTS},
        },
        "a servo",
    )


def strokes(time_s: float) -> float:
    """Wanted angle in rad: two sines, from rest."""
    return min(1.0, 2.0 * time_s) * float(
        1.2 * np.sin(0.7 * np.pi * time_s) + 0.6 * np.sin(2.2 * np.pi * time_s)
    )


def lift(time_s: float) -> float:
    """Wanted angle in rad: raised slowly, held, and back to 0 in a step."""
    return 0.8 * min(time_s, 2.0) if time_s < 3.0 else 0.0


def servo_log(
    wanted: Callable[[float], float],
    coulomb_nm: float = 0.0,
    load: float = 0.0,
    viscous: float = 0.0,
) -> MadeLog:
    """Log of a servo that follows wanted(time_s), rad, with more friction than its rig states:
    coulomb_nm in N m, load as a share of the load torque, viscous in N m s/rad.
    """
    lsb, rows = 2.0 * np.pi / COUNTS, round(LOG_S / ROW_S)
    ohm, nm_per_a, inertia = (
        MOTOR["resistance_ohm"],
        MOTOR["torque_constant_nm_per_a"],
        MOTOR["inertia_kg_m2"],
    )
    damping, weight_nm = (
        MOTOR["viscous_nm_s_per_rad"] + viscous,
        PENDULUM["mass_kg"] * 9.81 * PENDULUM["length_m"],
    )
    inertia += PENDULUM["mass_kg"] * PENDULUM["length_m"] ** 2
    angle = speed = bristle = current = 0.0
    kept = np.exp(-STEP_S * ohm / MOTOR["inductance_h"])  # share of a step's error of the current
    voltage, position = np.zeros(rows), np.zeros(rows)
    for row in range(rows):
        read = round(angle / lsb) * lsb
        voltage[row] = np.clip(GAIN_V_PER_RAD * (wanted(row * ROW_S) - read), -LIMIT_V, LIMIT_V)
        for _ in range(round(ROW_S / STEP_S)):
            hanging_nm = weight_nm * np.sin(angle)
            most_nm = MOTOR["coulomb_nm"] + coulomb_nm + load * abs(hanging_nm)
            before, bristle = (
                bristle,
                (bristle + STEP_S * speed) / (1.0 + STEP_S * BRISTLE * abs(speed) / most_nm),
            )
            bending = (
                (bristle - before)
                / STEP_S
                * BRISTLE_DAMPING
                * np.exp(-min(50.0, (speed / BRISTLE_RAD_S) ** 2))
            )
            friction_nm = BRISTLE * bristle + bending + damping * speed
            steady = (voltage[row] - nm_per_a * speed) / ohm
            current = steady + kept * (current - steady)
            speed += STEP_S * (nm_per_a * current - friction_nm - hanging_nm) / inertia
            angle += STEP_S * speed
        position[row] = round(angle / lsb) * lsb
    return MadeLog(ROW_S * np.arange(1, rows + 1), {"voltage_v": voltage, "position_rad": position})


@pytest.mark.parametrize("wanted", [strokes, pytest.param(lift, marks=pytest.mark.proof)])
@pytest.mark.parametrize(
    ("more", "effect", "size"),
    [
        ({}, "", 0.0),
        ({"coulomb_nm": 0.06}, "coulomb_friction", 0.06),
        ({"load": 0.15}, "load_dependent_friction", 0.15),
        ({"viscous": 0.1}, "viscous_friction", 0.1),
    ],
    ids=["nothing", "coulomb", "load", "viscous"],
)
def test_friction_of_a_servo_is_identified_from_a_coarse_angle_alone(
    wanted: Callable[[float], float], more: dict[str, float], effect: str, size: float
) -> None:
    verdict = diagnose([servo_log(wanted, **more)], servo_rig()).as_dict()
    assert (verdict["verdict"], verdict["selected"]) == (
        ("effect", [effect]) if effect else ("none", [])
    )
    if effect:
        found = verdict["effects"][0]["parameters"].values()
        assert [one["value"] for one in found] == pytest.approx([size], rel=0.05)
