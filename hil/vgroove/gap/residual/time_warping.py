"""The ISO/TS 18571 rating of objective_rating_metrics with its time warping done in numpy: the
package's own compiles for 15 s first.
"""

import sys
from functools import cache
from unittest.mock import MagicMock, patch

import numpy as np

UNUSED = ("dtwalign", "dtwalign.step_pattern", "dtwalign.window")


def overall_rating(reference: np.ndarray, comparison: np.ndarray, dt: float) -> float:
    """ISO/TS 18571 overall rating of a curve (n, 2: time, value) against a reference on the same
    grid.
    """
    metric = _metric()
    with np.errstate(invalid="ignore", divide="ignore"):
        return float(metric(reference, comparison, dt=dt).overall_rating())


@cache
def _metric() -> type:
    """The package's class with our alignment; its own (numba, matplotlib: seconds of start-up) is
    kept out while it is imported.
    """
    absent = {name: MagicMock() for name in UNUSED if name not in sys.modules}
    with patch.dict(sys.modules, absent):
        from objective_rating_metrics.rating import ISO18571
    ISO18571._compute_magnitude = staticmethod(aligned)
    return ISO18571


def aligned(x: np.ndarray, y: np.ndarray, window_size: float) -> tuple[np.ndarray, np.ndarray]:
    """Both curves along their warping path, as ISO18571._compute_magnitude gives them."""
    path = align(x, y, int(np.ceil(window_size * len(x))) - 1)
    return x[path[:, 0]], y[path[:, 1]]


def align(x: np.ndarray, y: np.ndarray, reach: int) -> np.ndarray:
    """Warping path (k, 2) of least squared distance between x (n,) and y (n,), |i - j| <= reach,
    ends tied, all steps of weight one.
    """
    n = len(x)
    step = np.zeros((2 * n - 1, n), np.int8)
    before, last = np.full(n + 1, np.inf), np.full(n + 1, np.inf)
    for k in range(2 * n - 1):
        low, high = max(0, k - n + 1, -((reach - k) // 2)), min(k, n - 1, (k + reach) // 2)
        i = np.arange(low, high + 1)
        now = np.full(n + 1, np.inf)
        cost = (x[i] - y[k - i]) ** 2
        if k == 0:
            now[1] = cost[0]
        else:
            # from (i-1, j), (i, j-1), (i-1, j-1); index 0 is outside
            ways = np.stack([last[i], last[i + 1], before[i]])
            best = np.argmin(ways, axis=0)
            step[k, i] = best
            now[i + 1] = cost + ways[best, np.arange(len(i))]
        before, last = last, now
    return backtrack(step, n)


def backtrack(step: np.ndarray, n: int) -> np.ndarray:
    """Follow the stored steps from the last pair to the first."""
    i = j = n - 1
    path = [(i, j)]
    while i > 0 or j > 0:
        way = step[i + j, i]
        i, j = (i - 1, j) if way == 0 else (i, j - 1) if way == 1 else (i - 1, j - 1)
        path.append((i, j))
    return np.array(path[::-1])
