"""Out-of-fold residuals of a fit: each block of the log predicted by a Newton step, from the fit of
all rows, to the optimum of the other folds, and simulated there.

Method: approximate cross-validation by one Newton step for each fold (Rahnama Rad and Maleki,
Journal of the Royal Statistical Society B 82 (2020) 965). Where the residuals jump (a ripple torque
that stops the shaft) the step and its fractions may all raise the cost of the fold's training rows.
Then points around the fit are simulated, and the fold takes the one of least cost on its training
rows; the block that is to be predicted is not among these rows.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from vgroove.gap.fitting.engine import Engine
from vgroove.gap.fitting.hypothesis import Fit
from vgroove.gap.fitting.neighbour_points import GRID_HALF_WIDTHS, ripple_neighbours
from vgroove.gap.fitting.steps import points_along

MAX_SHORTENINGS = 2  # of a fold's step that raises the cost of the fold's training rows
SHORTENING = 0.3  # factor of each

FoldStep = tuple[Fit, int, np.ndarray]  # a fit, the index of a fold and the step (p,) of the fold


def predict_held_out(engine: Engine, fits: Sequence[Fit]) -> None:
    """Replace the first-order out-of-fold residuals of fits by simulated ones, fold by fold; all
    columns of the Jacobians are computed at the fit.
    """
    todo = [f for f in fits if not f.exact]
    if not todo:
        return
    engine.differentiate(todo, fresh=True)
    for one in todo:
        one.fold_steps = engine.fold_steps(one)
    failed = [(one, k, step) for one in todo for k, step in enumerate(one.fold_steps)]
    for n in range(1 + MAX_SHORTENINGS):
        steps = [(one, k, SHORTENING * step if n else step) for one, k, step in failed]
        failed = list(take_fold_steps(engine, steps))
    for one in todo:
        predict_at_best_point(engine, one, [k for other, k, _ in failed if other is one])
        one.exact = True


def take_fold_steps(engine: Engine, steps: Sequence[FoldStep]) -> Iterator[FoldStep]:
    """Predict each fold's block at its step; yields the steps that raise the cost of the fold's
    training rows.
    """
    jobs = [(one.hypothesis, (one.x + step)[None, :]) for one, _, step in steps]
    for (one, k, step), (row,) in zip(steps, engine.residuals_of_jobs(jobs), strict=True):
        train, test = engine.problem.folds[k]
        one.out_of_fold[test], one.fold_steps[k] = row[test], step
        before = engine.cost(one, one.x, one.residual, train)
        if engine.cost(one, one.x + step, row, train) > before + engine.converged_gain(one):
            yield one, k, step


def predict_at_best_point(engine: Engine, one: Fit, folds: Sequence[int]) -> None:
    """Predict the blocks of these folds at the point of least cost on each fold's training rows,
    out of the points around the fit and the fit itself.
    """
    if not folds:
        return
    points = points_around(one)
    least = np.full(len(engine.problem.folds), np.inf)
    rows = engine.residuals_of_jobs([(one.hypothesis, x[None, :]) for x in points])
    for x, (row,) in zip(points, rows, strict=True):
        for k in folds:
            train, test = engine.problem.folds[k]
            cost = engine.cost(one, x, row, train)
            if cost < least[k]:
                least[k], one.out_of_fold[test] = cost, row[test]
                one.fold_steps[k] = x - one.x


def points_around(one: Fit) -> np.ndarray:
    """Points (k, p) around a fit, itself the first: the square grids of ripple_neighbours(), and
    each number one difference step up and down.
    """
    steps = one.hypothesis.steps_at(one.x)
    points = [
        one.x[None, :],
        *(ripple_neighbours(one, half_width) for half_width in GRID_HALF_WIDTHS),
        points_along(one.x, steps),
        points_along(one.x, -steps),
    ]
    return np.clip(np.concatenate(points), one.hypothesis.low, one.hypothesis.high)
