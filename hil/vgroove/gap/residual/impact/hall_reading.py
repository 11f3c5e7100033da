"""The speed that a Hall sensor's reader would give along a simulated motion: one pitch over the
last edge period, falling while the next edge is awaited (docs/spec/gap.md, section 1).
"""

import numpy as np

from vgroove.units import TURN_RAD

HERMITE_POINTS = 2  # instants between rows at which the angle is interpolated


def hall_speed(
    time_s: np.ndarray, angle: np.ndarray, speed: np.ndarray, pulses: int, timeout_s: float
) -> np.ndarray:
    """Reading (rows,) in rad/s of a sensor with `pulses` edges a turn, from times, angles in rad
    and speeds in rad/s (rows,), with the sign of the motion. Edges pass at multiples of the pitch
    of the travelled angle: where in the turn they lie is not known.
    """
    pitch = TURN_RAD / pulses
    fine_s, fine = _refined(time_s, angle, speed)
    fine = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(fine)))])
    first, last = np.floor(fine[0] / pitch) + 1.0, np.floor(fine[-1] / pitch)
    if last < first + 1.0:
        return np.zeros(len(time_s))
    edges = np.interp(np.arange(first, last + 1.0) * pitch, fine, fine_s)
    latest = np.searchsorted(edges, time_s, side="right") - 1
    period = np.diff(edges)[np.maximum(latest - 1, 0)]
    age = time_s - edges[np.maximum(latest, 0)]
    reading = pitch / np.maximum(np.maximum(period, age), 1e-9)
    return np.sign(speed) * np.where((latest < 1) | (age > timeout_s), 0.0, reading)


def _refined(
    time_s: np.ndarray, angle: np.ndarray, speed: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Times and angles with HERMITE_POINTS instants in each row, by cubic Hermite interpolation."""
    step, count = np.diff(time_s)[:, None], HERMITE_POINTS + 1
    f = np.arange(count) / count
    g = 1.0 - f
    inside = (
        g * g * (1.0 + 2.0 * f) * angle[:-1, None]
        + f * f * (3.0 - 2.0 * f) * angle[1:, None]
        + step * f * g * (g * speed[:-1, None] - f * speed[1:, None])
    )
    times = time_s[:-1, None] + step * f
    return np.append(times.ravel(), time_s[-1]), np.append(inside.ravel(), angle[-1])
