"""What a residual follows (measured signals, angles, time, lines of a spectrum), and what a smooth
correction over it would gain.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_smoothing_spline

from vgroove.gap.selection.model_comparison import Blocks

BINS = 12
KNOTS = 60  # points of quantiles that a spline is drawn through
# of the range: quantiles as close together are one point, or no spline could be told through them
CLOSE = 1e-3
TURN = 2.0 * np.pi
LINE = 30.0  # times the usual power by which a line of a spectrum stands out
LONGEST_GRID = 1 << 16
SHOWN = 25  # points of a correction that are reported


@dataclass(frozen=True)
class Driver:
    """A quantity (n,) that a residual may follow; period: of an angle, 0 otherwise."""

    name: str
    value: np.ndarray
    period: float = 0.0


def edges_of(driver: np.ndarray) -> np.ndarray:
    """Inner bin edges at quantiles of the driver (few values: between them)."""
    levels = np.unique(driver)
    if len(levels) <= BINS:
        return (levels[1:] + levels[:-1]) / 2.0
    return np.unique(np.quantile(driver, np.linspace(0.0, 1.0, BINS + 1)[1:-1]))


def predicted(residual: np.ndarray, driver: np.ndarray, cluster: np.ndarray) -> np.ndarray:
    """Bin means of the other half of the blocks (even blocks predict odd ones and the other way
    round).
    """
    if len(driver) < 4 * BINS:
        return np.zeros_like(residual)
    bins = np.searchsorted(edges_of(driver), driver)
    out = np.zeros_like(residual)
    for parity in (0, 1):
        there, here = cluster % 2 == parity, cluster % 2 != parity
        count = np.bincount(bins[there], minlength=BINS + 1)
        mean = np.bincount(bins[there], weights=residual[there], minlength=BINS + 1) / (count + 3.0)
        out[here] = mean[bins[here]]
    return out


def smooth_curve(residual: np.ndarray, driver: Driver) -> tuple[np.ndarray, np.ndarray]:
    """A smoothing spline (stiffness by generalised cross-validation) through means over quantiles:
    points (k,) and values.
    """
    x, y, weight = _means(residual, driver)
    if len(x) < 5:
        return x, y
    if driver.period:  # three turns of it, so that its ends meet
        x, y, weight = (
            np.concatenate([x - driver.period, x, x + driver.period]),
            np.tile(y, 3),
            np.tile(weight, 3),
        )
    scale = float(np.ptp(x))
    curve = make_smoothing_spline(x / scale, y, w=weight)
    grid = np.linspace(0.0, driver.period, KNOTS) if driver.period else x
    return grid, curve(grid / scale)


def _means(residual: np.ndarray, driver: Driver) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Means over quantiles of the driver (k,), of the residual there, and their weights (rows; the
    spline scales them).
    """
    step = max(CLOSE * float(np.ptp(driver.value)), 1e-12)
    inner = step * np.unique(
        np.round(np.quantile(driver.value, np.linspace(0.0, 1.0, KNOTS + 1)[1:-1]) / step)
    )
    bins = np.unique(np.searchsorted(inner, driver.value), return_inverse=True)[1]
    count = np.bincount(bins)
    x, y = (np.bincount(bins, weights=v) / count for v in (driver.value, residual))
    apart = np.concatenate([[True], np.diff(x) > 0.5 * step])
    return x[apart], y[apart], count[apart].astype(float)


def gained(residual: np.ndarray, driver: Driver, cluster: np.ndarray) -> float:
    """Share of the squared residual (m,) that a smooth correction takes from blocks that it was not
    drawn through.
    """
    left = residual.copy()
    for parity in (0, 1):
        there, here = cluster % 2 == parity, cluster % 2 != parity
        if there.sum() < 4 * BINS or not here.any():
            return 0.0
        x, y = smooth_curve(
            residual[there], Driver(driver.name, driver.value[there], driver.period)
        )
        left[here] -= np.interp(driver.value[here], x, y)
    return float(1.0 - (left**2).sum() / max(float((residual**2).sum()), 1e-12))


