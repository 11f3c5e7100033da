"""Corrects the sensor filters of a simulation at restarts: the plant starts them settled at the
true state, but the filter's output is the measured state, which lags behind a changing signal.
"""

import numpy as np

from vgroove.gap.residual.channels import Simulation
from vgroove.gap.residual.restarts import Restarts
from vgroove.gap.residual.sensors import DELAY, FILTER, SensorErrors

MIN_INTERVAL_S = 1e-12  # keeps a ratio finite in the first row


def correct_filters(
    simulation: Simulation, time_s: np.ndarray, restarts: Restarts, errors: SensorErrors
) -> None:
    """Change a simulation in place so that its sensor filters continue from the measured values.

    A filter y' = (x - y) / T started at y = x instead of y = x - T y' errs by T y' exp(-t / T),
    exactly, with the slope y' as measured.
    """
    window = np.searchsorted(restarts.rows, np.arange(len(time_s)), side="right") - 1
    since = time_s - time_s[restarts.rows][window]
    for b in np.flatnonzero(errors.lag_s[:, 0] > 0.0):
        slope = restarts.slopes[window, 0]
        simulation["current_a"][b] -= _mean_error(time_s, since, slope, errors.lag_s[b, 0])
    for b in np.flatnonzero(errors.lag_s[:, 1] > 0.0):
        lag, slope = errors.lag_s[b, 1], restarts.slopes[window, 1]
        if errors.form[b] == FILTER:
            speed = -slope * lag * np.exp(-since / lag)
            angle = slope * lag**2 * np.exp(-since / lag)
        else:
            late = _delay_error if errors.form[b] == DELAY else _mean_speed_error
            speed, angle = late(since, slope, restarts.curvatures[window, 1], lag)
        simulation["speed_measured_rad_s"][b] += speed
        simulation["angle_measured_rad"][b] += angle


def _mean_error(time_s: np.ndarray, since: np.ndarray, slope: np.ndarray, lag: float) -> np.ndarray:
    """Error (rows,) of a filtered current's mean over each row, in A."""
    dt = np.diff(time_s, prepend=time_s[0])
    decay = np.exp(-np.maximum(since - dt, 0.0) / lag) - np.exp(-since / lag)
    mean_decay = np.where(dt > 0.0, lag / np.maximum(dt, MIN_INTERVAL_S), 0.0) * decay
    return np.where(since > 0.0, lag * slope * mean_decay, 0.0)


def _delay_error(
    since: np.ndarray, slope: np.ndarray, curvature: np.ndarray, delay: float
) -> tuple[np.ndarray, np.ndarray]:
    """Errors (rows,) of a delayed speed in rad/s and of its angle in rad: until the delay has
    passed, the sensor shows the motion before the restart.
    """
    before = np.maximum(delay - since, 0.0)
    start = slope + delay * curvature
    speed = -start * before + 0.5 * curvature * before**2
    return speed, 0.5 * start * before**2 - curvature * before**3 / 6.0


def _mean_speed_error(
    since: np.ndarray, slope: np.ndarray, curvature: np.ndarray, lag: float
) -> tuple[np.ndarray, np.ndarray]:
    """Errors (rows,) of a speed in rad/s that is averaged over the last 2 lag, and of its angle in
    rad: the part of the window that lies before the restart shows the motion there.
    """
    before = np.maximum(2.0 * lag - since, 0.0)
    start = slope + lag * curvature
    return (-0.5 * start * before**2 + curvature * before**3 / 6.0) / (2.0 * lag), 0.0 * since
