"""The EMPS positioning axis: nested friction models fitted to its force, the error of each, and the
speed error of the plant in free runs.

Data and published parameters: A. Janot, M. Gautier, M. Brunot, "Data Set and Reference Models of
EMPS", Workshop on Nonlinear System Identification Benchmarks, 2019. Filters, trimming and held-out
thirds as tests/data/emps/README.md defines them.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table
from scipy.signal import butter, filtfilt

from vgroove import _core
from vgroove.errors import VgrooveError
from vgroove.log import read_log
from vgroove.rig import read_rig

SCHEMA = "vgroove.emps/1"
# low-pass filter of position and force (Hz, order), and rows cut off at either end
FILTER_HZ, FILTER_ORDER, TRIMMED_ROWS = 100.0, 2, 50
MIN_ROWS = 1000  # of a log
FREE_RUN_S = 0.25  # interval at which a free run restarts (docs/spec/gap.md, section 5)
THIRDS = 3  # folds of the held-out error
# parameters of Simulation_EMPS.m in the data set
PUBLISHED = {
    "inertia_kg": 95.1089,
    "viscous_n_s_per_m": 203.5034,
    "coulomb_n": 20.3935,
    "offset_n": -3.1648,
}
TERMS = {
    "inertia_kg": "kg",
    "viscous_n_s_per_m": "N s/m",
    "coulomb_n": "N",
    "offset_n": "N",
    "directional_n_s_per_m": "N s/m",
}
NESTED_MODELS = [
    ("M", ["inertia_kg"]),
    ("+ viscous", ["viscous_n_s_per_m"]),
    ("+ Coulomb", ["coulomb_n"]),
    ("+ offset", ["offset_n"]),
    ("+ directional viscous", ["directional_n_s_per_m"]),
]


@dataclass(frozen=True)
class Axis:
    """Filtered and trimmed run (n,): time s, position m, speed m/s, acceleration m/s^2, force N."""

    time_s: np.ndarray
    position: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray
    force: np.ndarray

    def terms(self, names: list[str]) -> np.ndarray:
        """Regressors (n, k) of the force for the named parameters."""
        columns = {
            "inertia_kg": self.acceleration,
            "viscous_n_s_per_m": self.speed,
            "coulomb_n": np.sign(self.speed),
            "offset_n": np.ones_like(self.speed),
            "directional_n_s_per_m": np.abs(self.speed),
        }
        return np.stack([columns[name] for name in names], axis=1)


def read_axis(directory: str | Path) -> Axis:
    """Axis from a directory with log.csv and rig.toml; the rig's torque constant turns the log's
    current into force.
    """
    folder = Path(directory)
    log, rig = read_log(folder / "log.csv"), read_rig(folder / "rig.toml")
    missing = [name for name in ("current_a", "position_rad") if name not in log.columns]
    if missing:
        raise VgrooveError(
            f"{folder / 'log.csv'}: the column {missing[0]} is missing, the models need force and"
            " position"
        )
    time_s = np.asarray(log.time_s)
    rate = 1.0 / float(np.median(np.diff(time_s)))
    if rate <= 2.0 * FILTER_HZ or len(time_s) < MIN_ROWS:
        raise VgrooveError(
            f"{folder / 'log.csv'}: needs {MIN_ROWS} samples at more than {2 * FILTER_HZ:g} Hz"
        )
    low_pass = butter(FILTER_ORDER, FILTER_HZ / (0.5 * rate))
    position = filtfilt(*low_pass, log.columns["position_rad"])
    force = filtfilt(*low_pass, rig.motor["torque_constant_nm_per_a"] * log.columns["current_a"])
    speed = np.gradient(position, time_s)
    kept = slice(TRIMMED_ROWS, -TRIMMED_ROWS)
    return Axis(
        time_s[kept], position[kept], speed[kept], np.gradient(speed, time_s)[kept], force[kept]
    )


def fit(axis: Axis, names: list[str], rows: np.ndarray) -> dict[str, float]:
    """Least-squares parameters of a model on some rows of the axis."""
    values, *_ = np.linalg.lstsq(axis.terms(names)[rows], axis.force[rows], rcond=None)
    return dict(zip(names, (float(v) for v in values), strict=True))


def nested_models(axis: Axis) -> list[dict[str, Any]]:
    """One entry per nested model: relative force errors in sample and on held-out thirds, speed
    error of free runs in m/s, and parameters.
    """
    models, names = [], []
    for title, added in NESTED_MODELS:
        names = names + added
        models.append((title, list(names)))
    models.append(("the same without the offset", [name for name in names if name != "offset_n"]))
    return [model_figures(axis, title, chosen) for title, chosen in models]


def model_figures(axis: Axis, title: str, names: list[str]) -> dict[str, Any]:
    """Errors and parameters of one model; each third is predicted by a fit to the other two."""
    everything = np.ones(len(axis.time_s), dtype=bool)
    third = np.minimum(THIRDS * np.arange(len(axis.time_s)) // len(axis.time_s), THIRDS - 1)
    whole = fit(axis, names, everything)
    parts = [fit(axis, names, third != k) for k in range(THIRDS)]
    held_out = np.empty_like(axis.force)
    for k, part in enumerate(parts):
        held_out[third == k] = (axis.terms(names) @ np.array([part[name] for name in names]))[
            third == k
        ]
    norm = np.linalg.norm(axis.force)
    in_sample = axis.terms(names) @ np.array([whole[name] for name in names])
    return {
        "model": title,
        "in_sample": float(np.linalg.norm(axis.force - in_sample) / norm),
        "held_out": float(np.linalg.norm(axis.force - held_out) / norm),
        "last": names[-1],
        "parameters": whole,
        "free_run_m_per_s": free_run_error(axis, parts, third),
    }


def free_run_error(axis: Axis, parts: list[dict[str, float]], third: np.ndarray) -> float:
    """RMS speed error, m/s, of the plant driven by the force, restarted every FREE_RUN_S; each
    third has the parameters of the other two.
    """
    step = int(round(FREE_RUN_S / float(np.median(np.diff(axis.time_s)))))
    starts = np.arange(0, len(axis.time_s), step, dtype=np.int64)
    states = np.stack([np.zeros(len(starts)), axis.speed[starts], axis.position[starts]], axis=1)
    drive = _core.LogInput(axis.time_s, "current_a", np.ascontiguousarray(axis.force))
    speed = _core.simulate_log(
        drive, np.stack([plant_parameters(part) for part in parts]), starts, states, threads=2
    )["speed_rad_s"]
    error = speed[third, np.arange(len(third))] - axis.speed
    return float(np.sqrt(np.mean(error**2)))


def plant_parameters(parameters: dict[str, float]) -> np.ndarray:
    """Parameter vector (P,) of the plant for a model of the axis: 1 m as 1 rad, 1 N as 1 N m."""
    theta = np.array(_core.parameter_defaults(), dtype=float)
    offset = parameters.get("offset_n", 0.0)
    values = {
        "motor.torque_constant_nm_per_a": 1.0,
        "motor.inertia_kg_m2": parameters["inertia_kg"],
        "motor.viscous_nm_s_per_rad": parameters.get("viscous_n_s_per_m", 0.0),
        "motor.coulomb_nm": parameters.get("coulomb_n", 0.0),
        "effects.asymmetric_friction.forward_nm": offset,
        "effects.asymmetric_friction.backward_nm": -offset,
        "effects.directional_viscous.nm_s_per_rad": parameters.get("directional_n_s_per_m", 0.0),
    }
    for name, value in values.items():
        theta[list(_core.PARAMETERS).index(name)] = value
    return theta


def emps_figures(directory: str | Path) -> dict[str, Any]:
    """The nested models, and the published parameters beside those of the + offset model, ready
    for JSON.
    """
    entries = nested_models(read_axis(directory))
    found = next(entry for entry in entries if entry["model"] == "+ offset")["parameters"]
    compared = {
        name: {
            "value": found[name],
            "published": known,
            "relative": found[name] / known - 1.0,
            "unit": TERMS[name],
        }
        for name, known in PUBLISHED.items()
    }
    return {"schema": SCHEMA, "ladder": entries, "published": compared}


def emps_tables(figures: dict[str, Any]) -> list[Table]:
    """The figures as tables."""
    return [error_table(figures["ladder"]), published_table(figures["published"])]


def error_table(entries: list[dict[str, Any]]) -> Table:
    """Errors of the nested models."""
    table = Table(title="relative error of the force", title_justify="left")
    header = ("model", "in sample", "held-out thirds", "last parameter added")
    for name in (*header, f"{FREE_RUN_S:g} s free run, held out"):
        table.add_column(name, justify="left" if name == "model" else "right")
    for entry in entries:
        table.add_row(
            entry["model"],
            f"{100 * entry['in_sample']:.1f} %",
            f"{100 * entry['held_out']:.1f} %",
            f"{entry['parameters'][entry['last']]:.4g} {TERMS[entry['last']]}",
            f"{1000 * entry['free_run_m_per_s']:.1f} mm/s",
        )
    return table


def published_table(rows: dict[str, dict[str, Any]]) -> Table:
    """Fitted parameters beside the published ones."""
    table = Table(title="+ offset against the published parameters", title_justify="left")
    for name in ("parameter", "found", "published", "difference"):
        table.add_column(name, justify="left" if name == "parameter" else "right")
    for name, row in rows.items():
        table.add_row(
            name,
            f"{row['value']:.4f} {row['unit']}",
            f"{row['published']:.4f} {row['unit']}",
            f"{100 * row['relative']:+.2f} %",
        )
    return table
