"""Effects of a generated impact tool, of the catalogue and outside it, each with one size in
physical units.

The list is independent of the diagnosis' catalogue by design.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from effects import LOGGER_KEYS, cogging, const, plain, speed_lag, with_phase
from impact_joints import JOINT_KEYS, TURN
from impact_rigs import ImpactRig

Made = Callable[[ImpactRig, float, np.random.Generator], dict[str, float]]
STEEL = ("hard_joint", "disc_spring")  # slipping joints without wood
STIFF = ("locked", "hard_joint", "disc_spring")
EVERYWHERE = ("locked", "hard_joint", "disc_spring", "wood_screw")


@dataclass(frozen=True)
class ImpactEffect:
    """An effect: `make(rig, size, rng)` are its changed parameters, `start_size(rig)` a size near
    the visible limit, `top(rig)` the largest plausible size.

    signed: the size may be negative. least: smallest size where it is negative. joints: those that
    show it. needs: property of the profile that shows it (partial: duty below 1; loosen).
    accept: equivalent ids. group: mechanism, drive or outside.
    """

    id: str
    group: str
    make: Made
    start_size: Callable[[ImpactRig], float]
    top: Callable[[ImpactRig], float]
    signed: bool = False
    joints: tuple[str, ...] = EVERYWHERE
    needs: str = ""
    accept: tuple[str, ...] = ()


def _relative(key: str) -> Made:
    return lambda rig, size, rng: {key.split(".")[1]: rig[key] * (1.0 + size)}


def _added(key: str, name: str = "") -> Made:
    return lambda rig, size, rng: {name or key.split(".")[1]: rig[key] + size}


def _part(key: str, part: float) -> Callable[[ImpactRig], float]:
    return lambda rig: part * rig[key]


def _groove_friction(rig: ImpactRig, size: float, rng: np.random.Generator) -> dict[str, float]:
    return {"groove_friction": size, "groove_knee_rad_s": rng.uniform(0.3, 1.0)}


def _joint_stiffness(rig: ImpactRig, size: float, rng: np.random.Generator) -> dict[str, float]:
    return {"joint_nm_per_rad": rig["load.stiffness_nm_per_rad"] * (1.0 + size)}


def _knot(rig: ImpactRig, size: float, rng: np.random.Generator) -> dict[str, float]:
    begin = float(rng.uniform(1.0, 4.0)) * TURN
    return {
        "knot_nm": size,
        "knot_from_rad": begin,
        "knot_to_rad": begin + float(rng.uniform(1.0, 3.0)) * TURN,
    }


def _droop(rig: ImpactRig, size: float, rng: np.random.Generator) -> dict[str, float]:
    return {
        "droop_volt_per_coulomb": size,
        "polarisation_ohm": size * rng.uniform(0.5, 3.0),
        "polarisation_s": rng.uniform(0.3, 1.2),
    }


def _heating(rig: ImpactRig, size: float, rng: np.random.Generator) -> dict[str, float]:
    return {
        "heating_kelvin_per_joule": size,
        "heating_cooling_s": rng.uniform(3.0, 15.0),
        "heating_housing_share": rng.uniform(0.1, 0.3),
    }


def _stribeck(rig: ImpactRig, size: float, rng: np.random.Generator) -> dict[str, float]:
    return {"breakaway_nm": size, "stribeck_rad_s": rng.uniform(60.0, 250.0)}


def _grease(rig: ImpactRig, size: float, rng: np.random.Generator) -> dict[str, float]:
    return {"grease_nm_s": size, "grease_s": rng.uniform(0.4, 1.5)}


def _coupler(rig: ImpactRig, size: float, rng: np.random.Generator) -> dict[str, float]:
    """A coupler of compliance `size`, with an inertia that grows with it."""
    return {
        "coupler_nm_per_rad": min(1.0 / size, 1e5),
        "coupler_nm_s_per_rad": rng.uniform(0.15, 0.3),
        "coupler_inertia_kg_m2": 2e-5 * float(np.clip(size * 2000.0, 0.02, 1.0)),
    }


def _saturation(rig: ImpactRig, size: float, rng: np.random.Generator) -> dict[str, float]:
    return {"saturation_a": size**-0.5}


def _limit(rig: ImpactRig, size: float, rng: np.random.Generator) -> dict[str, float]:
    return {"current_limit_a": 1.0 / size}


def _dent(rig: ImpactRig, size: float, rng: np.random.Generator) -> dict[str, float]:
    return {
        "u_groove_dent_m": size,
        "u_dent_at_rad": rng.uniform(0.5, 1.0),
        "u_dent_width_rad": rng.uniform(0.12, 0.25),
    }


def _bind(rig: ImpactRig, size: float, rng: np.random.Generator) -> dict[str, float]:
    return {
        "u_coil_bind_n_per_m": size,
        "u_coil_bind_at_m": rig["mechanism.lug_height_m"] * rng.uniform(0.9, 1.3),
    }


def _drag(rig: ImpactRig, size: float, rng: np.random.Generator) -> dict[str, float]:
    return {
        "u_housing_drag_nm": size,
        "u_drag_from_m": rig["mechanism.lug_height_m"] * rng.uniform(0.3, 1.1),
        "u_drag_width_m": 5e-4,
    }


def _arm(rig: ImpactRig, size: float, rng: np.random.Generator) -> dict[str, float]:
    """An arm whose compliance and inverse inertia grow with the size; 1 is a firm grip."""
    return {
        "u_arm_inertia_kg_m2": 4e-3 / size,
        "u_arm_nm_per_rad": 25.0 / size,
        "u_arm_nm_s_per_rad": 0.25 / size,
    }


def _gated(key: str) -> Made:
    return lambda rig, size, rng: {
        key: size,
        "gate_on_s": rng.uniform(0.08, 0.2),
        "gate_off_s": rng.uniform(0.15, 0.35),
    }


def _bit(rig: ImpactRig, size: float, rng: np.random.Generator) -> dict[str, float]:
    """A bit with play; the smaller the play, the stiffer and lighter the bit."""
    return {
        "u_bit_play_rad": size,
        "coupler_nm_per_rad": float(np.clip(25.0 / size, 2500.0, 6e4)),
        "coupler_nm_s_per_rad": 0.2,
        "coupler_inertia_kg_m2": 6e-6 * min(size / 0.01, 1.0),
    }


def _warm_joint(rig: ImpactRig, size: float, rng: np.random.Generator) -> dict[str, float]:
    return {"u_heat_per_joule": size, "u_heat_s": rng.uniform(0.3, 0.8)}


def _wander(rig: ImpactRig, size: float, rng: np.random.Generator) -> dict[str, float]:
    return {"u_wander_nm": size, "u_wander_s": rng.uniform(0.5, 1.1)}


_R = ("bridge_resistance", "winding_resistance")
_VISCOUS, _COULOMB = "motor.viscous_nm_s_per_rad", "motor.coulomb_nm"
_SLIPPING = ("hard_joint", "disc_spring", "wood_screw")
MECHANISM = tuple(
    ImpactEffect(row[0], "mechanism", *row[1:-1], **row[-1])
    for row in (
        ("groove_friction", _groove_friction, const(0.01), const(0.25), {}),
        (
            "spring_rate",
            _relative("mechanism.spring_rate_n_per_m"),
            const(0.02),
            const(0.3),
            {"signed": True},
        ),
        (
            "spring_preload",
            _relative("mechanism.spring_preload_n"),
            const(0.02),
            const(0.35),
            {"signed": True},
        ),
        (
            "impact_damping",
            _relative("mechanism.contact_damping_n_s_per_m"),
            const(0.2),
            const(3.0),
            {"joints": STIFF},
        ),
        (
            "lug_wear",
            lambda r, s, g: {"lug_height_m": r["mechanism.lug_height_m"] - s},
            const(1e-4),
            const(1.6e-3),
            {},
        ),
        ("joint_stiffness", _joint_stiffness, const(0.1), const(1.5), {"joints": STIFF}),
        (
            "thread_friction",
            plain("joint_friction"),
            const(0.05),
            const(0.8),
            {"signed": True, "joints": _SLIPPING},
        ),
        (
            "joint_hysteresis",
            plain("joint_hysteresis"),
            const(0.1),
            const(0.8),
            {"joints": ("disc_spring",), "needs": "loosen"},
        ),
        ("wood_knot", _knot, const(0.5), const(10.0), {"joints": ("wood_screw",)}),
    )
)
DRIVE = tuple(
    ImpactEffect(row[0], "drive", *row[1:-1], **row[-1])
    for row in (
        (
            "supply_resistance",
            _added("supply.resistance_ohm", "supply_resistance_ohm"),
            const(3e-3),
            const(0.12),
            {},
        ),
        ("supply_droop", _droop, const(2e-3), const(0.08), {}),
        ("dead_time", plain("dead_time_s"), const(2e-7), const(3e-6), {"needs": "partial"}),
        (
            "bridge_resistance",
            plain("bridge_resistance_ohm"),
            const(3e-3),
            const(0.12),
            {"accept": _R},
        ),
        (
            "winding_resistance",
            _relative("motor.resistance_ohm"),
            const(0.02),
            const(0.6),
            {"signed": True, "accept": _R},
        ),
        ("winding_heating", _heating, const(0.05), const(1.0), {}),
        ("brush_drop", plain("brush_drop_v"), const(0.1), const(2.0), {}),
        (
            "torque_constant",
            _relative("motor.torque_constant_nm_per_a"),
            const(5e-3),
            const(0.15),
            {"signed": True},
        ),
        ("magnetic_saturation", _saturation, const(2e-5), const(6e-4), {}),
        ("coulomb_friction", _added(_COULOMB), _part(_COULOMB, 0.2), _part(_COULOMB, 4.0), {}),
        ("stribeck_friction", _stribeck, _part(_COULOMB, 0.5), _part(_COULOMB, 6.0), {}),
        ("viscous_friction", _added(_VISCOUS), _part(_VISCOUS, 0.3), _part(_VISCOUS, 8.0), {}),
        (
            "quadratic_drag",
            plain("quadratic_nm_s2"),
            lambda r: 0.3 * r[_VISCOUS] / 1000.0,
            lambda r: 8.0 * r[_VISCOUS] / 1000.0,
            {},
        ),
        (
            "added_inertia",
            _added("motor.inertia_kg_m2"),
            _part("motor.inertia_kg_m2", 0.03),
            _part("motor.inertia_kg_m2", 0.5),
            {"signed": True},
        ),
        ("cogging_torque", cogging, _part(_COULOMB, 1.0), _part(_COULOMB, 6.0), {}),
        ("cold_grease", _grease, _part(_VISCOUS, 1.0), _part(_VISCOUS, 20.0), {}),
        ("load_dependent_friction", plain("load_friction"), const(0.02), const(0.35), {}),
        ("coupler_compliance", _coupler, const(5e-5), const(2e-3), {}),
        ("current_lag", plain("current_lag_s"), const(1e-3), const(0.03), {}),
        (
            "current_gain",
            plain("current_gain"),
            const(0.01),
            const(0.3),
            {"signed": True},
        ),
        (
            "current_offset",
            plain("current_offset_a"),
            const(0.2),
            const(5.0),
            {"signed": True},
        ),
        ("current_saturation", _limit, const(0.025), const(0.06), {}),
        ("speed_gain", plain("speed_gain"), const(0.01), const(0.2), {"signed": True}),
        ("speed_lag", speed_lag, const(1e-3), const(0.03), {}),
        (
            "hall_eccentricity",
            with_phase("hall_eccentricity_rad", "hall_eccentricity_phase_rad"),
            const(0.02),
            const(0.4),
            {},
        ),
        ("hall_dropout", plain("hall_dropout"), const(0.01), const(0.25), {}),
        ("supply_gain", plain("supply_gain"), const(2e-3), const(0.1), {"signed": True}),
        ("transport_delay", plain("transport_delay_s"), const(2e-3), const(0.03), {}),
    )
)
# Outside the catalogue: wear and faults of the mechanism and of contacts
OUTSIDE = tuple(
    ImpactEffect(row[0], "outside", *row[1:-1], **row[-1])
    for row in (
        ("u_groove_dent", _dent, const(1e-4), const(8e-4), {}),
        ("u_unequal_lugs", plain("u_lug_offset_rad"), const(0.03), const(0.5), {}),
        ("u_worn_lug", plain("u_lug_height_m"), const(3e-4), const(3e-3), {}),
        ("u_coil_bind", _bind, const(5e3), const(2e5), {}),
        ("u_housing_drag", _drag, const(0.05), const(1.5), {}),
        ("u_soft_grip", _arm, const(1.0), const(6.0), {}),
        ("u_brush_contact", _gated("u_brush_ohm"), const(0.02), const(0.5), {}),
        ("u_battery_contact", _gated("u_contact_ohm"), const(0.02), const(0.3), {}),
        ("u_bit_play", _bit, const(0.01), const(0.15), {}),
        ("u_warm_joint", _warm_joint, const(2e-3), const(0.1), {"joints": STEEL}),
        ("u_wandering_friction", _wander, _part(_COULOMB, 0.3), _part(_COULOMB, 0.95), {}),
    )
)
CATALOGUE = (*MECHANISM, *DRIVE)
BY_ID = {effect.id: effect for effect in (*CATALOGUE, *OUTSIDE)}
# Things of OUTSIDE that one effect of the catalogue imitates on most logs (spring_rate,
# added_inertia, coupler_compliance explain 0.8 or more of their squared gap)
IMITATED = ("u_coil_bind", "u_soft_grip", "u_bit_play")
OUTSIDE_IDS = tuple(effect.id for effect in OUTSIDE if effect.id not in IMITATED)
# Largest reduction by a negative size
LARGEST_REDUCTION = 0.45


def accepted(effect: ImpactEffect) -> list[str]:
    """Ids that are right answers for an effect: its equivalents."""
    return sorted(effect.accept or (effect.id,))


def split(
    params: dict[str, float],
) -> tuple[dict[str, float], dict[str, float], dict[str, float]]:
    """(parameters of the tool, those of the joint's slip torque, settings of the logger)."""
    joint = {key: value for key, value in params.items() if key in JOINT_KEYS}
    logger = {key: value for key, value in params.items() if key in LOGGER_KEYS}
    rest = {k: v for k, v in params.items() if k not in joint and k not in logger}
    return rest, joint, logger
