"""Errors of the measured states from which the model restarts. The samples of an angle from one
restart to the next share them.
"""

from dataclasses import replace

import numpy as np

from vgroove import _core
from vgroove.gap.residual.channels import AngleChannel, Channel
from vgroove.gap.residual.restarts import Restarts
from vgroove.gap.residual.sensors import SensorErrors
from vgroove.gap.residual.shared_errors import SharedErrors
from vgroove.rig import Rig


def share_restart_errors(
    channels: tuple[Channel, ...], drive: _core.LogInput, rig: Rig, restarts: Restarts
) -> tuple[Channel, ...]:
    """The channels, the angle of an encoder with the errors of angle and speed at each restart."""
    angles = [isinstance(channel, AngleChannel) for channel in channels]
    if not any(angles):
        return channels
    response = _response_to_speed(drive, rig, restarts)
    return tuple(
        replace(channel, shared=_errors(channel, response, restarts)) if angle else channel
        for channel, angle in zip(channels, angles, strict=True)
    )


def _errors(channel: Channel, response: np.ndarray, restarts: Restarts) -> SharedErrors:
    group = np.searchsorted(restarts.rows, channel.row, side="left") - 1
    of_speed = response[channel.row] / channel.sigma
    return SharedErrors(group, of_speed[:, None], unknown=1.0 / channel.sigma)


def _response_to_speed(drive: _core.LogInput, rig: Rig, restarts: Restarts) -> np.ndarray:
    """Change (rows,) in rad of the nominal angle by one standard deviation of the speed at the
    restart before.
    """
    theta = np.repeat(rig.parameters()[None], 2, axis=0)
    states = restarts.states(SensorErrors.of(theta, list(_core.PARAMETERS).index))
    states[1, :, 1] += restarts.speed_sigma
    found = _core.simulate_log(drive, theta, restarts.rows, states, threads=1, unfinished="nan")
    return np.nan_to_num(found["angle_rad"][1] - found["angle_rad"][0])
