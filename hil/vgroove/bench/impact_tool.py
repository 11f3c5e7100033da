"""The tool and the joints that the impact comparison runs: physics.md section 4's reference set, as
numbers for any solver.
"""

import math
from dataclasses import astuple, dataclass

import numpy as np
import numpy.typing as npt

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
# which contact a lug below the lug height has, where a solver keeps no state: impact_model.py
NEAR_RAD, DEEP_M = 0.02, 2e-4


@dataclass(frozen=True)
class ImpactTool:
    """Reference set in the order that `derivative` reads; the joint slips at run_nm + slope * head
    angle.
    """

    supply_v: float = 18.5
    supply_ohm: float = 0.10
    resistance_ohm: float = 0.19
    inductance_h: float = 1e-4
    torque_constant: float = 0.0109
    motor_inertia: float = 1.6e-5
    viscous: float = 4.5e-6
    coulomb_nm: float = 0.012
    ratio: float = 5.6
    spindle_inertia: float = 6e-6
    hammer_inertia: float = 4.5e-5
    hammer_kg: float = 0.19
    lead_m: float = 4.4e-3
    vertex_rad: float = 0.05
    travel_rad: float = 2.8
    preload_n: float = 220.0
    rate_n_m: float = 29400.0
    pitch_rad: float = math.pi
    lug_height_m: float = 4.5e-3
    lug_radius_m: float = 0.015
    overlap_rad: float = 1.0
    contact_n_m: float = 3e7
    contact_n_s_m: float = 2e3
    ramp_m: float = 1e-5
    anvil_inertia: float = 1.2e-5
    joint_nm_rad: float = 3000.0
    joint_nm_s_rad: float = 0.3
    run_nm: float = 60.0
    slope_nm_rad: float = 0.0
    loosen_ratio: float = 0.75
    duty: float = 1.0

    def vector(self) -> Floats:
        return np.array(astuple(self))


PARAMETER_COUNT = len(astuple(ImpactTool()))
SLIPPING = {"slip_60": ImpactTool(), "slope_700": ImpactTool(run_nm=0.3, slope_nm_rad=700.0)}


def rest(hammer_start_rad: float = -1.0) -> Floats:
    """Everything at rest, the hammer's flanks `hammer_start_rad` before the anvil's."""
    state = np.zeros(len(STATES))
    state[[1, 3]] = hammer_start_rad
    return state


def head_rad(state: Floats) -> float:
    """Angle of the screw's head."""
    return float(state[5] - state[7])
