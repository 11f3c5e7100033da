"""Uncertainty of the speed after a start from rest where a force drives the model: friction builds
up over a small angle, which no effect of the catalogue describes.

Before a surface slides it yields like a spring (pre-sliding: Dahl, AIAA Journal 14 (1976) 1675).
The shaft gains a speed on a model whose friction acts at once. Under a voltage the difference
decays with the motor's time constant; under a measured current it lasts until the model restarts.
"""

from dataclasses import dataclass, replace

import numpy as np

from vgroove.gap.residual.channels import Channel
from vgroove.gap.residual.restarts import Observations
from vgroove.rig import Rig
from vgroove.units import RPM_PER_RAD_S

# angle of a motor's shaft over which its friction builds up: some micrometres in its bearings and
# under its brushes
PRE_SLIDING_RAD = 2e-3


@dataclass(frozen=True)
class BreakawayRules:
    """Starts from rest in a speed record; chosen on the tuning half of the blind set."""

    min_rest_s: float = 0.1  # without a speed: the shaft stood still
    moving_sigmas: float = 3.0  # a speed above this is no rest
    # the acceleration after a rest is taken over at least so long and so many observations
    rise_s: float = 0.01
    rise_observations: int = 3


BREAKAWAY = BreakawayRules()
MIN_TIME_S, MIN_ACCELERATION = 1e-6, 1e-6  # keep an acceleration (rad/s^2) and a speed finite


@dataclass(frozen=True)
class SpeedRecord:
    """Observed speeds of a log that begins at start_s, in motion or at rest; None: no speed."""

    speed: Observations | None
    start_s: float
    moving: bool


def breakaways(record: SpeedRecord) -> tuple[np.ndarray, np.ndarray]:
    """Instants (k,) in s from which on the shaft has left its rest or reversed, and its
    accelerations (k,) in rad/s^2 there.
    """
    seen = record.speed
    clear = np.abs(seen.value) > BREAKAWAY.moving_sigmas * seen.sigma
    value, begin, end = seen.value[clear], seen.start_s[clear], seen.end_s[clear]
    before = np.concatenate([[record.start_s], end[:-1]])
    reversed_ = np.diff(np.sign(value), prepend=0.0) != 0.0
    first = np.flatnonzero(reversed_ | (begin - before > BREAKAWAY.min_rest_s))
    first = first[1:] if record.moving else first
    middle = 0.5 * (begin + end)
    later = np.searchsorted(middle, middle[first] + BREAKAWAY.rise_s)
    later = np.minimum(np.maximum(later, first + BREAKAWAY.rise_observations), len(value) - 1)
    mean = np.abs(value[first]) / np.maximum(middle[first] - before[first], MIN_TIME_S)
    rise = np.abs(value[later] - value[first]) / np.maximum(
        middle[later] - middle[first], MIN_TIME_S
    )
    return begin[first], np.maximum(mean, rise)


def breakaway_impulse_rad_s(rig: Rig, acceleration: np.ndarray) -> np.ndarray:
    """Standard deviation (k,) in rad/s of the speed gained at breakaway at accelerations (k,) in
    rad/s^2: what Coulomb friction takes away in the time for PRE_SLIDING_RAD.
    """
    duration = np.sqrt(2.0 * PRE_SLIDING_RAD / np.maximum(acceleration, MIN_ACCELERATION))
    return rig.motor["coulomb_nm"] / rig.shaft_inertia_kg_m2 * duration


def widen_after_breakaway(
    channels: tuple[Channel, ...], record: SpeedRecord, rig: Rig, restart_s: np.ndarray
) -> tuple[Channel, ...]:
    """Speed channels with an unknown shared offset from each start from rest up to the next
    restart, at instants restart_s (S,).
    """
    if rig.input["kind"] != "current_a" or record.speed is None:
        return channels
    instants, acceleration = breakaways(record)
    size = breakaway_impulse_rad_s(rig, acceleration)
    following = np.searchsorted(restart_s, instants, side="right")
    until = np.append(restart_s, np.inf)[following]
    return tuple(_with_impulses(channel, instants, until, size) for channel in channels)


def _with_impulses(
    channel: Channel, instants: np.ndarray, until: np.ndarray, size: np.ndarray
) -> Channel:
    factor = {"rpm": RPM_PER_RAD_S, "rad/s": 1.0}.get(channel.unit)
    if factor is None or not len(instants):
        return channel
    passage = np.searchsorted(instants, channel.time_s, side="right") - 1
    affected = (passage >= 0) & (channel.time_s < until[passage]) & ~channel.censored
    impulse = np.where(affected, factor * size[passage], 0.0)
    return replace(channel, passage=passage, impulse=impulse)
