"""The ripple of the speed at restarts: a smooth curve through measured speeds does not follow it,
the shaft does.

A cogging or an eccentric gear makes the speed swing with the angle, an eccentric wheel makes it
seem to. Where little brakes the shaft (an open bridge, a current as input) a start beside the swing
is an error that stays until the next restart.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from vgroove.gap.residual.restarts import Restarts

if TYPE_CHECKING:
    from vgroove.gap.residual.measured_run import MeasuredRun
    from vgroove.gap.residual.problem import Problem

# of the speed: a shaft that swings by more does not turn evenly enough for a swing to follow from
# its angle
LARGE = 0.2


@dataclass(frozen=True)
class SpeedRipple:
    """Part of a speed, amplitude (S,) rad/s times cos(periods th + phase (S,)) of the motor's angle
    th, at each restart; whether the shaft swings so or its sensor only seems to.
    """

    periods: float
    amplitude: np.ndarray
    phase: np.ndarray
    of_shaft: bool


def add_speed_ripple(
    problem: "Problem", run: "MeasuredRun", theta: np.ndarray, states: np.ndarray
) -> np.ndarray:
    """States (B, S, 3) of parameter sets (B, P) with the speed that the shaft has at each restart,
    not the smooth one around it.
    """
    found = states.copy()
    for values, mine in zip(theta, found, strict=True):
        for swing in speed_ripples(problem, run, values):
            mine[:, 1] += unsmoothed_part(run.restarts, swing)
    return found


def speed_ripples(
    problem: "Problem", run: "MeasuredRun", values: np.ndarray
) -> Iterator[SpeedRipple]:
    """Swings of one parameter set (P,)."""

    def value(name: str) -> float:
        return float(values[problem.index(name)])

    speed, ratio = run.restarts.measured[:, 1], value("gearbox.ratio")
    torques = (
        (
            value("effects.cogging_torque.torque_nm"),
            value("effects.cogging_torque.periods_per_rev"),
            value("effects.cogging_torque.phase_rad"),
        ),
        (
            value("effects.gear_eccentricity.torque_nm"),
            1.0 / ratio,
            value("effects.gear_eccentricity.phase_rad"),
        ),
    )
    for torque, periods, phase in torques:
        if torque:
            answer = torque * torque_response(value, run, periods * speed)
            size = np.abs(answer)
            even = 1.0 / (1.0 + (size / (LARGE * np.maximum(np.abs(speed), 1e-9))) ** 4)
            yield SpeedRipple(periods, size * even, phase + np.angle(answer), True)
    wheel = value("effects.hall_eccentricity.amplitude_rad")
    if wheel:
        yield SpeedRipple(
            1.0,
            wheel * speed,
            np.full(len(speed), value("effects.hall_eccentricity.phase_rad")),
            False,
        )


def torque_response(
    value: Callable[[str], float], run: "MeasuredRun", rate: np.ndarray
) -> np.ndarray:
    """What a torque of 1 N m sin(a) against the shaft, a growing at rate (S,) rad/s, adds to the
    speed: the complex amplitude (S,) of cos(a), rad/s; 0 where the shaft stands.

    J w' + (b + k^2 / (R + i rate L)) w = -torque; without the last term where the bridge is open or
    a current drives.
    """
    inertia = value("motor.inertia_kg_m2") + value("effects.added_inertia.kg_m2")
    inertia += value("gearbox.output_inertia_kg_m2") / value("gearbox.ratio") ** 2
    winding = value("motor.resistance_ohm") + 1j * rate * value("motor.inductance_h")
    through_current = (
        value("motor.torque_constant_nm_per_a") ** 2 / winding * run.bridge_closed[run.starts]
    )
    against = 1j * rate * inertia + value("motor.viscous_nm_s_per_rad") + through_current
    return np.divide(1j, against, out=np.zeros_like(against), where=rate != 0.0)


def unsmoothed_part(restarts: Restarts, swing: SpeedRipple) -> np.ndarray:
    """What (S,) a shaft's speed has at each restart that the measured one has not: its swing less
    what the smooth curve took of it.
    """
    n, phase = swing.periods, swing.periods * restarts.measured[:, 2] + swing.phase
    taken = np.zeros(len(phase))
    for k, seen in enumerate(restarts.smoothing):
        speed, slope, bend = restarts.measured[k, 1], restarts.slopes[k, 1], restarts.bends[k, 1]
        first, last = (
            n * t * (speed + t * (slope / 2.0 + t * bend / 6.0)) for t in (seen.start_s, seen.end_s)
        )
        middle, half = 0.5 * (first + last) + phase[k], 0.5 * (last - first)
        taken[k] = seen.share @ (np.cos(middle) * np.sinc(half / np.pi))
    smoothed = np.array([len(seen.share) > 0 for seen in restarts.smoothing])
    return swing.amplitude * (np.cos(phase) * swing.of_shaft - taken) * smoothed
