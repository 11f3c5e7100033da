"""Looks for the global minimum of a cost that has several local minima and jumps, so that gradient
steps end in a poor one: the cost of a hammering tool has a minimum for each limit cycle, and jumps
where a change of its parameters adds or removes a single blow.

Points are drawn from the prior. Around each of the best ones a population of points is moved
several times: a linear model of the residuals is fitted to the best points of the population, as in
ensemble Kalman inversion (M. Iglesias, K. Law, A. Stuart, Inverse Problems 29 (2013) 045001), so
that its slopes are means over the distance between these points. The next points are
Levenberg-Marquardt steps of that model, and random points around the best one and around the steps.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vgroove.gap.fitting.engine import FINAL_HUBER_SIGMAS, Engine
from vgroove.gap.fitting.hypothesis import Fit, Hypothesis
from vgroove.gap.residual.huber import huber_weight


@dataclass(frozen=True)
class PopulationRules:
    """How many points are simulated, how far apart they are drawn, and how the linear model is
    regularised; the values were chosen on simulated runs. The scatter of the points is their
    standard deviation in each coordinate.
    """

    drawn: int = 128  # points from the prior
    populations: int = 3  # each begins around one of the best of these
    members: int = 32  # points that a population simulates in each move
    moves: int = 6  # of a population
    moves_near: int = 3  # of a population that begins around a fit
    # standard deviation of the first points of a population, in standard deviations of the prior;
    # that of the size of an effect is the size itself, at least the typical one
    spread: float = 0.5
    # best points that the linear model is fitted to: so many, or so many more than there are
    # coordinates, whichever is more
    kept: int = 24
    more: int = 6
    ridge: float = 0.1  # of the regression, whose coordinates are in units of the scatter
    # damping factors of the Levenberg-Marquardt steps, in the same units
    damping: tuple[float, ...] = (0.3, 3.0, 30.0, 300.0)
    # standard deviations of the random points around the best point and around the steps, over the
    # scatter
    around_best: float = 0.8
    around_steps: float = 0.4
    least_scatter: float = 0.01  # in standard deviations of the prior or typical sizes
    max_residual: float = 1e3  # sigma: larger ones would dominate the linear model


RULES = PopulationRules()


@dataclass(frozen=True)
class Point:
    """Coordinates (p,), residuals (n,) and the cost at one point."""

    x: np.ndarray
    residual: np.ndarray
    cost: float


def best_first(points: Sequence[Point]) -> list[Point]:
    """The points in the order of their costs."""
    return sorted(points, key=lambda point: point.cost)


def lowest_start(engine: Engine, hypothesis: Hypothesis, seed: int) -> Hypothesis:
    """The hypothesis, all of whose coordinates have a standard normal prior, started at the point
    of least cost among its own start, points from the prior, and the populations around the best.
    """
    (one,) = engine.fit([hypothesis], 0)
    populations = _Populations(engine, one, np.random.default_rng(seed))
    return replace(hypothesis, start=populations.of_prior().x)


def start_near(engine: Engine, one: Fit, seed: int) -> Hypothesis:
    """The hypothesis of a fit, started at the point of least cost among the fit and a population
    around it.
    """
    populations = _Populations(engine, one, np.random.default_rng(seed))
    return replace(one.hypothesis, start=populations.moved(one.x, RULES.moves_near).x)


class _Populations:
    """Populations of the hypothesis of a fit. Their costs can be compared: all have the Huber
    threshold that a fit near the noise has.
    """

    def __init__(self, engine: Engine, one: Fit, rng: np.random.Generator) -> None:
        self.engine, self.hypothesis, self.rng = engine, one.hypothesis, rng
        self.p = len(one.x)
        self.kept = max(self.p + RULES.more, RULES.kept)
        self.near_noise = replace(one, delta=FINAL_HUBER_SIGMAS)

    def of_prior(self) -> Point:
        """The point of least cost of points from the prior and the populations around the best of
        these.
        """
        others = self.rng.standard_normal((RULES.drawn, self.p))[1:]
        drawn = best_first(self.simulated(np.vstack([self.hypothesis.start, others])))
        ends = [self.moved(point.x, RULES.moves) for point in drawn[: RULES.populations]]
        return best_first(ends)[0]

    def moved(self, x: np.ndarray, moves: int) -> Point:
        """The point of least cost of a population that begins around coordinates (p,), which are
        one of its points.
        """
        spread = np.where(self.hypothesis.prior > 0.0, RULES.spread, np.maximum(1.0, np.abs(x)))
        others = x + spread * self.rng.standard_normal((RULES.members - 1, self.p))
        best = best_first(self.simulated(np.vstack([x, others])))[: self.kept]
        for _ in range(moves):
            best = best_first([*best, *self.simulated(self.next_points(best))])[: self.kept]
        return best[0]

    def simulated(self, x: np.ndarray) -> list[Point]:
        """Points at coordinates (k, p), moved into the bounds."""
        x = np.clip(x, self.hypothesis.low, self.hypothesis.high)
        rows = self.engine.residuals([(self.hypothesis, x)])
        return [
            Point(one, row, self.engine.cost(self.near_noise, one, row))
            for one, row in zip(x, rows, strict=True)
        ]

    def next_points(self, best: Sequence[Point]) -> np.ndarray:
        """The next points (members, p): steps of the linear model from the best point, and random
        points around it and around the steps.
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
        """Slopes (n, p) of the residuals by the coordinates: a regression over the best points in
        which one of higher cost has less weight.
        """
        limit, least = RULES.max_residual, np.finfo(float).tiny
        residual = np.clip([p.residual for p in best], -limit, limit)
        x, cost = np.array([p.x for p in best]), np.array([p.cost for p in best])
        change, design = residual - residual[0], (x - x[0]) / scatter
        weight = 1.0 / (1.0 + cost / max(cost[0], least))
        normal = (design.T * weight) @ design + RULES.ridge * np.eye(self.p)
        return np.linalg.solve(normal, (design.T * weight) @ change).T / scatter

    def steps(self, first: Point, slopes: np.ndarray, scatter: np.ndarray) -> np.ndarray:
        """Points (K, p) after a Levenberg-Marquardt step from the best point with each of the K
        damping factors, by slopes (n, p) of the residuals.
        """
        prior = self.hypothesis.prior
        weighted = slopes.T * huber_weight(first.residual, FINAL_HUBER_SIGMAS)
        normal, gradient = weighted @ slopes, weighted @ first.residual + prior * first.x
        own = [np.diag(prior + damping / scatter**2) for damping in RULES.damping]
        return np.array([first.x - np.linalg.solve(normal + each, gradient) for each in own])
