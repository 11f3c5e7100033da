"""What of a log shows the states of the tool: the finest measured speed, the current, an angle to
keep count by.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from vgroove.gap.cleaning import sensor_noise
from vgroove.gap.cleaning.missing_values import hold_last_value, interpolate_missing
from vgroove.gap.hall_edges.edge_periods import MIN_COUNTING_PULSES, EdgePeriods, near_reversal
from vgroove.gap.hall_edges.jitter import sigma_with_missed_rpm
from vgroove.gap.hall_edges.missed_edges import add_missed_to_count, estimate_missed_edges
from vgroove.gap.residual.channels import Channel
from vgroove.gap.residual.restarts import (
    NEIGHBOURS,
    KnownForce,
    Observations,
    StateObserver,
    row_means,
)
from vgroove.rig import Rig
from vgroove.units import RAD_S_PER_RPM

# by as much a fit to neighbouring angles beats their differences: the errors of neighbours cancel
ANGLES = NEIGHBOURS[0]
# of a log that an angle must last: one that fails early shows no states beside a speed
SEEN_SHARE = 0.5
START_S = 0.02  # the shaft is taken to leave its rest this long before the first edge


def make_state_observer(
    time_s: np.ndarray,
    columns: dict[str, np.ndarray],
    rig: Rig,
    edges: EdgePeriods | None,
    channels: list[Channel],
) -> StateObserver:
    """What shows the states: the finest measured speed, the current, and an angle to keep count by."""
    by_column = {channel.column: channel for channel in channels}
    speed, angle_at, from_angle = None, _standing(rig), False
    if "speed_rpm" in by_column and edges is None:
        channel = by_column["speed_rpm"]
        speed = Observations(
            channel.time_s,
            channel.time_s,
            channel.measured * RAD_S_PER_RPM,
            channel.sigma * RAD_S_PER_RPM,
        )
        angle = angle_at(0.0) + np.concatenate(
            [[0.0], np.cumsum(0.5 * (speed.value[1:] + speed.value[:-1]) * np.diff(speed.start_s))]
        )
        angle_at = _interpolated(speed.start_s, angle)
    if edges is not None and not edges.timeout.all():
        speed, angle_at = _edge_sight(rig, edges, _standing(rig)(0.0))
    if "position_rad" in by_column and (
        speed is None or np.ptp(by_column["position_rad"].time_s) > SEEN_SHARE * np.ptp(time_s)
    ):
        differences, angle_at = _position_sight(time_s, columns["position_rad"], rig)
        from_angle = speed is None or typical_speed_sigma(
            differences
        ) / ANGLES < typical_speed_sigma(speed)
        speed = differences if from_angle else speed
    current = None
    if rig.input["kind"] == "current_a":
        force = hold_last_value(columns["current_a"])
        speed = (
            None
            if speed is None
            else replace(speed, driven=KnownForce(time_s, _nominal_rate(rig, force)))
        )
        return StateObserver(
            speed, None, angle_at, lambda t, w, dw: float(np.interp(t, time_s, force)), from_angle
        )
    if "current_a" in by_column and not by_column["current_a"].magnitude:
        channel = by_column["current_a"]
        current = row_means(time_s, columns["current_a"], float(channel.sigma[0]))
    return StateObserver(
        speed,
        current,
        angle_at,
        lambda t, w, dw: _current_from_motion(rig, time_s, columns, t, w, dw),
        from_angle,
    )


def typical_speed_sigma(seen: Observations) -> float:
    """1 sigma (rad/s) of a usual observation."""
    return float(np.median(seen.sigma))


def _standing(rig: Rig) -> Callable[[float], float]:
    angle = rig.load.get("zero_rad", 0.0) * rig.gearbox["ratio"]
    return lambda t: angle


def _interpolated(time_s: np.ndarray, angle: np.ndarray) -> Callable[[float], float]:
    return lambda t: float(np.interp(t, time_s, angle))


def _edge_sight(
    rig: Rig, edges: EdgePeriods, angle: float
) -> tuple[Observations, Callable[[float], float]]:
    pulses = rig.sensors["hall_pulses_per_rev"]
    missed = estimate_missed_edges(edges)
    edges = add_missed_to_count(edges, missed)
    whole = ~edges.timeout & ~near_reversal(edges)
    sigma = sigma_with_missed_rpm(rig, edges, missed)
    pitches = 1.0 + missed[whole]
    rad_s = pitches * RAD_S_PER_RPM
    turn = (
        {}
        if pulses >= MIN_COUNTING_PULSES
        else {"place": edges.count[whole] % pulses, "places": pulses}
    )
    seen = Observations(
        edges.start_s[whole],
        edges.end_s[whole],
        edges.speed_rpm[whole] * rad_s,
        sigma[whole] * rad_s,
        **turn,
    )
    counted = ~edges.timeout
    # On average the first edge comes half a pitch after rest.
    turns = (edges.count[counted] + 0.5 * np.sign(edges.count[counted][0])) / pulses
    first = edges.start_s[counted][0]
    times = np.concatenate([[first - START_S], edges.end_s[counted]])
    return seen, _interpolated(times, angle + 2.0 * np.pi * np.concatenate([[0.0], turns]))


def _position_sight(
    time_s: np.ndarray, position: np.ndarray, rig: Rig
) -> tuple[Observations, Callable[[float], float]]:
    known = np.flatnonzero(np.isfinite(position))
    sigma = sensor_noise.position_sigma(rig, time_s, position)
    length = np.diff(time_s[known])
    speed = Observations(
        time_s[known[:-1]],
        time_s[known[1:]],
        np.diff(position[known]) / length,
        np.sqrt(2.0) * sigma / length,
    )
    return speed, _interpolated(time_s[known], position[known])


def _nominal_rate(rig: Rig, current_a: np.ndarray) -> np.ndarray:
    """Acceleration (rows,) of the shaft under its motor's torque alone."""
    return rig.motor["torque_constant_nm_per_a"] * current_a / rig.shaft_inertia_kg_m2


def _current_from_motion(
    rig: Rig, time_s: np.ndarray, columns: dict[str, np.ndarray], t: float, w: float, dw: float
) -> float:
    """Current that the nominal motor needs for a motion: a start for the model where no signed
    current is measured.
    """
    motor, ratio = rig.motor, rig.gearbox["ratio"]
    torque = rig.shaft_inertia_kg_m2 * dw + motor["viscous_nm_s_per_rad"] * w
    torque += np.sign(w) * motor["coulomb_nm"]
    if "load_nm" in columns and rig.load["kind"] == "torque":
        torque += (
            np.sign(w)
            * float(np.interp(t, time_s, interpolate_missing(time_s, columns["load_nm"])))
            / ratio
        )
    return float(torque / motor["torque_constant_nm_per_a"])


def rough_speed(time_s: np.ndarray, sight: StateObserver) -> np.ndarray:
    """A rough speed per row, rad/s, for regimes and strokes; zeros where none is measured."""
    if sight.speed is None or not len(sight.speed.value):
        return np.zeros(len(time_s))
    middle = 0.5 * (sight.speed.start_s + sight.speed.end_s)
    speed = np.interp(time_s, middle, sight.speed.value, left=0.0, right=0.0)
    gap = np.diff(middle, prepend=middle[0])
    for k in np.flatnonzero(gap > 0.1):
        speed[(time_s > middle[k - 1] + 0.05) & (time_s < middle[k] - 0.05)] = 0.0
    return speed
