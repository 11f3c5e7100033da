"""Makes the state observer of a log: the most precise measured speed, the current, and the angle of
the shaft over all turns.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from vgroove.gap.cleaning.missing_values import hold_last_value, interpolate_missing
from vgroove.gap.hall_edges.edge_periods import MIN_COUNTING_PULSES, EdgePeriods, near_reversal
from vgroove.gap.hall_edges.jitter import sigma_with_missed_rpm
from vgroove.gap.hall_edges.missed_edges import add_missed_to_count, estimate_missed_edges
from vgroove.gap.residual.channels import AngleChannel, Channel
from vgroove.gap.residual.clean_log import CleanLog
from vgroove.gap.residual.inputs import before_rows
from vgroove.gap.residual.local_polynomial import NEIGHBOURS, KnownForce, Observations, row_means
from vgroove.gap.residual.restarts import StateObserver
from vgroove.rig import Rig
from vgroove.units import RAD_S_PER_RPM, TURN_RAD

AngleAt = Callable[[float], float]


@dataclass(frozen=True)
class ObserverRules:
    """Which column gives the speed and the angle; chosen on the tuning half of the blind set
    (docs/gap_bench.md).
    """

    # factor by which a fit to several angles is more precise than their single differences, because
    # the errors of neighbouring differences cancel
    angle_gain: float = float(NEIGHBOURS[0])
    # share of a log that an angle column must cover to be used where a speed column exists
    min_angle_share: float = 0.5
    start_s: float = 0.02  # assumed time from the end of the rest to the first edge
    # the rough speed is 0 between observations that are further apart than max_gap_s, but for
    # gap_margin_s next to each
    max_gap_s: float = 0.1
    gap_margin_s: float = 0.05


OBSERVER = ObserverRules()


def make_state_observer(
    log: CleanLog, edges: EdgePeriods | None, channels: list[Channel]
) -> StateObserver:
    """The observer of a log with its edge periods and channels."""
    by_column = {channel.column: channel for channel in channels}
    speed, angle_at = _observed_speed(log, edges, by_column.get("speed_rpm"))
    from_angle = False
    if "position_rad" in by_column and (speed is None or _lasts(log, by_column["position_rad"])):
        differences, angle_at = _from_position(log, by_column["position_rad"])
        from_angle = speed is None or typical_speed_sigma(
            differences
        ) / OBSERVER.angle_gain < typical_speed_sigma(speed)
        speed = differences if from_angle else speed
    if log.kind == "current_a":
        return _with_current_input(log, speed, angle_at, from_angle)
    current, channel = None, by_column.get("current_a")
    if channel is not None and not channel.magnitude:
        current = row_means(
            log.time_s, log.columns["current_a"], float(channel.sigma[0]), log.interval_s
        )
    return StateObserver(speed, current, angle_at, _current_from_motion(log), from_angle)


def _observed_speed(
    log: CleanLog, edges: EdgePeriods | None, channel: Channel | None
) -> tuple[Observations | None, AngleAt]:
    """Observations of the speed column, and the angle that it counts."""
    rest = log.rig.load.get("zero_rad", 0.0) * log.rig.gearbox["ratio"]
    if edges is not None and not edges.timeout.all():
        return _from_edges(log.rig, edges, rest)
    if edges is not None or channel is None:
        return None, lambda t: rest
    sigma = channel.sigma * RAD_S_PER_RPM
    interval_s = log.interval_s
    measured = channel.measured * RAD_S_PER_RPM
    speed = Observations(channel.time_s, channel.time_s, measured, sigma, interval_s=interval_s)
    gained = 0.5 * (speed.value[1:] + speed.value[:-1]) * np.diff(speed.start_s)
    angle = rest + np.concatenate([[0.0], np.cumsum(gained)])
    return speed, _interpolated(speed.start_s, angle)


def _lasts(log: CleanLog, channel: Channel) -> bool:
    """Whether an angle's channel covers enough of the log for the states to come from it."""
    return np.ptp(channel.time_s) > OBSERVER.min_angle_share * np.ptp(log.time_s)


def typical_speed_sigma(seen: Observations) -> float:
    """Standard deviation (rad/s) of a usual observation."""
    return float(np.median(seen.sigma))


def _interpolated(time_s: np.ndarray, angle: np.ndarray) -> AngleAt:
    return lambda t: float(np.interp(t, time_s, angle))


