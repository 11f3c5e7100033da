"""A motor that is driven by its current: no back EMF brakes it, so that an effect too small to see
0.25 s after a restart is seen later.
"""

import numpy as np
import pytest

from vgroove import _core
from vgroove.gap import diagnose
from vgroove.gap.residual.loading import load_problem
from vgroove.gap.residual.restarts import usual_restart_s
from vgroove.gap.simulate import compute_gap
from vgroove.log import Log
from vgroove.rig import Rig, rig_from_dict
from vgroove.units import RPM_PER_RAD_S

ROW_S, LASTS_S, NOISE_RPM = 0.01, 4.0, 2.0
SERVO = {
    "schema": "vgroove.rig/1",
    "name": "servo drive with a flywheel",
    "input": {"kind": "current_a"},
    "motor": {
        "resistance_ohm": 0.5,
        "inductance_h": 1e-4,
        "torque_constant_nm_per_a": 0.4,
        "inertia_kg_m2": 0.15,
        "viscous_nm_s_per_rad": 0.01,
        "coulomb_nm": 0.0,
    },
    "gearbox": {"ratio": 1.0, "output_inertia_kg_m2": 0.0},
    "mechanism": {"kind": "none"},
    "load": {"kind": "none"},
    "sensors": {"log_hz": 100, "speed_noise_rpm": NOISE_RPM, "speed_lsb_rpm": 0.1},
}


def servo(**effects: dict) -> Rig:
    """Rig of the drive SERVO with entries of its table [effects]."""
    return rig_from_dict(SERVO | {"effects": effects}, "the test's drive")


def servo_log(tool: Rig, seed: int) -> Log:
    """A log of the drive under currents that change their sign four times."""
    rng = np.random.default_rng(seed)
    time_s = ROW_S * np.arange(1 + round(LASTS_S / ROW_S))
    current = 3.0 * np.sign(np.sin(2.0 * np.pi * (time_s + 0.05) / 1.7))
    current *= np.interp(time_s, [0.0, 1.0, LASTS_S], rng.uniform(0.6, 1.0, 3))
    drive = _core.LogInput(time_s, "current_a", current)
    rows = _core.simulate_log(drive, tool.parameters()[None], np.array([0]), np.zeros((1, 3)))
    speed = rows["speed_rad_s"][0] * RPM_PER_RAD_S
    noisy = np.round(speed + NOISE_RPM * rng.standard_normal(len(time_s)), 1)
    return Log(time_s, {"current_a": current, "speed_rpm": noisy}, "drive")


def gap_of(rig: Rig, log: Log, restart_s: float | None = None) -> float:
    """Gap between a log and the simulation of a rig that restarts every restart_s seconds (None: at
    the interval that a diagnosis uses).
    """
    return compute_gap(rig, [log], restart_s=restart_s)[0]["gap"]


@pytest.mark.parametrize(
    ("drives_speed", "lasts_s", "wanted_s"),
    [(False, 60.0, 0.25), (True, 0.9, 0.25), (True, 3.0, 0.75), (True, 60.0, 1.0)],
)
def test_only_the_speed_under_a_given_current_is_simulated_longer(
    drives_speed: bool, lasts_s: float, wanted_s: float
) -> None:
    assert usual_restart_s(drives_speed, lasts_s) == wanted_s


def test_an_angle_alone_is_simulated_as_under_a_voltage() -> None:
    """Without a speed column the interval is that of a voltage-driven motor, here 32 rows: the
    error of a simulated angle grows with the time since the restart.
    """
    log = servo_log(servo(), 1)
    turned = np.cumsum(log.columns["speed_rpm"] / RPM_PER_RAD_S) * ROW_S
    alone = Log(log.time_s, {"current_a": log.columns["current_a"], "position_rad": turned}, "a")
    shorter = load_problem([alone], servo()).restart_s
    assert shorter == pytest.approx(32.0 * ROW_S)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_friction_that_acts_slowly_is_named(seed: int) -> None:
    """It would not be visible over 0.25 s."""
    tool, given = servo(coulomb_friction={"torque_nm": 0.06}), servo()
    log = servo_log(tool, seed)
    verdict = diagnose([log], given)
    assert verdict.selected == ["coulomb_friction"]
    torque = verdict.effects[0].parameters["torque_nm"]
    assert torque.ci95[0] < 0.06 < torque.ci95[1]
    assert verdict.gap.restart_s == 1.0
    assert gap_of(given, log, 0.25) - gap_of(tool, log, 0.25) < 0.1
    assert gap_of(given, log) - gap_of(tool, log) > 0.2


