"""Standard deviation of the model's speed and current that comes from its input: the driving
columns are measured and rounded (an errors-in-variables model: Fuller, Measurement Error Models,
1987), and the nominal motor turns their errors into current and speed.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import accumulate

import numpy as np
import scipy  # its parts load when they are first used

from vgroove.gap.cleaning.denoised_command import DenoisedCommand
from vgroove.gap.cleaning.missing_values import interpolate_missing
from vgroove.gap.cleaning.sensor_noise import (
    FILTER_ROWS,
    UNIFORM_WIDTH_SIGMAS,
    column_sigma,
    decimal_resolution,
    driving_current_sigma,
    high_pass_residual,
    residual_power_share,
    resolution_of,
)
from vgroove.gap.residual.magnitude import robust_magnitude
from vgroove.rig import Rig


@dataclass(frozen=True)
class RoundingTest:
    """Test by the current whether the bridge applied the quantised values of a ramp's column or a
    finer command that only the logger rounded; chosen on the tuning half of the blind set
    (docs/gap_bench.md).
    """

    # second difference, in steps of the column, above which a ramp bends; rounding of a straight
    # ramp alone stays below it
    kink_steps: float = 3.5
    max_lag_rows: int = 8  # rows by which the current may lag behind its command
    min_rows: int = 50  # rows on smooth ramps below which the test is not made
    sigmas: float = 2.0  # of the confidence bounds of the shares
    min_power: float = 1e-12  # A^2; keeps a ratio of powers finite


ROUNDING = RoundingTest()
IMPULSE_ROWS = 64  # length of the computed impulse response of the winding, rows


@dataclass(frozen=True)
class MeasuredInput:
    """Driving columns (rows,) of a log as measured, without missing samples."""

    time_s: np.ndarray
    command: np.ndarray  # duty, V or A
    load_nm: np.ndarray | None = None
    current_a: np.ndarray | None = None  # measured; its samples may be missing
    denoised: DenoisedCommand | None = None  # a measured terminal or bus voltage with its noise
    bridge_closed: np.ndarray | bool = True  # (rows,) whether the voltage reaches the motor
    full_volt: float = 1.0  # terminal voltage in V of a command of 1


def input_sigma(
    rig: Rig, given: MeasuredInput, restart_s: float = np.inf
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Standard deviations (rows,) of speed in rad/s, current in A and angle in rad from errors of
    the input.

    The errors: of a ramp the resolution of its column or less (ramp_sigma()), of a load step its
    instant within a row, of a measured current or voltage its noise, of a constant command its last
    digit. Each error changes the speed of the nominal motor by an impulse that decays with the
    motor's time constant, or ends at the next restart. An open bridge passes no error of the
    command on and does not brake.
    """
    dt = np.diff(given.time_s, prepend=2.0 * given.time_s[0] - given.time_s[1])
    decay = _speed_decay(rig, given.bridge_closed) + 1.0 / restart_s  # 1/s
    current, torque = _command_errors(rig, given, dt)
    if given.denoised is not None:
        noise_current, noise_torque = _voltage_errors(rig, given, dt, decay)
        current, torque = np.hypot(current, noise_current), np.hypot(torque, noise_torque)
    if given.load_nm is not None:
        torque = np.hypot(torque, _load_errors(rig, given.load_nm))
    impulse = (torque * dt / rig.shaft_inertia_kg_m2) ** 2
    variance, angle = _accumulated(impulse, np.exp(-decay * dt), dt, np.exp(-dt / restart_s))
    amps_per_rad_s = rig.motor["torque_constant_nm_per_a"] / rig.motor["resistance_ohm"]
    constant = _constant_command_error(rig, given)
    lasts = min(restart_s, float(np.ptp(given.time_s)))
    return (
        np.hypot(np.sqrt(variance), constant),
        np.sqrt(current**2 + variance * amps_per_rad_s**2),
        np.hypot(np.sqrt(angle), constant * lasts),
    )


def _speed_decay(rig: Rig, closed: np.ndarray | bool) -> np.ndarray | float:
    """Rate (rows,) in 1/s at which an error of the speed decays."""
    braking = rig.back_emf_damping_nm_s_per_rad * closed
    return (rig.motor["viscous_nm_s_per_rad"] + braking) / rig.shaft_inertia_kg_m2


