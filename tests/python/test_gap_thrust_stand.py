"""Short logs of a motor with a propeller on a thrust stand: a few large voltage steps, with a gap
of hundreds of times the sensor's noise. The rig lacks the propeller's drag and a delay or a lag;
either alone closes little. In addition the acting voltage has an offset and a curvature over the
command, which no effect of the catalogue describes. All values are drawn from ranges.
"""

import numpy as np
import pytest

from vgroove import _core
from vgroove.gap import diagnose
from vgroove.log import Log
from vgroove.rig import Rig, rig_from_dict
from vgroove.units import RPM_PER_RAD_S

FINE = 16  # simulated intervals in one row of the log
LATE = ("transport_delay", "speed_lag")


def drawn_rig(rng: np.random.Generator) -> dict[str, object]:
    """A motor with a propeller, as its data sheet states it."""
    ranges = (8.0, 20.0), (2e-3, 0.012), (0.05, 0.4)
    volt, constant, resistance = (rng.uniform(*ends) for ends in ranges)
    start_s = rng.uniform(0.02, 0.12)
    return {
        "schema": "vgroove.rig/1",
        "name": "thrust stand",
        "input": {"kind": "voltage_v", "hold": "after"},
        "supply": {"voltage_v": volt, "resistance_ohm": 0.0},
        "motor": {
            "resistance_ohm": resistance,
            "inductance_h": 1e-4 * resistance,
            "torque_constant_nm_per_a": constant,
            "inertia_kg_m2": start_s * constant**2 / resistance,
            "viscous_nm_s_per_rad": 0.0,
            "coulomb_nm": 0.0,
        },
        "gearbox": {"ratio": 1.0, "output_inertia_kg_m2": 0.0},
        "mechanism": {"kind": "none"},
        "load": {"kind": "none"},
        "sensors": {"speed_lsb_rpm": 1.0},
        "tolerance": {
            "motor.torque_constant_nm_per_a": 0.12,
            "motor.resistance_ohm": 0.4,
            "motor.inertia_kg_m2": 0.5,
        },
    }


def drawn_tool(data: dict, late: str, late_s: float, rng: np.random.Generator) -> Rig:
    """The stand as it is: values off by half a tolerance, a drag, and a late answer."""
    motor = dict(data["motor"])
    for key, sigma in data["tolerance"].items():
        motor[key.removeprefix("motor.")] *= float(np.exp(0.5 * sigma * rng.standard_normal()))
    volt, constant = data["supply"]["voltage_v"], data["motor"]["torque_constant_nm_per_a"]
    most_nm = constant * volt / data["motor"]["resistance_ohm"]
    drag = rng.uniform(0.15, 0.6) * most_nm / (volt / constant) ** 2
    number = "delay_s" if late == "transport_delay" else "time_constant_s"
    effects = {"quadratic_drag": {"nm_s2_per_rad2": drag}, late: {number: late_s}}
    return rig_from_dict(data | {"motor": motor, "effects": effects}, "the stand as it is")


def drawn_stand(seed: int) -> tuple[Rig, Log]:
    """Rig and log."""
    rng = np.random.default_rng([78, seed])
    data, row_s, late = drawn_rig(rng), rng.uniform(0.015, 0.04), str(rng.choice(LATE))
    tool = drawn_tool(data, late, rng.uniform(1.0, 3.0) * row_s, rng)
    volt, rows = data["supply"]["voltage_v"], int(rng.integers(90, 220))
    steps = np.sort(rng.integers(0.15 * rows, 0.85 * rows, size=rng.integers(2, 5)))
    levels = volt * rng.uniform(0.05, 0.9, size=len(steps) + 1)
    command = levels[np.searchsorted(steps, np.arange(rows), side="right")]
    fine = np.repeat(command, FINE)[: (rows - 1) * FINE + 1]
    acting = (fine + rng.uniform(-0.02, 0.02) * volt) * (
        1.0 + rng.uniform(-0.08, 0.08) * (fine / volt - 0.5)
    )
    time_s = np.arange(len(fine)) * row_s / FINE
    start = np.array([[np.nan, 0.8 * acting[0] / data["motor"]["torque_constant_nm_per_a"], 0.0]])
    drive = _core.LogInput(time_s, "voltage_v", acting)
    found = _core.simulate_log(drive, tool.parameters()[None], np.array([0]), start)
    speed = found["speed_measured_rad_s"][0, ::FINE] * RPM_PER_RAD_S
    speed = speed * (1.0 + 2e-4 * rng.standard_normal(rows)) + 1.5 * rng.standard_normal(rows)
    columns = {"voltage_v": command, "speed_rpm": np.round(speed)}
    return rig_from_dict(data, "stand"), Log(row_s * np.arange(rows), columns, "stand")


def names_both(seed: int) -> bool:
    """Whether the drag and a late answer are named; a delay and a filter of the speed are twins."""
    rig, log = drawn_stand(seed)
    named = set(diagnose([log], rig).selected)
    return "quadratic_drag" in named and bool(named & set(LATE))


@pytest.mark.parametrize("seed", [10, 19])
def test_a_drag_and_a_late_answer_are_named_together(seed: int) -> None:
    """With seed 19 three bootstrap blocks do not show the drag to be significant, though the gap
    falls from 12.5 to 4.0 with it.
    """
    assert names_both(seed)


@pytest.mark.proof
def test_most_drawn_stands_have_both_names() -> None:
    named = [seed for seed in range(40, 60) if names_both(seed)]
    assert len(named) >= 15, named
