"""Finds what a residual depends on: bin means over a measured quantity, cross-validated smoothing
splines, and lines of the spectrum.
"""

from dataclasses import dataclass

import numpy as np
import scipy  # its parts load when they are first used

from vgroove.units import TURN_RAD


@dataclass(frozen=True)
class CorrelateLimits:
    """Numbers of the search for covariates; chosen on the tuning half of the blind set
    (docs/gap_bench.md).
    """

    bins: int = 12  # quantile bins of a covariate
    bin_prior_rows: float = 3.0  # rows of value 0 that are added to each bin (shrinkage)
    rows_per_bin: int = 4  # mean number of rows in a bin below which nothing is predicted
    knots: int = 60  # quantile means that a spline is fitted to
    min_points: int = 5  # below which no spline is fitted
    min_knot_distance: float = 1e-3  # of range or period: closer quantiles are one point
    # smallest power of a spectral line, divided by the mean power of noise, which is estimated as
    # the median power around the line over ln 2
    line_over_median: float = 30.0
    line_rows: int = 200  # rows below which no line is looked for
    slow_cells: int = 16  # cells of lowest frequency, which are drifts and no lines
    max_grid: int = 1 << 16  # cells of the grid that the spectrum is computed on
    points_reported: int = 25  # of a correction
    monotonic: float = 0.8  # correlation from which a curve is called growing or falling
    # periods an output turn above which the period of a line is stated in motor turns
    output_line: float = 1.5


CORRELATE = CorrelateLimits()


@dataclass(frozen=True)
class Covariate:
    """A quantity (n,) that a residual may depend on; period: 2 pi for an angle, 0 otherwise."""

    name: str
    value: np.ndarray
    period: float = 0.0


def bin_edges(value: np.ndarray) -> np.ndarray:
    """Inner bin edges at quantiles of a covariate; between the levels where it has few."""
    levels = np.unique(value)
    if len(levels) <= CORRELATE.bins:
        return (levels[1:] + levels[:-1]) / 2.0
    return np.unique(np.quantile(value, np.linspace(0.0, 1.0, CORRELATE.bins + 1)[1:-1]))


def predict_by_bins(residual: np.ndarray, value: np.ndarray, cluster: np.ndarray) -> np.ndarray:
    """Residuals (m,) as bin means over a covariate predict them, two-fold cross-validated: even
    blocks predict odd ones and odd ones even ones. cluster (m,): block of each row.
    """
    if len(value) < CORRELATE.rows_per_bin * CORRELATE.bins:
        return np.zeros_like(residual)
    bins = np.searchsorted(bin_edges(value), value)
    out, size = np.zeros_like(residual), CORRELATE.bins + 1
    for parity in (0, 1):
        there, here = cluster % 2 == parity, cluster % 2 != parity
        count = np.bincount(bins[there], minlength=size) + CORRELATE.bin_prior_rows
        mean = np.bincount(bins[there], weights=residual[there], minlength=size) / count
        out[here] = mean[bins[here]]
    return out


def smooth_curve(residual: np.ndarray, covariate: Covariate) -> tuple[np.ndarray, np.ndarray]:
    """A smoothing spline through quantile means: covariate (k,) and residual there (k,).

    Its smoothing parameter is chosen by generalised cross-validation (P. Craven, G. Wahba,
    Numerische Mathematik 31, 1979).
    """
    x, y, weight = quantile_means(residual, covariate)
    if len(x) < CORRELATE.min_points:
        return x, y
    if covariate.period:  # three periods, so that the ends of the middle one meet
        x = np.concatenate([x - covariate.period, x, x + covariate.period])
        y, weight = np.tile(y, 3), np.tile(weight, 3)
    # with points about 1 apart the cross-validation, whose tolerance is absolute, finds its minimum
    scale = float(np.ptp(x)) / len(x)
    curve = scipy.interpolate.make_smoothing_spline(x / scale, y, w=weight)
    grid = np.linspace(0.0, covariate.period, CORRELATE.knots) if covariate.period else x
    return grid, curve(grid / scale)


