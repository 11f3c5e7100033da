"""Duty of the servo's slow sweep as a sum of Coulomb friction and cogging, fitted to alternate
revolutions and judged on the others: `python reference_fit.py` prints the held-out errors.

The back-EMF (1.5 counts) is neglected; each sweep has one direction.
"""

import sys
import tomllib
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
LOGS = ("log.csv", "log_2.csv")
COUNTS = 1023.0  # PWM counts of a duty of 1
PERIODS = range(1, 25)  # of the cogging, per revolution


def read() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Duty in counts, angle in rad, sign of the sweep, of the rows (n,) of both logs."""
    logs = [np.genfromtxt(HERE / name, delimiter=",", names=True) for name in LOGS]
    angles = [log["position_rad"] for log in logs]
    signs = [np.full(len(angle), np.sign(angle[-1] - angle[0])) for angle in angles]
    duty = COUNTS * np.concatenate([log["duty"] for log in logs])
    return duty, np.concatenate(angles), np.concatenate(signs)


def cogging(angle: np.ndarray, periods: int) -> list[np.ndarray]:
    """Regressors (n,) of a torque of any phase with some periods a revolution."""
    return [np.sin(periods * angle), np.cos(periods * angle)]


def fit(columns: list[np.ndarray], duty: np.ndarray) -> np.ndarray:
    """Least-squares parameters (k,)."""
    return np.linalg.lstsq(np.stack(columns, axis=1), duty, rcond=None)[0]


def held_out_rms(columns: list[np.ndarray], duty: np.ndarray, angle: np.ndarray) -> float:
    """RMS error, counts, of even revolutions predicted by the fit to odd ones, and the reverse."""
    odd = np.floor(angle / (2.0 * np.pi)) % 2 == 1
    error = duty.copy()
    for rows in (odd, ~odd) if columns else ():
        parameters = fit([column[~rows] for column in columns], duty[~rows])
        error[rows] -= np.stack(columns, axis=1)[rows] @ parameters
    return float(np.sqrt(np.mean(error**2)))


def figures() -> dict[str, tuple[float, str]]:
    """Label -> value and unit."""
    duty, angle, sign = read()
    rig = tomllib.loads((HERE / "rig.toml").read_text(encoding="utf-8"))
    motor, supply_v = rig["motor"], rig["supply"]["voltage_v"]
    stall_a = supply_v / motor["resistance_ohm"]
    mnm_per_count = 1e3 * motor["torque_constant_nm_per_a"] * stall_a / COUNTS
    with_periods = {n: held_out_rms([sign, *cogging(angle, n)], duty, angle) for n in PERIODS}
    others = [error for n, error in with_periods.items() if n != 6]
    coulomb, *cosine = fit([sign, *cogging(angle, 6)], duty)
    return {
        "duty error, nothing": (held_out_rms([], duty, angle), "counts"),
        "duty error held out, Coulomb": (held_out_rms([sign], duty, angle), "counts"),
        "duty error held out, cogging of 6 periods": (
            held_out_rms(cogging(angle, 6), duty, angle),
            "counts",
        ),
        "duty error held out, both": (with_periods[6], "counts"),
        "Coulomb and other periods, least": (min(others), "counts"),
        "Coulomb and other periods, largest": (max(others), "counts"),
        "periods with the least error": (min(with_periods, key=with_periods.get), ""),
        "Coulomb friction, both": (mnm_per_count * coulomb, "mN m"),
        "cogging torque, both": (mnm_per_count * float(np.hypot(*cosine)), "mN m"),
    }


if __name__ == "__main__":
    for label, (value, unit) in figures().items():
        sys.stdout.write(f"{label}: {value:.4g} {unit}".rstrip() + "\n")
