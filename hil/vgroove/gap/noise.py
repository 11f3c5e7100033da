"""Sensor noise: what the rig states, and what a log alone tells where the rig is silent; a model's
residual is never asked.
"""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.signal import savgol_coeffs, savgol_filter
from scipy.stats import chi2

from vgroove.gap.edges import COUNTING_PULSES, EdgePeriods
from vgroove.gap.missed import as_if_seen, loosened
from vgroove.rig import Rig

# differences that must fit a column's resolution, and steps in the smallest of them
STEPS_LOOKED_AT, MOST_PARTS = 2000, 64
SCATTER_WINDOW, SCATTER_ORDER = 11, 3  # Savitzky-Golay filter whose residual is called noise
SHORT = (5, 2)  # window and order of the filter that reaches across fewer steps
DIFFERENCE_ORDERS = range(3, 9)  # of a position, in which white noise is looked for
FEWEST_WINDOWS = 5  # of edge periods, in which their jitter is looked for
# edge periods of a window besides two turns: room for what is slow, for a pattern of the turn, and
# for jitter
BESIDE_A_TURN = 14
COUNTED_ROWS = 14  # of a sensor that counts edges, in which its jitter is looked for
TOUCHING = 0.2  # of a period: two that begin and end closer than this share an edge
RPM = 2.0 * np.pi / 60.0
MAD = 1.4826  # median absolute deviation to standard deviation of a normal distribution
# a noiseless log must not divide by zero
LEAST_SIGMA = {"current_a": 1e-3, "supply_v": 1e-3, "speed_rpm": 1e-2, "position_rad": 1e-9}