def quantile_means(
    residual: np.ndarray, covariate: Covariate
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Means of covariate (k,) and residual (k,) over quantile bins, and the rows of each bin."""
    value = covariate.value
    span = covariate.period or float(np.ptp(value))
    step = max(CORRELATE.min_knot_distance * span, 1e-12)
    quantiles = np.quantile(value, np.linspace(0.0, 1.0, CORRELATE.knots + 1)[1:-1])
    inner = step * np.unique(np.round(quantiles / step))
    bins = np.unique(np.searchsorted(inner, value), return_inverse=True)[1]
    count = np.bincount(bins)
    x, y = (np.bincount(bins, weights=v) / count for v in (value, residual))
    apart = np.concatenate([[True], np.diff(x) > 0.5 * step])
    if covariate.period and len(x) > 1:  # the last one is a neighbour of the first
        apart[-1] &= x[0] + covariate.period - x[-1] > 0.5 * step
    return x[apart], y[apart], count[apart].astype(float)


def cross_validated_gain(residual: np.ndarray, covariate: Covariate, cluster: np.ndarray) -> float:
    """Share of the squared residual (m,) that a smooth curve closes, two-fold cross-validated over
    the blocks.
    """
    left = residual.copy()
    for parity in (0, 1):
        there, here = cluster % 2 == parity, cluster % 2 != parity
        if there.sum() < CORRELATE.rows_per_bin * CORRELATE.bins or not here.any():
            return 0.0
        half = Covariate(covariate.name, covariate.value[there], covariate.period)
        x, y = smooth_curve(residual[there], half)
        left[here] -= np.interp(covariate.value[here], x, y)
    return float(1.0 - (left**2).sum() / max(float((residual**2).sum()), 1e-12))


def spectral_line(residual: np.ndarray, place: np.ndarray) -> float | None:
    """Frequency, per unit of place, of a line in the residual's spectrum over an increasing place
    (m,), time or angle; None where no line exceeds the noise.
    """
    span = float(np.ptp(place))
    if span <= 0.0 or len(place) < CORRELATE.line_rows:
        return None
    cells = int(min(CORRELATE.max_grid, 2 ** np.ceil(np.log2(2 * len(place)))))
    cell = np.minimum(((place - place.min()) / span * (cells - 1)).astype(int), cells - 1)
    grid = np.bincount(cell, weights=residual - residual.mean(), minlength=cells)
    power = np.abs(np.fft.rfft(grid, 2 * cells)) ** 2
    power = power[: len(place) // 2]
    power[: CORRELATE.slow_cells] = 0.0
    top = int(np.argmax(power))
    usual = np.median(
        power[max(CORRELATE.slow_cells, top // 2) : 2 * top + 2 * CORRELATE.slow_cells]
    )
    # the median of an exponentially distributed power is ln 2 times its mean
    if usual <= 0.0 or power[top] <= CORRELATE.line_over_median * usual / np.log(2.0):
        return None
    return top / (2.0 * span * cells / (cells - 1))


def spectral_covariates(
    residual: np.ndarray,
    time_s: np.ndarray,
    angle: np.ndarray | None,
    ratio: float,
    log: np.ndarray,
) -> list[Covariate]:
    """Lines of the spectra over time in s and over the motor's unwound angle in rad, read from the
    first log, as phase angles (n,) that the residual may depend on; ratio: of the gearbox.
    """
    found, first = [], log == log[0]
    line = spectral_line(residual[first], time_s[first])
    if line is not None:
        phase = np.mod(TURN_RAD * line * time_s, TURN_RAD)
        found.append(Covariate(f"time at {line:.4g} Hz", phase, TURN_RAD))
    if angle is None:
        return found
    line = spectral_line(residual[first], angle[first] / TURN_RAD)
    if line is not None:
        shaft, periods = (
            ("motor", line) if line * ratio > CORRELATE.output_line else ("output", line * ratio)
        )
        name = f"{shaft} angle, {periods:.4g} periods a turn"
        found.append(Covariate(name, np.mod(angle * line, TURN_RAD), TURN_RAD))
    return found


def describe_curve(x: np.ndarray, y: np.ndarray, covariate: Covariate) -> str:
    """A curve (k,) over a covariate in words."""
    name = covariate.name
    if covariate.period:
        once_a_turn = " at " not in name and "periods" not in name
        shaft = name.replace(" angle", "")
        return f"repeats with every turn of the {shaft}" if once_a_turn else f"periodic in {name}"
    if name == "sign of speed":
        return "changes with the direction of motion"
    if len(x) < 3 or np.ptp(y) <= 0.0:
        return f"differs with {name}"
    odd = np.corrcoef(x, y)[0, 1]
    even = np.corrcoef(np.abs(x), y)[0, 1] if x.min() < 0.0 < x.max() else 0.0
    if max(abs(odd), abs(even)) > CORRELATE.monotonic:
        larger = odd if abs(odd) >= abs(even) else even
        return f"{'grows' if larger > 0.0 else 'falls'} with {name}"
    at = int(np.argmax(np.abs(y - np.median(y))))
    return f"has a {'peak' if y[at] > np.median(y) else 'dip'} at {name} {x[at]:.3g}"


def thin_curve(x: np.ndarray, y: np.ndarray) -> list[tuple[float, float]]:
    """At most CORRELATE.points_reported points of a curve, evenly spread, its ends among them."""
    count = min(CORRELATE.points_reported, len(x))
    chosen = np.unique(np.linspace(0, len(x) - 1, count).astype(int))
    return [(float(x[i]), float(y[i])) for i in chosen]
