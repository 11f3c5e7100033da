"""Estimated noise of a sensor in several logs: a log in which its column is constant does not show
the noise, and takes it from the other logs.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import savgol_filter

from made_log import MadeLog, rig
from vgroove.gap.cleaning.sensor_noise import SensorNoise, common_noise, savitzky_golay
from vgroove.gap.residual.clean_log import CleanLog, clean_log, with_common_noise
from vgroove.gap.residual.loading import load_problem
from vgroove.gap.simulate import compute_gap
from vgroove.rig import Rig

ROWS, HZ = 400, 500.0
UNSTATED = rig(sensors={"log_hz": HZ, "hall_pulses_per_rev": 0})
del UNSTATED.sensors["current_noise_a"]


def made(current_sigma: float, speed_sigma: float, rows: int = ROWS, seed: int = 0) -> MadeLog:
    """A log of a motor at standstill: white noise of these standard deviations, A and rpm."""
    rng = np.random.default_rng(seed)
    columns = {
        "duty": np.zeros(rows),
        "current_a": rng.normal(0.0, current_sigma, rows),
        "speed_rpm": rng.normal(0.0, speed_sigma, rows),
    }
    return MadeLog(np.arange(rows) / HZ, columns)


def cleaned(tool: Rig, *logs: MadeLog) -> list[CleanLog]:
    return with_common_noise([clean_log(log, tool) for log in logs])


def sigmas(name: str, *logs: CleanLog) -> list[float]:
    return [log.noise[name].sigma for log in logs]


@settings(max_examples=200, deadline=None)
@given(
    st.lists(st.floats(-1e4, 1e4), min_size=11, max_size=60),
    st.sampled_from([(11, 3), (5, 2)]),
    st.booleans(),
)
def test_the_noise_filter_is_that_of_scipy(
    drawn: list[float], filter_: tuple[int, int], is_constant: bool
) -> None:
    """To the last bit, also where a column repeats its values."""
    values = np.repeat(drawn, 5) if is_constant else np.array(drawn)
    assert np.array_equal(savitzky_golay(values, *filter_), savgol_filter(values, *filter_))


def test_a_log_at_rest_has_the_least_noise_that_another_one_shows() -> None:
    logs = made(0.5, 20.0), made(0.5, 0.0, seed=1), made(0.5, 60.0, seed=2)
    own = sigmas("speed_rpm", *(clean_log(log, UNSTATED) for log in logs))
    found = sigmas("speed_rpm", *cleaned(UNSTATED, *logs))
    assert own[1] < 1.0 < own[0] < own[2]
    assert found == [own[0], own[0], own[2]]


def test_motion_in_one_log_hides_nothing_in_another() -> None:
    """The estimate takes the current's steps, a new value every four rows, for noise."""
    steady, moving = made(0.05, 5.0), made(0.05, 5.0, seed=1)
    moving.columns["current_a"] += np.repeat(np.random.default_rng(3).normal(0, 9, ROWS // 4), 4)
    one, other = sigmas("current_a", *cleaned(UNSTATED, steady, moving))
    assert one == pytest.approx(0.05, rel=0.2)
    assert other > 1.0


@pytest.mark.parametrize("rows", [16, 19, 21])
def test_a_log_of_few_samples_has_the_noise_of_the_others(rows: int) -> None:
    short, long = cleaned(UNSTATED, made(0.5, 20.0, rows), made(0.5, 20.0, seed=1))
    assert np.isfinite(short.noise["current_a"].sigma)
    assert short.noise["current_a"].is_seen is (rows > 20)
    if rows < 20:
        assert sigmas("current_a", short, long) == [long.noise["current_a"].sigma] * 2


def test_where_no_log_shows_a_noise_the_resolution_stays() -> None:
    quiet = SensorNoise(0.3, False)
    assert common_noise([{"speed_rpm": quiet}, {}]) == [{"speed_rpm": quiet}, {}]


def test_a_stated_noise_and_resolution_are_kept() -> None:
    tool = rig(sensors={"log_hz": HZ, "hall_pulses_per_rev": 0, "speed_noise_rpm": 7.0})
    for log in cleaned(tool, made(0.5, 20.0), made(5.0, 0.0, seed=1)):
        assert log.noise["current_a"].sigma == pytest.approx(np.hypot(0.15, 0.1 / np.sqrt(12.0)))
        assert log.noise["speed_rpm"].sigma == pytest.approx(np.hypot(7.0, 0.5 / np.sqrt(12.0)))


@pytest.mark.parametrize("column", ["current_a", "speed_rpm", "supply_v", "position_rad"])
def test_a_column_without_a_value_is_not_judged(column: str) -> None:
    log = made(0.5, 20.0)
    log.columns[column] = np.full(ROWS, np.nan)
    judged = {signal.column for signal in load_problem([log], UNSTATED).signals}
    assert judged == {"current_a", "speed_rpm"} - {column}
    assert np.isfinite(compute_gap(UNSTATED, [log])[0]["gap"])


def test_the_residuals_of_a_log_at_rest_do_not_outweigh_the_others() -> None:
    problem = load_problem([made(0.5, 20.0), made(0.5, 0.0, seed=1)], UNSTATED)
    speed = problem.signal == [s.column for s in problem.signals].index("speed_rpm")
    shown, raised = (np.median(problem.sigma[speed & (problem.log == k)]) for k in (0, 1))
    assert raised == pytest.approx(shown)
