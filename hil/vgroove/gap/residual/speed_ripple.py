"""Adds the ripple of the speed to the measured speeds at restarts: the smooth curve that gives
these speeds does not contain the ripple of the shaft.

A cogging or an eccentric gear makes the speed oscillate with the angle; an eccentric Hall wheel
makes the measured speed oscillate. Where little brakes the shaft (an open bridge, a current as
input), the error of a restart without the ripple lasts until the next restart.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np

from vgroove.gap.catalogue import PERIODIC
from vgroove.gap.residual.measured_run import MeasuredRun
from vgroove.gap.residual.restarts import Restarts
from vgroove.gap.residual.shaft_inertia import shaft_inertia

# amplitude, as a share of the speed, at which the first-order response is reduced to one half, and
# the order of that reduction: the response assumes a nearly constant speed.
# Chosen on the tuning half of the blind set.
LARGE_SHARE, TRANSITION_ORDER = 0.2, 4
MIN_SPEED = 1e-9  # rad/s; keeps a ratio finite at rest


class NamedParameters(Protocol):
    """Gives the column of a parameter in theta."""

    def index(self, name: str) -> int: ...


@dataclass(frozen=True)
class SpeedRipple:
    """Part of a speed at each restart (S,): amplitude (S,) in rad/s times cos(periods th + phase)
    of the motor's angle th; of the shaft, or of its sensor alone.
    """

    periods: float
    amplitude: np.ndarray
    phase: np.ndarray
    of_shaft: bool


def add_speed_ripple(
    parameters: NamedParameters, run: MeasuredRun, theta: np.ndarray, states: np.ndarray
) -> np.ndarray:
    """States (B, S, 3) of parameter sets (B, P), their speed at each restart with the ripple that
    the smooth curve lacks.
    """
    found = states.copy()
    for values, mine in zip(theta, found, strict=True):
        for ripple in speed_ripples(parameters, run, values):
            mine[:, 1] += unsmoothed_part(run.restarts, ripple)
    return found


def speed_ripples(
    parameters: NamedParameters, run: MeasuredRun, values: np.ndarray
) -> Iterator[SpeedRipple]:
    """Ripples of one parameter set (P,)."""

    def value(name: str) -> float:
        return float(values[parameters.index(name)])

    speed = run.restarts.measured[:, 1]
    for effect, periodic in PERIODIC.items():
        own = partial(_of_effect, value, effect)
        amplitude = own(periodic.amplitude)
        if not amplitude:
            continue
        count, phase = periodic.periods_per_rev(own, value("gearbox.ratio")), own("phase_rad")
        if periodic.moves_shaft:
            response = amplitude * torque_response(value, run, count * speed)
            yield _shaft_ripple(count, response, phase, speed)
        else:
            yield SpeedRipple(count, amplitude * speed * count, np.full(len(speed), phase), False)


def _of_effect(value: Callable[[str], float], effect: str, name: str) -> float:
    return value(f"effects.{effect}.{name}")


def _shaft_ripple(
    periods: float, response: np.ndarray, phase: float, speed: np.ndarray
) -> SpeedRipple:
    """Ripple of the shaft from its complex response (S,), reduced where it is large."""
    size = np.abs(response)
    share = size / (LARGE_SHARE * np.maximum(np.abs(speed), MIN_SPEED))
    even = 1.0 / (1.0 + share**TRANSITION_ORDER)
    return SpeedRipple(periods, size * even, phase + np.angle(response), True)


def torque_response(
    value: Callable[[str], float], run: MeasuredRun, rate: np.ndarray
) -> np.ndarray:
    """Response of the speed to a torque of 1 N m sin(a) against the shaft, a growing at rate (S,)
    rad/s: the complex amplitude (S,) of cos(a) in rad/s; 0 where the shaft stands.

    J w' + (b + k^2 / (R + i rate L)) w = -torque; without the last term where the bridge is open or
    a current drives.
    """
    inertia = shaft_inertia(value, run.driving.more["load_kind"])
    winding = value("motor.resistance_ohm") + 1j * rate * value("motor.inductance_h")
    closed = run.bridge_closed[run.restarts.rows]
    through_current = value("motor.torque_constant_nm_per_a") ** 2 / winding * closed
    impedance = 1j * rate * inertia + value("motor.viscous_nm_s_per_rad") + through_current
    return np.divide(1j, impedance, out=np.zeros_like(impedance), where=rate != 0.0)


def unsmoothed_part(restarts: Restarts, ripple: SpeedRipple) -> np.ndarray:
    """Part (S,) of a shaft's speed at each restart, in rad/s, that the measured speed lacks: its
    ripple less what the smooth curve contains of it.
    """
    n, phase = ripple.periods, ripple.periods * restarts.measured[:, 2] + ripple.phase
    contained = np.zeros(len(phase))
    for k, seen in enumerate(restarts.smoothing):
        speed = restarts.measured[k, 1]
        slope, curvature = restarts.slopes[k, 1], restarts.curvatures[k, 1]
        first, last = (
            n * t * (speed + t * (slope / 2.0 + t * curvature / 6.0))
            for t in (seen.start_s, seen.end_s)
        )
        # the mean of a cosine over a span
        middle, half = 0.5 * (first + last) + phase[k], 0.5 * (last - first)
        contained[k] = seen.weight @ (np.cos(middle) * np.sinc(half / np.pi))
    smoothed = np.array([len(seen.weight) > 0 for seen in restarts.smoothing])
    return ripple.amplitude * (np.cos(phase) * ripple.of_shaft - contained) * smoothed
