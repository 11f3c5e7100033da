"""Quantities that a residual may depend on, per residual row: measured signals, angles of the
model, time, heat, the command and its rate.
"""

import numpy as np

from vgroove.gap.residual.moving_mean import moving_mean
from vgroove.gap.residual.problem import Problem
from vgroove.gap.selection.log_content import fill_rows, measured_speed
from vgroove.units import TURN_RAD

Covariates = dict[str, np.ndarray]
UNWOUND_ANGLE = "unwound motor angle"  # for spectra over the angle, not used as a covariate
HEAT_TIME_S = 2.0  # time constant of the heat, s: the order of a winding's, for logs of seconds
# rows of the moving mean, without which the noise of a sample would correlate with its own residual
SMOOTHED_ROWS = 21
STANDSTILL_RAD_S = 1.0  # speed below which the direction counts as 0
# columns of a log -> names in a verdict
COLUMN_NAMES = {
    "current_a": "current",
    "duty": "duty",
    "voltage_v": "voltage",
    "supply_v": "bus voltage",
    "load_nm": "load",
}


def covariates_of(problem: Problem, theta: np.ndarray) -> Covariates:
    """Covariates (n,) by name that all logs have; the angles are simulated with theta (P,)."""
    angles = problem.motor_angles(theta)
    tables = [log_covariates(problem, j, angles[j]) for j in range(len(problem.logs))]
    names = set.intersection(*(set(t) for t in tables))
    found = {name: np.full(problem.n, np.nan) for name in sorted(names)}
    for j, table in enumerate(tables):
        rows = problem.log == j
        for name in names:
            found[name][rows] = table[name][problem.row[rows]]
    return found


def log_covariates(problem: Problem, j: int, angle: np.ndarray) -> Covariates:
    """Covariates (rows,) of log j; angle (rows,): of the motor, rad, unwound."""
    log, ratio = problem.logs[j], problem.rig.gearbox["ratio"]
    t, speed = np.asarray(log.time_s, float), measured_speed(problem, j)
    found = {
        "speed": speed,
        "sign of speed": np.sign(np.where(np.abs(speed) > STANDSTILL_RAD_S, speed, 0.0)),
        "time since start": t - t[0],
        "motor angle": np.mod(angle, TURN_RAD),
        "output angle": np.mod(angle / ratio, TURN_RAD),
        UNWOUND_ANGLE: angle,
    }
    for column, name in COLUMN_NAMES.items():
        if column in log.columns:
            found[name] = moving_mean(
                fill_rows(np.asarray(log.columns[column], float)), SMOOTHED_ROWS
            )
    command = found.get("duty", found.get("voltage"))
    if command is not None:
        found["rate of command"] = np.gradient(command, t)
    if "current" in found:
        found["heat"] = heat(found["current"], t)
    return found


def heat(current: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """Squared current (n,), A^2 s, through a first-order low pass of HEAT_TIME_S."""
    out, level = np.zeros(len(time_s)), 0.0
    kept = np.exp(-np.diff(time_s) / HEAT_TIME_S)
    for n in range(1, len(time_s)):
        level = kept[n - 1] * level + (1.0 - kept[n - 1]) * HEAT_TIME_S * current[n] ** 2
        out[n] = level
    return out
