"""Sensor filters at restarts: the plant starts them settled, but what was measured there is the
filter's own output, on the move.
"""

import numpy as np

from vgroove.gap.residual.channels import Simulation
from vgroove.gap.residual.restarts import Restarts


def correct_filters(
    simulation: Simulation,
    time_s: np.ndarray,
    restarts: Restarts,
    lags: np.ndarray,
    delay_form: np.ndarray,
) -> None:
    """Change a simulation in place so that filters go on from the measured values.

    lags (B, 2): time constants of the current and speed sensors; delay_form (B,): the speed sensor
    delays instead. A filter y' = (x - y) / T started at x instead of y = x - T y' is wrong by T y'
    exp(-t / T), exactly; slopes are those of y, as measured.
    """
    window = np.searchsorted(restarts.rows, np.arange(len(time_s)), side="right") - 1
    since = time_s - time_s[restarts.rows][window]
    dt = np.diff(time_s, prepend=time_s[0])
    for b in np.flatnonzero(lags[:, 0] > 0.0):
        lag, slope = lags[b, 0], restarts.slopes[window, 0]
        left = np.where(dt > 0.0, lag / np.maximum(dt, 1e-12), 0.0) * (
            np.exp(-np.maximum(since - dt, 0.0) / lag) - np.exp(-since / lag)
        )
        simulation["current_a"][b] -= np.where(since > 0.0, lag * slope * left, 0.0)
    for b in np.flatnonzero(lags[:, 1] > 0.0):
        lag, slope, bend = lags[b, 1], restarts.slopes[window, 1], restarts.bends[window, 1]
        before = np.maximum(lag - since, 0.0)  # how long before the restart the delayed shaft is
        start = slope + lag * bend
        speed = (
            -start * before + 0.5 * bend * before**2
            if delay_form[b]
            else -slope * lag * np.exp(-since / lag)
        )
        angle = (
            0.5 * start * before**2 - bend * before**3 / 6.0
            if delay_form[b]
            else slope * lag**2 * np.exp(-since / lag)
        )
        simulation["speed_measured_rad_s"][b] += speed
        simulation["angle_measured_rad"][b] += angle
