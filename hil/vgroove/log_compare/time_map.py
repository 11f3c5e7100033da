"""Time offset and clock drift between two logs: nonlinear least squares (Gauss-Newton) on all
continuous columns, from the best of a grid of offsets.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vgroove.log.table import Log
from vgroove.log_compare.limits import Limits
from vgroove.log_compare.pairing import values_at

ITERATIONS = 8
MAX_DRIFT = 0.01  # 1 %: a larger one is not that of two clocks


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
    """Rows of log A that the fit uses, log B, and the columns with their scales."""

    a: Log
    b: Log
    rows: np.ndarray
    scales: dict[str, float]
    origin_s: float

    def residual(self, offset_s: float, drift: float) -> np.ndarray:
        """Normalised gap (columns x rows,), 0 where a sample is missing."""
        time_a = self.a.time_s[self.rows]
        time_b = time_a + offset_s + drift * (time_a - self.origin_s)
        gaps = [
            (values_at(self.b, name, time_b) - self.a[name][self.rows]) / scale
            for name, scale in self.scales.items()
        ]
        return np.nan_to_num(np.concatenate(gaps), nan=0.0)

    def cost(self, offset_s: float, drift: float) -> float:
        """Mean square of the normalised gap over the samples that exist."""
        residual = self.residual(offset_s, drift)
        used = max(1, int(np.count_nonzero(residual)))
        return float(residual @ residual) / max(used, len(residual) // 2)


def fit_time_map(a: Log, b: Log, columns: Sequence[str], limits: Limits) -> TimeMap:
    """The time map with the least squared gap of the columns; TimeMap() where none removes
    `partly_share` of it.
    """
    scales = {name: float(np.nanstd(a[name])) for name in columns if np.isfinite(a[name]).any()}
    scales = {name: scale for name, scale in scales.items() if scale > 0.0}
    if not scales:
        return TimeMap()
    rows = np.unique(np.linspace(0, len(a) - 1, min(len(a), limits.fit_rows)).astype(int))
    fit = _Fit(a, b, rows, scales, float(a.time_s[0] + a.time_s[-1]) / 2)
    before = fit.cost(0.0, 0.0)
    if before == 0.0:
        return TimeMap()
    offset_s, drift = _gauss_newton(fit, _best_offset(fit, limits), limits)
    share = 1.0 - fit.cost(offset_s, drift) / before
    if share < limits.partly_share:
        return TimeMap()
    return TimeMap(offset_s, drift, fit.origin_s, share)


def _best_offset(fit: _Fit, limits: Limits) -> float:
    """The offset of a grid of one interval's spacing with the least cost."""
    interval = float(np.median(np.diff(fit.a.time_s)))
    count = int(limits.max_shift_s / interval)
    offsets = interval * np.arange(-count, count + 1)
    return float(min(offsets, key=lambda offset: (fit.cost(offset, 0.0), abs(offset))))


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
        change, *_ = np.linalg.lstsq(slopes, -centre, rcond=None)
        for halving in range(6):
            moved = offset_s + 0.5**halving * change[0] * step_s
            turned = drift + 0.5**halving * change[1] * step_s / span_s
            allowed = abs(moved) <= 2 * limits.max_shift_s and abs(turned) <= MAX_DRIFT
            if allowed and (cost := fit.cost(moved, turned)) < best:
                offset_s, drift, best = moved, turned, cost
                break
        else:
            break
    return offset_s, drift