def _from_edges(rig: Rig, edges: EdgePeriods, rest: float) -> tuple[Observations, AngleAt]:
    """Speeds over edge periods, and the angle that the edges count from a rest in rad."""
    pulses = rig.sensors["hall_pulses_per_rev"]
    missed = estimate_missed_edges(edges)
    edges = add_missed_to_count(edges, missed)
    whole = ~edges.timeout & ~near_reversal(edges)
    sigma = sigma_with_missed_rpm(rig, edges, missed)
    rad_s = (1.0 + missed[whole]) * RAD_S_PER_RPM
    turn = {}
    if pulses < MIN_COUNTING_PULSES:
        turn = {"pitch": edges.count[whole] % pulses, "pitches_per_rev": pulses}
    seen = Observations(
        edges.start_s[whole],
        edges.end_s[whole],
        edges.speed_rpm[whole] * rad_s,
        sigma[whole] * rad_s,
        **turn,
    )
    counted = ~edges.timeout
    # on average the first edge comes half a pitch after rest
    turns = (edges.count[counted] + 0.5 * np.sign(edges.count[counted][0])) / pulses
    first = edges.start_s[counted][0]
    times = np.concatenate([[first - OBSERVER.start_s], edges.end_s[counted]])
    return seen, _interpolated(times, rest + TURN_RAD * np.concatenate([[0.0], turns]))


def _from_position(log: CleanLog, channel: Channel) -> tuple[Observations, AngleAt]:
    """Speeds as differences of a measured angle, and that angle."""
    if isinstance(channel, AngleChannel):
        time_s, position, sigma = channel.time_s, channel.measured, channel.sigma
    else:
        known = np.flatnonzero(np.isfinite(log.columns["position_rad"]))
        time_s, position = log.time_s[known], log.columns["position_rad"][known]
        sigma = np.full(len(known), log.noise["position_rad"].sigma)
    length = np.diff(time_s)
    speed = Observations(
        time_s[:-1],
        time_s[1:],
        np.diff(position) / length,
        np.hypot(sigma[1:], sigma[:-1]) / length,
        interval_s=max(log.interval_s, float(np.median(length))),
    )
    return speed, _interpolated(time_s, position)


def _with_current_input(
    log: CleanLog, speed: Observations | None, angle_at: AngleAt, from_angle: bool
) -> StateObserver:
    """Observer of a log whose input is a current: the motor's torque is a known force."""
    rig, driving = log.rig, before_rows(log, hold_last_value(log.columns["current_a"]))
    if speed is not None:
        rate = rig.motor["torque_constant_nm_per_a"] * driving / rig.shaft_inertia_kg_m2
        speed = replace(speed, known_force=KnownForce(log.time_s, rate))
    return StateObserver(
        speed, None, angle_at, lambda t, w, dw: float(np.interp(t, log.time_s, driving)), from_angle
    )


def _current_from_motion(log: CleanLog) -> Callable[[float, float, float], float]:
    """Function of an instant, speed and acceleration: current in A that the nominal motor needs for
    that motion, where no signed current is measured.
    """
    rig, time_s = log.rig, log.time_s
    motor, load = rig.motor, None
    if "load_nm" in log.columns and rig.load["kind"] == "torque":
        load = interpolate_missing(time_s, log.columns["load_nm"])

    def current_a(t: float, speed: float, acceleration: float) -> float:
        torque = rig.shaft_inertia_kg_m2 * acceleration + motor["viscous_nm_s_per_rad"] * speed
        torque += np.sign(speed) * motor["coulomb_nm"]
        if load is not None:
            at_instant = float(np.interp(t, time_s, load))
            torque += np.sign(speed) * at_instant / rig.gearbox["ratio"]
        return float(torque / motor["torque_constant_nm_per_a"])

    return current_a


def rough_speed(time_s: np.ndarray, observer: StateObserver) -> np.ndarray:
    """A rough speed (rows,) in rad/s, for regimes and strokes; zeros where none is measured."""
    seen = observer.speed
    if seen is None or not len(seen.value):
        return np.zeros(len(time_s))
    middle = 0.5 * (seen.start_s + seen.end_s)
    speed = np.interp(time_s, middle, seen.value, left=0.0, right=0.0)
    gap, margin = np.diff(middle, prepend=middle[0]), OBSERVER.gap_margin_s
    for k in np.flatnonzero(gap > OBSERVER.max_gap_s):
        speed[(time_s > middle[k - 1] + margin) & (time_s < middle[k] - margin)] = 0.0
    return speed
