"""Logs that differ from usual ones in what does not matter: the zero of time and angle, stamps
since 1970, one log at rest beside a moving one, slow rows, noise of a driving current that no rig
states.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from made_log import rig
from test_gap_current_driven import SERVO, gap_of, servo, servo_log
from vgroove import _core
from vgroove.gap.cleaning.clock import row_times
from vgroove.gap.cleaning.long_logs import reduce_long_logs
from vgroove.gap.residual.input_uncertainty import full_volt
from vgroove.gap.residual.loading import load_problem
from vgroove.gap.selection.model_comparison import make_blocks
from vgroove.gap.verdict.covariates import HEAT_TIME_S, heat
from vgroove.log import Log
from vgroove.rig import rig_from_dict


@pytest.mark.parametrize("noise_a", [0.0, 0.3, 1.5])
def test_the_noise_of_a_driving_current_need_not_be_stated(noise_a: float) -> None:
    log = servo_log(servo(), 3)
    rng = np.random.default_rng(4)
    log.columns["current_a"] = log.columns["current_a"] + noise_a * rng.standard_normal(len(log))
    assert gap_of(servo(), log) < 1.3


def test_a_full_duty_is_the_measured_bus() -> None:
    data = SERVO | {"input": {"kind": "duty", "bus": "measured"}}
    tool = rig_from_dict(data | {"bridge": {"pwm_hz": 20000}}, "a rig without supply")
    columns = {"supply_v": np.r_[np.full(500, 17.9), np.full(5, 40.0), np.nan]}
    assert full_volt(tool, columns) == pytest.approx(17.9)
    assert full_volt(servo(), columns) == 1.0


def encoder_log(current: np.ndarray, step_rad: float) -> Log:
    """Log of the drive with its angle in steps of an encoder alone."""
    time_s = 0.01 * np.arange(len(current))
    drive = _core.LogInput(time_s, "current_a", current)
    rows = _core.simulate_log(drive, servo().parameters()[None], np.array([0]), np.zeros((1, 3)))
    angle = step_rad * np.floor(rows["angle_rad"][0] / step_rad)
    return Log(time_s, {"current_a": current, "position_rad": angle}, "encoder")


def test_a_log_at_rest_beside_a_moving_one_is_compared() -> None:
    tool, step_rad = rig(sensors={"hall_pulses_per_rev": 0}), 2.0 * np.pi / 24
    time_s = 0.01 * np.arange(400)
    duty = np.where(np.arange(400) % 100 < 60, 0.4, 0.15)
    drive = _core.LogInput(time_s, "duty", duty)
    rows = _core.simulate_log(drive, tool.parameters()[None], np.array([0]), np.zeros((1, 3)))
    angle = step_rad * np.floor(rows["angle_rad"][0] / step_rad)
    columns = {"duty": duty, "current_a": rows["current_a"][0], "position_rad": angle}
    stalled = {"duty": 0.1 * duty, "current_a": 1.8 * duty / 0.19, "position_rad": 0.0 * angle}
    logs = [Log(time_s, columns, "moving"), Log(time_s, stalled, "at rest")]
    problem = load_problem(logs, tool)
    assert np.isfinite(problem.residuals(problem.theta0)).all()


@pytest.mark.parametrize("zero_rad", [0.0, 5e3, -1e6])
def test_the_size_of_an_angle_does_not_depend_on_its_zero(zero_rad: float) -> None:
    log = encoder_log(3.0 * np.sign(np.sin(np.arange(400) / 30.0)), 2.0 * np.pi / 24)
    log.columns["position_rad"] = log.columns["position_rad"] + zero_rad
    problem = load_problem([log], servo())
    assert problem.signals[0].unit == "rad"
    found = problem.rms_by_signal()["position_rad"]
    motion = log.columns["position_rad"] - log.columns["position_rad"][0]
    assert found == pytest.approx(float(np.sqrt(np.mean(motion**2))), rel=0.2)


@pytest.mark.parametrize("start_s", [0.0, 1e6, 1.7e9])
def test_rounded_stamps_are_recognised_wherever_time_begins(start_s: float) -> None:
    even = np.arange(1, 401) / 300.0
    stamps = start_s + np.round(even, 3)
    assert row_times(stamps) - start_s == pytest.approx(even, abs=1e-4)


def test_heat_follows_its_law_for_rows_of_any_interval() -> None:
    for row_s in (0.001, 0.5, 6.0, 60.0):
        time_s = row_s * np.arange(200)
        found = heat(np.full(200, 10.0), time_s)
        expected = 100.0 * HEAT_TIME_S * (1.0 - np.exp(-time_s / HEAT_TIME_S))
        assert found == pytest.approx(expected, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("start_s", [0.0, -5.0, -20.0, 3.0])
def test_bootstrap_blocks_of_two_logs_are_apart_wherever_time_begins(start_s: float) -> None:
    time_s = np.tile(start_s + 0.01 * np.arange(1000), 2)
    log = np.repeat([0, 1], 1000)
    none = np.zeros(2000, int)
    rows = SimpleNamespace(log=log, signal=none, time_s=time_s, censored=none == 1)
    blocks = make_blocks(rows, none == 0, 0.5, 0)
    assert len(blocks.rows) == 40
    assert not set(blocks.cluster[log == 0]) & set(blocks.cluster[log == 1])


def test_a_reduced_log_is_not_reduced_again() -> None:
    time_s = 0.004 * np.arange(200_000)
    current = 3.0 * np.sign(np.sin(time_s / 7.0))
    log = Log(time_s, {"current_a": current, "speed_rpm": 10.0 * np.sin(time_s)}, "long")
    [once] = reduce_long_logs([log], servo(), 20_000)
    assert len(once.time_s) < 40_000
    [again] = reduce_long_logs([once], servo(), 5_000)
    assert again is once
