"""The plant as the comparisons run it: impact runs of any number of tools, and the drivetrain along
a log.
"""

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from vgroove import _core
from vgroove.bench.impact_tool import ImpactTool

Floats = npt.NDArray[np.float64]

RIG_KEYS = {
    "supply_v": "supply.voltage_v",
    "supply_ohm": "supply.resistance_ohm",
    "resistance_ohm": "motor.resistance_ohm",
    "inductance_h": "motor.inductance_h",
    "torque_constant": "motor.torque_constant_nm_per_a",
    "motor_inertia": "motor.inertia_kg_m2",
    "viscous": "motor.viscous_nm_s_per_rad",
    "coulomb_nm": "motor.coulomb_nm",
    "ratio": "gearbox.ratio",
    "spindle_inertia": "gearbox.output_inertia_kg_m2",
    "hammer_inertia": "mechanism.hammer_inertia_kg_m2",
    "hammer_kg": "mechanism.hammer_mass_kg",
    "lead_m": "mechanism.groove_lead_m_per_rad",
    "vertex_rad": "mechanism.vertex_rad",
    "travel_rad": "mechanism.travel_rad",
    "preload_n": "mechanism.spring_preload_n",
    "rate_n_m": "mechanism.spring_rate_n_per_m",
    "lug_height_m": "mechanism.lug_height_m",
    "lug_radius_m": "mechanism.lug_radius_m",
    "overlap_rad": "mechanism.lug_overlap_rad",
    "contact_n_m": "mechanism.contact_stiffness_n_per_m",
    "contact_n_s_m": "mechanism.contact_damping_n_s_per_m",
    "ramp_m": "mechanism.contact_ramp_m",
    "anvil_inertia": "mechanism.anvil_inertia_kg_m2",
    "joint_nm_rad": "load.stiffness_nm_per_rad",
    "joint_nm_s_rad": "load.damping_nm_s_per_rad",
    "run_nm": "load.run_torque_nm",
    "slope_nm_rad": "load.slip_slope_nm_per_rad",
    "loosen_ratio": "load.loosen_ratio",
}
GROOVE_RADIUS_M = 0.010


def parameters(values: dict[str, float]) -> Floats:
    """(P,) in the order of _core.PARAMETERS, all others at their defaults."""
    theta = np.array(_core.parameter_defaults())
    for name, value in values.items():
        theta[_core.PARAMETERS.index(name)] = value
    return theta


def impact_parameters(tool: ImpactTool) -> Floats:
    """(P,) of a tool of the comparison."""
    values = {key: getattr(tool, name) for name, key in RIG_KEYS.items()}
    lugs = round(2 * np.pi / tool.pitch_rad)
    return parameters(
        values | {"mechanism.lug_count": lugs, "mechanism.groove_radius_m": GROOVE_RADIUS_M}
    )


def impact_log(duty: float, rows: int) -> _core.LogInput:
    """Full trigger from rest: rows of 1 ms at a constant duty, a joint that slips."""
    time_s = np.arange(rows + 1) * 1e-3
    return _core.LogInput(time_s, "duty", np.full(rows + 1, duty), load_kind="hard_joint")


def impact_heads(
    tools: Sequence[ImpactTool], rows: int, mode: str, threads: int = 1
) -> Callable[[], Floats]:
    """A call that runs tools that share a duty for `rows` ms and gives their head angles (B,)."""
    log, theta = (
        impact_log(tools[0].duty, rows),
        np.stack([impact_parameters(tool) for tool in tools]),
    )
    return lambda: _core.simulate_impact(log, theta, mode=mode, threads=threads)["head_rad"][:, -1]
