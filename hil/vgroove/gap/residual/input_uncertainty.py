"""What the driving columns leave open: they are measured and rounded, and the nominal motor makes
current and speed of their errors.
"""

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

KINK = 3.5  # steps of the column by which a line of rounded values may seem to bend
LAGS = 8  # rows by which a current may come after its command
LEAST_ROWS = 50  # of smooth ramps, below which they tell nothing
IMPULSE_ROWS = 64


def drive_sigma(
    rig: Rig,
    time_s: np.ndarray,
    command: np.ndarray,
    load_nm: np.ndarray | None,
    current_a: np.ndarray | None,
    driven: DenoisedCommand | None = None,
    closed: np.ndarray | bool = True,
    restart_s: float = np.inf,
) -> tuple[np.ndarray, np.ndarray]:
    """1 sigma (rows,) of speed, rad/s, and current, A, that the driving columns leave open.

    A ramp is known to its column's resolution or better (ramp_sigma), a load step to the row it
    happens in, a measured current to its noise. The nominal motor turns each into an impulse of
    speed that decays with its time constant, or is gone at the next restart. A constant command is
    known to the last digit written. A measured bus or terminal voltage (driven) has a noise that is
    white, or lasts as long as a mean over rows. A bridge that is not closed (rows,) passes none on,
    and does not brake either.
    """
    motor, inertia = rig.motor, rig.shaft_inertia_kg_m2
    constant, resistance = motor["torque_constant_nm_per_a"], motor["resistance_ohm"]
    dt = np.diff(time_s, prepend=2.0 * time_s[0] - time_s[1])
    torque, current = np.zeros(len(time_s)), np.zeros(len(time_s))
    volt, rate = (
        full_volt(rig),
        (motor["viscous_nm_s_per_rad"] + constant**2 / resistance * closed) / inertia,
    )
    if rig.input["kind"] == "current_a":
        torque += constant * rig.sensors.get("current_noise_a", 0.0)
    elif "slew_per_s" in rig.input:
        amps = np.diff(command, prepend=command[0]) != 0.0
        amps = amps * ramp_sigma(rig, time_s, command, current_a) * volt / resistance
        current, torque = amps * of_one_row(rig, float(np.median(dt))), constant * amps
    if driven is not None:
        # of the stationary current within a row
        reached = 1.0 - np.exp(-dt * resistance / motor["inductance_h"])
        amps = (
            (np.minimum(np.abs(command), 1.0) if rig.input["kind"] == "duty" else 1.0)
            * closed
            / resistance
        )
        # longer than the shaft remembers a white noise
        lasts = 0.5 * (driven.averaged - 1.0) * dt * (rate + 1.0 / restart_s)
        current = np.hypot(
            current,
            amps * reached * np.hypot(driven.noise_v / np.sqrt(driven.averaged), driven.fast_v),
        )
        torque = np.hypot(
            torque, constant * amps * np.hypot(driven.noise_v / np.sqrt(1.0 + lasts), driven.fast_v)
        )
    if load_nm is not None:
        torque = np.hypot(
            torque,
            np.abs(np.diff(load_nm, prepend=load_nm[0])) / np.sqrt(12.0) / rig.gearbox["ratio"],
        )
    digit = (
        decimal_resolution(command) / np.sqrt(12.0) * volt / constant
        if rig.input["kind"] != "current_a"
        else 0.0
    )
    impulse, kept = (torque * dt / inertia) ** 2, np.exp(-2.0 * (rate + 1.0 / restart_s) * dt)
    variance = np.empty(len(time_s))
    last = 0.0
    for i in range(len(time_s)):
        last = variance[i] = last * kept[i] + impulse[i]
    unsure = (np.abs(command) != 0.0) & (np.abs(command) != 1.0)
    return np.hypot(np.sqrt(variance), digit * unsure), np.sqrt(
        current**2 + variance * (constant / resistance) ** 2
    )


def full_volt(rig: Rig) -> float:
    """Terminal voltage of a command of 1."""
    return rig.supply.get("voltage_v", 1.0) if rig.input["kind"] == "duty" else 1.0


