"""Delay of the Robotino motor's speed after its command, from the steps of the command and by least
squares, and its Coulomb friction: `python reference_fit.py` prints delays and errors.

The motor's time constant, J R / k^2 = 0.9 ms, is short against a row (30.6 ms): the model is the
static motor, v = R i + k w and k i = b w + c sign(w). The command of a row acts from the row on.
"""

import sys
import tomllib
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
RAD_S_PER_RPM = np.pi / 30.0
DELAYS_S = np.arange(0.0, 0.25, 0.0005)  # searched
LAGS_S = np.arange(0.005, 0.3, 0.005)  # searched
FOLDS = 4  # of the cross-validation: quarters of the log, or blocks dealt to the folds in turn
BLOCK_S = 1.0
EDGE_ROWS = 8  # rows after a step of the command by which the speed has settled


def static_motor(motor: dict[str, float], voltage: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Current A and speed rad/s (n,) of the motor at rest or in steady motion at a voltage."""
    r, k, b, c = (motor[name] for name in ("r", "k", "b", "c"))
    speed = (voltage - np.sign(voltage) * r * c / k) / (k + r * b / k)
    moving = np.abs(voltage) > r * c / k
    return np.where(moving, (b * speed + c * np.sign(voltage)) / k, voltage / r), speed * moving


def delayed(time_s: np.ndarray, values: np.ndarray, delay_s: float) -> np.ndarray:
    """Values (n,) in force a delay ago."""
    row = np.searchsorted(time_s, time_s - delay_s, side="right") - 1
    return values[np.maximum(row, 0)]


def lagged(time_s: np.ndarray, values: np.ndarray, lag_s: float) -> np.ndarray:
    """Values (n,) behind a first-order filter."""
    out = np.zeros(len(values))
    for n, decay in enumerate(np.exp(-np.diff(time_s) / lag_s)):
        out[n + 1] = values[n] + (out[n] - values[n]) * decay
    return out


def edge_delays(time_s: np.ndarray, voltage: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Delay, s, of each step of the command: to the first row beyond half the step of the speed."""
    found = []
    for row in np.flatnonzero(np.diff(voltage)) + 1:
        first, last = speed[row - 1], speed[row + EDGE_ROWS]
        beyond = (speed[row:] - 0.5 * (first + last)) * np.sign(last - first) > 0
        found.append(time_s[row + np.argmax(beyond)] - time_s[row])
    return np.array(found)


def held_out(squared: np.ndarray, fold: np.ndarray) -> tuple[np.ndarray, float]:
    """Best candidate (4,) of each fit to three folds, and the RMS error of the rows that each did
    not see; squared errors (candidates, n).
    """
    folds = np.arange(FOLDS)
    best = np.array([np.argmin(squared[:, fold != k].mean(axis=1)) for k in folds])
    return best, float(np.sqrt(np.mean(squared[best[fold], np.arange(len(fold))])))


def rms(error: np.ndarray) -> float:
    """RMS of the samples that are not missing."""
    return float(np.sqrt(np.nanmean(error**2)))


def speed_figures(log: np.ndarray, model: np.ndarray) -> dict[str, tuple[float, str]]:
    """Delays and errors of the measured speed against the undelayed model's (n,), rad/s."""
    time_s, speed = log["time_s"], RAD_S_PER_RPM * log["speed_rpm"]
    edges = edge_delays(time_s, log["voltage_v"], speed)
    quarter = FOLDS * np.arange(len(time_s)) // len(time_s)
    block = (time_s // BLOCK_S).astype(int) % FOLDS
    delay = np.stack([(speed - delayed(time_s, model, d)) ** 2 for d in DELAYS_S])
    lag = np.stack([(speed - lagged(time_s, model, d)) ** 2 for d in LAGS_S])
    (best, error), (best_block, error_block) = held_out(delay, quarter), held_out(delay, block)
    fitted = DELAYS_S[np.concatenate([best, best_block])]
    return {
        "steps of the command": (len(edges), ""),
        "delay of a step, least": (edges.min(), "s"),
        "delay of a step, median": (float(np.median(edges)), "s"),
        "delay of a step, largest": (edges.max(), "s"),
        "fitted delay, least of 8 fits": (fitted.min(), "s"),
        "fitted delay, largest of 8 fits": (fitted.max(), "s"),
        "speed error, no delay": (rms(speed - model), "rad/s"),
        "speed error held out, delay, quarters": (error, "rad/s"),
        "speed error held out, delay, blocks": (error_block, "rad/s"),
        "speed error held out, lag, quarters": (held_out(lag, quarter)[1], "rad/s"),
    }


def coulomb_figures(
    log: np.ndarray, motor: dict[str, float], delay_s: float
) -> dict[str, tuple[float, str]]:
    """Coulomb friction from the torque balance in motion, and the current's error without it and
    without the delay, and with both.
    """
    time_s, speed, current = log["time_s"], RAD_S_PER_RPM * log["speed_rpm"], log["current_a"]
    moving = np.isfinite(current) & (speed != 0.0)
    c = np.mean((motor["k"] * current - motor["b"] * speed)[moving] * np.sign(speed[moving]))
    without = static_motor(motor | {"c": 0.0}, log["voltage_v"])[0]
    both = delayed(time_s, static_motor(motor | {"c": c}, log["voltage_v"])[0], delay_s)
    return {
        "Coulomb friction": (1e3 * float(c), "mN m"),
        "current error, neither": (rms(current - without), "A"),
        "current error, delay and Coulomb": (rms(current - both), "A"),
    }


def figures() -> dict[str, tuple[float, str]]:
    """Label -> value and unit."""
    rig = tomllib.loads((HERE / "rig.toml").read_text(encoding="utf-8"))["motor"]
    names = {"r": "resistance_ohm", "k": "torque_constant_nm_per_a"}
    names |= {"b": "viscous_nm_s_per_rad", "c": "coulomb_nm"}
    motor = {short: rig[name] for short, name in names.items()}
    log = np.genfromtxt(HERE / "log.csv", delimiter=",", names=True)
    found = speed_figures(log, static_motor(motor, log["voltage_v"])[1])
    delay_s = found["fitted delay, least of 8 fits"][0]
    return found | coulomb_figures(log, motor, delay_s)


if __name__ == "__main__":
    for label, (value, unit) in figures().items():
        sys.stdout.write(f"{label}: {value:.4g} {unit}".rstrip() + "\n")
