"""Standard deviation of Hall edges (angle and time stamp) estimated from a log's edge periods, and
the resulting sigma of each edge speed.
"""

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from vgroove.gap.cleaning.sensor_noise import MIN_SIGMA
from vgroove.gap.hall_edges.edge_periods import MIN_COUNTING_PULSES, EdgePeriods
from vgroove.gap.hall_edges.missed_edges import as_single_pitches, widen_beside_missed
from vgroove.rig import Rig
from vgroove.units import RAD_S_PER_RPM

FEWEST_WINDOWS = 5  # of edge periods, in which their jitter is looked for
# edge periods of a window besides two turns: room for what is slow, for a pattern of the turn, and
# for jitter
BESIDE_A_TURN = 14
COUNTED_ROWS = 14  # of a sensor that counts edges, in which its jitter is looked for
TOUCHING = 0.2  # of a period: two that begin and end closer than this share an edge


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
    edges = edges.without_timeouts()
    # each row spans several edges: no pattern of a turn is left, and a turn would be long
    counted = pulses_per_rev >= MIN_COUNTING_PULSES
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
    return _split_jitter(variance, ((edges.speed_rpm * RAD_S_PER_RPM)[rows].mean(axis=1)) ** 2)


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
    angle = ((edges.speed_rpm - motion_rpm) * RAD_S_PER_RPM)[rows] * mean_period[:, None]
    square = np.sum(np.einsum("mi,mij->mj", angle, keep) ** 2, axis=1)
    rounding = np.trace(keep, axis1=1, axis2=2) * (rounding_rpm * RAD_S_PER_RPM * mean_period) ** 2
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


def sigma_with_missed_rpm(rig: Rig, edges: EdgePeriods, missed: np.ndarray) -> np.ndarray:
    """1 sigma (m,) of each edge period's speed, rpm, where missed (m,) edges were passed unseen:
    jitter is that of the edges as if seen.
    """
    rounding = rig.sensors.get("speed_lsb_rpm", 0.0) / np.sqrt(12.0)
    jitter = edge_jitter(
        as_single_pitches(edges, missed), rig.sensors["hall_pulses_per_rev"], rounding
    )
    return edge_sigma_rpm(rig, widen_beside_missed(edges, missed), jitter)


def edge_sigma_rpm(rig: Rig, edges: EdgePeriods, jitter: Jitter) -> np.ndarray:
    """1 sigma (m,) of each edge period's speed, rpm: quantisation, stated noise, edge jitter, and
    how well its place in time is known.
    """
    length = np.maximum(edges.end_s - edges.start_s, 1e-9)
    rounding = rig.sensors.get("speed_lsb_rpm", 0.0) / np.sqrt(12.0)
    noise = rig.sensors.get("speed_noise_rpm", 0.0)
    edge = (
        np.sqrt(2.0)
        * np.hypot(jitter.angle_rad / RAD_S_PER_RPM, jitter.time_s * edges.speed_rpm)
        / length
    )
    return np.sqrt(
        rounding**2
        + noise**2
        + edge**2
        + _place_error_rpm(edges) ** 2
        + MIN_SIGMA["speed_rpm"] ** 2
    )


def _place_error_rpm(edges: EdgePeriods) -> np.ndarray:
    """Speed error (m,) from the uncertain place of each period: its slack times the acceleration
    around it.
    """
    whole = np.flatnonzero(~edges.timeout)
    if len(whole) < 3:
        return np.zeros(len(edges.row))
    middle = 0.5 * (edges.start_s + edges.end_s)
    time, speed = middle[whole], edges.speed_rpm[whole]
    rate = np.abs(np.gradient(speed, np.maximum.accumulate(time) + 1e-9 * np.arange(len(time))))
    return edges.slack_s / np.sqrt(3.0) * np.interp(middle, time, rate)
