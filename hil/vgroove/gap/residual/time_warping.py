"""The ISO/TS 18571 rating of the package objective_rating_metrics, with the dynamic time warping
replaced by one in numpy: that of the package is compiled at its first call, which takes 15 s.

Method: Sakoe and Chiba, IEEE Transactions on Acoustics, Speech, and Signal Processing 26 (1978) 43.
"""

import sys
from functools import cache
from unittest.mock import MagicMock, patch

import numpy as np

UNUSED_MODULES = ("dtwalign", "dtwalign.step_pattern", "dtwalign.window")


def overall_rating(reference: np.ndarray, comparison: np.ndarray, dt: float) -> float:
    """ISO/TS 18571 overall rating 0..1 of a curve (n, 2: time, value) against a reference on the
    same grid of step dt.
    """
    metric = _metric()
    with np.errstate(invalid="ignore", divide="ignore"):
        return float(metric(reference, comparison, dt=dt).overall_rating())


@cache
def _metric() -> type:
    """The package's class with the warping of this module. The package is imported without numba
    and matplotlib, which its own warping and plots need and which take seconds to load.
    """
    absent = {name: MagicMock() for name in UNUSED_MODULES if name not in sys.modules}
    with patch.dict(sys.modules, absent):
        from objective_rating_metrics.rating import ISO18571
    ISO18571._compute_magnitude = staticmethod(aligned)
    return ISO18571


def aligned(x: np.ndarray, y: np.ndarray, window_size: float) -> tuple[np.ndarray, np.ndarray]:
    """Both curves (k,) along their warping path, as ISO18571._compute_magnitude gives them;
    window_size: width of the Sakoe-Chiba band as a share of the curves' length. Curves with values
    that are not finite are left as they are: their rating is nan.
    """
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        return x, y
    path = warping_path(x, y, int(np.ceil(window_size * len(x))) - 1)
    return x[path[:, 0]], y[path[:, 1]]


def warping_path(x: np.ndarray, y: np.ndarray, reach: int) -> np.ndarray:
    """Warping path (k, 2) of the smallest squared distance between x (n,) and y (n,) with
    |i - j| <= reach, both ends fixed, all steps of weight one; one anti-diagonal at a time.
    """
    n = len(x)
    step = np.zeros((2 * n - 1, n), np.int8)
    backwards = y[::-1]
    before, last, total = (np.full(n + 1, np.inf) for _ in range(3))
    for k in range(2 * n - 1):
        low, high = max(0, k - n + 1, -((reach - k) // 2)), min(k, n - 1, (k + reach) // 2) + 1
        cost = (x[low:high] - backwards[n - 1 - k + low : n - 1 - k + high]) ** 2
        total.fill(np.inf)
        if k == 0:
            total[1] = cost[0]
        else:
            # from (i-1, j), (i, j-1), (i-1, j-1); index 0 is outside
            ways = last[low:high], last[low + 1 : high + 1], before[low:high]
            least = np.minimum(ways[0], ways[1])
            step[k, low:high] = ways[1] < ways[0]
            step[k, low:high][ways[2] < least] = 2
            np.add(cost, np.minimum(least, ways[2]), out=total[low + 1 : high + 1])
        before, last, total = last, total, before
    return _backtrack(step, n)


def _backtrack(step: np.ndarray, n: int) -> np.ndarray:
    """The path (k, 2) along the stored steps, from the last pair back to the first, in order."""
    i = j = n - 1
    path = [(i, j)]
    while i > 0 or j > 0:
        way = step[i + j, i]
        i, j = (i - 1, j) if way == 0 else (i, j - 1) if way == 1 else (i - 1, j - 1)
        path.append((i, j))
    return np.array(path[::-1])