def ramp_sigma(
    rig: Rig, time_s: np.ndarray, command: np.ndarray, current_a: np.ndarray | None
) -> float:
    """1 sigma of a ramp's command (rows,) at the end of a row, in its column's unit: that of
    rounding to the column's steps, less what the measured current (rows,) shows to have run as it
    is written.

    A timer's compare value is what ran, a number rounded by the logger is not. Rounding is fast and
    of known shape: as far as the fast part of the current follows that of the column it was real.
    """
    rounded = resolution_of(command) / np.sqrt(12.0)
    if current_a is None or "current_noise_a" not in rig.sensors:
        return rounded
    expected = (
        full_volt(rig)
        / rig.motor["resistance_ohm"]
        * winding_response(rig, float(np.median(np.diff(time_s))), command)
    )
    rows = on_smooth_ramps(command) & np.isfinite(current_a)
    rows[:LAGS] = False
    if np.count_nonzero(rows) < LEAST_ROWS:
        return rounded
    fast, seen = (
        high_pass_residual(expected),
        high_pass_residual(interpolate_missing(time_s, current_a))[rows],
    )
    late = np.stack([np.roll(fast, lag)[rows] for lag in range(LAGS)], axis=1)
    return rounded * float(
        np.sqrt(
            unreal_share(
                late, seen, RESIDUAL_POWER_SHARE * column_sigma(rig, "current_a", current_a) ** 2
            )
        )
    )


def unreal_share(late: np.ndarray, seen: np.ndarray, noise: float) -> float:
    """Share 0..1 of the power of a rounding that did not run: what a current (n,) lacks of what
    follows from it at several delays (n, LAGS), and what it has besides over the sensor's noise
    power, both as large as the scatter of a part KEPT of n samples allows.
    """
    power, freedom = (
        max(float(np.mean(late[:, 0] ** 2)), 1e-12),
        RESIDUAL_POWER_SHARE * (len(seen) - LAGS),
    )
    follows = late @ np.linalg.lstsq(late, seen, rcond=None)[0]
    spread = float(np.sum((seen - follows) ** 2)) / (len(seen) - LAGS)
    share = np.sqrt(max(0.0, float(np.mean(follows**2)) - LAGS * spread / freedom) / power)
    lacks = 1.0 - np.clip(share - 2.0 * np.sqrt(spread / freedom / power), 0.0, 1.0)
    besides = max(0.0, spread * (1.0 + 2.0 * np.sqrt(2.0 / freedom)) - noise) / power
    return float(np.clip(lacks**2 + besides, 0.0, 1.0))


def on_smooth_ramps(command: np.ndarray) -> np.ndarray:
    """Rows (mask) within reach of which the command changes, and bends no more than a rounded line
    seems to.
    """
    bend = np.abs(np.diff(command, 2, prepend=[command[0]] * 2)) > KINK * resolution_of(command)
    changes = np.diff(command, prepend=command[0]) != 0.0
    reach = 2 * (FILTER_ROWS + LAGS) + 1
    return maximum_filter1d(changes, FILTER_ROWS) & ~maximum_filter1d(bend, reach)


def of_one_row(rig: Rig, dt_s: float) -> float:
    """Share of a command's error at one row's end that the row means of the current show (root of
    the sum of squares).
    """
    impulse = np.zeros(IMPULSE_ROWS)
    impulse[1] = 1.0
    return float(np.linalg.norm(winding_response(rig, dt_s, impulse)))


def winding_response(rig: Rig, dt_s: float, command: np.ndarray) -> np.ndarray:
    """Row means of the stationary current that a command (rows,), straight between rows, asks of a
    winding at rest, as share of volt over resistance.
    """
    r = dt_s * rig.motor["resistance_ohm"] / rig.motor["inductance_h"]
    a, before, rise = (
        np.exp(-r),
        np.concatenate([command[:1], command[:-1]]),
        np.diff(command, prepend=command[0]),
    )
    end = lfilter(
        [1.0], [1.0, -a], command - rise / r - a * before + a * rise / r, zi=[a * command[0]]
    )[0]
    begin = np.concatenate([command[:1], end[:-1]])
    return 0.5 * (command + before) - rise / r + (begin - before + rise / r) * (1.0 - a) / r
