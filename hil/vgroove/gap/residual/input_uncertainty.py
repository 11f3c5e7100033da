"""Standard deviation of the model's speed and current that comes from its input: the driving
columns are measured and rounded (an errors-in-variables model: Fuller, Measurement Error Models,
1987), and the nominal motor turns their errors into current and speed.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d
from scipy.signal import lfilter

from vgroove.gap.cleaning.denoised_command import DenoisedCommand
from vgroove.gap.cleaning.missing_values import interpolate_missing
from vgroove.gap.cleaning.sensor_noise import (
    FILTER_ROWS,
    RESIDUAL_POWER_SHARE,
    column_sigma,
    decimal_resolution,
    high_pass_residual,
    resolution_of,
)
from vgroove.rig import Rig

UNIFORM_WIDTH_SIGMAS = np.sqrt(12.0)  # width of a uniform distribution in standard deviations


@dataclass(frozen=True)
class RoundingTest:
    """How the current shows whether a ramp ran as its column rounds it; chosen on the tuning half
    of the blind set.
    """

    kink_steps: float = 3.5  # steps of the column by which a straight, rounded ramp seems to bend
    max_lag_rows: int = 8  # rows by which the current may lag behind its command
    min_rows: int = 50  # of smooth ramps; fewer show nothing
    sigmas: float = 2.0  # by which shares are bounded
    min_power: float = 1e-12  # A^2; keeps a ratio of powers finite


ROUNDING = RoundingTest()
IMPULSE_ROWS = 64  # length of an impulse response: longer than any winding's


@dataclass(frozen=True)
class MeasuredInput:
    """Driving columns (rows,) of a log as measured, without missing samples."""

    time_s: np.ndarray
    command: np.ndarray  # duty, V or A
    load_nm: np.ndarray | None = None
    current_a: np.ndarray | None = None  # measured; its samples may be missing
    denoised: DenoisedCommand | None = None  # a measured terminal or bus voltage with its noise
    bridge_closed: np.ndarray | bool = True  # whether the voltage reaches the motor


def input_sigma(
    rig: Rig, given: MeasuredInput, restart_s: float = np.inf
) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviations (rows,) of speed in rad/s and current in A from errors of the input.

    A ramp is known to its column's resolution or better (ramp_sigma), a load step to the row in
    which it happens, a measured current and a measured voltage to their noise, a constant command
    to the last digit written. The nominal motor turns each error into an impulse of speed that
    decays with its time constant, or ends at the next restart. An open bridge passes no error on
    and does not brake.
    """
    dt = np.diff(given.time_s, prepend=2.0 * given.time_s[0] - given.time_s[1])
    forgetting = _speed_decay(rig, given.bridge_closed) + 1.0 / restart_s  # 1/s
    current, torque = _command_errors(rig, given, dt)
    if given.denoised is not None:
        noise_current, noise_torque = _voltage_errors(rig, given, dt, forgetting)
        current, torque = np.hypot(current, noise_current), np.hypot(torque, noise_torque)
    if given.load_nm is not None:
        torque = np.hypot(torque, _load_errors(rig, given.load_nm))
    variance = _accumulated(
        (torque * dt / rig.shaft_inertia_kg_m2) ** 2, np.exp(-2.0 * forgetting * dt)
    )
    amps_per_rad_s = rig.motor["torque_constant_nm_per_a"] / rig.motor["resistance_ohm"]
    speed = np.hypot(np.sqrt(variance), _constant_command_error(rig, given.command))
    return speed, np.sqrt(current**2 + variance * amps_per_rad_s**2)


def _speed_decay(rig: Rig, closed: np.ndarray | bool) -> np.ndarray | float:
    """Rate (rows,) in 1/s at which an error of the speed decays."""
    motor = rig.motor
    braking = motor["torque_constant_nm_per_a"] ** 2 / motor["resistance_ohm"] * closed
    return (motor["viscous_nm_s_per_rad"] + braking) / rig.shaft_inertia_kg_m2


