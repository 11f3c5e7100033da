"""Gauss-Newton steps of a fit within its bounds, from all training rows and from the rows of each
fold.

Method: Nocedal and Wright, Numerical Optimization, 2006: section 10.3 (Gauss-Newton), section 16.5
(active sets for the bounds). Robust weights: Huber 1964.
"""

import numpy as np

from vgroove.gap.fitting.hypothesis import Fit, Hypothesis
from vgroove.gap.fitting.normal_equations import FoldGroups

# Share of the curvature of all rows that is added to a fold's normal equations as a ridge around
# the step of all rows: it matters only where the fold's rows contain less than this share of the
# information on a number. Chosen on the tuning half of the blind set (docs/gap_bench.md).
FOLD_RIDGE_SHARE = 1e-3
# ridge of a linear system, relative to its diagonal and absolute: without it the system is singular
# where a number has no influence
RIDGE_SHARE, RIDGE = 1e-9, 1e-12
BOUND_SLACK = 1e-12  # violation of a bound that is rounding


def newton_steps(groups: FoldGroups, one: Fit) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Newton steps of the robust cost inside the bounds: over all training rows (p,), and
    over each fold's training rows (folds, p).
    """
    sums = groups.sums(one.jacobian, one.residual, one.delta)
    total = sums.sum(axis=0, where=groups.trained[:, None, None])
    whole = _step(one, total)
    curvature = FOLD_RIDGE_SHARE * total[:, :-1]
    ridge = np.column_stack([curvature, -curvature @ whole])
    by_fold = [
        _step(one, sums[use].sum(axis=0) + ridge, whole) if leaves_out else whole
        for use, leaves_out in zip(groups.trains, groups.leaves_out, strict=True)
    ]
    return whole, np.array(by_fold)


def _step(one: Fit, sums: np.ndarray, whole: np.ndarray | None = None) -> np.ndarray:
    """Step (p,) from J'WJ and J'Wr side by side (p, p + 1) and the priors; whole: the step (p,) of
    all rows, which the local numbers of a fold take.
    """
    h, p = one.hypothesis, len(one.x)
    normal = sums[:, :p].copy()
    normal.flat[:: p + 1] += h.prior
    gradient = sums[:, p] + h.prior * one.x
    low, high = h.low - one.x, h.high - one.x
    if whole is not None:
        low, high = np.where(h.local, whole, low), np.where(h.local, whole, high)
    return bounded_step(normal, gradient, low, high)


def predict_first_order(
    groups: FoldGroups, one: Fit, by_fold: np.ndarray, untested: np.ndarray
) -> np.ndarray:
    """Residuals (n,) to first order: of each row after the step (folds, p) of the fold that tests
    it; of rows that no fold tests after the step untested (p,).
    """
    # index -1 of tested_by (a group that no fold tests) selects the last row, `untested`
    steps = np.vstack([by_fold, untested])[groups.tested_by]
    return groups.moved(one.residual, one.jacobian, steps)


def points_along(x: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Points (k, p) one step (k,) from x (p,) along each of its first k numbers."""
    return x + np.eye(len(steps), len(x)) * steps[:, None]


def needed_steps(one: Fit, x: np.ndarray, fresh: bool = False) -> np.ndarray:
    """The difference_steps() (k,) that the Jacobian at x (p,) needs: those of the effects' numbers,
    and of the nuisance parameters where their columns are not known or asked for fresh.
    """
    fitted = one.hypothesis.count if one.nuisance_slopes_known and not fresh else len(x)
    return difference_steps(one.hypothesis, x)[:fitted]


def difference_steps(h: Hypothesis, x: np.ndarray) -> np.ndarray:
    """Signed steps (p,) of differences at x (p,), away from upper bounds. Where a step leaves the
    bounds both ways it ends at the farther one.
    """
    steps, up, down = h.steps_at(x), h.high - x, x - h.low
    farther = np.where(up >= down, up, -down)
    return np.select([steps <= up, steps <= down], [steps, -steps], farther)


def bounded_step(
    normal: np.ndarray, gradient: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Minimise d' normal d / 2 + gradient' d within low <= d <= high: the number that violates its
    bound most is fixed there (active set), until none does.
    """
    p = len(gradient)
    ridge = normal.copy()
    ridge.flat[:: p + 1] += RIDGE_SHARE * np.diagonal(normal) + RIDGE
    step, free = -np.linalg.solve(ridge, gradient), np.ones(p, bool)
    if np.all((low <= step) & (step <= high)):
        return step
    for _ in range(p):
        over = np.where(free, np.maximum(low - step, step - high), -1.0)
        worst = int(over.argmax())
        if over[worst] <= BOUND_SLACK:
            break
        step[worst] = np.clip(step[worst], low[worst], high[worst])
        free[worst] = False
        if not free.any():
            break
        rest = gradient[free] + ridge[np.ix_(free, ~free)] @ step[~free]
        step[free] = -np.linalg.solve(ridge[np.ix_(free, free)], rest)
    return np.clip(step, low, high)
