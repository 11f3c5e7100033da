"""Noise of a sensor that measured several logs: one value, of all of them."""

import numpy as np
import pytest

from made_log import MadeLog, rig
from vgroove.gap.cleaning.sensor_noise import pooled_noise
from vgroove.gap.residual.clean_log import CleanLog, clean_log, with_pooled_noise
from vgroove.gap.residual.loading import load_problem
from vgroove.rig import Rig

ROWS, HZ = 400, 500.0
UNSTATED = rig(sensors={"log_hz": HZ, "hall_pulses_per_rev": 0})
del UNSTATED.sensors["current_noise_a"]


def made(current_sigma: float, speed_sigma: float, rows: int = ROWS, seed: int = 0) -> MadeLog:
    """A log of a tool at rest whose columns scatter by these standard deviations."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(rows) / HZ
    columns = {
        "duty": np.zeros(rows),
        "current_a": rng.normal(0.0, current_sigma, rows),
        "speed_rpm": rng.normal(0.0, speed_sigma, rows),
    }
    return MadeLog(time_s, columns)


def cleaned(tool: Rig, *logs: MadeLog) -> list[CleanLog]:
    return with_pooled_noise([clean_log(log, tool) for log in logs])


@pytest.mark.parametrize("ratio", [1.0, 3.0, 100.0])
def test_all_logs_have_the_mean_power_of_the_noise(ratio: float) -> None:
    logs = made(0.5, 20.0), made(0.5, 20.0 / ratio, seed=1)
    own = [clean_log(log, UNSTATED).noise["speed_rpm"] for log in logs]
    one, other = (log.noise["speed_rpm"] for log in cleaned(UNSTATED, *logs))
    assert one == other == pytest.approx(np.sqrt(np.mean(np.square(own))))
    assert one == pytest.approx(20.0 * np.sqrt(0.5 + 0.5 / ratio**2), rel=0.15)


def test_logs_count_by_their_rows() -> None:
    found = pooled_noise(
        [{"current_a": 300}, {"current_a": 100}], [{"current_a": 0.0}, {"current_a": 1.0}]
    )
    assert found == {"current_a": pytest.approx(0.5)}


def test_a_column_that_one_log_lacks_has_the_noise_of_the_others() -> None:
    short = made(0.5, 20.0)
    del short.columns["current_a"]
    one, other = cleaned(UNSTATED, short, made(0.5, 20.0, seed=1))
    assert set(one.noise) == {"speed_rpm"}
    assert other.noise["current_a"] == pytest.approx(0.5, rel=0.15)


def test_a_stated_noise_and_resolution_are_kept() -> None:
    tool = rig(sensors={"log_hz": HZ, "hall_pulses_per_rev": 0, "speed_noise_rpm": 7.0})
    for log in cleaned(tool, made(0.5, 20.0), made(5.0, 0.1, seed=1)):
        assert log.noise["current_a"] == pytest.approx(np.hypot(0.15, 0.1 / np.sqrt(12.0)))
        assert log.noise["speed_rpm"] == pytest.approx(np.hypot(7.0, 0.5 / np.sqrt(12.0)))


def test_the_residuals_of_all_logs_have_one_standard_deviation() -> None:
    """A log of a resting sensor would otherwise have a hundred times the weight of the others."""
    problem = load_problem([made(0.5, 20.0), made(0.005, 0.2, seed=1)], UNSTATED)
    for signal in range(len(problem.signals)):
        sigmas = [problem.sigma[(problem.signal == signal) & (problem.log == k)] for k in (0, 1)]
        assert np.median(sigmas[0]) == pytest.approx(np.median(sigmas[1]))
