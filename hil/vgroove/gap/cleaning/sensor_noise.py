"""Standard deviation of the sensors' noise: as the rig states it, or estimated from the log alone
where the rig states none; never from a model's residual. The error of a speed from Hall edges is in
hall_edges/jitter.py, that of statistics of the impact cycle in residual/impact/cycle_statistics.py.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
import scipy  # its parts load when they are first used
from numpy.lib.stride_tricks import sliding_window_view

from vgroove.rig import Rig

# filter of Savitzky and Golay (Anal. Chem. 36(8), 1964) whose residual is taken as noise: window,
# samples, and order
FILTER_ROWS, FILTER_ORDER = 11, 3
SHORT_ROWS, SHORT_ORDER = 5, 2  # a shorter one, whose window contains fewer steps of the motion
DIFFERENCE_ORDERS = range(3, 9)  # orders of a position's differences in which noise is looked for
MIN_SAMPLES = 20  # finite samples below which no noise is estimated
# 1 / the 75 % quantile of the normal distribution: median absolute deviation to sigma
MAD_TO_SIGMA = 1.4826
UNIFORM_WIDTH_SIGMAS = np.sqrt(12.0)  # width of a uniform distribution in standard deviations
# keys of a rig's sensors that state noise and quantisation
NOISE_KEYS = {
    "current_a": "current_noise_a",
    "supply_v": "supply_noise_v",
    "speed_rpm": "speed_noise_rpm",
}
LSB_KEYS = {"current_a": "current_lsb_a", "supply_v": "", "speed_rpm": "speed_lsb_rpm"}
# smallest standard deviation of each column, in its unit: a noiseless log must not divide by zero
MIN_SIGMA = {"current_a": 1e-3, "supply_v": 1e-3, "speed_rpm": 1e-2, "position_rad": 1e-9}


@dataclass(frozen=True)
class ResolutionLimits:
    """Limits of the search for a column's resolution, chosen on the tuning half of the blind
    set.
    """

    min_step: float = 1e-9  # smaller differences are rounding errors of arithmetic
    max_differences: int = 2000  # differences that are examined: bounds the time
    max_parts: int = 64  # resolution steps in the smallest difference, at most
    # a difference of more resolution steps is not examined: the rounding of the smallest
    # difference alone would make it miss a multiple
    max_count: float = 1000.0
    multiple_error: float = 0.1  # of a resolution step, by which a difference may miss a multiple
    multiple_share: float = 0.98  # of the differences, that must be multiples
    decimal_error: float = 1e-9  # in the column's unit, by which a rounded value misses its decimal
    # decimals up to which a column looks exact, and last one that is taken as a rounding
    exact_decimals: int = 3
    last_decimals: int = 6


LIMITS = ResolutionLimits()


@cache
def residual_power_share(window: int = FILTER_ROWS, order: int = FILTER_ORDER) -> float:
    """Share of the power of white noise in the residual of a Savitzky-Golay filter of this window,
    samples, and order.
    """
    return 1.0 - float(filter_coefficients(window, order)[window // 2])


def high_frequency_sigma(values: np.ndarray) -> float:
    """Standard deviation of a column's (n,) high-frequency scatter, in its unit, robust against
    steps; nan with fewer than MIN_SAMPLES finite samples.
    """
    finite = values[np.isfinite(values)]
    if len(finite) < MIN_SAMPLES:
        return float("nan")
    sigma = typical_sigma(finite)
    if sigma > 0.0:
        return sigma
    return float(high_pass_residual(finite).std() / np.sqrt(residual_power_share()))


def typical_sigma(values: np.ndarray) -> float:
    """Standard deviation of the scatter of a column (n,) in most of its samples, in its unit; 0
    where most samples repeat the one before.

    The smaller of two filters' estimates, because motion only adds scatter: where steps follow one
    another closely the shorter window holds fewer of them.
    """
    sigmas = [
        _robust_sigma(values, window, order)
        for window, order in ((FILTER_ROWS, FILTER_ORDER), (SHORT_ROWS, SHORT_ORDER))
    ]
    return min(sigmas) if min(sigmas) > 0.0 else max(sigmas)


def _robust_sigma(values: np.ndarray, window: int, order: int) -> float:
    """Standard deviation of the white noise whose filter residual has the median absolute deviation
    that the column's (n,) residual has.
    """
    residual = high_pass_residual(values, window, order)
    return float(
        MAD_TO_SIGMA
        * np.median(np.abs(residual - np.median(residual)))
        / np.sqrt(residual_power_share(window, order))
    )


def command_noise_sigma(values: np.ndarray) -> float:
    """Standard deviation of the noise of a measured command (n,), in its unit; 0 where the scatter
    is at most half of the column's resolution and therefore rounding.
    """
    finite = values[np.isfinite(values)]
    sigma = typical_sigma(finite) if len(finite) >= FILTER_ROWS else 0.0
    return sigma if sigma > 0.5 * resolution_of(finite) else 0.0


def driving_current_sigma(rig: Rig, values: np.ndarray) -> float:
    """Standard deviation in A of the noise of a current (n,) that drives the model: stated noise
    and rounding, or the column's scatter, which contains its rounding.
    """
    stated = rig.sensors.get("current_noise_a")
    rounding = rig.sensors.get("current_lsb_a", 0.0) / UNIFORM_WIDTH_SIGMAS
    if stated is None:
        return max(command_noise_sigma(values), rounding)
    return float(np.hypot(stated, rounding))


def high_pass_residual(
    values: np.ndarray, window: int = FILTER_ROWS, order: int = FILTER_ORDER
) -> np.ndarray:
    """Difference (n,) of a column and its Savitzky-Golay filter: noise and rounding."""
    return values - savitzky_golay(values, window, order)


def savitzky_golay(values: np.ndarray, window: int, order: int) -> np.ndarray:
    """Savitzky-Golay filter (n,) of a column of at least `window` samples, an odd number; as
    scipy.signal.savgol_filter(), without the second that the import of scipy.signal takes.
    """
    half, rows = window // 2, np.arange(window)
    values = np.asarray(values, dtype=float)
    out = scipy.ndimage.convolve1d(values, filter_coefficients(window, order), mode="constant")
    out[:half] = np.polyval(np.polyfit(rows, values[:window], order), rows[:half])
    out[-half:] = np.polyval(np.polyfit(rows, values[-window:], order), rows[-half:])
    return out


@cache
def filter_coefficients(window: int, order: int) -> np.ndarray:
    """Coefficients (window,) of the least-squares polynomial at the middle of the window."""
    rows = np.arange(window // 2, -(window // 2) - 1, -1.0)
    powers = rows ** np.arange(order + 1)[:, None]
    return np.linalg.lstsq(powers, np.eye(order + 1)[0], rcond=None)[0]


def divided_differences(
    time_s: np.ndarray, values: np.ndarray, order: int, rows: int = 1
) -> np.ndarray:
    """Divided differences of a column (n,) at its times (n,), s, each over instants `rows` rows
    apart, normalised so that white noise keeps its standard deviation.

    A polynomial below this order vanishes, however uneven the rows.
    """
    times, values = (sliding_window_view(x, order * rows + 1)[:, ::rows] for x in (time_s, values))
    length, weight = times[:, -1:] - times[:, :1], np.ones(times.shape)
    for k in range(order + 1):
        weight /= np.where(np.arange(order + 1) == k, 1.0, (times - times[:, k : k + 1]) / length)
    return np.sum(weight * values, axis=1) / np.sqrt(np.sum(weight**2, axis=1))


def position_noise_sigma(time_s: np.ndarray, values: np.ndarray) -> float:
    """Standard deviation of the noise of a position (n,), in its unit, at times (n,), s; nan with
    fewer than MIN_SAMPLES finite samples.

    The smallest estimate over the orders of differences is taken, since motion only adds to it.
    """
    return float(np.min(scatter_by_order(time_s, values)))


def scatter_by_order(
    time_s: np.ndarray, values: np.ndarray, part: np.ndarray | None = None
) -> np.ndarray:
    """Standard deviations (orders,) of the noise of a position (n,), in its unit, at times (n,), s,
    by divided differences of several high orders, which remove a smooth motion; nan with fewer than
    MIN_SAMPLES finite samples. part: number (n,) of the part of each sample; differences lie within
    the parts that are long enough for the highest order, or, where none is, across them.
    """
    known = np.isfinite(values)
    if np.count_nonzero(known) < MIN_SAMPLES:
        return np.full(len(DIFFERENCE_ORDERS), np.nan)
    rows = np.flatnonzero(known)
    borders = [] if part is None else np.flatnonzero(np.diff(part[known])) + 1
    parts = [p for p in np.split(rows, borders) if len(p) > DIFFERENCE_ORDERS[-1]] or [rows]
    found = []
    for order in DIFFERENCE_ORDERS:
        each = [divided_differences(time_s[p], values[p], order) for p in parts]
        scatter = np.concatenate(each)
        found.append(MAD_TO_SIGMA * np.median(np.abs(scatter - np.median(scatter))))
    return np.array(found)


class SensorNoise(NamedTuple):
    """Standard deviation of a column's noise in its unit, and whether it is stated by the rig or
    measured by the scatter of the log; otherwise sigma is a lower bound (the column is constant, or
    has too few samples).
    """

    sigma: float
    is_seen: bool


def position_noise(rig: Rig, time_s: np.ndarray, values: np.ndarray) -> SensorNoise:
    """Noise, rad, of the samples (n,) of an angle at times (n,), s: the log's scatter, at least its
    quantisation.
    """
    rounding = rig.sensors.get("position_lsb_rad", resolution_of(values)) / UNIFORM_WIDTH_SIGMAS
    scatter = position_noise_sigma(time_s, values)
    sigma = float(np.nanmax([scatter, rounding, MIN_SIGMA["position_rad"]]))
    return SensorNoise(sigma, scatter >= sigma)


def column_noise(rig: Rig, column: str, values: np.ndarray) -> SensorNoise:
    """Noise of the samples (n,) of current_a, supply_v or speed_rpm, in its unit: stated noise and
    quantisation, or the log's scatter where the rig states no noise.
    """
    rounding = rig.sensors.get(LSB_KEYS[column], resolution_of(values)) / UNIFORM_WIDTH_SIGMAS
    stated = rig.sensors.get(NOISE_KEYS[column])
    if stated is not None:
        return SensorNoise(float(max(np.hypot(stated, rounding), MIN_SIGMA[column])), True)
    scatter = high_frequency_sigma(values)
    sigma = float(np.nanmax([scatter, rounding, MIN_SIGMA[column]]))
    return SensorNoise(sigma, scatter >= sigma)


def column_sigma(rig: Rig, column: str, values: np.ndarray) -> float:
    """Standard deviation of column_noise()."""
    return column_noise(rig, column, values).sigma


def noise_of(
    rig: Rig, time_s: np.ndarray, columns: Mapping[str, np.ndarray]
) -> dict[str, SensorNoise]:
    """Noise of each measured column (rows,) that a log has, by the name of the column; time_s
    (rows,): times of the rows, s.
    """
    noise = {name: column_noise(rig, name, columns[name]) for name in NOISE_KEYS if name in columns}
    if "position_rad" in columns:
        noise["position_rad"] = position_noise(rig, time_s, columns["position_rad"])
    return noise


def common_noise(logs: Sequence[Mapping[str, SensorNoise]]) -> list[dict[str, SensorNoise]]:
    """Noise of each column in each of several logs of one tool. Where a log gives only a lower
    bound (is_seen is False), the smallest noise of that column in the other logs replaces it if it
    is larger: all logs come from the same sensor, and motion only enlarges an estimate.
    """
    shown: dict[str, float] = {}
    for name, noise in (item for log in logs for item in log.items() if item[1].is_seen):
        shown[name] = min(noise.sigma, shown.get(name, np.inf))

    def raised(name: str, noise: SensorNoise) -> SensorNoise:
        least = 0.0 if noise.is_seen else shown.get(name, 0.0)
        return noise._replace(sigma=max(noise.sigma, least))

    return [{name: raised(name, noise) for name, noise in log.items()} for log in logs]


def resolution_of(values: np.ndarray) -> float:
    """Resolution of a column (n,), in its unit: the greatest step of which all differences between
    its values are multiples, at most the smallest difference; 0 for a constant.

    A column that moves fast (an encoder) holds few neighbouring values: its smallest difference is
    then several steps.
    """
    steps = np.diff(np.unique(values[np.isfinite(values)]))
    steps = steps[steps > LIMITS.min_step]
    if not len(steps):
        return 0.0
    least = float(steps.min())
    some = steps[:: max(1, len(steps) // LIMITS.max_differences)]
    for parts in range(1, LIMITS.max_parts + 1):
        count = some * parts / least
        near = count < LIMITS.max_count
        if near.any():
            is_multiple = np.abs(count[near] - np.round(count[near])) < LIMITS.multiple_error
            if np.mean(is_multiple) > LIMITS.multiple_share:
                return least / parts
    return least


def decimal_resolution(values: np.ndarray) -> float:
    """Value of the last decimal digit that a column (n,) is rounded to, in its unit; 0 where the
    values look exact: up to three decimals, or more than six.
    """
    known = values[np.isfinite(values)]

    def has_decimals(decimals: int) -> bool:
        return bool(np.all(np.abs(np.round(known, decimals) - known) < LIMITS.decimal_error))

    if has_decimals(LIMITS.exact_decimals):
        return 0.0
    for decimals in range(LIMITS.exact_decimals + 1, LIMITS.last_decimals + 1):
        if has_decimals(decimals):
            return 10.0**-decimals
    return 0.0
