"""Functional forms of the effects of the impact tool other than the catalogue's, as a real tool may
have them.
"""

from collections.abc import Callable

import numpy as np
from forms import off_one
from impact_rigs import ImpactRig

Form = Callable[[ImpactRig, dict[str, float], np.random.Generator], dict[str, float]]


def _groove(rig: ImpactRig, made: dict[str, float], rng: np.random.Generator) -> dict[str, float]:
    """More friction at low sliding speed."""
    return made | {"groove_static": float(rng.uniform(0.2, 0.6))}


def _rate(rig: ImpactRig, made: dict[str, float], rng: np.random.Generator) -> dict[str, float]:
    """A part of the change grows with the travel."""
    nominal = rig["mechanism.spring_rate_n_per_m"]
    extra, part = made["spring_rate_n_per_m"] - nominal, float(rng.uniform(0.2, 0.4))
    travel = 1.5 * rig["mechanism.lug_height_m"]
    return {
        "spring_rate_n_per_m": nominal + (1.0 - part) * extra,
        "spring_square_n_per_m2": part * extra / travel,
    }


def _preload(rig: ImpactRig, made: dict[str, float], rng: np.random.Generator) -> dict[str, float]:
    """A spring that has set has another rate as well."""
    change = made["spring_preload_n"] / rig["mechanism.spring_preload_n"] - 1.0
    rate = rig["mechanism.spring_rate_n_per_m"]
    part = float(rng.uniform(0.05, 0.12))
    return made | {"spring_rate_n_per_m": rate * (1.0 + part * change)}


def _damping(rig: ImpactRig, made: dict[str, float], rng: np.random.Generator) -> dict[str, float]:
    """The added damping grows with the depth, as by Hunt and Crossley (1975)."""
    nominal = rig["mechanism.contact_damping_n_s_per_m"]
    extra = made["contact_damping_n_s_per_m"] - nominal
    depth = 4e-5 * float(rng.uniform(0.7, 1.4))
    return {
        "contact_damping_n_s_per_m": nominal + 0.5 * extra,
        "extra_damping_n_s_per_m2": 0.5 * extra / depth,
    }


def _wear(rig: ImpactRig, made: dict[str, float], rng: np.random.Generator) -> dict[str, float]:
    """One pair of lugs is worn more than the other."""
    worn = rig["mechanism.lug_height_m"] - made["lug_height_m"]
    part = float(rng.uniform(0.05, 0.15))
    return {
        "lug_height_m": rig["mechanism.lug_height_m"] - worn * (1.0 - part),
        "u_lug_height_m": 2.0 * part * worn,
    }


def _stiff(rig: ImpactRig, made: dict[str, float], rng: np.random.Generator) -> dict[str, float]:
    """A joint that stiffens with its twist."""
    return made | {"joint_cubic_per_rad2": float(rng.uniform(0.03, 0.08)) / 0.04**2}


def _thread(rig: ImpactRig, made: dict[str, float], rng: np.random.Generator) -> dict[str, float]:
    """Friction that grows or falls along the thread."""
    bend = float(rng.choice([-1.0, 1.0])) * float(rng.uniform(0.2, 0.5))
    reach = 0.5 if rig.joint == "hard_joint" else 15.0
    return made | {"joint_friction_bend": bend, "joint_bend_rad": reach}


def _hysteresis(
    rig: ImpactRig, made: dict[str, float], rng: np.random.Generator
) -> dict[str, float]:
    return made | {"joint_hysteresis_bend": off_one(rng, 0.2, 0.5, 0.0)}


def _knot(rig: ImpactRig, made: dict[str, float], rng: np.random.Generator) -> dict[str, float]:
    return made | {"knot_skew": off_one(rng, 0.3, 0.8, 0.0)}


def _supply(rig: ImpactRig, made: dict[str, float], rng: np.random.Generator) -> dict[str, float]:
    extra = made["supply_resistance_ohm"] - rig["supply.resistance_ohm"]
    return {"extra_source_ohm": extra, "source_power": off_one(rng, 0.05, 0.2, 0.0)}


def _droop(rig: ImpactRig, made: dict[str, float], rng: np.random.Generator) -> dict[str, float]:
    """Polarisation with two time constants: electrode surface and diffusion."""
    part = float(rng.uniform(0.25, 0.45))
    return made | {
        "polarisation_ohm": made["polarisation_ohm"] * (1.0 - part),
        "polarisation2_ohm": made["polarisation_ohm"] * part,
        "polarisation2_s": made["polarisation_s"] * float(rng.uniform(3.0, 6.0)),
    }


def _winding(rig: ImpactRig, made: dict[str, float], rng: np.random.Generator) -> dict[str, float]:
    extra = made["resistance_ohm"] - rig["motor.resistance_ohm"]
    return {"extra_ohm": extra, "extra_ohm_power": float(rng.uniform(0.05, 0.15))}


def _bridge(rig: ImpactRig, made: dict[str, float], rng: np.random.Generator) -> dict[str, float]:
    power = -float(rng.uniform(0.05, 0.15))
    return {"extra_ohm": made["bridge_resistance_ohm"], "extra_ohm_power": power}


def _brush(rig: ImpactRig, made: dict[str, float], rng: np.random.Generator) -> dict[str, float]:
    return made | {"brush_knee_a": float(rng.uniform(0.1, 0.6))}


def _coulomb(rig: ImpactRig, made: dict[str, float], rng: np.random.Generator) -> dict[str, float]:
    extra = made["coulomb_nm"] - rig["motor.coulomb_nm"]
    return {"power_coulomb_nm": extra, "coulomb_power": float(rng.uniform(0.04, 0.12))}


def _viscous(rig: ImpactRig, made: dict[str, float], rng: np.random.Generator) -> dict[str, float]:
    extra = made["viscous_nm_s_per_rad"] - rig["motor.viscous_nm_s_per_rad"]
    return {"extra_viscous_nm_s": extra, "viscous_power": off_one(rng, 0.06, 0.18)}


def _load(rig: ImpactRig, made: dict[str, float], rng: np.random.Generator) -> dict[str, float]:
    return made | {"load_friction_power": off_one(rng, 0.06, 0.18)}


def _lag(rig: ImpactRig, made: dict[str, float], rng: np.random.Generator) -> dict[str, float]:
    return made | {"current_lag2_s": made["current_lag_s"] * float(rng.uniform(0.1, 0.35))}


def _gain(rig: ImpactRig, made: dict[str, float], rng: np.random.Generator) -> dict[str, float]:
    return made | {"current_gain_bend": off_one(rng, 0.05, 0.15, 0.0)}


FORMS: dict[str, Form] = {
    "groove_friction": _groove,
    "spring_rate": _rate,
    "spring_preload": _preload,
    "impact_damping": _damping,
    "lug_wear": _wear,
    "joint_stiffness": _stiff,
    "thread_friction": _thread,
    "joint_hysteresis": _hysteresis,
    "wood_knot": _knot,
    "supply_resistance": _supply,
    "supply_droop": _droop,
    "winding_resistance": _winding,
    "bridge_resistance": _bridge,
    "brush_drop": _brush,
    "coulomb_friction": _coulomb,
    "viscous_friction": _viscous,
    "load_dependent_friction": _load,
    "current_lag": _lag,
    "current_gain": _gain,
}


def other_form(
    effect_id: str, tool: ImpactRig, made: dict[str, float], rng: np.random.Generator
) -> dict[str, float]:
    """The parameters of an effect in another form than the catalogue's; those of the catalogue
    where there is none.
    """
    return FORMS[effect_id](tool, made, rng) if effect_id in FORMS else made