def _command_errors(
    rig: Rig, given: MeasuredInput, dt: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviations (rows,) of current, A, and torque, N m, from a measured current or a
    rounded ramp.
    """
    none = np.zeros(len(given.time_s))
    constant = rig.motor["torque_constant_nm_per_a"]
    if rig.input["kind"] == "current_a":
        return none, none + constant * driving_current_sigma(rig, given.command)
    if "slew_per_s" not in rig.input:
        return none, none
    changes = np.diff(given.command, prepend=given.command[0]) != 0.0
    sigma = ramp_sigma(rig, given)
    amps = changes * sigma * given.full_volt / rig.motor["resistance_ohm"]
    return amps * one_row_share(rig, float(np.median(dt))), constant * amps


def _voltage_errors(
    rig: Rig, given: MeasuredInput, dt: np.ndarray, decay: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviations (rows,) of current, A, and torque, N m, from the noise of a measured
    voltage: a white part, and a part that is correlated over the rows that were averaged. decay
    (rows,): rate in 1/s at which an error of the speed decays.
    """
    motor, noise = rig.motor, given.denoised
    constant, resistance = motor["torque_constant_nm_per_a"], motor["resistance_ohm"]
    # share of the stationary current that is reached within a row
    reached = 1.0 - np.exp(-dt * resistance / motor["inductance_h"])
    duty = np.minimum(np.abs(given.command), 1.0) if rig.input["kind"] == "duty" else 1.0
    amps = duty * given.bridge_closed / resistance
    # correlation time of the averaged noise over the time constant of the speed
    lasts = 0.5 * (noise.averaged - 1.0) * dt * decay
    current = amps * reached * np.hypot(noise.noise_v / np.sqrt(noise.averaged), noise.fast_v)
    torque = constant * amps * np.hypot(noise.noise_v / np.sqrt(1.0 + lasts), noise.fast_v)
    return current, torque


def _load_errors(rig: Rig, load_nm: np.ndarray) -> np.ndarray:
    """Standard deviation (rows,) of the motor's torque in N m, as a load step may be at any instant
    of its row.
    """
    return (
        np.abs(np.diff(load_nm, prepend=load_nm[0])) / UNIFORM_WIDTH_SIGMAS / rig.gearbox["ratio"]
    )


def _accumulated(
    impulse: np.ndarray, kept: np.ndarray, dt: np.ndarray, angle_kept: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Variances (rows,) of the speed of a first-order process and of its integral, the angle:
    impulse (rows,) is the variance of the speed that each row adds, kept and angle_kept (rows,) the
    shares of speed and angle before that remain.
    """
    speed, angle = np.empty(len(impulse)), np.empty(len(impulse))
    v = c = a = 0.0
    for i, (added, k, step, k_angle) in enumerate(
        zip(impulse.tolist(), kept.tolist(), dt.tolist(), angle_kept.tolist(), strict=True)
    ):
        a = (a + 2.0 * step * c + step**2 * v) * k_angle**2
        c = (c + step * v) * k * k_angle
        v = v * k**2 + added
        speed[i], angle[i] = v, a
    return speed, angle


def _constant_command_error(rig: Rig, given: MeasuredInput) -> np.ndarray:
    """Standard deviation (rows,) of the speed in rad/s from rounding of a command to its last
    digit; commands of 0 and of +-1 are exact.
    """
    command = given.command
    inexact = (np.abs(command) != 0.0) & (np.abs(command) != 1.0)
    if rig.input["kind"] == "current_a":
        return 0.0 * inexact
    constant = rig.motor["torque_constant_nm_per_a"]
    volts = decimal_resolution(command) / UNIFORM_WIDTH_SIGMAS * given.full_volt
    return volts / constant * inexact


def full_volt(rig: Rig, columns: Mapping[str, np.ndarray]) -> float:
    """Terminal voltage in V at a command of 1: for a duty the voltage of the bus, measured or else
    as the rig states it; 1 V for a command in V.
    """
    if rig.input["kind"] != "duty":
        return 1.0
    stated = rig.supply.get("voltage_v", 1.0)
    if not rig.bus_is_measured or "supply_v" not in columns:
        return stated
    return robust_magnitude(np.asarray(columns["supply_v"], float), stated)


def ramp_sigma(rig: Rig, given: MeasuredInput) -> float:
    """Standard deviation of a ramp's command (rows,) at the end of a row, in its column's unit:
    that of rounding to the column's steps, reduced by the share of the rounding that the bridge
    really applied.

    A timer's compare value is applied as it is logged: it has no rounding error. A command that the
    logger rounded was applied unrounded. The measured current (rows,) separates the two: its
    high-frequency part follows the steps of the column only where they were applied.
    """
    time_s, command, current_a = given.time_s, given.command, given.current_a
    rounded = resolution_of(command) / UNIFORM_WIDTH_SIGMAS
    if current_a is None or "current_noise_a" not in rig.sensors:
        return rounded
    rows = on_smooth_ramps(command) & np.isfinite(current_a)
    rows[: ROUNDING.max_lag_rows] = False
    if np.count_nonzero(rows) < ROUNDING.min_rows:
        return rounded
    response = winding_response(rig, float(np.median(np.diff(time_s))), command)
    expected = high_pass_residual(given.full_volt / rig.motor["resistance_ohm"] * response)
    lagged = np.stack(
        [np.roll(expected, lag)[rows] for lag in range(ROUNDING.max_lag_rows)], axis=1
    )
    fast = high_pass_residual(interpolate_missing(time_s, current_a))[rows]
    noise = residual_power_share() * column_sigma(rig, "current_a", current_a) ** 2
    return rounded * float(np.sqrt(rounding_share(lagged, fast, noise)))


def rounding_share(lagged: np.ndarray, fast: np.ndarray, noise: float) -> float:
    """Share 0..1 of the power of a rounding that was not applied to the motor, from the
    high-frequency part of the current, fast (n,), and that which the rounded command would cause at
    several delays, lagged (n, lags). noise: power of the sensor's noise in `fast`, A^2.

    It is the power of the expected part that is missing in the current, plus the power of the
    current above the sensor's noise; each is an upper confidence bound for n samples.
    """
    lags = ROUNDING.max_lag_rows
    power = max(float(np.mean(lagged[:, 0] ** 2)), ROUNDING.min_power)
    freedom = residual_power_share() * (len(fast) - lags)
    follows = lagged @ np.linalg.lstsq(lagged, fast, rcond=None)[0]
    spread = float(np.sum((fast - follows) ** 2)) / (len(fast) - lags)
    share = np.sqrt(max(0.0, float(np.mean(follows**2)) - lags * spread / freedom) / power)
    scatter = np.sqrt(spread / freedom / power)
    lacks = 1.0 - np.clip(share - ROUNDING.sigmas * scatter, 0.0, 1.0)
    bound = spread * (1.0 + ROUNDING.sigmas * np.sqrt(2.0 / freedom))
    return float(np.clip(lacks**2 + max(0.0, bound - noise) / power, 0.0, 1.0))


def on_smooth_ramps(command: np.ndarray) -> np.ndarray:
    """Mask (rows,) of rows near which the command changes, and its second difference is no larger
    than rounding of a straight line makes it.
    """
    step = resolution_of(command)
    bend = np.abs(np.diff(command, 2, prepend=[command[0]] * 2)) > ROUNDING.kink_steps * step
    changes = np.diff(command, prepend=command[0]) != 0.0
    reach = 2 * (FILTER_ROWS + ROUNDING.max_lag_rows) + 1
    near = scipy.ndimage.maximum_filter1d
    return near(changes, FILTER_ROWS) & ~near(bend, reach)


def one_row_share(rig: Rig, dt_s: float) -> float:
    """Change of the row means of the current from an error of the command at the end of one row, as
    a share of the stationary change (root of the sum of squares over the rows).
    """
    impulse = np.zeros(IMPULSE_ROWS)
    impulse[1] = 1.0
    return float(np.linalg.norm(winding_response(rig, dt_s, impulse)))


def winding_response(rig: Rig, dt_s: float, command: np.ndarray) -> np.ndarray:
    """Row means of the current that a command (rows,), straight between rows, drives through a
    winding of a motor at rest, in units of the stationary current: L i' + R i = u, solved exactly.
    """
    r = dt_s * rig.motor["resistance_ohm"] / rig.motor["inductance_h"]
    a, before = np.exp(-r), np.concatenate([command[:1], command[:-1]])
    rise = np.diff(command, prepend=command[0])
    forcing = command - rise / r - a * before + a * rise / r
    # scipy.signal.lfilter() as a loop: the import of scipy.signal takes longer than the loop
    ends = accumulate(
        forcing.tolist(), lambda end, force: force + a * end, initial=float(command[0])
    )
    end = np.fromiter(ends, float)[1:]
    begin = np.concatenate([command[:1], end[:-1]])
    return 0.5 * (command + before) - rise / r + (begin - before + rise / r) * (1.0 - a) / r
