"""What logs and rig contain: which effects they can show, and the magnitudes that effects are
scaled by.
"""

from collections.abc import Iterator

import numpy as np

from vgroove.gap.catalogue import MIN_PERIODS, Effect, Scales, available
from vgroove.gap.cleaning.missing_values import has_values, interpolate_missing
from vgroove.gap.fitting.hypothesis import least_share
from vgroove.gap.residual.magnitude import robust_magnitude
from vgroove.gap.residual.problem import Problem
from vgroove.units import RAD_S_PER_RPM, TURN_RAD

MOVING_SHARE = 0.02  # of the largest speed: a lower speed counts as standstill
REVERSAL_SHARE = 0.1  # of the range of an angle: a smaller way back counts as noise
MIN_TIME_EACH_WAY = 0.05  # share of the moving rows in each direction for both to count
# inertia behind the gear, as a share of the rotor's, below which a log cannot contain its effects
MIN_REFLECTED_INERTIA = 0.01
STALL_SHARE = 0.3  # assumed magnitude of a current that is not logged, as a share of stall current
UNKNOWN_CLOCK_PPM = 20000.0  # docs/spec/gap.md, section 2
SHOWN_SIGMAS = 3.0  # by which noise may raise the 99th percentile of a clipped current
ROWS_OF_DELAY = 1.5  # row intervals below which a delay may be the logger's convention


def logged_column(problem: Problem, name: str) -> np.ndarray:
    """A column of all logs, concatenated; empty where no log has it."""
    found = [np.asarray(log.columns[name], float) for log in problem.logs if name in log.columns]
    return np.concatenate(found) if found else np.zeros(0)


def fill_rows(values: np.ndarray) -> np.ndarray:
    """Missing samples interpolated over the row numbers."""
    return interpolate_missing(np.arange(len(values)), values)


def measured_speed(problem: Problem, j: int) -> np.ndarray:
    """Motor speed of log j per row, rad/s, from the speed or the position column; zeros where both
    are absent.
    """
    log = problem.logs[j]
    if has_values(log.columns, "speed_rpm"):
        return fill_rows(np.asarray(log.columns["speed_rpm"], float)) * RAD_S_PER_RPM
    if has_values(log.columns, "position_rad"):
        angle = fill_rows(np.asarray(log.columns["position_rad"], float))
        return np.gradient(angle, np.asarray(log.time_s, float))
    return np.zeros(len(log.time_s))


def all_speeds(problem: Problem) -> np.ndarray:
    """Motor speed of all logs, rad/s, concatenated."""
    return np.concatenate([measured_speed(problem, j) for j in range(len(problem.logs))])


def turns_both_ways(problem: Problem) -> bool:
    """Whether the shaft turns in each direction for MIN_TIME_EACH_WAY of the moving rows."""
    speed = all_speeds(problem)
    moving = np.abs(speed) > MOVING_SHARE * max(np.abs(speed).max(), 1e-12)
    backward = float((speed[moving] < 0.0).mean()) if moving.any() else 0.0
    return MIN_TIME_EACH_WAY < backward < 1.0 - MIN_TIME_EACH_WAY


def turned(problem: Problem) -> float:
    """Turns of the motor between the outermost angles of the log that turns furthest; infinite
    where neither speed nor angle is logged.
    """
    return max(map(np.ptp, angles(problem)), default=np.inf) / TURN_RAD


def turned_repeatedly(problem: Problem) -> float:
    """The repeated_range() of the motor in turns, of the log with the most; infinite where neither
    speed nor angle is logged.
    """
    return max(map(repeated_range, angles(problem)), default=np.inf) / TURN_RAD


def angles(problem: Problem) -> list[np.ndarray]:
    """Angle of the motor from the start of each log (rows,), rad; none where a log shows neither
    speed nor angle.
    """
    moves = ("speed_rpm", "position_rad")
    if any(not any(has_values(log.columns, name) for name in moves) for log in problem.logs):
        return []
    steps = [np.diff(np.asarray(log.time_s, float), prepend=log.time_s[0]) for log in problem.logs]
    return [np.cumsum(measured_speed(problem, j) * step) for j, step in enumerate(steps)]


def repeated_range(angle: np.ndarray) -> float:
    """MIN_PERIODS times the longest period of a torque over the shaft's angle (rows,) that a log
    can show, in the unit of the angle. One way, MIN_PERIODS periods must be passed; with reversals,
    half a period of which half is passed at least twice.
    """
    extent = float(np.ptp(angle))
    turning = angle[turning_rows(angle, REVERSAL_SHARE * extent)]
    return max(extent, 2.0 * MIN_PERIODS * min(extent, 2.0 * passed_again(turning)))