def drawn_drive(seed: int, inertia_error: float = 0.0) -> tuple[Log, Rig]:
    """A log of a drive whose inertia, frictions, noise, row interval, length and current are drawn
    from ranges, and its rig; the drive has a larger inertia by a share inertia_error.
    """
    rng = np.random.default_rng(seed)
    inertia = float(np.exp(rng.uniform(np.log(1e-3), np.log(0.3))))
    torque_nm = float(rng.uniform(30.0, 60.0) * inertia)
    row_s, noise_rpm = float(rng.choice([0.002, 0.005, 0.01, 0.02])), float(rng.uniform(0.5, 5.0))
    motor = SERVO["motor"] | {
        "inertia_kg_m2": inertia,
        "viscous_nm_s_per_rad": float(inertia * rng.uniform(0.02, 1.0)),
        "coulomb_nm": 0.05 * torque_nm,
    }
    sensors = {"log_hz": 1.0 / row_s, "speed_noise_rpm": noise_rpm, "speed_lsb_rpm": 0.1}
    given = rig_from_dict(SERVO | {"motor": motor, "sensors": sensors}, "a drawn drive")
    tool = given.with_effects({"added_inertia": {"kg_m2": inertia_error * inertia}})
    time_s = row_s * np.arange(round(rng.uniform(1.5, 8.0) / row_s))
    wave = np.sin(2.0 * np.pi * rng.uniform(0.3, 1.5) * time_s + rng.uniform(0.0, 6.0))
    current = np.round(torque_nm / 0.4 * (np.sign(wave) if seed % 2 else wave), 3)
    drive = _core.LogInput(time_s, "current_a", current)
    rows = _core.simulate_log(drive, tool.parameters()[None], np.array([0]), np.zeros((1, 3)))
    speed = rows["speed_rad_s"][0] * RPM_PER_RAD_S
    noisy = np.round(speed + noise_rpm * rng.standard_normal(len(time_s)), 1)
    return Log(time_s, {"current_a": current, "speed_rpm": noisy}, "drawn"), given


@pytest.mark.parametrize("seed", range(8))
def test_a_true_drive_has_no_gap(seed: int) -> None:
    log, given = drawn_drive(seed)
    assert diagnose([log], given).verdict == "none"


@pytest.mark.parametrize("seed", range(4))
def test_an_inertia_is_named_or_is_a_rival(seed: int) -> None:
    """Under a given current a torque constant changes the motion as an inertia does."""
    log, given = drawn_drive(seed, 0.08)
    verdict = diagnose([log], given)
    assert "added_inertia" in {*verdict.selected, *(r.id for r in verdict.indistinguishable)}


def test_the_true_drive_leaves_noise_alone() -> None:
    """The normalised residuals of the correct model have an RMS of 1, although each restart begins
    with a measured speed whose standard deviation is about half of the sensor's.
    """
    gaps = []
    for seed in range(20):
        problem = load_problem([servo_log(servo(), seed)], servo())
        gaps.append(problem.gap(problem.residuals(problem.theta0)[0]))
    start_sigma = problem.runs[0].restarts.speed_sigma * RPM_PER_RAD_S
    assert np.median(start_sigma[1:]) > 0.4 * NOISE_RPM
    assert np.mean(gaps) == pytest.approx(1.0, abs=0.04) and np.std(gaps) < 0.1


@pytest.mark.parametrize("torque_nm", [0.06, 0.8])
def test_the_corrected_drive_has_the_gap_of_the_refit(torque_nm: float) -> None:
    log = servo_log(servo(coulomb_friction={"torque_nm": torque_nm}), 1)
    verdict = diagnose([log], servo())
    assert gap_of(verdict.corrected_rig(), log) == pytest.approx(verdict.gap.refit, rel=0.01)
