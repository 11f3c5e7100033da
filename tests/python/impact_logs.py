"""Logs of hammering tools for tests, made by the project's plant."""

import sys

import numpy as np

from truth_helpers import TRUTH
from vgroove import _core
from vgroove.log import Log
from vgroove.rig import Rig, read_rig
from vgroove.units import RPM_PER_RAD_S, TURN_RAD

if str(TRUTH) not in sys.path:
    sys.path.insert(0, str(TRUTH))

PARAMETERS = list(_core.PARAMETERS)
NOISE = {"current_a": 0.15, "supply_v": 0.02}
PULSES, TIMEOUT_S = 4, 0.05


def impact_rig(file: str = "impact_driver", **values: float) -> Rig:
    """The reference tool on the hard joint, or the joint of another file in rigs/, with the noise
    of its sensors stated.
    """
    rig = read_rig(TRUTH.parent.parent / "rigs" / f"{file}.toml")
    stated = {
        "sensors.current_noise_a": NOISE["current_a"],
        "sensors.supply_noise_v": NOISE["supply_v"],
        "sensors.hall_timeout_s": TIMEOUT_S,
    }
    if rig.load["kind"] == "hard_joint":
        stated["load.slip_slope_nm_per_rad"] = 200.0
    return rig.with_values(stated | {k.replace("__", "."): v for k, v in values.items()})


def edge_reading(time_s: np.ndarray, angle: np.ndarray, offset_rad: float) -> np.ndarray:
    """Speed (rows,) in rad/s over the last period of a Hall sensor's edges, for an angle (rows,)
    that grows; edges at multiples of the pitch less the offset.
    """
    pitch = TURN_RAD / PULSES
    turned = np.maximum.accumulate(angle + offset_rad)
    numbers = np.arange(np.floor(turned[0] / pitch) + 1.0, np.floor(turned[-1] / pitch) + 1.0)
    edges = np.interp(numbers * pitch, turned, time_s)
    latest = np.searchsorted(edges, time_s, side="right") - 1
    period = np.diff(edges)[np.maximum(latest - 1, 0)]
    age = time_s - edges[np.maximum(latest, 0)]
    reading = pitch / np.maximum(np.maximum(period, age), 1e-9)
    return np.where((latest < 1) | (age > TIMEOUT_S), 0.0, reading)


def plant_log(
    rig: Rig, effects: dict[str, float], seed: int, duty: np.ndarray, bench: tuple[str, ...] = ()
) -> Log:
    """A log of 1 kHz rows of the plant with effects (flat names) and sensors' noise; the start
    angle of the hammer, where the rig states none, and the places of the edges are drawn.
    """
    rng, time_s = np.random.default_rng(seed), 1e-3 * np.arange(len(duty))
    theta = rig.parameters().copy()
    for name, value in effects.items():
        theta[PARAMETERS.index(f"effects.{name}")] = value
    drawn = -rng.uniform(0.05, 2.1)
    start = rig.mechanism.get("hammer_start_rad", drawn)
    theta[PARAMETERS.index("mechanism.hammer_start_rad")] = start
    drive = _core.LogInput(time_s, "duty", duty, load_kind=rig.load["kind"])
    rows = _core.simulate_impact(drive, theta[None], mode="fast")
    speed = edge_reading(time_s, rows["angle_measured_rad"][0], rng.uniform(0.0, 1.5))
    columns = {
        "duty": duty,
        "current_a": rows["current_a"][0] + NOISE["current_a"] * rng.standard_normal(len(duty)),
        "supply_v": rows["supply_v"][0] + NOISE["supply_v"] * rng.standard_normal(len(duty)),
        "speed_rpm": RPM_PER_RAD_S * speed,
    }
    return Log(time_s, columns | {name: rows[name][0] for name in bench}, f"run {seed}")


def ramp(duty: float, seconds: float) -> np.ndarray:
    """A duty that rises within 0.15 s and holds."""
    return duty * np.clip(np.arange(round(1000 * seconds) + 1) / 150.0, 0.0, 1.0)
