"""What a fit predicts of each block from the other blocks alone: a Newton step from the fit of all
rows, simulated.

Where the model jumps (a ripple that stops the shaft) no part of that step may make the rows better
that it is made from. Then the points around the fit are tried as they are, and each fold takes the
one at which its own rows, the block not among them, leave least.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from vgroove.gap.fitting.fit import Engine, Fit, around
from vgroove.gap.fitting.neighbour_points import SPREADS, ripple_neighbours

SHORTER = 2  # times a fold's step is shortened that makes its own rows worse

Step = tuple[Fit, int, np.ndarray]


def predict_held_out(engine: Engine, fits: Sequence[Fit]) -> None:
    """Replace first-order held-out predictions by simulated ones, fold by fold, and refresh the
    Jacobians.
    """
    todo = [f for f in fits if not f.exact]
    if not todo:
        return
    engine.differentiate(todo, fresh=True)
    astray = [(one, k, step) for one in todo for k, step in enumerate(engine.fold_steps(one))]
    for n in range(1 + SHORTER):
        astray = list(
            stepped(engine, [(one, k, 0.3 * step if n else step) for one, k, step in astray])
        )
    for one in todo:
        fit_around(engine, one, [k for other, k, _ in astray if other is one])
        one.exact = True


def stepped(engine: Engine, steps: Sequence[Step]) -> Iterator[Step]:
    """Predict each fold's block at its step; the steps that make their own rows, of which the
    Jacobian promised a gain, worse.
    """
    jobs = [(one.hypothesis, (one.x + step)[None, :]) for one, _, step in steps]
    for (one, k, step), (row,) in zip(steps, engine.shown(jobs), strict=True):
        train, test = engine.problem.folds[k]
        one.held[test] = row[test]
        if engine.cost(one, one.x + step, row, train) > engine.cost(
            one, one.x, one.residual, train
        ) + engine.enough(one):
            yield one, k, step


def fit_around(engine: Engine, one: Fit, folds: Sequence[int]) -> None:
    """Predict the blocks of these folds at the best point around the fit for each one's own rows,
    the fit's own point one of them.
    """
    if not folds:
        return
    points = near(one)
    least = np.full(len(engine.problem.folds), np.inf)
    for x, (row,) in zip(
        points, engine.shown([(one.hypothesis, x[None, :]) for x in points]), strict=True
    ):
        for k in folds:
            train, test = engine.problem.folds[k]
            cost = engine.cost(one, x, row, train)
            if cost < least[k]:
                least[k], one.held[test] = cost, row[test]


def near(one: Fit) -> np.ndarray:
    """Points (k, p) around a fit, itself the first: rings around its ripples, and each number a
    difference's step up and down.
    """
    steps = np.array(
        [c.step_at(float(x)) for c, x in zip(one.hypothesis.coordinates, one.x, strict=True)]
    )
    points = [
        one.x[None, :],
        *(ripple_neighbours(one, spread) for spread in SPREADS),
        around(one.x, steps),
        around(one.x, -steps),
    ]
    return np.clip(np.concatenate(points), one.hypothesis.low, one.hypothesis.high)
