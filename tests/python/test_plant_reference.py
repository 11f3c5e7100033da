"""simulate_log against an independent SciPy solution at rtol 1e-10: nominal drive, every effect in
turn, every input and load.
"""

from __future__ import annotations

import numpy as np
import pytest

import plant_reference as ref
from vgroove import _core as core

RIG_KEYS = {
    "voltage": "supply.voltage_v",
    "supply_ohm": "supply.resistance_ohm",
    "pwm_hz": "bridge.pwm_hz",
    "r": "motor.resistance_ohm",
    "l": "motor.inductance_h",
    "k": "motor.torque_constant_nm_per_a",
    "j": "motor.inertia_kg_m2",
    "b": "motor.viscous_nm_s_per_rad",
    "tc": "motor.coulomb_nm",
    "n": "gearbox.ratio",
    "j_out": "gearbox.output_inertia_kg_m2",
    "mass": "load.mass_kg",
    "length": "load.length_m",
    "zero": "load.zero_rad",
}
AGREEMENT = 1e-4  # of the signal's largest value: 0.01 %

EFFECTS = {
    "supply_resistance": {"resistance_ohm": 0.03},
    "supply_droop": {"volt_per_coulomb": 0.3, "polarisation_ohm": 0.05, "polarisation_s": 0.2},
    "dead_time": {"dead_time_s": 1.2e-6},
    "dead_time edges": {"dead_time_s": 1.2e-6, "at_edges": 1.0},
    "bridge_resistance": {"resistance_ohm": 0.02},
    "winding_resistance": {"relative": 0.12},
    "winding_heating": {"kelvin_per_joule": 0.5, "cooling_s": 0.5},
    "brush_drop": {"voltage_v": 0.6},
    "inductance": {"relative": 0.3},
    "torque_constant": {"relative": -0.06},
    "magnetic_saturation": {"saturation_a": 90.0},
    "coulomb_friction": {"torque_nm": 0.006},
    "stribeck_friction": {"breakaway_nm": 0.02, "speed_rad_s": 40.0},
    "viscous_friction": {"nm_s_per_rad": 1e-5},
    "quadratic_drag": {"nm_s2_per_rad2": 1e-7},
    "asymmetric_friction": {"forward_nm": 0.006, "backward_nm": -0.002},
    "directional_viscous": {"nm_s_per_rad": 5e-6},
    "cogging_torque": {"torque_nm": 0.01, "periods_per_rev": 12.0, "phase_rad": 0.4},
    "added_inertia": {"kg_m2": 4e-6},
    "cold_grease": {"nm_s_per_rad": 3e-5, "time_s": 0.15},
    "load_dependent_friction": {"relative": 0.12},
    "gear_eccentricity": {"torque_nm": 0.008, "phase_rad": 1.0},
    "coupler_compliance": {
        "stiffness_nm_per_rad": 2.0,
        "damping_ratio": 0.1,
        "inertia_kg_m2": 2e-6,
    },
    "gear_backlash": {"play_rad": 0.03},
    "current_lag": {"time_constant_s": 0.002},
    "current_gain": {"relative": 0.05},
    "current_offset": {"offset_a": 0.7},
    "current_saturation": {"limit_a": 25.0},
    "speed_gain": {"relative": 0.03},
    "speed_lag": {"time_constant_s": 0.004},
    "hall_eccentricity": {"amplitude_rad": 0.05, "phase_rad": 0.7},
    "supply_gain": {"relative": 0.02},
    "transport_delay": {"delay_s": 0.0037},
    "clock_skew": {"relative": 0.02},
    "clock_skew command": {"relative": 0.02, "command_clock": 1.0},
}


def theta_of(tool: ref.Tool) -> np.ndarray:
    """(P,) parameters of a tool."""
    names = core.PARAMETERS
    theta = core.parameter_defaults()
    for attribute, name in RIG_KEYS.items():
        theta[names.index(name)] = getattr(tool, attribute)
    for effect, values in tool.effects.items():
        for parameter, value in values.items():
            theta[names.index(f"effects.{effect}.{parameter}")] = value
    return theta


def drive_log(seed: int = 3, **kwargs: object) -> ref.Log:
    """Start, rest under load, reversal, braking, coasting and load steps over 0.3 s; irregular rows
    of 2 to 9 ms, ramps and steps.
    """
    rng = np.random.default_rng(seed)
    time_s = np.concatenate([[0.0], np.cumsum(rng.uniform(0.002, 0.009, 54))])
    knots = np.array([0.0, 0.02, 0.06, 0.10, 0.11, 0.15, 0.155, 0.19, 0.20, 0.24, 0.26, 0.4])
    duty = np.interp(
        time_s, knots, [0.02, 0.05, 0.8, 0.8, 0.3, 0.25, -0.6, -0.5, 0.0, 0.0, 0.9, 0.9]
    )
    coast = ((time_s > 0.165) & (time_s < 0.178)).astype(float)
    load = np.where((time_s > 0.08) & (time_s < 0.13), 1.2, 0.2)
    values: dict[str, object] = {
        "time_s": time_s,
        "command": duty,
        "slew_per_s": 30.0,
        "load_nm": load,
        "coast": coast,
    }
    values["load_kind"] = "torque"
    return ref.Log(**{**values, **kwargs})


