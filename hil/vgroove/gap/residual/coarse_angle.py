"""Samples of an angle from a sensor with a coarse resolution, taken at the instants at which its
reading changes by a step.

Between two changes the angle is known to one step only. At a change it equals the border between
the two readings; only the instant of the change within its row interval is unknown.
"""

from dataclasses import dataclass

import numpy as np

from vgroove.gap.cleaning.logging_interval import median_interval_s
from vgroove.gap.cleaning.sensor_noise import UNIFORM_WIDTH_SIGMAS, position_noise_sigma

MAX_REST_S = 0.05  # of an unchanged reading between two samples
SINGLE_STEP = 1.5  # steps; a smaller change is one step
MAX_GAP_ROWS = 5.0  # usual row intervals; what happened in a longer one is unknown
# steps; least standard deviation of a border's place: data sheets of encoders allow an edge to err
# by 10 and more of the 90 electrical degrees of a step
BORDER_STEPS = 0.05


@dataclass(frozen=True)
class AngleSamples:
    """Measured angles (m,) in order of time: row of the log at or before whose end each lies,
    instant in s, angle and its standard deviation in rad. borders_scatter: whether the angles at
    which the reading changes scatter by more than BORDER_STEPS steps.
    """

    row: np.ndarray
    time_s: np.ndarray
    angle_rad: np.ndarray
    sigma_rad: np.ndarray
    borders_scatter: bool = False


def angle_samples(
    time_s: np.ndarray, position: np.ndarray, sigma: float, step: float
) -> AngleSamples:
    """Angle samples from the readings (n,) of a sensor at times (n,), s. sigma: standard deviation
    of one reading, step: its resolution, both in rad.

    Samples are taken where a reading changes by one step; every MAX_REST_S while it does not
    change; and at each row while it changes by several steps a row. No sample is taken from a
    change across missing rows.
    """
    follows = np.diff(time_s) <= MAX_GAP_ROWS * median_interval_s(time_s)
    changes = _changes(time_s, position, step, follows)
    parts = (
        changes,
        _readings(time_s, position, sigma, _rest_rows(time_s, position, follows)),
        _readings(time_s, position, sigma, _fast_rows(position, step, follows)),
    )
    order = np.argsort(np.concatenate([part.time_s for part in parts]), kind="stable")
    return AngleSamples(
        *(
            np.concatenate([getattr(part, name) for part in parts])[order]
            for name in ("row", "time_s", "angle_rad", "sigma_rad")
        ),
        changes.borders_scatter,
    )


def _changes(
    time_s: np.ndarray, position: np.ndarray, step: float, follows: np.ndarray
) -> AngleSamples:
    """One sample for each row interval in which the reading changes by one step. follows (n - 1,):
    whether no reading is missing between a row and the next; intervals with missing ones are left
    out.

    The sample lies in the middle of the interval, and its angle is the mean of the two readings:
    the border between them. Its variance is the sum of two: that of a uniform distribution over the
    motion within the interval, since the instant of the change is unknown; and that of the border's
    place, because marks of an encoder are unevenly spaced and noise shifts a change. The latter is
    estimated from the scatter of the changes, at least BORDER_STEPS steps.
    """
    change = np.diff(position)
    before = np.flatnonzero(change)
    instant, angle = (0.5 * (x[before] + x[before + 1]) for x in (time_s, position))
    moved = _motion_within_rows(np.diff(time_s)[before], instant, change[before], step)
    single = (np.abs(change[before]) < SINGLE_STEP * step) & follows[before]
    before, instant, angle, moved = (x[single] for x in (before, instant, angle, moved))
    rounding = moved / UNIFORM_WIDTH_SIGMAS
    seen = np.nan_to_num(position_noise_sigma(instant, angle))
    scatter = np.sqrt(max(0.0, seen**2 - float(np.median(rounding**2)))) if len(before) else 0.0
    border = max(float(scatter), BORDER_STEPS * step)
    sigma = np.hypot(rounding, border)
    return AngleSamples(before + 1, instant, angle, sigma, border > BORDER_STEPS * step)


def _motion_within_rows(
    length_s: np.ndarray, instant_s: np.ndarray, change: np.ndarray, step: float
) -> np.ndarray:
    """Estimate (k,), in rad, of the angle by which the shaft turns within each row interval of
    length (k,), s, in which the reading changes: speed times length, at most one step. The speed is
    the higher one of those before and after the change, each a mean over the nearest two intervals
    between changes in the same direction.
    """
    size = np.abs(change)
    same = np.sign(change[1:]) == np.sign(change[:-1])
    between, moved = np.diff(instant_s), np.where(same, 0.5 * (size[1:] + size[:-1]), np.inf)
    after = np.append(_speed_over_two(between, moved), 0.0)
    before = np.append(_speed_over_two(between[::-1], moved[::-1]), 0.0)[::-1]
    fastest = np.maximum(after, before) if len(change) > 1 else np.full(1, np.inf)
    return np.minimum(fastest * length_s, step)


def _speed_over_two(between_s: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Mean speed (k,) in rad/s over each interval between two changes and the one that follows it.
    moved (k,): angle turned in each interval, rad; inf where the direction reverses. The interval
    alone is used where the following one is missing or has a reversal.
    """
    longer = np.append(between_s[1:], 0.0) + between_s
    both = np.append(moved[1:], np.inf) + moved
    return np.where(np.isfinite(both), both / longer, moved / between_s)


def _readings(
    time_s: np.ndarray, position: np.ndarray, sigma: float, rows: np.ndarray
) -> AngleSamples:
    return AngleSamples(rows, time_s[rows], position[rows], np.full(len(rows), sigma))


def _fast_rows(position: np.ndarray, step: float, follows: np.ndarray) -> np.ndarray:
    """Rows (k,) before and after which the reading changes by several steps. The shaft is then so
    fast that the reading of a row is more precise than the instant of a change.
    """
    moved = np.abs(np.diff(position))  # a shaft at rest shows no step
    several = (moved >= SINGLE_STEP * step) & (moved > 0.0) & follows
    return 1 + np.flatnonzero(several[1:] & several[:-1])


def _rest_rows(time_s: np.ndarray, position: np.ndarray, follows: np.ndarray) -> np.ndarray:
    """Rows (k,) about every MAX_REST_S within each run of equal readings, at least MAX_REST_S from
    the ends of the run.
    """
    rows: list[int] = []
    first = np.append(0, 1 + np.flatnonzero((np.diff(position) != 0.0) | ~follows))
    for begin, end in zip(first, np.append(first[1:], len(position)) - 1, strict=True):
        count = int((time_s[end] - time_s[begin]) / MAX_REST_S)
        instants = time_s[begin] + MAX_REST_S * np.arange(1, count)
        rows += np.searchsorted(time_s, instants).tolist()
    return np.unique(np.array(rows, dtype=int))
