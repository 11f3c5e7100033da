"""Errors of the measured states from which the model restarts. All samples of the angle from one
restart to the next contain the same error of the start state, and so do those of the current.
"""

from dataclasses import replace

import numpy as np

from vgroove import _core
from vgroove.gap.residual.channels import AngleChannel, Channel, RowChannel, Simulation
from vgroove.gap.residual.restarts import Restarts
from vgroove.gap.residual.sensors import SensorErrors
from vgroove.gap.residual.shared_errors import SharedErrors
from vgroove.rig import Rig

CURRENT, SPEED = "current_a", "speed_measured_rad_s"


def widen_by_start_speeds(
    channels: tuple[Channel, ...], drive: _core.LogInput, rig: Rig, restarts: Restarts
) -> tuple[Channel, ...]:
    """The channels of a log, with a larger standard deviation of each speed that is measured in
    rows. The model restarts from a measured speed, whose error changes all simulated speeds up to
    the next restart; this change is added as the root of the sum of squares.
    """
    if not any(map(_is_row_speed, channels)):
        return channels
    error = _response_to_speed(drive, rig, restarts)[SPEED]
    return tuple(
        replace(channel, sigma=np.hypot(channel.sigma, channel.factor * error[channel.row]))
        if _is_row_speed(channel)
        else channel
        for channel in channels
    )


def _is_row_speed(channel: Channel) -> bool:
    return isinstance(channel, RowChannel) and channel.key == SPEED


def share_restart_errors(
    channels: tuple[Channel, ...], drive: _core.LogInput, rig: Rig, restarts: Restarts
) -> tuple[Channel, ...]:
    """The channels of a log, with SharedErrors where its angle is compared directly: of the angle
    for the unknown angle and the error of the speed at each restart, of the current for the latter.
    """
    if not any(isinstance(channel, AngleChannel) for channel in channels):
        return channels
    response = _response_to_speed(drive, rig, restarts)
    return tuple(_with_errors(channel, response, restarts) for channel in channels)


def _with_errors(channel: Channel, response: Simulation, restarts: Restarts) -> Channel:
    group = restarts.before(channel.row)
    if isinstance(channel, AngleChannel):
        of_speed = response["angle_rad"][channel.row] / channel.sigma
        return replace(
            channel, shared=SharedErrors(group, of_speed[:, None], unknown=1.0 / channel.sigma)
        )
    if isinstance(channel, RowChannel) and channel.key == CURRENT and not channel.magnitude:
        of_speed = response[CURRENT][channel.row] / channel.sigma
        return replace(channel, shared=SharedErrors(group, of_speed[:, None]))
    return channel


def _response_to_speed(drive: _core.LogInput, rig: Rig, restarts: Restarts) -> Simulation:
    """Change of the simulated angle (rad), speed (rad/s) and current (A) in each row (rows,) if the
    simulation starts at every restart with a speed that is higher by its standard deviation; 0 in
    rows that the simulation does not reach. It is computed without the effects of the rig, so that
    a rig corrected by an effect has the same standard deviations.
    """
    theta = np.repeat(replace(rig, effects={}).parameters()[None], 2, axis=0)
    states = restarts.states(SensorErrors.of(theta, list(_core.PARAMETERS).index))
    states[1, :, 1] += restarts.speed_sigma
    found = _core.simulate_log(drive, theta, restarts.rows, states, threads=1, unfinished="nan")
    return {
        name: np.nan_to_num(found[name][1] - found[name][0])
        for name in ("angle_rad", SPEED, CURRENT)
    }
