"""Samples of an angle whose sensor has coarse steps: the instants at which its reading changes by
a step.

Between two changes the angle is known to a step only; at a change it lies on the border between two
readings, up to the motion within the row in which the change falls.
"""

from dataclasses import dataclass

import numpy as np

from vgroove.gap.cleaning.sensor_noise import UNIFORM_WIDTH_SIGMAS, position_noise_sigma

MAX_REST_S = 0.05  # of an unchanged reading between two samples
SINGLE_STEP = 1.5  # steps; a smaller change is one step
MAX_GAP_ROWS = 5.0  # usual row intervals; what happened in a longer one is unknown
# steps; least standard deviation of a border's place: data sheets of encoders allow an edge to err
# by 10 and more of the 90 electrical degrees of a step
BORDER_STEPS = 0.05


@dataclass(frozen=True)
class AngleSamples:
    """Samples (m,) in order of time: the row at which each ends, its instant in s, angle and
    standard deviation in rad; borders_scatter: whether the borders between readings scatter more
    than those of a good encoder.
    """

    row: np.ndarray
    time_s: np.ndarray
    angle_rad: np.ndarray
    sigma_rad: np.ndarray
    borders_scatter: bool = False


def angle_samples(
    time_s: np.ndarray, position: np.ndarray, sigma: float, step: float
) -> AngleSamples:
    """Samples of the readings (n,) of a sensor at times (n,), with standard deviation sigma and
    steps in rad: the changes by one step, some readings in longer rests and all in a fast motion;
    nothing across missing rows.
    """
    follows = np.diff(time_s) <= MAX_GAP_ROWS * np.median(np.diff(time_s))
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
    """The changes of a reading by one step from a row to one that follows (n - 1,), each in the
    middle of its row interval and of the two readings. The standard deviation is that of an even
    distribution over the motion within the row, and of the places of the borders, which an
    encoder's marks or a noise below a step scatter: as the changes show it, at least BORDER_STEPS.
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
    """Motion (k,) in rad within the rows of lengths (k,) in which the reading changes, at most a
    step: what the speed shows of it. The speed is that of the faster side, over two changes in the
    same direction.
    """
    size = np.abs(change)
    same = np.sign(change[1:]) == np.sign(change[:-1])
    between, moved = np.diff(instant_s), np.where(same, 0.5 * (size[1:] + size[:-1]), np.inf)
    after = np.append(_speed_over_two(between, moved), 0.0)
    before = np.append(_speed_over_two(between[::-1], moved[::-1]), 0.0)[::-1]
    fastest = np.maximum(after, before) if len(change) > 1 else np.full(1, np.inf)
    return np.minimum(fastest * length_s, step)


def _speed_over_two(between_s: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Speed (k,) in rad/s over each interval and the next, over the interval alone where the next
    has no direction (infinite motion) or is missing.
    """
    longer = np.append(between_s[1:], 0.0) + between_s
    both = np.append(moved[1:], np.inf) + moved
    return np.where(np.isfinite(both), both / longer, moved / between_s)


def _readings(
    time_s: np.ndarray, position: np.ndarray, sigma: float, rows: np.ndarray
) -> AngleSamples:
    return AngleSamples(rows, time_s[rows], position[rows], np.full(len(rows), sigma))


def _fast_rows(position: np.ndarray, step: float, follows: np.ndarray) -> np.ndarray:
    """Rows before and after which the reading changes by several steps: the reading is then more
    precise than the instants of its changes.
    """
    several = (np.abs(np.diff(position)) >= SINGLE_STEP * step) & follows
    return 1 + np.flatnonzero(several[1:] & several[:-1])


def _rest_rows(time_s: np.ndarray, position: np.ndarray, follows: np.ndarray) -> np.ndarray:
    """Rows every MAX_REST_S in runs of equal readings, that far from their ends."""
    rows: list[int] = []
    first = np.append(0, 1 + np.flatnonzero((np.diff(position) != 0.0) | ~follows))
    for begin, end in zip(first, np.append(first[1:], len(position)) - 1, strict=True):
        count = int((time_s[end] - time_s[begin]) / MAX_REST_S)
        instants = time_s[begin] + MAX_REST_S * np.arange(1, count)
        rows += np.searchsorted(time_s, instants).tolist()
    return np.unique(np.array(rows, dtype=int))