def passed_again(turning: np.ndarray) -> float:
    """Length of the angles that a shaft passes more than once on its way from each of the angles
    (k,) at which it turns back to the next.
    """
    again = []
    for k in range(1, len(turning) - 1):
        before = turning[: k + 1]
        low, high = np.sort(turning[k : k + 2])
        again.append((max(low, before.min()), min(high, before.max())))
    length, end = 0.0, -np.inf
    for low, high in sorted(again):
        length += max(0.0, high - max(low, end))
        end = max(end, high)
    return float(length)


def turning_rows(angle: np.ndarray, least: float) -> list[int]:
    """Indices of the rows at which an angle (rows,) reverses its direction: maxima that it then
    falls below, and minima that it then exceeds, by more than `least`. The first and the last row
    are included.
    """
    rows, extreme_row, direction = [0], 0, 0.0
    for row, value in enumerate(angle):
        passed = value - angle[extreme_row]
        if passed * direction >= 0.0 and (direction or abs(passed) > least):
            extreme_row, direction = row, direction or np.sign(passed)
        elif abs(passed) > least:
            rows.append(extreme_row)
            extreme_row, direction = row, -direction
    return [*rows, extreme_row, len(angle) - 1]


def resolved_periods(problem: Problem) -> float:
    """Largest number of periods a motor turn that the compared samples of some log resolve:
    MIN_PERIODS of them pass at speeds at which each lasts at least from one sample to the next.
    Infinite where the angle is measured, so that the phase of each sample is known, where no motion
    is logged, and for a hammering tool, whose rows are not compared.
    """
    counts_angle = any(s.edges or s.column == "position_rad" for s in problem.signals)
    if counts_angle or problem.rig.mechanism["kind"] == "impact":
        return np.inf
    if any(not has_values(log.columns, "speed_rpm") for log in problem.logs):
        return np.inf
    return max(map(periods_of_rows, turns_between_samples(problem)))


def turns_between_samples(problem: Problem) -> Iterator[np.ndarray]:
    """For each log, the turns (k,) of the motor between neighbouring compared samples, while the
    motor moves.
    """
    slowest = MOVING_SHARE * np.abs(all_speeds(problem)).max()
    for j, log in enumerate(problem.logs):
        time_s = np.asarray(log.time_s, float)
        speed = np.abs(measured_speed(problem, j))
        turned_rad = np.cumsum(speed * np.diff(time_s, prepend=time_s[0]))
        sampled_s = np.unique(problem.time_s[problem.log == j])
        passed_rad = np.diff(np.interp(sampled_s, time_s, turned_rad))
        yield passed_rad[passed_rad > slowest * np.diff(sampled_s)] / TURN_RAD


def periods_of_rows(turns: np.ndarray) -> float:
    """Largest number of periods per motor turn that rows can show. turns (k,): the motor turns
    between neighbouring rows. Only row intervals in which at most one period passes count, and
    MIN_PERIODS must pass in these.
    """
    turns = np.sort(turns)
    shown = np.cumsum(turns) >= MIN_PERIODS * turns
    return 1.0 / float(turns[shown][0]) if shown.any() else 0.0


def log_flags(problem: Problem) -> frozenset[str]:
    """What the logs can show, as flags of Effect.needs."""
    rig, kind, judged = problem.rig, problem.rig.input["kind"], {s.column for s in problem.signals}
    torque = np.nanmax(np.abs(logged_column(problem, "load_nm")), initial=0.0) > 0.0
    load = rig.load["kind"] == "pendulum" or (rig.load["kind"] == "torque" and torque)
    reflected = rig.shaft_inertia_kg_m2 / rig.motor["inertia_kg_m2"] - 1.0
    if rig.mechanism["kind"] == "impact":
        return frozenset(impact_flags(problem))
    flags = {
        "rows": True,
        "duty": kind == "duty",
        "voltage": kind != "current_a",
        "current_input": kind == "current_a",
        "current": "current_a" in judged,
        "speed": "speed_rpm" in judged,
        "motion": not judged.isdisjoint({"speed_rpm", "position_rad"}),
        "supply": "supply_v" in judged,
        "edges": any(s.edges for s in problem.signals),
        "both": turns_both_ways(problem),
        "load": bool(load),
        "output": bool(load)
        or (reflected > MIN_REFLECTED_INERTIA and not np.isclose(reflected, MIN_REFLECTED_INERTIA)),
    }
    return frozenset(name for name, here in flags.items() if here)


