"""Effects that depend on the shaft's angle, in logs of an encoder: the torque of a pendulum that
the rig does not state, an eccentric encoder wheel; and how far the shaft must turn for a log to
show them.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from made_log import MadeLog, rig
from vgroove import _core
from vgroove.gap import diagnose
from vgroove.gap.catalogue import BY_ID
from vgroove.gap.residual.loading import load_problem
from vgroove.gap.selection.comparison import effects_in_balance
from vgroove.gap.selection.log_content import (
    impact_flags,
    repeated_range,
    shown_effects,
    turning_rows,
)
from vgroove.rig import Rig, rig_from_dict
from vgroove.units import RAD_S_PER_RPM

ROW_S, STEP_RAD = 0.01, 2.0 * np.pi / 4096
TIME_S = ROW_S * np.arange(600)
TURN_RAD = 2.0 * np.pi
PENDULUM = {"kind": "pendulum", "mass_kg": 0.02, "length_m": 0.15, "zero_rad": 0.0}


def servo(**sections: dict) -> Rig:
    """A motor without a gear, driven by its terminal voltage, whose angle an encoder measures."""
    sensors = {"position_lsb_rad": STEP_RAD, "log_hz": 100}
    motor = {
        "resistance_ohm": 4.0,
        "inductance_h": 1e-3,
        "torque_constant_nm_per_a": 0.05,
        "inertia_kg_m2": 1e-4,
        "viscous_nm_s_per_rad": 1e-5,
        "coulomb_nm": 2e-3,
    }
    data = rig().as_dict() | {"input": {"kind": "voltage_v"}, "motor": motor, "sensors": sensors}
    data |= {"gearbox": {"ratio": 1.0, "output_inertia_kg_m2": 0.0}} | sections
    return rig_from_dict(data, "the test's servo")


def encoder_log(tool: Rig, voltage: np.ndarray) -> MadeLog:
    """Simulated log of a tool that starts at rest: voltage, and angle rounded to encoder steps."""
    rows = _core.simulate_log(
        _core.LogInput(TIME_S, "voltage_v", voltage, load_kind=tool.load["kind"]),
        tool.parameters()[None],
        np.array([0]),
        np.zeros((1, 3)),
    )
    angle = np.round(rows["angle_measured_rad"][0] / STEP_RAD) * STEP_RAD
    return MadeLog(TIME_S, {"voltage_v": voltage, "position_rad": angle})


def swing(hz: float, volt: float) -> np.ndarray:
    """A voltage (rows,) of sines of two frequencies, with a pause."""
    wave = np.sin(TURN_RAD * hz * TIME_S) + 0.5 * np.sin(TURN_RAD * 1.7 * hz * TIME_S)
    return volt * wave * (TIME_S < 5.5)


def test_a_pendulum_that_the_rig_lacks_is_a_torque_of_one_period_a_turn() -> None:
    """The rig holds its inertia. The shaft swings by less than a turn."""
    tool = servo(load=PENDULUM)
    inertia = 0.02 * 0.15**2
    stated = servo(gearbox={"ratio": 1.0, "output_inertia_kg_m2": inertia})
    log = encoder_log(tool, swing(0.6, 1.2))
    assert 0.5 < np.ptp(log.columns["position_rad"]) / TURN_RAD < 1.0
    found = diagnose([log], stated)
    assert (found.verdict, found.selected) == ("effect", ["gear_eccentricity"])
    torque = found.effects[0].parameters["torque_nm"]
    assert torque.value == pytest.approx(0.02 * 9.81 * 0.15, rel=0.05)


def test_an_eccentric_encoder_wheel_is_named() -> None:
    tool = servo(effects={"hall_eccentricity": {"amplitude_rad": 0.03, "phase_rad": 0.7}})
    found = diagnose([encoder_log(tool, swing(0.3, 6.0))], servo())
    assert (found.verdict, found.selected) == ("effect", ["hall_eccentricity"])
    assert found.effects[0].parameters["amplitude_rad"].value == pytest.approx(0.03, rel=0.05)


def test_the_same_servo_without_an_effect_has_no_gap() -> None:
    assert diagnose([encoder_log(servo(), swing(0.3, 6.0))], servo()).verdict == "none"


def test_what_a_log_shows_of_a_wheel_and_of_a_gear() -> None:
    """A wheel needs a sensor of the motion; a hammering tool is compared by statistics."""
    tool = servo()
    log = encoder_log(tool, swing(0.3, 6.0))
    speed = np.gradient(log.columns["position_rad"], TIME_S) / RAD_S_PER_RPM
    current = 0.1 * np.sin(TIME_S) + 1e-3 * np.cos(37.0 * TIME_S)
    rows = {"voltage_v": log.columns["voltage_v"]}
    for column, shows in (
        ({"position_rad": log.columns["position_rad"]}, True),
        ({"speed_rpm": speed}, True),
        ({"current_a": current}, False),
    ):
        problem = load_problem([MadeLog(TIME_S, rows | column)], tool)
        shown = {e.id for e in shown_effects(problem, frozenset())}
        assert ("hall_eccentricity" in shown) is shows and "gear_eccentricity" in shown
    assert not {"rows", "motion"} & set(impact_flags(problem))
    balance = SimpleNamespace(rows_per_span=20, logs=problem.logs)
    left = effects_in_balance(balance, [BY_ID["hall_eccentricity"], BY_ID["coulomb_friction"]])
    assert [e.id for e in left] == ["coulomb_friction"]


def test_a_tolerated_mass_of_the_pendulum_is_retuned() -> None:
    """The rig's mass is 5 % too large, within its tolerance: it is corrected, and no effect is
    named.
    """
    tool = servo(load=PENDULUM)
    stated = servo(load=PENDULUM | {"mass_kg": 0.021}, tolerance={"load.mass_kg": 0.05})
    found = diagnose([encoder_log(tool, swing(0.6, 1.2))], stated)
    assert (found.verdict, found.selected) == ("none", [])
    assert found.retuned_parameters["load.mass_kg"] == pytest.approx(0.02, rel=0.02)


@pytest.mark.parametrize(
    ("turns", "repeated"),
    [
        ((0.0, 3.0), 3.0),  # one way: its range
        ((0.0, 0.7), 0.7),
        ((0.0, 0.5, 0.0), 2.0),  # half a period to and fro: as two periods one way
        ((0.0, 0.5, 0.25), 2.0),
        ((0.0, 0.5, 0.4), 0.8),
        ((0.0, 0.3, -0.3, 0.3), 2.4),
        ((0.0, 2.0, 1.9, 4.0), 4.0),  # a way back below a tenth of the range
        ((0.0, 0.5, 0.44, 0.5, 0.44, 0.5, 0.44, 0.5), 0.5),  # a small part, passed many times
        ((0.0, 0.5, 0.25, 0.5, 0.25), 2.0),
        ((0.0, 6.0, 5.3, 6.0, 5.3), 6.0),
    ],
)
def test_a_way_back_shows_that_a_torque_belongs_to_the_angle(
    turns: tuple[float, ...], repeated: float
) -> None:
    """turns: angles, in turns, at which the shaft starts, reverses and ends. repeated: twice the
    longest period, in turns, for which the log can show that a torque repeats with the angle.
    """
    angle = np.interp(np.linspace(0.0, 1.0, 501), np.linspace(0.0, 1.0, len(turns)), turns)
    rng = np.random.default_rng(2)
    for noise in (0.0, 1e-3 * np.ptp(angle)):
        noisy = angle + noise * rng.normal(size=501)
        assert repeated_range(noisy) == pytest.approx(repeated, rel=0.03)
        assert repeated_range(-noisy) == pytest.approx(repeated_range(noisy))


def test_rows_at_which_a_shaft_turns_back() -> None:
    angle = np.array([0.0, 1.0, 2.0, 1.9, 3.0, 1.0, 0.0, 0.5, 0.45])
    assert turning_rows(angle, 0.3) == [0, 4, 6, 7, 8]
    assert turning_rows(angle, 5.0)[-1] == 8
    assert turning_rows(np.zeros(4), 0.0)[0] == 0