def _command_errors(
    rig: Rig, given: MeasuredInput, dt: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviations (rows,) of current, A, and torque, N m, from a measured current or a
    rounded ramp.
    """
    none = np.zeros(len(given.time_s))
    constant = rig.motor["torque_constant_nm_per_a"]
    if rig.input["kind"] == "current_a":
        return none, none + constant * rig.sensors.get("current_noise_a", 0.0)
    if "slew_per_s" not in rig.input:
        return none, none
    changes = np.diff(given.command, prepend=given.command[0]) != 0.0
    sigma = ramp_sigma(rig, given.time_s, given.command, given.current_a)
    amps = changes * sigma * full_volt(rig) / rig.motor["resistance_ohm"]
    return amps * one_row_share(rig, float(np.median(dt))), constant * amps


def _voltage_errors(
    rig: Rig, given: MeasuredInput, dt: np.ndarray, forgetting: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviations (rows,) of current, A, and torque, N m, from the noise of a measured
    voltage, which is white or lasts as long as a mean over rows.
    """
    motor, noise = rig.motor, given.denoised
    constant, resistance = motor["torque_constant_nm_per_a"], motor["resistance_ohm"]
    # share of the stationary current that is reached within a row
    reached = 1.0 - np.exp(-dt * resistance / motor["inductance_h"])
    duty = np.minimum(np.abs(given.command), 1.0) if rig.input["kind"] == "duty" else 1.0
    amps = duty * given.bridge_closed / resistance
    # duration of the noise over the time in which the shaft forgets a white one
    lasts = 0.5 * (noise.averaged - 1.0) * dt * forgetting
    current = amps * reached * np.hypot(noise.noise_v / np.sqrt(noise.averaged), noise.fast_v)
    torque = constant * amps * np.hypot(noise.noise_v / np.sqrt(1.0 + lasts), noise.fast_v)
    return current, torque


def _load_errors(rig: Rig, load_nm: np.ndarray) -> np.ndarray:
    """Standard deviation (rows,) of the motor's torque in N m: a load step lies anywhere in its
    row.
    """
    return (
        np.abs(np.diff(load_nm, prepend=load_nm[0])) / UNIFORM_WIDTH_SIGMAS / rig.gearbox["ratio"]
    )


def _accumulated(impulse: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """Variance (rows,) of a first-order process with the variance of its impulses (rows,) and the
    share (rows,) that each row keeps of the variance before.
    """
    variance = np.empty(len(impulse))
    last = 0.0
    for i in range(len(impulse)):
        last = variance[i] = last * kept[i] + impulse[i]
    return variance


def _constant_command_error(rig: Rig, command: np.ndarray) -> np.ndarray:
    """Standard deviation (rows,) of the speed in rad/s from the last digit of a command; commands
    of 0 and of the full supply are exact.
    """
    inexact = (np.abs(command) != 0.0) & (np.abs(command) != 1.0)
    if rig.input["kind"] == "current_a":
        return 0.0 * inexact
    constant = rig.motor["torque_constant_nm_per_a"]
    return decimal_resolution(command) / UNIFORM_WIDTH_SIGMAS * full_volt(rig) / constant * inexact


def full_volt(rig: Rig) -> float:
    """Terminal voltage in V of a command of 1."""
    return rig.supply.get("voltage_v", 1.0) if rig.input["kind"] == "duty" else 1.0


def ramp_sigma(
    rig: Rig, time_s: np.ndarray, command: np.ndarray, current_a: np.ndarray | None
) -> float:
    """Standard deviation of a ramp's command (rows,) at the end of a row, in its column's unit:
    that of rounding to the column's steps, less what the measured current (rows,) shows to have
    run as it is written.

    A timer's compare value is what ran, a number rounded by the logger is not. Rounding is fast and
    of known shape: it was real as far as the fast part of the current follows that of the column.
    """
    rounded = resolution_of(command) / UNIFORM_WIDTH_SIGMAS
    if current_a is None or "current_noise_a" not in rig.sensors:
        return rounded
    rows = on_smooth_ramps(command) & np.isfinite(current_a)
    rows[: ROUNDING.max_lag_rows] = False
    if np.count_nonzero(rows) < ROUNDING.min_rows:
        return rounded
    response = winding_response(rig, float(np.median(np.diff(time_s))), command)
    expected = high_pass_residual(full_volt(rig) / rig.motor["resistance_ohm"] * response)
    lagged = np.stack(
        [np.roll(expected, lag)[rows] for lag in range(ROUNDING.max_lag_rows)], axis=1
    )
    fast = high_pass_residual(interpolate_missing(time_s, current_a))[rows]
    noise = RESIDUAL_POWER_SHARE * column_sigma(rig, "current_a", current_a) ** 2
    return rounded * float(np.sqrt(rounding_share(lagged, fast, noise)))


def rounding_share(lagged: np.ndarray, fast: np.ndarray, noise: float) -> float:
    """Share 0..1 of the power of a rounding that did not run, from the fast part of a current (n,)
    and of what follows from the rounded command at several delays (n, lags).

    It is the power that the current lacks of what follows from the command, plus its power above
    the sensor's noise power, each as large as the scatter of n samples allows.
    """
    lags = ROUNDING.max_lag_rows
    power = max(float(np.mean(lagged[:, 0] ** 2)), ROUNDING.min_power)
    freedom = RESIDUAL_POWER_SHARE * (len(fast) - lags)
    follows = lagged @ np.linalg.lstsq(lagged, fast, rcond=None)[0]
    spread = float(np.sum((fast - follows) ** 2)) / (len(fast) - lags)
    share = np.sqrt(max(0.0, float(np.mean(follows**2)) - lags * spread / freedom) / power)
    scatter = np.sqrt(spread / freedom / power)
    lacks = 1.0 - np.clip(share - ROUNDING.sigmas * scatter, 0.0, 1.0)
    bound = spread * (1.0 + ROUNDING.sigmas * np.sqrt(2.0 / freedom))
    return float(np.clip(lacks**2 + max(0.0, bound - noise) / power, 0.0, 1.0))


def on_smooth_ramps(command: np.ndarray) -> np.ndarray:
    """Rows (mask) near which the command changes, and bends no more than a rounded straight line
    seems to.
    """
    step = resolution_of(command)
    bend = np.abs(np.diff(command, 2, prepend=[command[0]] * 2)) > ROUNDING.kink_steps * step
    changes = np.diff(command, prepend=command[0]) != 0.0
    reach = 2 * (FILTER_ROWS + ROUNDING.max_lag_rows) + 1
    return maximum_filter1d(changes, FILTER_ROWS) & ~maximum_filter1d(bend, reach)


def one_row_share(rig: Rig, dt_s: float) -> float:
    """Share of a command's error at one row's end that the row means of the current show (root of
    the sum of squares).
    """
    impulse = np.zeros(IMPULSE_ROWS)
    impulse[1] = 1.0
    return float(np.linalg.norm(winding_response(rig, dt_s, impulse)))


def winding_response(rig: Rig, dt_s: float, command: np.ndarray) -> np.ndarray:
    """Row means of the current that a command (rows,), straight between rows, drives through a
    winding at rest, as a share of volt over resistance: L i' + R i = u, solved exactly.
    """
    r = dt_s * rig.motor["resistance_ohm"] / rig.motor["inductance_h"]
    a, before = np.exp(-r), np.concatenate([command[:1], command[:-1]])
    rise = np.diff(command, prepend=command[0])
    forcing = command - rise / r - a * before + a * rise / r
    end = lfilter([1.0], [1.0, -a], forcing, zi=[a * command[0]])[0]
    begin = np.concatenate([command[:1], end[:-1]])
    return 0.5 * (command + before) - rise / r + (begin - before + rise / r) * (1.0 - a) / r
