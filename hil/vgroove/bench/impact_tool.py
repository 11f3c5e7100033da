"""The impact tool of the comparison as plain numbers, which every solver's model can take.

The values are those of the reference rig (vgroove.reference); the peers' compiled models read them
from a vector.
"""

from dataclasses import astuple, dataclass

import numpy as np
import numpy.typing as npt

from vgroove.reference.joints import REFERENCE_JOINTS
from vgroove.reference.rigs import reference_rig, with_load
from vgroove.units import TURN_RAD

Floats = npt.NDArray[np.float64]

STATES = (
    "current_a",
    "spindle_rad",
    "spindle_rad_s",
    "hammer_rad",
    "hammer_rad_s",
    "anvil_rad",
    "anvil_rad_s",
    "twist_rad",
)
# Which contact a lug below the lug height has, for solvers without a contact state: impact_model.py
NEAR_RAD, DEEP_M = 0.02, 2e-4
# Field of ImpactTool -> dotted key of a rig
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


@dataclass(frozen=True)
class ImpactTool:
    """Tool and joint, SI units, in the order in which the compiled models read them.

    The joint slips at run_nm + slope_nm_rad * head angle; pitch_rad is the angle between two lugs.
    """

    supply_v: float
    supply_ohm: float
    resistance_ohm: float
    inductance_h: float
    torque_constant: float
    motor_inertia: float
    viscous: float
    coulomb_nm: float
    ratio: float
    spindle_inertia: float
    hammer_inertia: float
    hammer_kg: float
    lead_m: float
    vertex_rad: float
    travel_rad: float
    preload_n: float
    rate_n_m: float
    pitch_rad: float
    lug_height_m: float
    lug_radius_m: float
    overlap_rad: float
    contact_n_m: float
    contact_n_s_m: float
    ramp_m: float
    anvil_inertia: float
    joint_nm_rad: float
    joint_nm_s_rad: float
    run_nm: float
    slope_nm_rad: float
    loosen_ratio: float
    duty: float = 1.0

    def vector(self) -> Floats:
        """The fields as a vector (PARAMETER_COUNT,)."""
        return np.array(astuple(self))


def reference_tool(joint: str) -> ImpactTool:
    """The reference tool on one of the slipping REFERENCE_JOINTS, at full duty."""
    rig = with_load(reference_rig(), REFERENCE_JOINTS[joint].load)
    values = {name: float(rig.value(key)) for name, key in RIG_KEYS.items()}
    return ImpactTool(**values, pitch_rad=TURN_RAD / rig.mechanism["lug_count"])


SLIPPING = {"slip_60": reference_tool("slip_60"), "slope_700": reference_tool("hard_joint")}
PARAMETER_COUNT = len(SLIPPING["slip_60"].vector())


def rest(hammer_start_rad: float = -1.0) -> Floats:
    """STATES at rest, the hammer's flanks `hammer_start_rad` from the anvil's."""
    state = np.zeros(len(STATES))
    state[[1, 3]] = hammer_start_rad
    return state


def head_rad(state: Floats) -> float:
    """Angle of the screw's head in STATES."""
    return float(state[5] - state[7])