def impact_flags(problem: Problem) -> Iterator[str]:
    """What cycle statistics of a hammering tool can show. Effects of single Hall edges are averaged
    over a window; the torque behind the gear is the mechanism's own.
    """
    judged = {s.column.split(".")[0] for s in problem.signals}
    yield from ("duty", "voltage") if problem.rig.input["kind"] == "duty" else ("voltage",)
    names = {"current": "current_a", "speed": "speed_rpm", "supply": "supply_v"}
    yield from (flag for flag, column in names.items() if column in judged)
    yield from ("load", "impact")


def shown_effects(problem: Problem, without: frozenset[str]) -> list[Effect]:
    """Effects of the catalogue that the logs can show: has_range() and repeats(). On a hammering
    tool only those that act on its joint's kind, and with several logs none that is periodic in an
    angle, since the angle at the start of each log is not known.
    """
    scales = effect_scales(problem)
    effects = [
        e
        for e in available(log_flags(problem), without)
        if has_range(e, scales) and repeats(e, scales)
    ]
    if problem.rig.mechanism["kind"] != "impact":
        return effects
    kinds, several = problem.load_kinds, len(problem.logs) > 1
    return [
        e
        for e in effects
        if not (e.periodic and several) and (not e.loads or kinds.intersection(e.loads))
    ]


def has_range(effect: Effect, scales: Scales) -> bool:
    """Whether every parameter of an effect has a typical size, and a lower bound below its upper
    bound. The size of a knot is 0 where the joint takes up no torque. The upper bounds of a number
    of periods and of a stiffness depend on the interval between rows; where one lies below the
    lower bound, the log cannot show the effect.
    """
    parameters = effect.of_tool(scales).parameters
    return all(p.size(scales) > 0.0 and p.low(scales) < p.high(scales) for p in parameters)


def repeats(effect: Effect, scales: Scales) -> bool:
    """Whether an effect that is periodic in the angle with a known period repeats in the logs: the
    rows resolve its period, and the shaft passes enough of it (repeated_range()). True for every
    other effect.
    """
    if effect.periodic is None or effect.periodic.is_fitted:
        return True
    known = effect.periodic.periods_per_rev({}.get, scales.ratio)
    return scales.repeated_turns * known >= MIN_PERIODS and known <= scales.periods


def current_sigma(problem: Problem) -> float:
    """Standard deviation of the noise of a judged current in A; infinite without one, and of a
    hammering tool, whose rows are not compared.
    """
    return max((s.sigma for s in problem.signals if s.column == "current_a"), default=np.inf)


def effect_scales(problem: Problem) -> Scales:
    """Magnitudes (SI) that the sizes of effects are scaled by, from the logs and the rig."""
    rig, motor = problem.rig, problem.rig.motor
    resistance, k = motor["resistance_ohm"], motor["torque_constant_nm_per_a"]
    volt = robust_magnitude(
        logged_column(problem, "supply_v"),
        rig.supply.get("voltage_v", 0.0)
        or robust_magnitude(logged_column(problem, "voltage_v"), 1.0),
    )
    amp = robust_magnitude(logged_column(problem, "current_a"), STALL_SHARE * volt / resistance)
    times = [np.asarray(log.time_s, float) for log in problem.logs]
    interval = float(np.median(np.concatenate([np.diff(t) for t in times])))
    # A measured current may belong to the start or the end of its row, by the logger's convention:
    # one row interval is no delay.
    least_delay = ROWS_OF_DELAY * interval if rig.input["kind"] == "current_a" else 0.0
    return Scales(
        volt=volt,
        amp=amp,
        speed=robust_magnitude(all_speeds(problem), volt / k),
        torque=k * amp,
        inertia=rig.shaft_inertia_kg_m2,
        motor_inertia=motor["inertia_kg_m2"],
        resistance=resistance,
        coulomb=motor["coulomb_nm"],
        viscous=motor["viscous_nm_s_per_rad"],
        ratio=rig.gearbox["ratio"],
        turns=turned(problem),
        repeated_turns=turned_repeatedly(problem),
        periods=resolved_periods(problem),
        edges=any(signal.edges for signal in problem.signals),
        shown_amp=amp - SHOWN_SIGMAS * current_sigma(problem),
        duration=float(max(t[-1] - t[0] for t in times)),
        interval=interval,
        least_delay=least_delay,
        clock=1e-6 * rig.sensors.get("clock_ppm", UNKNOWN_CLOCK_PPM),
        pwm_hz=rig.bridge.get("pwm_hz", 20000.0),
        supply_ohm=rig.supply.get("resistance_ohm", 0.0),
        hammering=rig.mechanism["kind"] == "impact",
        head_rad=problem.head_rad,
        joint_nm=problem.joint_nm,
        least={key: least_share(sigma) for key, sigma in rig.tolerance.items()},
    )