def spectral_line(residual: np.ndarray, place: np.ndarray) -> float | None:
    """Frequency (per unit of place) of the line that stands out in the residual's spectrum over a
    growing place; None where none does.
    """
    span = float(np.ptp(place))
    if span <= 0.0 or len(place) < 200:
        return None
    cells = int(min(LONGEST_GRID, 2 ** np.ceil(np.log2(2 * len(place)))))
    cell = np.minimum(((place - place.min()) / span * (cells - 1)).astype(int), cells - 1)
    power = (
        np.abs(
            np.fft.rfft(
                np.bincount(cell, weights=residual - residual.mean(), minlength=cells), 2 * cells
            )
        )
        ** 2
    )
    power = power[: len(place) // 2]
    power[:16] = 0.0  # slow drifts are no line
    top = int(np.argmax(power))
    usual = np.median(power[max(16, top // 2) : 2 * top + 32])
    return (
        top / (2.0 * span * cells / (cells - 1))
        if usual > 0.0 and power[top] > LINE * usual / np.log(2.0)
        else None
    )


def lines(
    residual: np.ndarray,
    time_s: np.ndarray,
    angle: np.ndarray | None,
    ratio: float,
    log: np.ndarray,
) -> list[Driver]:
    """Lines of the spectra over time and over the motor's angle (of the first log), as angles of
    their own that the residual may follow.
    """
    found, first = [], log == log[0]
    line = spectral_line(residual[first], time_s[first])
    if line is not None:
        found.append(Driver(f"time at {line:.4g} Hz", np.mod(TURN * line * time_s, TURN), TURN))
    if angle is not None:
        line = spectral_line(residual[first], angle[first] / TURN)
        if line is not None:
            whose = (
                f"motor angle, {line:.4g} periods a turn"
                if line * ratio > 1.5
                else f"output angle, {line * ratio:.4g} periods a turn"
            )
            found.append(Driver(whose, np.mod(angle * line, TURN), TURN))
    return found


def looks(x: np.ndarray, y: np.ndarray, driver: Driver) -> str:
    """A correction (k,) in words."""
    name = driver.name
    if driver.period:
        turns = " at " not in name and "periods" not in name
        return (
            f"repeats with every turn of the {name.replace(' angle', '')}"
            if turns
            else f"periodic in {name}"
        )
    if name == "sign of speed":
        return "changes with the direction of motion"
    if len(x) < 3 or np.ptp(y) <= 0.0:
        return f"differs with {name}"
    rise = np.corrcoef(x, y)[0, 1]
    even = np.corrcoef(np.abs(x), y)[0, 1] if x.min() < 0.0 < x.max() else 0.0
    if max(abs(rise), abs(even)) > 0.8:
        return f"{'grows' if (rise if abs(rise) >= abs(even) else even) > 0.0 else 'falls'} with {name}"
    at = x[int(np.argmax(np.abs(y - np.median(y))))]
    return f"has a {'peak' if y[int(np.argmax(np.abs(y - np.median(y))))] > np.median(y) else 'dip'} at {name} {at:.3g}"


def thinned(x: np.ndarray, y: np.ndarray, scale: float) -> list[list[float]]:
    """Points [driver, correction in the signal's unit] of a curve for the verdict."""
    chosen = np.unique(np.linspace(0, len(x) - 1, min(SHOWN, len(x))).astype(int))
    return [[float(x[i]), float(y[i] * scale)] for i in chosen]


def shares(
    residual: np.ndarray,
    drivers: list[Driver],
    signal: np.ndarray,
    names: list[str],
    own: dict[str, str],
    blocks: Blocks,
    floor: float,
) -> list[dict[str, object]]:
    """How much of the squared gap above the noise each driver explains in each signal, largest
    first; what explains a twentieth is told.
    """
    total = float((residual[blocks.tested] ** 2 - floor**2).sum())
    found = []
    for driver in drivers if total > 0.0 else []:
        for k in (k for k in range(len(names)) if own.get(names[k]) != driver.name):
            rows = blocks.tested & (signal == k) & np.isfinite(driver.value) & (residual != 0.0)
            left = residual[rows] - predicted(
                residual[rows], driver.value[rows], blocks.cluster[rows]
            )
            share = float((residual[rows] ** 2 - left**2).sum()) / total
            if share > 0.05:
                found.append({"follows": driver.name, "signal": names[k], "share": min(1.0, share)})
    return sorted(found, key=lambda f: (-f["share"], f["follows"], f["signal"]))
