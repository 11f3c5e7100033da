"""Torque balance of the Robotino motor in steady motion, k i = b w + c sign(w), fitted to one log
and judged on the other: `python reference_fit.py` prints the held-out errors.
"""

import sys
import tomllib
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
LOGS = ("log.csv", "log_2.csv")
RAD_S_PER_RPM = np.pi / 30.0
STANDSTILL_RAD_S = 5.0  # the slowest stretch in motion has 19 rad/s


def torque_and_speed(path: Path, torque_constant: float) -> tuple[np.ndarray, np.ndarray]:
    """Motor torque N m and speed rad/s of the rows (n,) in motion; empty rows are left out."""
    log = np.genfromtxt(path, delimiter=",", names=True)
    speed = RAD_S_PER_RPM * log["speed_rpm"]
    moving = np.isfinite(log["current_a"]) & (np.abs(speed) > STANDSTILL_RAD_S)
    return torque_constant * log["current_a"][moving], speed[moving]


def regressors(speed: np.ndarray, model: str) -> np.ndarray:
    """Regressors (n, k) of the torque: viscous, Coulomb or both."""
    columns = {"viscous": [speed], "Coulomb": [np.sign(speed)]}
    columns["both"] = columns["viscous"] + columns["Coulomb"]
    return np.stack(columns[model], axis=1)


def fit(logs: list[tuple[np.ndarray, np.ndarray]], model: str) -> np.ndarray:
    """Least-squares parameters (k,) of a model on some logs."""
    rows = np.concatenate([regressors(speed, model) for _, speed in logs])
    return np.linalg.lstsq(rows, np.concatenate([torque for torque, _ in logs]), rcond=None)[0]


def held_out_rms(logs: list[tuple[np.ndarray, np.ndarray]], model: str) -> float:
    """RMS torque error, N m, of each log predicted by the fit to the other."""
    errors = [
        torque - regressors(speed, model) @ fit([other], model)
        for (torque, speed), other in zip(logs, logs[::-1], strict=True)
    ]
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))


def figures() -> dict[str, tuple[float, str]]:
    """Label -> value and unit."""
    rig = tomllib.loads((HERE / "rig.toml").read_text(encoding="utf-8"))
    k, b = rig["motor"]["torque_constant_nm_per_a"], rig["motor"]["viscous_nm_s_per_rad"]
    logs = [torque_and_speed(HERE / name, k) for name in LOGS]
    given = np.concatenate([torque - b * speed for torque, speed in logs])
    found = {"torque error, rig as given": (1e3 * float(np.sqrt(np.mean(given**2))), "mN m")}
    for model in ("viscous", "Coulomb", "both"):
        found[f"torque error held out, {model}"] = (1e3 * held_out_rms(logs, model), "mN m")
    noise = 1e3 * k * rig["sensors"]["current_noise_a"]
    return found | {
        "noise of the current": (noise, "mN m"),
        "Coulomb friction, Coulomb": (1e3 * fit(logs, "Coulomb")[0], "mN m"),
        "Coulomb friction, both": (1e3 * fit(logs, "both")[1], "mN m"),
        "viscous friction, both": (1e6 * fit(logs, "both")[0], "uN m s"),
    }


if __name__ == "__main__":
    for label, (value, unit) in figures().items():
        sys.stdout.write(f"{label}: {value:.4g} {unit}\n")
