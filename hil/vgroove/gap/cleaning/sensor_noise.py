"""Sensor noise: what the rig states, and what a log alone tells where the rig is silent; a model's
residual is never asked.
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.signal import savgol_coeffs, savgol_filter

from vgroove.rig import Rig

# differences that must fit a column's resolution, and steps in the smallest of them
STEPS_LOOKED_AT, MOST_PARTS = 2000, 64
FILTER_ROWS, FILTER_ORDER = 11, 3  # Savitzky-Golay filter whose residual is called noise
SHORT = (5, 2)  # window and order of the filter that reaches across fewer steps
DIFFERENCE_ORDERS = range(3, 9)  # of a position, in which white noise is looked for
MAD_TO_SIGMA = 1.4826  # median absolute deviation to standard deviation of a normal distribution
# a noiseless log must not divide by zero
MIN_SIGMA = {"current_a": 1e-3, "supply_v": 1e-3, "speed_rpm": 1e-2, "position_rad": 1e-9}


def residual_power_share(window: int, order: int) -> float:
    """Share of the power of white noise that a smooth line through a window around each sample
    leaves.
    """
    return 1.0 - float(savgol_coeffs(window, order)[window // 2])


RESIDUAL_POWER_SHARE = residual_power_share(FILTER_ROWS, FILTER_ORDER)


def high_frequency_sigma(values: np.ndarray) -> float:
    """Standard deviation of a column's (n,) high-frequency scatter, robust against steps; nan where
    fewer than 20 samples are there.
    """
    finite = values[np.isfinite(values)]
    if len(finite) < 20:
        return float("nan")
    spread = typical_sigma(finite)
    return (
        spread
        if spread > 0.0
        else float(high_pass_residual(finite).std() / np.sqrt(RESIDUAL_POWER_SHARE))
    )


def typical_sigma(values: np.ndarray) -> float:
    """Standard deviation of the scatter of a column (n,) in most of its samples; 0 where most
    repeat the one before. Motion only adds: where steps follow one another closely, windows that
    reach across fewer of them tell.
    """
    spreads = [
        _usual(values, window, order) for window, order in ((FILTER_ROWS, FILTER_ORDER), SHORT)
    ]
    return min(spreads) if min(spreads) > 0.0 else max(spreads)


def _usual(values: np.ndarray, window: int, order: int) -> float:
    """Standard deviation of white noise that leaves as much as most samples (n,) depart from a line
    through a window around them.
    """
    residual = high_pass_residual(values, window, order)
    return float(
        MAD_TO_SIGMA
        * np.median(np.abs(residual - np.median(residual)))
        / np.sqrt(residual_power_share(window, order))
    )


def command_noise_sigma(values: np.ndarray) -> float:
    """1 sigma of the noise of a measured command (n,); 0 for one without: a scatter within half a
    step of the column is its rounding.
    """
    finite = values[np.isfinite(values)]
    spread = typical_sigma(finite) if len(finite) >= FILTER_ROWS else 0.0
    return spread if spread > 0.5 * resolution_of(finite) else 0.0


def high_pass_residual(
    values: np.ndarray, window: int = FILTER_ROWS, order: int = FILTER_ORDER
) -> np.ndarray:
    """What a smooth line through a column (n,) leaves: its noise, and its rounding."""
    return values - savgol_filter(values, window, order)


def divided_differences(
    time_s: np.ndarray, values: np.ndarray, order: int, rows: int = 1
) -> np.ndarray:
    """Divided differences of a column (n,) at its times (n,), each over instants so many rows
    apart: a polynomial of a lower order leaves nothing, however uneven the rows, and white noise
    itself.
    """
    times, values = (sliding_window_view(x, order * rows + 1)[:, ::rows] for x in (time_s, values))
    length, weight = times[:, -1:] - times[:, :1], np.ones(times.shape)
    for k in range(order + 1):
        weight /= np.where(np.arange(order + 1) == k, 1.0, (times - times[:, k : k + 1]) / length)
    return np.sum(weight * values, axis=1) / np.sqrt(np.sum(weight**2, axis=1))


def position_noise_sigma(time_s: np.ndarray, values: np.ndarray) -> float:
    """Standard deviation of the noise of a position (n,) at its times (n,): differences of high
    order leave of a smooth motion little. The least over the orders, since motion only adds; nan
    where fewer than 20 samples are there.
    """
    known = np.isfinite(values)
    if np.count_nonzero(known) < 20:
        return float("nan")
    found = (
        divided_differences(time_s[known], values[known], order) for order in DIFFERENCE_ORDERS
    )
    return float(min(MAD_TO_SIGMA * np.median(np.abs(d - np.median(d))) for d in found))


def position_sigma(rig: Rig, time_s: np.ndarray, values: np.ndarray) -> float:
    """1 sigma of the samples (n,) of an angle at their times (n,), rad: the log's scatter, at least
    its quantisation.
    """
    rounding = rig.sensors.get("position_lsb_rad", resolution_of(values)) / np.sqrt(12.0)
    return float(
        np.nanmax([position_noise_sigma(time_s, values), rounding, MIN_SIGMA["position_rad"]])
    )


def column_sigma(rig: Rig, column: str, values: np.ndarray) -> float:
    """1 sigma of a column's samples in its unit: stated noise and quantisation, or the log's
    scatter where no noise is stated.
    """
    noise_key, lsb_key = {
        "current_a": ("current_noise_a", "current_lsb_a"),
        "supply_v": ("supply_noise_v", ""),
        "speed_rpm": ("speed_noise_rpm", "speed_lsb_rpm"),
    }[column]
    rounding = rig.sensors.get(lsb_key, resolution_of(values)) / np.sqrt(12.0)
    noise = rig.sensors.get(noise_key)
    sigma = (
        np.hypot(noise, rounding)
        if noise is not None
        else max(high_frequency_sigma(values), rounding)
    )
    return float(max(sigma, MIN_SIGMA[column]))


def resolution_of(command: np.ndarray) -> float:
    """Resolution of a column: the greatest step of which all differences between its values are
    multiples, at most the smallest difference.

    A column that moves fast (an encoder) shows few neighbouring values: its smallest difference is
    several steps.
    """
    steps = np.diff(np.unique(command[np.isfinite(command)]))
    steps = steps[steps > 1e-9]
    if not len(steps):
        return 0.0
    least = float(steps.min())
    some = steps[:: max(1, len(steps) // STEPS_LOOKED_AT)]
    for parts in range(1, MOST_PARTS + 1):
        count = some * parts / least
        # beyond that the smallest difference, rounded as it is, misses the multiple
        near = count < 1000.0
        if near.any() and np.mean(np.abs(count[near] - np.round(count[near])) < 0.1) > 0.98:
            return least / parts
    return least


def decimal_resolution(command: np.ndarray) -> float:
    """Value of the last decimal digit that a column is rounded to; 0 where values look exact: up to
    three decimals, or more than six.
    """
    known = command[np.isfinite(command)]
    if np.all(np.abs(np.round(known, 3) - known) < 1e-9):
        return 0.0
    for decimals in range(4, 7):
        if np.all(np.abs(np.round(known, decimals) - known) < 1e-9):
            return 10.0**-decimals
    return 0.0
