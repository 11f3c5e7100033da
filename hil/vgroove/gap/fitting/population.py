"""Looks for the lowest minimum of a rough cost by populations of points, where a gradient does not
lead to it: a hammering tool has a minimum for each limit cycle, and single blows make its
statistics jump within short steps.

Points from the prior show the basins. In the lowest ones a population is moved: a linear model of
the residuals is fitted to its best points, as in ensemble Kalman inversion (M. Iglesias, K. Law,
A. Stuart, Inverse Problems 29 (2013) 045001), so that a slope is one over the scatter of the
points; the next points are Levenberg-Marquardt steps by that model, and draws around these.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vgroove.gap.fitting.engine import FINAL_HUBER_SIGMAS, Engine
from vgroove.gap.fitting.hypothesis import Fit, Hypothesis
from vgroove.gap.residual.huber import huber_weight


@dataclass(frozen=True)
class PopulationRules:
    """Sizes of the populations and of their moves; chosen on simulated runs."""

    drawn: int = 128  # points from the prior
    basins: int = 3  # of least cost of these, around each of which a population is moved
    members: int = 32  # points of a population
    rounds: int = 6  # moves of a population
    rounds_near: int = 3  # of one around a fit
    # of its first points: in standard deviations of the prior, and of the size of an effect in
    # sizes, at least in typical ones
    spread: float = 0.5
    of_size: float = 1.0
    # best points that the linear model is fitted to, or `more` than parameters where that is more
    kept: int = 24
    more: int = 6
    # ridge of the linear model's slopes, in squared deviations over the scatter of the points
    ridge: float = 0.1
    # of Levenberg-Marquardt steps, in squared sigma over the scatter of the points
    damping: tuple[float, ...] = (0.3, 3.0, 30.0, 300.0)
    # of the draws around the best point, and around the steps, over the scatter of the points
    around_best: float = 0.8
    around_steps: float = 0.4
    least_scatter: float = 0.01  # of the points, in standard deviations or typical sizes
    max_residual: float = 1e3  # sigma: larger ones would dominate the linear model


RULES = PopulationRules()


@dataclass(frozen=True)
class Point:
    """Coordinates (p,), residuals (n,) and the cost at one point."""

    x: np.ndarray
    residual: np.ndarray
    cost: float


def lowest_start(engine: Engine, hypothesis: Hypothesis, seed: int) -> Hypothesis:
    """The hypothesis, all of whose coordinates have a standard normal prior, started at the point
    of least cost that the populations find; its own start is among their points.
    """
    return _Populations(engine, hypothesis, np.random.default_rng(seed)).started_lowest()


def start_near(engine: Engine, one: Fit, seed: int) -> Hypothesis:
    """The hypothesis of a fit, started at the point of least cost that a population around the fit
    finds.
    """
    populations = _Populations(engine, one.hypothesis, np.random.default_rng(seed))
    return replace(one.hypothesis, start=populations.moved(one.x, RULES.rounds_near).x)


class _Populations:
    """Populations of one hypothesis; the cost has the Huber threshold of residuals near the noise,
    the same for all points.
    """

    def __init__(self, engine: Engine, hypothesis: Hypothesis, rng: np.random.Generator) -> None:
        self.engine, self.hypothesis, self.rng = engine, hypothesis, rng
        self.p = len(hypothesis.start)
        self.kept = max(self.p + RULES.more, RULES.kept)
        self.alike: Fit = replace(engine.fit([hypothesis], 0)[0], delta=FINAL_HUBER_SIGMAS)

    def started_lowest(self) -> Hypothesis:
        """The hypothesis started at the lowest point of all populations."""
        scatter = self.rng.standard_normal((RULES.drawn, self.p))
        drawn = self.simulated(np.vstack([self.hypothesis.start, scatter[1:]]))
        ends = [self.moved(basin.x, RULES.rounds) for basin in drawn[: RULES.basins]]
        return replace(self.hypothesis, start=min(ends, key=lambda end: end.cost).x)

    def moved(self, x: np.ndarray, rounds: int) -> Point:
        """The lowest point of the population that begins around coordinates (p,)."""
        sizes = RULES.of_size * np.maximum(1.0, np.abs(x))
        spread = np.where(self.hypothesis.prior > 0.0, RULES.spread, sizes)
        drawn = spread * self.rng.standard_normal((RULES.members - 1, self.p))
        best = self.lowest(self.simulated(np.vstack([x, x + drawn])))
        for _ in range(rounds):
            best = self.lowest([*best, *self.simulated(self.next_points(best))])
        return best[0]

    def lowest(self, points: Sequence[Point]) -> list[Point]:
        """The kept points, in the order of their costs."""
        return sorted(points, key=lambda point: point.cost)[: self.kept]

    def simulated(self, x: np.ndarray) -> list[Point]:
        """Points at coordinates (k, p), moved into the bounds, in the order of their costs."""
        x = np.clip(x, self.hypothesis.low, self.hypothesis.high)
        rows = self.engine.residuals([(self.hypothesis, x)])
        points = [
            Point(one, row, self.engine.cost(self.alike, one, row))
            for one, row in zip(x, rows, strict=True)
        ]
        return sorted(points, key=lambda point: point.cost)

    def next_points(self, best: Sequence[Point]) -> np.ndarray:
        """The next points (members, p): the steps from the best point, and draws around it and
        around them.
        """
        x = np.array([point.x for point in best])
        scatter = np.maximum(x.std(axis=0), RULES.least_scatter)
        steps = self.steps(best[0], self.slopes(best, scatter), scatter)
        count = RULES.members - len(steps)
        of_best = np.tile(x[0], (count // 2, 1))
        of_steps = steps[self.rng.integers(len(steps), size=count - len(of_best))]
        share = np.repeat([RULES.around_best, RULES.around_steps], [len(of_best), len(of_steps)])
        drawn = share[:, None] * scatter * self.rng.standard_normal((count, self.p))
        return np.vstack([steps, np.vstack([of_best, of_steps]) + drawn])

    def slopes(self, best: Sequence[Point], scatter: np.ndarray) -> np.ndarray:
        """Slopes (n, p) of the residuals by the coordinates, from the best points: a regression in
        which a point of higher cost has less weight.
        """
        limit, least = RULES.max_residual, np.finfo(float).tiny
        residual = np.clip([p.residual for p in best], -limit, limit)
        x, cost = np.array([p.x for p in best]), np.array([p.cost for p in best])
        change, design = residual - residual[0], (x - x[0]) / scatter
        weight = 1.0 / (1.0 + cost / max(cost[0], least))
        normal = (design.T * weight) @ design + RULES.ridge * np.eye(self.p)
        return np.linalg.solve(normal, (design.T * weight) @ change).T / scatter

    def steps(self, first: Point, slopes: np.ndarray, scatter: np.ndarray) -> np.ndarray:
        """Points (K, p) after a step from the best point with each damping, by slopes (n, p)."""
        prior = self.hypothesis.prior
        weighted = slopes.T * huber_weight(first.residual, FINAL_HUBER_SIGMAS)
        normal, gradient = weighted @ slopes, weighted @ first.residual + prior * first.x
        own = [np.diag(prior + damping / scatter**2) for damping in RULES.damping]
        return np.array([first.x - np.linalg.solve(normal + each, gradient) for each in own])
