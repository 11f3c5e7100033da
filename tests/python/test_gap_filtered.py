"""A filtered edge speed holds no edge periods: it is compared over the pitch before each row, and
its lag is identified.
"""

import numpy as np
import pytest

from made_log import MadeLog, drive_log, rig
from vgroove.gap.residual.loading import load_problem


def filtered(log: MadeLog, lag_s: float) -> MadeLog:
    """The log with a first-order filter behind its speed."""
    speed, keep, out, value = log.columns["speed_rpm"], np.exp(-1e-3 / lag_s), [], 0.0
    for sample in speed:
        value = sample + (value - sample) * keep
        out.append(value)
    return MadeLog(log.time_s, {**log.columns, "speed_rpm": np.round(np.array(out) / 0.5) * 0.5})


def gap_at(problem: object, lag_s: float) -> float:
    """Gap of the model with that speed lag."""
    theta = problem.theta0.copy()
    theta[problem.index("effects.speed_lag.time_constant_s")] = lag_s
    return problem.gap(problem.residuals(theta)[0])


@pytest.mark.parametrize("lag_s", [0.002, 0.004])
def test_the_lag_of_a_filtered_edge_speed_is_identified(lag_s: float) -> None:
    problem = load_problem([filtered(drive_log(rig()), lag_s)], rig())
    assert any("filtered" in warning for warning in problem.warnings)
    speed = problem.signal == [s.column for s in problem.signals].index("speed_rpm")
    # sigmas from a broken chain of edges would give the speed no weight
    assert np.median(problem.sigma[speed]) < 30.0
    assert gap_at(problem, lag_s) < 1.15 < 1.3 < gap_at(problem, 0.0)
    assert gap_at(problem, lag_s) < gap_at(problem, 2.0 * lag_s)


def test_an_unfiltered_speed_is_compared_over_its_edge_periods() -> None:
    problem = load_problem([drive_log(rig())], rig())
    assert next(s for s in problem.signals if s.column == "speed_rpm").edges
    assert not any("filtered" in warning for warning in problem.warnings)


def test_noise_of_a_driving_voltage_leaves_no_gap() -> None:
    tool = rig(input={"kind": "voltage_v", "slew_per_s": 110.0})
    log = drive_log(tool)
    volt = log.columns["voltage_v"] + 0.05 * np.random.default_rng(5).standard_normal(
        len(log.time_s)
    )
    log = MadeLog(
        log.time_s, {**{k: v for k, v in log.columns.items() if k != "supply_v"}, "voltage_v": volt}
    )
    problem = load_problem([log], tool)
    assert problem.gap(problem.residuals(problem.theta0)[0]) < 1.1
