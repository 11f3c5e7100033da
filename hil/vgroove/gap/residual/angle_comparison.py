"""Decides whether the angle of an encoder is compared directly, from each restart of the model to
the next, or through its derivative; for all logs of a tool alike.

A difference of two readings is an imprecise speed if the resolution of the readings is as large as
the motion between them. The angle itself is then compared.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vgroove.gap.cleaning.sensor_noise import (
    divided_differences,
    driving_current_sigma,
    resolution_of,
)
from vgroove.gap.residual.clean_log import CleanLog

# share of the changes of a reading that have the opposite sign of the change before. A larger share
# is a sign of noise; without noise the sign changes only where the shaft reverses
MAX_RETURNS = 0.15
# steps; median change of the reading of a coarse encoder from row to row. The rounding of a
# difference is 10 % of a change of 4 steps
MAX_COARSE_STEPS = 4.0
# ratio of the standard deviation of second differences to that of the angle's noise, above which
# they show an acceleration; chosen on the tuning half of the blind set (docs/gap_bench.md)
VISIBLE_BEND_SIGMAS = 4.0


def with_angle_comparison(logs: Sequence[CleanLog]) -> list[CleanLog]:
    """The cleaned logs of one tool, with CleanLog.compares_angle set."""
    seen = [log for log in logs if log.has_values("position_rad")]
    direct = bool(seen) and _is_rounded(seen)
    if direct and logs[0].kind == "current_a":
        direct = all(
            not log.has_values("speed_rpm")
            and _hides_acceleration(log)
            and _errs_more_than_the_input(log)
            for log in seen
        )
    elif direct:
        direct = _is_coarse(seen)
    return [replace(log, compares_angle=direct) for log in logs]


def angle_step_rad(log: CleanLog) -> float:
    """Step of the angle in rad: that of the rig, else that of the column."""
    stated = log.rig.sensors.get("position_lsb_rad")
    return resolution_of(log.columns["position_rad"]) if stated is None else stated


def acceleration_sigma(log: CleanLog, current_noise_a: float) -> float:
    """Standard deviation, in rad/s^2, of the shaft's acceleration that a noise of the motor current
    with the standard deviation current_noise_a, in A, causes.
    """
    rig = log.rig
    return rig.motor["torque_constant_nm_per_a"] * current_noise_a / rig.shaft_inertia_kg_m2


def is_visible(bend: np.ndarray, sigma: float) -> bool:
    """Whether second differences (k,), normalised so that noise keeps its standard deviation sigma,
    show an acceleration.
    """
    return bool(bend.std() > VISIBLE_BEND_SIGMAS * sigma)


def _changes_in_steps(log: CleanLog) -> np.ndarray:
    """Differences (k,) between consecutive readings of the angle, in units of its resolution; pairs
    of equal readings are left out.
    """
    angle = log.columns["position_rad"]
    change = np.diff(angle[np.isfinite(angle)])
    return change[change != 0.0] / angle_step_rad(log)


def _is_rounded(logs: Sequence[CleanLog]) -> bool:
    """Whether rounding is the main error of the readings, since they rarely change back and forth
    as noise makes them do.
    """
    signs = [np.sign(_changes_in_steps(log)) for log in logs]
    returns = np.concatenate([one[1:] != one[:-1] for one in signs])
    return len(returns) > 0 and float(returns.mean()) <= MAX_RETURNS


def _is_coarse(logs: Sequence[CleanLog]) -> bool:
    """Whether the steps are large for the motion from row to row."""
    changes = np.abs(np.concatenate([_changes_in_steps(log) for log in logs]))
    return bool(np.median(changes) < MAX_COARSE_STEPS)


def _hides_acceleration(log: CleanLog) -> bool:
    """Whether the noise of the angle hides its second difference from row to row."""
    angle = log.columns["position_rad"]
    known = np.isfinite(angle)
    bend = divided_differences(log.time_s[known], angle[known], 2)
    return len(bend) > 0 and not is_visible(bend, log.noise["position_rad"].sigma)


def _errs_more_than_the_input(log: CleanLog) -> bool:
    """Whether the measured angle has a larger standard deviation than the angle that the model
    computes from the noisy current, at the end of the time between two restarts. There the noise of
    the current acts as white noise of the acceleration that is integrated twice.
    """
    noise_a = driving_current_sigma(log.rig, log.columns["current_a"])
    per_root_s3 = acceleration_sigma(log, noise_a) * np.sqrt(log.interval_s / 3.0)
    turned_rad = per_root_s3 * log.restart_s**1.5
    return bool(turned_rad < log.noise["position_rad"].sigma)