def plant_run(
    tool: ref.Tool, log: ref.Log, start: tuple[float, float, float], theta: np.ndarray | None = None
) -> dict[str, np.ndarray]:
    given = core.LogInput(
        log.time_s,
        log.kind,
        log.command,
        log.slew_per_s,
        log.supply_v,
        log.load_nm,
        log.coast,
        log.load_kind,
    )
    out = core.simulate_log(
        given,
        (theta_of(tool) if theta is None else theta)[None, :],
        np.array([0]),
        np.array([start]),
        1,
    )
    return {name: column[0] for name, column in out.items()}


def relative_errors(plant: dict[str, np.ndarray], truth: dict[str, np.ndarray]) -> dict[str, float]:
    """Largest difference of each column after the first row, over its largest value."""
    found = {}
    for name, column in plant.items():
        a, b = column[1:], truth[name][1:]
        found[name] = float(np.max(np.abs(a - b)) / np.max(np.abs(b)))
    return found


def check(
    tool: ref.Tool, log: ref.Log, start: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> None:
    found = relative_errors(plant_run(tool, log, start), ref.simulate(tool, log, start))
    assert max(found.values()) < AGREEMENT, found


def test_nominal_drive() -> None:
    check(ref.Tool(), drive_log())


@pytest.mark.parametrize("name", EFFECTS)
def test_each_effect(name: str) -> None:
    check(ref.Tool(effects={name.split()[0]: EFFECTS[name]}), drive_log())


def test_running_start_without_slew() -> None:
    check(ref.Tool(), drive_log(slew_per_s=None), (4.0, -500.0, 2.0))


def test_pendulum() -> None:
    log = drive_log(load_kind="pendulum")
    check(ref.Tool(mass=0.49, length=0.1, zero=0.3), log, (0.0, 0.0, 8.0))


FREE = {
    "stribeck": (
        {"tc": 1.5, "tbrk": 1.8, "w_brk": 8.0, "f": 2e-3},
        {
            "torque_nm": 1.5,
            "breakaway_ratio": 1.2,
            "breakaway_rad_s": 8.0,
            "viscous_nm_s_per_rad": 2e-3,
        },
    ),
    "exponential": (
        {"tc": 1.0, "tbrk": 1.5, "w_th": 2.0, "cv": 0.05, "f": 1e-3},
        {
            "torque_nm": 1.0,
            "breakaway_ratio": 1.5,
            "threshold_rad_s": 2.0,
            "decay_s_per_rad": 0.05,
            "viscous_nm_s_per_rad": 1e-3,
            "exponential": 1.0,
        },
    ),
}


@pytest.mark.parametrize(
    "effect", [None, "load_dependent_friction", "coupler_compliance", "gear_backlash"]
)
@pytest.mark.parametrize("form", FREE)
def test_free_load(form: str, effect: str | None) -> None:
    law, keys = FREE[form]
    tool = ref.Tool(free=law, effects={effect: EFFECTS[effect]} if effect else {})
    log, theta = drive_log(load_kind="free"), theta_of(tool)
    for key, value in keys.items():
        theta[core.PARAMETERS.index(f"load.{key}")] = value
    found = relative_errors(
        plant_run(tool, log, (0.0, 0.0, 0.0), theta), ref.simulate(tool, log, (0.0, 0.0, 0.0))
    )
    assert max(found.values()) < AGREEMENT, found


def test_voltage_input() -> None:
    log = drive_log(kind="voltage_v")
    log.command = 18.0 * log.command
    log.slew_per_s = 500.0
    check(ref.Tool(effects={"brush_drop": EFFECTS["brush_drop"]}), log)


def test_current_input() -> None:
    log = drive_log(kind="current_a")
    log.command = 12.0 * log.command
    log.slew_per_s, log.coast = None, None
    check(
        ref.Tool(
            effects={
                "stribeck_friction": EFFECTS["stribeck_friction"],
                "cogging_torque": EFFECTS["cogging_torque"],
            }
        ),
        log,
    )


def test_measured_bus_drives_the_model() -> None:
    log = drive_log()
    log.supply_v = 18.0 + np.sin(40.0 * log.time_s)
    check(ref.Tool(effects={"supply_gain": {"relative": 0.03}}), log)


def test_coupler_with_play_and_pendulum() -> None:
    effects = {
        "coupler_compliance": EFFECTS["coupler_compliance"],
        "gear_backlash": EFFECTS["gear_backlash"],
    }
    check(ref.Tool(mass=0.3, length=0.1, effects=effects), drive_log(load_kind="pendulum"))


def test_all_drive_effects_together() -> None:
    apart = ("clock_skew", "clock_skew command", "current_saturation", "dead_time edges")
    together = {name: values for name, values in EFFECTS.items() if name not in apart}
    check(ref.Tool(effects=together), drive_log())
