"""Uncertainty of the speed after a start from rest where a current or force drives the model:
friction builds up over a small angle, which no effect of the catalogue describes.

Before a surface slides it yields like a spring (pre-sliding: Dahl, AIAA Journal 14 (1976) 1675).
The shaft therefore starts faster than a model whose friction acts at once. With a voltage as input
the difference decays with the motor's time constant; with a measured current it lasts until the
model restarts.
"""

from dataclasses import dataclass, replace

import numpy as np

from vgroove.gap.residual.channels import AngleChannel, Channel
from vgroove.gap.residual.restarts import Observations
from vgroove.gap.residual.shared_errors import SharedErrors
from vgroove.rig import Rig
from vgroove.units import RPM_PER_RAD_S

# angle of a motor's shaft over which its friction builds up: some micrometres in its bearings and
# under its brushes, at radii of some millimetres
PRE_SLIDING_RAD = 2e-3


@dataclass(frozen=True)
class BreakawayRules:
    """Starts from rest in a speed record; chosen on the tuning half of the blind set
    (docs/gap_bench.md).
    """

    min_rest_s: float = 0.1  # a longer interval without a speed above moving_sigmas is a rest
    moving_sigmas: float = 3.0  # a speed above this counts as motion
    # the acceleration after a rest is taken over at least so long and so many observations
    rise_s: float = 0.01
    rise_observations: int = 3


BREAKAWAY = BreakawayRules()
MIN_TIME_S, MIN_ACCELERATION = 1e-6, 1e-6  # keep an acceleration (rad/s^2) and a speed finite


@dataclass(frozen=True)
class SpeedRecord:
    """Observed speeds of a log (None: no speed), the time at which it begins, and whether the shaft
    moves there.
    """

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


def breakaway_sigma_rad_s(rig: Rig, acceleration: np.ndarray) -> np.ndarray:
    """Standard deviation (k,) in rad/s of the speed gained at breakaway at accelerations (k,) in
    rad/s^2: the speed that Coulomb friction removes while the shaft turns by PRE_SLIDING_RAD.
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
    sigma_rad_s = breakaway_sigma_rad_s(rig, acceleration)
    following = np.searchsorted(restart_s, instants, side="right")
    until = np.append(restart_s, np.inf)[following]
    return tuple(_with_offsets(channel, instants, until, sigma_rad_s) for channel in channels)


def _with_offsets(
    channel: Channel, instants: np.ndarray, until: np.ndarray, sigma_rad_s: np.ndarray
) -> Channel:
    """The channel with an unknown offset of the speed, of standard deviation sigma_rad_s (k,), that
    its samples from each instant (k,) to `until` (k,) share; unchanged where it is no speed or
    angle.
    """
    factor = {"rpm": RPM_PER_RAD_S, "rad/s": 1.0, "rad": 1.0}.get(channel.unit)
    if factor is None or not len(instants):
        return channel
    group = np.searchsorted(instants, channel.time_s, side="right") - 1
    affected = (group >= 0) & (channel.time_s < until[group]) & ~channel.censored
    size = np.where(affected, factor * sigma_rad_s[group], 0.0) / channel.sigma
    if not isinstance(channel, AngleChannel):
        return replace(channel, shared=SharedErrors(group, size[:, None]))
    turned = size * (channel.time_s - instants[group])
    loadings = np.column_stack([channel.shared.loadings, turned])
    return replace(channel, shared=replace(channel.shared, loadings=loadings))
