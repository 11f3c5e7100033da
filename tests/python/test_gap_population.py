"""Populations of points on a cost with jumps and with a second limit cycle: they find the true
values of the tolerated keys, wherever these lie within the tolerances. Gauss-Newton steps alone,
from the rig's values, mostly end in the wrong limit cycle.
"""

from dataclasses import replace

import numpy as np
import pytest

from gap_toy import RIG, SCALES, Toy
from vgroove.gap.catalogue import BY_ID
from vgroove.gap.fitting.engine import Engine
from vgroove.gap.fitting.hypothesis import log_sigma
from vgroove.gap.fitting.population import lowest_start, start_near
from vgroove.gap.residual.restart_angles import RestartAngles
from vgroove.gap.selection import search_state
from vgroove.gap.selection.options import DiagnosisOptions

KEYS = sorted(RIG)
TOLERANCE = dict.fromkeys(KEYS, 0.05)
# distance from the truth, over all keys together, within which the tool settles on the log's cycle
CYCLE_SD = 2.0
JUMP_SIGMAS, JUMP_SD = 1.5, 0.05  # single blows: height, and distance between two jumps


class SeveralCycles(Toy):
    """Residuals in proportion to the distance from the true values of the tolerated keys, with
    jumps; far from these another limit cycle, in which all slopes are others.
    """

    sigma_is_bound, difference_factor = True, 4.0

    def __init__(self, seed: int) -> None:
        super().__init__({})
        rng = np.random.default_rng(seed)
        self.rows = 60
        self.truth = np.clip(rng.standard_normal(len(KEYS)), -2.0, 2.0)
        self.slopes, self.others = rng.standard_normal((2, len(KEYS), self.rows))
        self.noise = rng.standard_normal(self.rows)

    def away(self, theta: np.ndarray) -> np.ndarray:
        """Difference of the tolerated keys from their true values, in standard deviations of the
        tolerance (B, keys).
        """
        columns = [self.index(key) for key in KEYS]
        ratio = np.log(np.atleast_2d(theta)[:, columns] / self.theta0[columns])
        return ratio / log_sigma(0.05) - self.truth

    def residuals(self, theta: np.ndarray, angles: RestartAngles | None = None) -> np.ndarray:
        """Residuals (B, n), of which the first few depend on theta."""
        away = self.away(theta)
        jumps = JUMP_SIGMAS * np.sin(np.floor(away / JUMP_SD) * 12.9898)
        same = 4.0 * away @ self.slopes + jumps @ self.slopes / len(KEYS)
        other = 40.0 + 10.0 * away @ self.others
        far = np.linalg.norm(away, axis=1) > CYCLE_SD
        found = np.zeros((len(away), self.n))
        found[:, : self.rows] = self.noise + np.where(far[:, None], other, same)
        return found


def engine_of(seed: int) -> Engine:
    """The engine of a problem whose true values are drawn."""
    return Engine(SeveralCycles(seed), SCALES, TOLERANCE)


@pytest.mark.parametrize("seed", range(4))
def test_the_cycle_of_the_log_is_found_from_the_rigs_values(seed: int) -> None:
    engine = engine_of(seed)
    found = search_state.begin(engine, [BY_ID["brush_drop"]], DiagnosisOptions()).retuned
    away = engine.problem.away(found.theta(engine.problem.theta0)[None])
    assert np.abs(away).max() < 0.3


def test_gauss_newton_steps_alone_end_in_another_cycle() -> None:
    missed = 0
    for seed in range(5):
        engine = engine_of(seed)
        (one,) = engine.fit(engine.hypotheses([]))
        away = engine.problem.away(one.theta(engine.problem.theta0)[None])
        missed += np.abs(away).max() > 0.3
    assert missed >= 3


def test_a_population_around_a_fit_leaves_a_poor_minimum() -> None:
    """The fit lies in the wrong limit cycle, its distance from the true values a quarter more than
    that of the border between the two.
    """
    way = (-1.0) ** np.arange(len(KEYS)) / np.sqrt(len(KEYS))
    for seed in range(4):
        engine = engine_of(seed)
        (plain,) = engine.hypotheses([])
        (one,) = engine.fit([replace(plain, start=engine.problem.truth + 1.25 * CYCLE_SD * way)], 0)
        near = start_near(engine, one, 7)
        assert engine.fit([near], 0)[0].cost < 0.1 * one.cost
        (again,) = engine.fit([near])
        assert again.cost < 0.1 * one.cost
        assert np.abs(again.x - engine.problem.truth).max() < 0.3


def test_the_same_seed_finds_the_same_start_within_the_bounds() -> None:
    engine = engine_of(3)
    (plain,) = engine.hypotheses([])
    one, again = (lowest_start(engine, plain, 7).start for _ in range(2))
    np.testing.assert_array_equal(one, again)
    assert np.all((plain.low <= one) & (one <= plain.high))


def test_a_problem_that_is_smooth_in_its_parameters_has_no_population() -> None:
    toy = Toy({"motor.coulomb_nm": 0.013})
    engine = Engine(toy, SCALES, {"motor.coulomb_nm": 0.1})
    search_state.begin(engine, [BY_ID["brush_drop"]], DiagnosisOptions())
    assert engine.calls < 30
