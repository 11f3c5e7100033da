"""Decides how the angle of an encoder is compared, for all logs of a tool alike: itself, from each
restart of the model to the next, or through its derivatives, which differences of noisy angles
hardly show.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vgroove.gap.cleaning.logging_interval import logging_interval_s
from vgroove.gap.cleaning.sensor_noise import (
    UNIFORM_WIDTH_SIGMAS,
    divided_differences,
    resolution_of,
)
from vgroove.gap.residual.clean_log import CleanLog
from vgroove.gap.residual.restarts import RESTART, restart_interval_s

# standard deviation of a reading, in that of its rounding, up to which it is no more than rounded
MAX_ROUNDED = 1.2
MAX_COARSE_STEPS = 4.0  # median change of a coarse angle: a difference errs by 10 % of it or more
# standard deviation of second differences, in that of the angle's noise, above which they show an
# acceleration; chosen on the tuning half of the blind set (docs/gap_bench.md)
VISIBLE_BEND_SIGMAS = 4.0


def with_angle_comparison(logs: Sequence[CleanLog]) -> list[CleanLog]:
    """The cleaned logs of one tool with compares_angle."""
    seen = [log for log in logs if log.has_values("position_rad")]
    if not seen:
        return list(logs)
    if logs[0].kind == "current_a":
        itself = all(_hides_acceleration(log) and _errs_more_than_the_input(log) for log in seen)
    else:
        itself = _is_coarse(seen)
    return [replace(log, compares_angle=itself) for log in logs]


def _is_coarse(logs: Sequence[CleanLog]) -> bool:
    """Whether the readings are rounded to steps that are large for the motion from row to row, and
    scatter no more than rounding does.
    """
    changes = np.concatenate([_changes_in_steps(log) for log in logs])
    rounded = all(_sigma(log) < MAX_ROUNDED * _rounding(log) for log in logs)
    return rounded and len(changes) > 0 and bool(np.median(changes) < MAX_COARSE_STEPS)


def _changes_in_steps(log: CleanLog) -> np.ndarray:
    """Changes (k,) of the angle from one known sample to the next, but those of 0, in steps."""
    angle = log.columns["position_rad"]
    change = np.abs(np.diff(angle[np.isfinite(angle)]))
    return change[change > 0.0] / angle_step_rad(log)


def _hides_acceleration(log: CleanLog) -> bool:
    """Whether the noise of the angle hides its second difference from row to row."""
    angle = log.columns["position_rad"]
    known = np.isfinite(angle)
    bend = divided_differences(log.time_s[known], angle[known], 2)
    return len(bend) > 0 and not is_visible(bend, _sigma(log))


def _errs_more_than_the_input(log: CleanLog) -> bool:
    """Whether the angle, as the only sensor, errs more at an instant than the noise of the current
    has turned the model since the last restart: white noise of the acceleration, integrated twice.
    """
    lasts_s = restart_interval_s(log.time_s, RESTART.nominal_s)
    interval_s = logging_interval_s(log.time_s)
    turned = input_acceleration_sigma(log) * np.sqrt(interval_s * lasts_s**3 / 3.0)
    return not log.has_values("speed_rpm") and bool(turned < _sigma(log))


def _sigma(log: CleanLog) -> float:
    return log.noise["position_rad"].sigma


def _rounding(log: CleanLog) -> float:
    """Standard deviation in rad of the rounding of the angle."""
    return angle_step_rad(log) / UNIFORM_WIDTH_SIGMAS


def is_visible(bend: np.ndarray, sigma: float) -> bool:
    """Whether second differences (k,), normalised so that noise keeps its standard deviation sigma,
    show an acceleration.
    """
    return bool(bend.std() > VISIBLE_BEND_SIGMAS * sigma)


def angle_step_rad(log: CleanLog) -> float:
    """Step of the angle in rad: that of the rig, else that of the column."""
    stated = log.rig.sensors.get("position_lsb_rad")
    return resolution_of(log.columns["position_rad"]) if stated is None else stated


def input_acceleration_sigma(log: CleanLog) -> float:
    """Standard deviation of the acceleration in rad/s^2 from the noise of a measured current."""
    rig = log.rig
    return (
        rig.motor["torque_constant_nm_per_a"]
        * rig.sensors.get("current_noise_a", 0.0)
        / rig.shaft_inertia_kg_m2
    )
