"""Time offset and clock drift between two logs: nonlinear least squares (Gauss-Newton) on all
continuous columns, from the best of a grid of offsets, whose costs are correlations.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.signal import correlate

from vgroove.log.table import Log
from vgroove.log_compare.limits import Limits
from vgroove.log_compare.pairing import values_at

ITERATIONS = 8
MAX_DRIFT = 0.01  # 1 %: a larger one is not that of two clocks
MAX_PAUSES = 4.0  # length of a log over that of its rows, up to which its even times are taken
ROUNDING = 1e-9  # of a normalised cost: smaller differences of correlations are rounding


@dataclass(frozen=True)
class TimeMap:
    """Instant t of log A is t + offset_s + drift (t - origin_s) of log B; `share`: of the
    normalised squared gap of all continuous columns that the map removes.
    """

    offset_s: float = 0.0
    drift: float = 0.0
    origin_s: float = 0.0
    share: float = 0.0

    def to_b(self, time_s: np.ndarray) -> np.ndarray:
        """Times of log B (n,) for times of log A (n,)."""
        return time_s + self.offset_s + self.drift * (time_s - self.origin_s)


@dataclass(frozen=True)
class _Fit:
    """What is fitted: log A at the rows `rows`, log B, and the columns with their standard
    deviations. least_share: of the samples with a value in both logs without an offset, those that
    must remain with one, since where the logs hardly overlap any offset fits.
    """

    a: Log
    b: Log
    rows: np.ndarray
    scales: dict[str, float]
    origin_s: float
    least_share: float

    def residual(self, offset_s: float, drift: float) -> np.ndarray:
        """Normalised gap (columns x rows,), NaN where a sample is missing."""
        time_a = self.a.time_s[self.rows]
        time_b = time_a + offset_s + drift * (time_a - self.origin_s)
        gaps = [
            (values_at(self.b, name, time_b) - self.a[name][self.rows]) / scale
            for name, scale in self.scales.items()
        ]
        return np.concatenate(gaps)

    @cached_property
    def least_used(self) -> float:
        """Least number of samples with a value in both logs."""
        return self.least_share * float(np.isfinite(self.residual(0.0, 0.0)).sum())

    def cost(self, offset_s: float, drift: float) -> float:
        """Mean square of the normalised gap over the samples that both logs have; infinite where
        these are too few.
        """
        residual = self.residual(offset_s, drift)
        used = np.isfinite(residual)
        if used.sum() < max(self.least_used, 1.0):
            return np.inf
        return float(np.mean(residual[used] ** 2))


def fit_time_map(a: Log, b: Log, columns: Sequence[str], limits: Limits) -> TimeMap:
    """The time map with the least squared gap of the columns; TimeMap() where none removes
    `partly_share` of it.
    """
    scales = {name: float(np.nanstd(a[name])) for name in columns if np.isfinite(a[name]).any()}
    scales = {name: scale for name, scale in scales.items() if scale > 0.0}
    if not scales:
        return TimeMap()
    rows = np.unique(np.linspace(0, len(a) - 1, min(len(a), limits.fit_rows)).astype(int))
    middle = float(a.time_s[0] + a.time_s[-1]) / 2
    fit = _Fit(a, b, rows, scales, middle, limits.overlap_share)
    before = fit.cost(0.0, 0.0)
    if before == 0.0 or not np.isfinite(before):
        return TimeMap()
    offset_s, drift = _gauss_newton(fit, _best_offset(fit, limits), limits)
    share = 1.0 - fit.cost(offset_s, drift) / before
    if share < limits.partly_share:
        return TimeMap()
    return TimeMap(offset_s, drift, fit.origin_s, share)


def _best_offset(fit: _Fit, limits: Limits) -> float:
    """The offset of a grid of one interval's spacing with the least cost."""
    interval = float(np.median(np.diff(fit.a.time_s)))
    count = int(limits.max_shift_s / interval * (1.0 + 1e-9))
    offsets = interval * np.arange(-count, count + 1)
    if np.ptp(fit.a.time_s) > MAX_PAUSES * interval * len(fit.a):
        # the even times of a log with long pauses are far more than its rows
        costs = np.array([fit.cost(float(offset), 0.0) for offset in offsets])
    else:
        costs = _costs_on_grid(fit, interval, count)
    best = offsets[costs <= costs.min() * (1.0 + ROUNDING) + ROUNDING]
    return float(min(best, key=abs))


def _costs_on_grid(fit: _Fit, interval_s: float, count: int) -> np.ndarray:
    """Costs (2 count + 1,) of the offsets of -count to count intervals: mean squares of differences
    of samples at even times, whose sums over all offsets are correlations.
    """
    length = int(np.ptp(fit.a.time_s) / interval_s) + 1
    time_a = fit.a.time_s[0] + interval_s * np.arange(length)
    time_b = fit.a.time_s[0] + interval_s * np.arange(-count, length + count)
    used, squares = np.zeros(2 * count + 1), np.zeros(2 * count + 1)
    for name, scale in fit.scales.items():
        centre = float(np.nanmean(fit.a[name]))
        (a, in_a), (b, in_b) = (
            _filled((values_at(log, name, time_s) - centre) / scale)
            for log, time_s in ((fit.a, time_a), (fit.b, time_b))
        )
        used += correlate(in_b, in_a, mode="valid", method="fft")
        squares += correlate(b**2, in_a, mode="valid", method="fft")
        squares += correlate(in_b, a**2, mode="valid", method="fft")
        squares -= 2.0 * correlate(b, a, mode="valid", method="fft")
    least = max(fit.least_share * used[count], 1.0)
    return np.where(used >= least - 0.5, np.maximum(squares, 0.0) / np.maximum(used, 1.0), np.inf)


def _filled(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values (n,) with 0 where a sample is missing, and whether each exists (n,), as 0 or 1."""
    return np.nan_to_num(values), np.isfinite(values).astype(float)


def _gauss_newton(fit: _Fit, offset_s: float, limits: Limits) -> tuple[float, float]:
    """Offset and drift from a start value; a step that does not reduce the cost is halved."""
    step_s = float(np.median(np.diff(fit.a.time_s))) / 4
    span_s = max(float(np.ptp(fit.a.time_s)), step_s)
    drift, best = 0.0, fit.cost(offset_s, 0.0)
    for _ in range(ITERATIONS):
        centre = fit.residual(offset_s, drift)
        slopes = np.stack(
            [
                fit.residual(offset_s + step_s, drift) - centre,
                fit.residual(offset_s, drift + step_s / span_s) - centre,
            ],
            axis=1,
        )
        used = np.isfinite(slopes).all(axis=1)
        change, *_ = np.linalg.lstsq(slopes[used], -centre[used], rcond=None)
        for halving in range(6):
            moved = offset_s + 0.5**halving * change[0] * step_s
            turned = drift + 0.5**halving * change[1] * step_s / span_s
            allowed = abs(moved) <= limits.max_shift_s and abs(turned) <= MAX_DRIFT
            if allowed and (cost := fit.cost(moved, turned)) < best:
                offset_s, drift, best = moved, turned, cost
                break
        else:
            break
    return offset_s, drift
