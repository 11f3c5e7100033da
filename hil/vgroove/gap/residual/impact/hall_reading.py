"""The speed that a Hall sensor's reader gives along a simulated motion, as its mean over all places
that the edges may have in the turn.

A reading is the mean speed over the last edge period (docs/spec/gap.md, section 1), and the age of
that edge is uniformly distributed over one period. The mean reading is therefore the speed under a
triangular window of two periods, to first order in the change of speed over these: smooth in the
parameters of the model, unlike a single reading, whose edges jump over the rows of the log.
"""

import numpy as np
import scipy  # its parts load when they are first used

from vgroove.units import TURN_RAD

FINE = 8  # points of an interval between rows at which edges are looked for
MIN_ROWS_OF_PERIOD = 0.05  # shortest edge period, in row intervals: keeps differences exact


def mean_hall_speed(
    angle: np.ndarray, speed: np.ndarray, row_s: float, pulses: int, timeout_s: float
) -> np.ndarray:
    """Mean readings (B, rows) in rad/s of a sensor with `pulses` edges a turn, from angles in rad
    and speeds in rad/s (B, rows) at rows every row_s; 0 where an edge period exceeds timeout_s,
    nan where the plant could not simulate.
    """
    pitch = TURN_RAD / pulses
    period = pitch / np.maximum(np.abs(speed), 1e-9)
    shift = np.clip(period / row_s, MIN_ROWS_OF_PERIOD, speed.shape[1])
    integral = _integral(angle - angle[:, :1], speed, row_s)
    rows = np.arange(speed.shape[1], dtype=float)
    now = integral
    once, twice = (_at(integral, angle - angle[:, :1], rows - k * shift, row_s) for k in (1.0, 2.0))
    reading = (now - 2.0 * once + twice) / (shift * row_s) ** 2
    return np.where(period > timeout_s, 0.0, reading)


def edge_speed(
    angle: np.ndarray, speed: np.ndarray, row_s: float, pulses: int, timeout_s: float
) -> np.ndarray:
    """Readings (B, rows) in rad/s of a Hall sensor whose edges lie at multiples of the pitch: pitch
    over the last edge period, or over the time since the last edge where that is longer.
    mean_hall_speed() is the mean of such readings over all places of the edges.
    """
    return np.stack(
        [_edge_speed(*one, row_s, pulses, timeout_s) for one in zip(angle, speed, strict=True)]
    )


def _edge_speed(
    angle: np.ndarray, speed: np.ndarray, row_s: float, pulses: int, timeout_s: float
) -> np.ndarray:
    """The readings (rows,) of one motion; a shaft that swings back repeats no edge."""
    if not np.isfinite(angle).all():
        return np.full(len(angle), np.nan)
    pitch, time_s = TURN_RAD / pulses, row_s * np.arange(len(angle))
    fine_s = row_s / FINE * np.arange(FINE * (len(angle) - 1) + 1)
    forwards = np.sign(angle[-1] - angle[0])
    path = forwards * scipy.interpolate.CubicHermiteSpline(time_s, angle, speed)(fine_s)
    turned = np.maximum.accumulate(path) / pitch
    numbers = np.arange(np.floor(turned[0]) + 1.0, np.floor(turned[-1]) + 1.0)
    edges = np.interp(numbers, turned, fine_s)
    if len(edges) < 2:
        return np.zeros(len(angle))
    latest = np.searchsorted(edges, time_s, side="right") - 1
    period = np.diff(edges)[np.maximum(latest - 1, 0)]
    age = time_s - edges[np.maximum(latest, 0)]
    shown = np.maximum(np.maximum(period, age), MIN_ROWS_OF_PERIOD * row_s)
    return np.where((latest < 1) | (shown > timeout_s), 0.0, forwards * pitch / shown)


def _integral(angle: np.ndarray, speed: np.ndarray, row_s: float) -> np.ndarray:
    """Integral (B, rows) of angles over time, with their known derivatives (Hermite)."""
    steps = 0.5 * row_s * (angle[:, 1:] + angle[:, :-1])
    steps += row_s**2 / 12.0 * (speed[:, :-1] - speed[:, 1:])
    return np.concatenate([np.zeros((len(angle), 1)), np.cumsum(steps, axis=1)], axis=1)


def _at(integral: np.ndarray, angle: np.ndarray, place: np.ndarray, row_s: float) -> np.ndarray:
    """The integral (B, rows) at places between rows (B, rows), by cubic Hermite interpolation; 0
    before the first row, where the shaft rests at angle 0.
    """
    inside = np.maximum(np.nan_to_num(place), 0.0)
    row = np.minimum(inside.astype(int), integral.shape[1] - 2)
    f = inside - row
    g = 1.0 - f
    left, right = (np.take_along_axis(integral, row + k, axis=1) for k in (0, 1))
    slope_left, slope_right = (np.take_along_axis(angle, row + k, axis=1) for k in (0, 1))
    value = g * g * (1.0 + 2.0 * f) * left + f * f * (3.0 - 2.0 * f) * right
    value += row_s * f * g * (g * slope_left - f * slope_right)
    return np.where(place < 0.0, 0.0, value)
