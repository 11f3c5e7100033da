"""What a start from rest leaves open where a force drives the model: friction builds up over a
small angle, which no effect describes.

Before a surface slides it gives way like a spring (pre-sliding): the shaft gains an impulse on a
friction that acts at once. Under a voltage it is forgotten within the motor's time constant; under
a measured current the speed keeps it until the model restarts.
"""

from dataclasses import replace

import numpy as np

from vgroove.gap.residual.channels import RAD_S_TO_RPM, Channel
from vgroove.gap.residual.restarts import Observations
from vgroove.rig import Rig

PRE_SLIDING_RAD = 2e-3  # of a motor's shaft: some micrometres in its bearings and under its brushes
REST_S = 0.1  # longer without a speed: the shaft stood still
SEEN = 3.0  # sigmas from which on a speed is no rest
# the acceleration after a rest is taken over so long and so many observations at least
RISE_S, RISE = 0.01, 3


def passages(seen: Observations, start_s: float, moving: bool) -> tuple[np.ndarray, np.ndarray]:
    """Instants (k,) from which on the shaft has left its rest or turned round, and its
    accelerations there; moving: not at start_s.
    """
    clear = np.abs(seen.value) > SEEN * seen.sigma
    value, begin, end = seen.value[clear], seen.start_s[clear], seen.end_s[clear]
    before = np.concatenate([[start_s], end[:-1]])
    turned = np.diff(np.sign(value), prepend=0.0) != 0.0
    first = np.flatnonzero(turned | (begin - before > REST_S))
    first = first[1:] if moving else first
    middle = 0.5 * (begin + end)
    later = np.minimum(
        np.maximum(np.searchsorted(middle, middle[first] + RISE_S), first + RISE), len(value) - 1
    )
    mean = np.abs(value[first]) / np.maximum(middle[first] - before[first], 1e-6)
    rise = np.abs(value[later] - value[first]) / np.maximum(middle[later] - middle[first], 1e-6)
    return begin[first], np.maximum(mean, rise)


def impulse_rad_s(rig: Rig, acceleration: np.ndarray) -> np.ndarray:
    """1 sigma (k,) of the speed that friction leaves open at breakaway: it acts in full once the
    shaft has turned PRE_SLIDING_RAD.
    """
    return (
        rig.motor["coulomb_nm"]
        / rig.shaft_inertia_kg_m2
        * np.sqrt(2.0 * PRE_SLIDING_RAD / np.maximum(acceleration, 1e-6))
    )


def widen_after_breakaway(
    channels: tuple[Channel, ...],
    seen: Observations | None,
    rig: Rig,
    restart_s: np.ndarray,
    start_s: float,
    moving: bool,
) -> tuple[Channel, ...]:
    """Speed channels that leave an impulse open from each start from rest up to the next restart;
    restart_s (S,) are their instants.
    """
    if rig.input["kind"] != "current_a" or seen is None:
        return channels
    instants, acceleration = passages(seen, start_s, moving)
    size, until = (
        impulse_rad_s(rig, acceleration),
        np.append(restart_s, np.inf)[np.searchsorted(restart_s, instants, side="right")],
    )
    return tuple(_opened(channel, instants, until, size) for channel in channels)


def _opened(channel: Channel, instants: np.ndarray, until: np.ndarray, size: np.ndarray) -> Channel:
    factor = {"rpm": RAD_S_TO_RPM, "rad/s": 1.0}.get(channel.unit)
    if factor is None or not len(instants):
        return channel
    passage = np.searchsorted(instants, channel.time_s, side="right") - 1
    here = (passage >= 0) & (channel.time_s < until[passage]) & ~channel.conditional
    return replace(channel, passage=passage, impulse=np.where(here, factor * size[passage], 0.0))