def kept(window: int, order: int) -> float:
    """Share of the power of white noise that a smooth line through a window around each sample
    leaves.
    """
    return 1.0 - float(savgol_coeffs(window, order)[window // 2])


KEPT = kept(SCATTER_WINDOW, SCATTER_ORDER)


def scatter(values: np.ndarray) -> float:
    """Standard deviation of a column's (n,) high-frequency scatter, robust against steps; nan where
    fewer than 20 samples are there.
    """
    finite = values[np.isfinite(values)]
    if len(finite) < 20:
        return float("nan")
    spread = usual_scatter(finite)
    return spread if spread > 0.0 else float(fast_part(finite).std() / np.sqrt(KEPT))


def usual_scatter(values: np.ndarray) -> float:
    """Standard deviation of the scatter of a column (n,) in most of its samples; 0 where most
    repeat the one before. Motion only adds: where steps follow one another closely, windows that
    reach across fewer of them tell.
    """
    spreads = [
        _usual(values, window, order) for window, order in ((SCATTER_WINDOW, SCATTER_ORDER), SHORT)
    ]
    return min(spreads) if min(spreads) > 0.0 else max(spreads)


def _usual(values: np.ndarray, window: int, order: int) -> float:
    """Standard deviation of white noise that leaves as much as most samples (n,) depart from a line
    through a window around them.
    """
    residual = fast_part(values, window, order)
    return float(
        MAD * np.median(np.abs(residual - np.median(residual))) / np.sqrt(kept(window, order))
    )


def command_noise(values: np.ndarray) -> float:
    """1 sigma of the noise of a measured command (n,); 0 for one without: a scatter within half a
    step of the column is its rounding.
    """
    finite = values[np.isfinite(values)]
    spread = usual_scatter(finite) if len(finite) >= SCATTER_WINDOW else 0.0
    return spread if spread > 0.5 * step_of(finite) else 0.0


def fast_part(
    values: np.ndarray, window: int = SCATTER_WINDOW, order: int = SCATTER_ORDER
) -> np.ndarray:
    """What a smooth line through a column (n,) leaves: its noise, and its rounding."""
    return values - savgol_filter(values, window, order)


def differences(time_s: np.ndarray, values: np.ndarray, order: int, rows: int = 1) -> np.ndarray:
    """Divided differences of a column (n,) at its times (n,), each over instants so many rows
    apart: a polynomial of a lower order leaves nothing, however uneven the rows, and white noise
    itself.
    """
    times, values = (sliding_window_view(x, order * rows + 1)[:, ::rows] for x in (time_s, values))
    length, weight = times[:, -1:] - times[:, :1], np.ones(times.shape)
    for k in range(order + 1):
        weight /= np.where(np.arange(order + 1) == k, 1.0, (times - times[:, k : k + 1]) / length)
    return np.sum(weight * values, axis=1) / np.sqrt(np.sum(weight**2, axis=1))


def position_scatter(time_s: np.ndarray, values: np.ndarray) -> float:
    """Standard deviation of the noise of a position (n,) at its times (n,): differences of high
    order leave of a smooth motion little. The least over the orders, since motion only adds; nan
    where fewer than 20 samples are there.
    """
    known = np.isfinite(values)
    if np.count_nonzero(known) < 20:
        return float("nan")
    found = (differences(time_s[known], values[known], order) for order in DIFFERENCE_ORDERS)
    return float(min(MAD * np.median(np.abs(d - np.median(d))) for d in found))


def position_sigma(rig: Rig, time_s: np.ndarray, values: np.ndarray) -> float:
    """1 sigma of the samples (n,) of an angle at their times (n,), rad: the log's scatter, at least
    its quantisation.
    """
    rounding = rig.sensors.get("position_lsb_rad", step_of(values)) / np.sqrt(12.0)
    return float(
        np.nanmax([position_scatter(time_s, values), rounding, LEAST_SIGMA["position_rad"]])
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
    rounding = rig.sensors.get(lsb_key, step_of(values)) / np.sqrt(12.0)
    noise = rig.sensors.get(noise_key)
    sigma = np.hypot(noise, rounding) if noise is not None else max(scatter(values), rounding)
    return float(max(sigma, LEAST_SIGMA[column]))


@dataclass(frozen=True)
class Jitter:
    """Standard deviation of an edge: of its angle, rad, and of its time stamp, s."""

    angle_rad: float = 0.0
    time_s: float = 0.0


def edge_jitter(edges: EdgePeriods, pulses_per_rev: int, rounding_rpm: float) -> Jitter:
    """Jitter of the edges from a log's edge periods alone; none where the log is too short to tell.

    In windows of some turns a quintic motion and a pattern that repeats every turn (eccentric or
    unequal edges, cogging) are taken away. What stays is rounding and jitter; neighbouring periods
    share an edge, so that jitter e makes period n err by e(n) - e(n-1). Where a row shows the last
    of several edges its neighbours share none, and its place in the turn is counted along the edges
    that no row shows. Rows that come slowly hold fast motion: what the nominal model expects is
    taken away. Motion only adds: the least that is found counts.
    """
    edges = edges.whole()
    # each row spans several edges: no pattern of a turn is left, and a turn would be long
    counted = pulses_per_rev >= COUNTING_PULSES
    turn = 1 if counted else pulses_per_rev
    size = COUNTED_ROWS if counted else max(4 * turn, 2 * turn + BESIDE_A_TURN)
    starts = np.arange(0, len(edges.row) - size + 1, size // 2)
    starts = starts[edges.chain[starts] == edges.chain[starts + size - 1]]
    if len(starts) < FEWEST_WINDOWS:
        return Jitter()
    rows = starts[:, None] + np.arange(size)
    motions = [0.0] if edges.expected_rpm is None else [0.0, edges.expected_rpm]
    places = [np.arange(len(edges.row)) % turn, edges.count % turn]
    variance = min(
        (
            _edge_variance(edges, rows, motion, place, rounding_rpm)
            for motion in motions
            for place in places
        ),
        key=np.median,
    )
    return _split_jitter(variance, ((edges.speed_rpm * RPM)[rows].mean(axis=1)) ** 2)


def _edge_variance(
    edges: EdgePeriods,
    rows: np.ndarray,
    motion_rpm: np.ndarray | float,
    place: np.ndarray,
    rounding_rpm: float,
) -> np.ndarray:
    """Variance (m,) of an edge's angle, rad^2, in windows of rows (m, size), less a known motion
    (n,), if edges lie at places (n,) of the turn.
    """
    period, middle = edges.end_s - edges.start_s, 0.5 * (edges.start_s + edges.end_s)
    mean_period, size = period[rows].mean(axis=1), rows.shape[1]
    keep = _what_motion_leaves(middle[rows], place[rows])
    touching = float(np.mean(np.abs(edges.start_s[1:] - edges.end_s[:-1]) < TOUCHING * period[1:]))
    seen = keep @ (2.0 * np.eye(size) - touching * (np.eye(size, k=1) + np.eye(size, k=-1))) @ keep
    power = np.trace(seen, axis1=1, axis2=2)
    freedom = power**2 / np.sum(seen**2, axis=(1, 2))
    usual = chi2.median(freedom) / freedom  # the median of so few squares lies below their mean
    angle = ((edges.speed_rpm - motion_rpm) * RPM)[rows] * mean_period[:, None]
    square = np.sum(np.einsum("mi,mij->mj", angle, keep) ** 2, axis=1)
    rounding = np.trace(keep, axis1=1, axis2=2) * (rounding_rpm * RPM * mean_period) ** 2
    return (square / usual - rounding) / power


def _split_jitter(variance: np.ndarray, speed_squared: np.ndarray) -> Jitter:
    """Angle and time part of windows' edge variances (m,), rad^2 = angle^2 + speed^2 time^2, from
    the medians of fast and slow windows.
    """
    fast = speed_squared >= 0.25 * np.quantile(speed_squared, 0.9)
    slow = ~fast if np.count_nonzero(~fast) >= 5 else fast
    angle = time = 0.0
    for _ in range(10):
        time = max(0.0, float(np.median((variance[fast] - angle) / speed_squared[fast])))
        angle = 0.5 * angle + 0.5 * max(
            0.0, float(np.median(variance[slow] - speed_squared[slow] * time))
        )
    return Jitter(float(np.sqrt(angle)), float(np.sqrt(time)))


def _what_motion_leaves(time_s: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Projections (m, size, size) of windows of values at times (m, size) that remove all that is
    slower than half of the fastest wave, a quintic, and what depends on the place (m, size) in the
    turn alone: jitter of shared edges is strongest in the fastest waves, where no motion and no
    vibration reaches.
    """
    size, since = time_s.shape[1], time_s - time_s[:, :1]
    share = (0.5 + since * (size - 1) / since[:, -1:]) / size
    slow = np.cos(np.pi * share[:, :, None] * np.arange(size // 2))
    quintic = (2.0 * share[:, :, None] - 1.0) ** np.arange(6)
    turn = place[:, :, None] == np.arange(1, int(place.max()) + 1)
    basis, scale, _ = np.linalg.svd(
        np.concatenate([slow, quintic, turn], axis=2), full_matrices=False
    )
    basis = basis * (scale > 1e-9 * scale[:, :1])[:, None, :]
    return np.eye(size) - basis @ np.swapaxes(basis, 1, 2)


def step_of(command: np.ndarray) -> float:
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


def last_digit(command: np.ndarray) -> float:
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


def sigma_with_missed_rpm(rig: Rig, edges: EdgePeriods, missed: np.ndarray) -> np.ndarray:
    """1 sigma (m,) of each edge period's speed, rpm, where missed (m,) edges were passed unseen:
    jitter is that of the edges as if seen.
    """
    rounding = rig.sensors.get("speed_lsb_rpm", 0.0) / np.sqrt(12.0)
    jitter = edge_jitter(as_if_seen(edges, missed), rig.sensors["hall_pulses_per_rev"], rounding)
    return edge_sigma_rpm(rig, loosened(edges, missed), jitter)


def edge_sigma_rpm(rig: Rig, edges: EdgePeriods, jitter: Jitter) -> np.ndarray:
    """1 sigma (m,) of each edge period's speed, rpm: quantisation, stated noise, edge jitter, and
    how well its place in time is known.
    """
    length = np.maximum(edges.end_s - edges.start_s, 1e-9)
    rounding = rig.sensors.get("speed_lsb_rpm", 0.0) / np.sqrt(12.0)
    noise = rig.sensors.get("speed_noise_rpm", 0.0)
    edge = np.sqrt(2.0) * np.hypot(jitter.angle_rad / RPM, jitter.time_s * edges.speed_rpm) / length
    return np.sqrt(
        rounding**2
        + noise**2
        + edge**2
        + _place_error_rpm(edges) ** 2
        + LEAST_SIGMA["speed_rpm"] ** 2
    )


def _place_error_rpm(edges: EdgePeriods) -> np.ndarray:
    """Speed error (m,) from the uncertain place of each period: its slack times the acceleration
    around it.
    """
    whole = np.flatnonzero(~edges.falling)
    if len(whole) < 3:
        return np.zeros(len(edges.row))
    middle = 0.5 * (edges.start_s + edges.end_s)
    time, speed = middle[whole], edges.speed_rpm[whole]
    rate = np.abs(np.gradient(speed, np.maximum.accumulate(time) + 1e-9 * np.arange(len(time))))
    return edges.slack_s / np.sqrt(3.0) * np.interp(middle, time, rate)
