"""Estimates the standard deviation of Hall edges (angle and time stamp) from a log's edge periods,
and from it the standard deviation of each edge speed.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from vgroove.array_cache import cached_by_content
from vgroove.gap.cleaning.sensor_noise import (
    MIN_SIGMA,
    UNIFORM_WIDTH_SIGMAS,
    scatter_by_order,
)
from vgroove.gap.hall_edges.edge_periods import MIN_COUNTING_PULSES, EdgePeriods
from vgroove.gap.hall_edges.missed_edges import as_single_pitches, widen_beside_missed
from vgroove.rig import Rig
from vgroove.units import RAD_S_PER_RPM, TURN_RAD


@dataclass(frozen=True)
class JitterLimits:
    """Limits of the jitter estimate, chosen on the tuning half of the blind set."""

    min_windows: int = 5  # windows of edge periods below which a log is short
    # edge periods of a window in addition to two turns: degrees of freedom that remain for jitter
    # after motion and the pattern of the turn are projected out
    beside_turns: int = 14
    counted_rows: int = 14  # edge periods of a window of a sensor that counts edges
    touching_share: float = 0.2  # of a period: two periods that are closer than this share an edge
    # a window is fast if its squared speed exceeds this share of that quantile of all windows
    fast_share: float = 0.25
    fast_quantile: float = 0.9
    min_slow_windows: int = 5  # with fewer, the angle part is estimated from the fast windows too
    iterations: int = 10  # alternating estimates of angle and time part
    rank_tolerance: float = 1e-9  # singular values below this share of the largest count as 0
    min_length_s: float = 1e-9  # smallest length of a period that is divided by, s


LIMITS = JitterLimits()
KEPT_LOGS = 8  # results that are kept: speed channel and state observer need the same one


@dataclass(frozen=True)
class Jitter:
    """Standard deviation of an edge: of its angle, rad, and of its time stamp, s."""

    angle_rad: float = 0.0
    time_s: float = 0.0


@cached_by_content(most=KEPT_LOGS)
def edge_jitter(edges: EdgePeriods, pulses_per_rev: int, rounding_rpm: float) -> Jitter:
    """Jitter of the edges from a log's edge periods alone.

    In windows of four or more turns an orthogonal projection removes slow motion and any pattern
    that repeats every turn (eccentric or unequal edges, cogging). What remains is rounding of
    standard deviation rounding_rpm and jitter; neighbouring periods share an edge, so that jitter e
    adds e(n) - e(n-1) to period n. The median over windows is divided by the median of chi-square.

    Two numberings of the edges in the turn are tried (as reported, and with hidden edges), each
    with and without subtracting the motion that the nominal model expects. Motion that is left only
    adds variance: the smallest estimate is taken.
    """
    edges = edges.without_timeouts()
    counted = pulses_per_rev >= MIN_COUNTING_PULSES
    # each row of a counting sensor spans several edges: no pattern of a turn is left
    turn = 1 if counted else pulses_per_rev
    size = LIMITS.counted_rows if counted else max(4 * turn, 2 * turn + LIMITS.beside_turns)
    starts = np.arange(0, len(edges.row) - size + 1, size // 2)
    starts = starts[edges.chain[starts] == edges.chain[starts + size - 1]]
    if len(starts) < LIMITS.min_windows:
        return Jitter(angle_rad=_scatter_of_few_edges(edges, TURN_RAD / pulses_per_rev))
    rows = starts[:, None] + np.arange(size)
    motions = [0.0] if edges.expected_rpm is None else [0.0, edges.expected_rpm]
    places = [np.arange(len(edges.row)) % turn, edges.count % turn]
    by_place = [_edge_variances(edges, rows, motions, place, rounding_rpm) for place in places]
    variance = min(
        (v for of_motion in zip(*by_place, strict=True) for v in of_motion), key=np.median
    )
    return _split_jitter(variance, ((edges.speed_rpm * RAD_S_PER_RPM)[rows].mean(axis=1)) ** 2)


def _scatter_of_few_edges(edges: EdgePeriods, pitch_rad: float) -> float:
    """Standard deviation in rad of the angles of edges against a smooth motion, for a log that is
    too short to tell jitter from a pattern of the turn; 0 where there are too few. Of few edges the
    smallest of several estimates would be small by chance: the median over the orders is taken, and
    the smaller one of those with and without the motion that the nominal model expects. A period
    spans several edges where the sensor counts them.
    """
    period_s = edges.end_s - edges.start_s
    turned_rad = edges.speed_rpm / edges.scale * RAD_S_PER_RPM * period_s
    count = np.maximum(np.round(np.abs(turned_rad) / pitch_rad), 1.0)
    step_rad = pitch_rad * np.where(turned_rad < 0.0, -count, count)
    motions_rpm = [0.0] if edges.expected_rpm is None else [0.0, edges.expected_rpm]
    time_s = np.cumsum(period_s)
    scatter = [
        scatter_by_order(time_s, np.cumsum(step_rad - rpm * RAD_S_PER_RPM * period_s), edges.chain)
        for rpm in motions_rpm
    ]
    return float(np.nan_to_num(np.median(scatter, axis=1).min()))


def _edge_variances(
    edges: EdgePeriods,
    rows: np.ndarray,
    motions_rpm: Sequence[np.ndarray | float],
    place: np.ndarray,
    rounding_rpm: float,
) -> list[np.ndarray]:
    """Variance (m,) of an edge's angle, rad^2, in windows of rows (m, size), after subtracting each
    of the known motions (n,); place (n,): number of each edge in the turn.
    """
    period, middle = edges.end_s - edges.start_s, 0.5 * (edges.start_s + edges.end_s)
    mean_period, size = period[rows].mean(axis=1), rows.shape[1]
    projection = _motion_free_projection(middle[rows], place[rows])
    near = LIMITS.touching_share * period[1:]
    touching = float(np.mean(np.abs(edges.start_s[1:] - edges.end_s[:-1]) < near))
    # covariance of differences e(n) - e(n-1) of unit jitter, after the projection
    unit = 2.0 * np.eye(size) - touching * (np.eye(size, k=1) + np.eye(size, k=-1))
    covariance = projection @ unit @ projection
    power = np.trace(covariance, axis1=1, axis2=2)
    # the squared remainder is a sum of weighted squares: a scaled chi-square distribution with
    # trace^2 / trace of the square as its degrees of freedom (Satterthwaite, Biometrics Bulletin
    # 2(6), 1946)
    freedom = power**2 / np.sum(covariance**2, axis=(1, 2))
    median_share = chdtri(freedom, 0.5) / freedom  # its median lies below its mean
    rounding = (
        np.trace(projection, axis1=1, axis2=2) * (rounding_rpm * RAD_S_PER_RPM * mean_period) ** 2
    )
    found = []
    for motion_rpm in motions_rpm:
        angle = ((edges.speed_rpm - motion_rpm) * RAD_S_PER_RPM)[rows] * mean_period[:, None]
        square = np.sum(np.einsum("mi,mij->mj", angle, projection) ** 2, axis=1)
        found.append((square / median_share - rounding) / power)
    return found


def _split_jitter(variance: np.ndarray, speed_squared: np.ndarray) -> Jitter:
    """Angle and time part of the edge variances (m,) of windows, rad^2 = angle^2 + speed^2 time^2,
    from the medians of fast and slow windows; speed_squared (m,), (rad/s)^2.
    """
    fast = speed_squared >= LIMITS.fast_share * np.quantile(speed_squared, LIMITS.fast_quantile)
    slow = ~fast if np.count_nonzero(~fast) >= LIMITS.min_slow_windows else fast
    angle = time = 0.0
    for _ in range(LIMITS.iterations):
        time = max(0.0, float(np.median((variance[fast] - angle) / speed_squared[fast])))
        angle = 0.5 * angle + 0.5 * max(
            0.0, float(np.median(variance[slow] - speed_squared[slow] * time))
        )
    return Jitter(float(np.sqrt(angle)), float(np.sqrt(time)))


def _motion_free_projection(time_s: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Orthogonal projections (m, size, size) that remove motion from windows of values at times
    (m, size), s.

    Removed are the slower half of all cosines (discrete cosine transform), a quintic polynomial,
    and what depends on the edge's number `place` (m, size) in the turn alone. Jitter of shared
    edges is strongest in the fastest cosines, where motion and vibration are absent.
    """
    size, since = time_s.shape[1], time_s - time_s[:, :1]
    share = (0.5 + since * (size - 1) / since[:, -1:]) / size
    slow = np.cos(np.pi * share[:, :, None] * np.arange(size // 2))
    quintic = (2.0 * share[:, :, None] - 1.0) ** np.arange(6)
    turn = place[:, :, None] == np.arange(1, int(place.max()) + 1)
    basis, scale, _ = np.linalg.svd(
        np.concatenate([slow, quintic, turn], axis=2), full_matrices=False
    )
    basis = basis * (scale > LIMITS.rank_tolerance * scale[:, :1])[:, None, :]
    return np.eye(size) - basis @ np.swapaxes(basis, 1, 2)


def sigma_with_missed_rpm(rig: Rig, edges: EdgePeriods, missed: np.ndarray) -> np.ndarray:
    """Standard deviation (m,) of each edge period's speed, rpm, where the sensor missed `missed`
    (m,) edges: jitter is estimated from the periods shortened to one pitch.
    """
    rounding = rig.sensors.get("speed_lsb_rpm", 0.0) / UNIFORM_WIDTH_SIGMAS
    jitter = edge_jitter(
        as_single_pitches(edges, missed), rig.sensors["hall_pulses_per_rev"], rounding
    )
    return edge_sigma_rpm(rig, widen_beside_missed(edges, missed), jitter)


def edge_sigma_rpm(rig: Rig, edges: EdgePeriods, jitter: Jitter) -> np.ndarray:
    """Standard deviation (m,) of each edge period's speed, rpm: quantisation, stated noise, edge
    jitter, and the uncertainty of its instant.
    """
    length = np.maximum(edges.end_s - edges.start_s, LIMITS.min_length_s)
    rounding = rig.sensors.get("speed_lsb_rpm", 0.0) / UNIFORM_WIDTH_SIGMAS
    noise = rig.sensors.get("speed_noise_rpm", 0.0)
    edge_rpm = np.hypot(jitter.angle_rad / RAD_S_PER_RPM, jitter.time_s * edges.speed_rpm)
    edge = np.sqrt(2.0) * edge_rpm / length
    return np.sqrt(
        rounding**2
        + noise**2
        + edge**2
        + _place_error_rpm(edges) ** 2
        + MIN_SIGMA["speed_rpm"] ** 2
    )


def _place_error_rpm(edges: EdgePeriods) -> np.ndarray:
    """Speed error (m,), rpm, from the uncertain time of each period: the standard deviation of its
    time, half width / sqrt(3), times the acceleration around it.
    """
    whole = np.flatnonzero(~edges.timeout)
    if len(whole) < 3:
        return np.zeros(len(edges.row))
    middle = 0.5 * (edges.start_s + edges.end_s)
    time, speed = middle[whole], edges.speed_rpm[whole]
    # strictly increasing times, which the gradient needs
    increasing = np.maximum.accumulate(time) + LIMITS.min_length_s * np.arange(len(time))
    rate = np.abs(np.gradient(speed, increasing))
    return edges.slack_s / np.sqrt(3.0) * np.interp(middle, time, rate)
