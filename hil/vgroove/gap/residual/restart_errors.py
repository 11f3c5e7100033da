"""Errors of the measured states from which the model restarts. The samples of an angle from one
restart to the next share them, and those of the current beside it.
"""

from dataclasses import replace

import numpy as np

from vgroove import _core
from vgroove.gap.residual.channels import AngleChannel, Channel, RowChannel, Simulation
from vgroove.gap.residual.restarts import Restarts
from vgroove.gap.residual.sensors import SensorErrors
from vgroove.gap.residual.shared_errors import SharedErrors
from vgroove.rig import Rig

CURRENT = "current_a"


def share_restart_errors(
    channels: tuple[Channel, ...], drive: _core.LogInput, rig: Rig, restarts: Restarts
) -> tuple[Channel, ...]:
    """The channels; those of an angle that is compared itself with the errors of angle and speed at
    each restart, of a current beside it with that of the speed.
    """
    if not any(isinstance(channel, AngleChannel) for channel in channels):
        return channels
    response = _response_to_speed(drive, rig, restarts)
    return tuple(_with_errors(channel, response, restarts) for channel in channels)


def _with_errors(channel: Channel, response: Simulation, restarts: Restarts) -> Channel:
    group = np.searchsorted(restarts.rows, channel.row, side="left") - 1
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
    """Changes (rows,) of the nominal angle in rad and current in A by one standard deviation of the
    speed at the restart before; 0 in rows that the plant does not reach, which are no evidence.
    """
    theta = np.repeat(rig.parameters()[None], 2, axis=0)
    states = restarts.states(SensorErrors.of(theta, list(_core.PARAMETERS).index))
    states[1, :, 1] += restarts.speed_sigma
    found = _core.simulate_log(drive, theta, restarts.rows, states, threads=1, unfinished="nan")
    return {name: np.nan_to_num(found[name][1] - found[name][0]) for name in ("angle_rad", CURRENT)}
