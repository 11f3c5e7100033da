"""How the motor levels of a tool relate to those of the reference tool.

Blows turn a hard joint until it withstands them. The torque that they reach over the level rises
unevenly, since lugs are hit three times, twice or once. The course of a tool that is slightly off
is that of the reference tool with stretched axes, and the stretch of the level is what the
setpoints of the controllers need.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

from vgroove.adapt.level_control import Run, motor_of
from vgroove.errors import VgrooveError
from vgroove.reference.rigs import reference_rig
from vgroove.rig import Rig

LEVELS_V = np.arange(5.4, 12.6, 0.1)
SLOPE, SECONDS = 200.0, 2.0  # N m/rad; on the level, until the joint is settled
RUN_V = 5.7  # level of the run-up: the hammer climbs over the lugs with any tool of the range
SCALES = 1.0 + 0.0025 * np.arange(-36, 47)  # the bytes of the map hold these


@dataclass(frozen=True)
class LevelScale:
    """A tool's levels, torques and currents over those of the reference tool. rms_nm: RMS of what
    the stretch of the axes leaves of the torque.
    """

    level: float
    torque: float
    current: float
    rms_nm: float


def settled(rig: Rig, motor: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """(torque in N m, mean current in A) on LEVELS_V, (n,) each; the levels are voltages of a motor
    with this torque constant and resistance.
    """
    found = []
    for level_v in LEVELS_V:
        run = Run(rig, SLOPE, RUN_V, motor=motor)
        run.go(level_v, SECONDS)
        found.append((run.torque_nm, run.level.slow_a))
    torque, current = np.array(found).T
    return torque, current


@cache
def reference_settled() -> tuple[np.ndarray, np.ndarray]:
    """`settled` of the reference tool."""
    rig = reference_rig()
    return settled(rig, motor_of(rig))


def fitted(torque_nm: np.ndarray, current_a: np.ndarray) -> LevelScale:
    """The stretch with which a tool's torques (n,) and currents (n,) on LEVELS_V agree best with
    the reference tool's.
    """
    reference_nm, reference_a = reference_settled()
    best = None
    for scale in SCALES:
        there = (scale * LEVELS_V >= LEVELS_V[0]) & (scale * LEVELS_V <= LEVELS_V[-1])
        torque = np.interp(scale * LEVELS_V[there], LEVELS_V, torque_nm)
        gain = (torque @ reference_nm[there]) / (reference_nm[there] @ reference_nm[there])
        rms_nm = float(np.sqrt(np.mean((torque / gain - reference_nm[there]) ** 2)))
        if best is None or rms_nm < best.rms_nm:
            current = np.interp(scale * LEVELS_V[there], LEVELS_V, current_a)
            ratio = float(np.median(current / reference_a[there]))
            best = LevelScale(float(scale), float(gain), ratio, rms_nm)
    return best


def level_scale(rig: Rig, motor: tuple[float, float] | None = None) -> LevelScale:
    """The scale of a rig's levels; `motor`: that of which the levels are voltages, by default that
    of torque.c. VgrooveError for a tool that is too far off the reference tool.
    """
    found = fitted(*settled(rig, motor or motor_of(reference_rig())))
    if not SCALES[0] < found.level < SCALES[-1]:
        raise VgrooveError(
            f"{rig.name or 'the rig'}: its levels are not within {SCALES[0]:g} to {SCALES[-1]:.2f} "
            "times those of the reference tool, for which the controllers were designed; compare "
            "its motor and mechanism with rigs/impact_driver_18v.toml"
        )
    return found
