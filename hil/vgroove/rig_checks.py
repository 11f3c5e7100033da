"""Checks of quantities that depend on several keys of a rig: their time constants and rates must be
possible for a tool, and such that the solver can follow them.
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from vgroove.errors import VgrooveError, refused_by_plant
from vgroove.gap.catalogue import BY_ID

if TYPE_CHECKING:
    from vgroove.rig import Rig

# Highest rate of the impact mechanism, rad/s or 1/s, that its solver follows in bounded work.
MAX_RATE_PER_S = 1e6


@dataclass(frozen=True)
class DerivedQuantity:
    """A quantity computed from several keys of a rig, its allowed range low..high, and the keys;
    name: what it is, with its unit.
    """

    name: str
    value: float
    low: float
    high: float
    keys: tuple[str, ...]


def check_tool(rig: "Rig", source: str) -> None:
    """Check that the sections of a rig agree; VgrooveError, whose message begins with `source`."""
    _check_kinds(rig, source)
    _check_quantities(rig, source)
    _check_joint_effects(rig, source)
    _check_impact_tool(rig, source)


def _check_kinds(rig: "Rig", source: str) -> None:
    """Check that the kinds of mechanism, load and input may be combined."""
    if (rig.mechanism["kind"] == "drill_driver") != (rig.load["kind"] == "chuck"):
        raise VgrooveError(
            f'{source}: [mechanism] kind = "drill_driver" and [load] kind = "chuck" go together'
        )
    if rig.input["kind"] == "duty" and not rig.bus_is_measured and "voltage_v" not in rig.supply:
        raise VgrooveError(
            f"{source}: supply.voltage_v is missing: duty as input and a modelled bus need the "
            "open-circuit voltage"
        )
    if rig.load["kind"] == "free" and rig.mechanism["kind"] != "none":
        raise VgrooveError(
            f'{source}: [load] kind = "free" is a friction behind the gear and needs [mechanism] '
            'kind = "none"; the anvil of an impact mechanism is free with [load] kind = "none"'
        )


def _check_quantities(rig: "Rig", source: str) -> None:
    """Check the quantities that depend on several keys; they bound the rates that a solver has to
    follow.
    """
    electrical = _electrical_quantities(rig) if rig.input["kind"] != "current_a" else ()
    impact = _impact_quantities(rig) if rig.mechanism["kind"] == "impact" else ()
    for quantity in (*_mechanical_quantities(rig), *electrical, *impact):
        if not quantity.low <= quantity.value <= quantity.high:
            stated = ", ".join(f"{key} {rig.value(key):g}" for key in quantity.keys)
            raise VgrooveError(
                f"{source}: {stated}: together they make {quantity.name} {quantity.value:.3g}, "
                f"which must be from {quantity.low:g} to {quantity.high:g}; "
                "is one of them in another unit?"
            )


def _check_joint_effects(rig: "Rig", source: str) -> None:
    """Check that each effect of a joint acts on the kind of load of the rig."""
    for effect in rig.effects:
        loads = BY_ID[effect].loads
        if loads and rig.load["kind"] not in loads:
            raise VgrooveError(
                f"{source}: effects.{effect} acts on a load of kind {' or '.join(loads)}, "
                f"not {rig.load['kind']}"
            )


def _check_impact_tool(rig: "Rig", source: str) -> None:
    """Check the plant's conditions: the lugs leave a gap; the hammer starts between them and can
    rise above them.
    """
    if rig.mechanism["kind"] == "impact":
        from vgroove import _core

        with refused_by_plant(source):
            _core.check_impact_tool(rig.parameters(), rig.load["kind"])


_INERTIA_KEYS = ("motor.inertia_kg_m2", "gearbox.output_inertia_kg_m2", "gearbox.ratio")


def _mechanical_quantities(rig: "Rig") -> list[DerivedQuantity]:
    """Inertia and mechanical time constant at the motor shaft."""
    added = rig.effects.get("added_inertia", {}).get("kg_m2", 0.0)
    drag = rig.motor["viscous_nm_s_per_rad"]
    found = [
        DerivedQuantity(
            "the inertia at the motor with the added one in kg m2",
            rig.drive_inertia_kg_m2 + added,
            1e-12,
            1e6,
            _INERTIA_KEYS,
        )
    ]
    if drag > 0.0:
        keys = ("motor.viscous_nm_s_per_rad", *_INERTIA_KEYS)
        found.append(
            DerivedQuantity(
                "the time constant J / b in s", rig.drive_inertia_kg_m2 / drag, 1e-5, math.inf, keys
            )
        )
    return found


_LEFT_OUT_H = 2e-6  # largest inductance that stands for an unknown one; coreless motors have 10 uH


def _electrical_quantities(rig: "Rig") -> list[DerivedQuantity]:
    """Time constants and ratios of the electrical part. The fastest coreless motors have a winding
    time constant of 3 us (limit 1 us) and a run-up time constant of 1 ms (limit 1 us: a rig may
    lack most of an inertia; a torque constant in mN m/A makes it a millionth). An inductance
    smaller than any motor's is stated where it is not known, and has no least time constant.
    """
    motor = rig.motor
    resistance, k = motor["resistance_ohm"], motor["torque_constant_nm_per_a"]
    winding, run_up = (
        ("motor.inductance_h", "motor.resistance_ohm"),
        ("motor.resistance_ohm", "motor.torque_constant_nm_per_a", *_INERTIA_KEYS),
    )
    found = [
        DerivedQuantity(
            "the winding's time constant L / R in s",
            motor["inductance_h"] / resistance,
            1e-6 if motor["inductance_h"] > _LEFT_OUT_H else 0.0,
            0.3,
            winding,
        ),
        DerivedQuantity(
            "the run-up time constant J R / k^2 in s",
            rig.drive_inertia_kg_m2 * resistance / k**2,
            1e-6,
            1e3,
            run_up,
        ),
    ]
    if rig.input["kind"] == "duty" and not rig.bus_is_measured:
        share = motor["coulomb_nm"] * resistance / (k * rig.supply["voltage_v"])
        stall = (
            "motor.coulomb_nm",
            "motor.torque_constant_nm_per_a",
            "supply.voltage_v",
            "motor.resistance_ohm",
        )
        pack = rig.value("supply.resistance_ohm") / resistance
        found += [
            DerivedQuantity("Coulomb friction over stall torque", share, 0.0, 1.0, stall),
            DerivedQuantity(
                "pack resistance over winding resistance",
                pack,
                0.0,
                100.0,
                ("supply.resistance_ohm", "motor.resistance_ohm"),
            ),
        ]
    return found


def _impact_quantities(rig: "Rig") -> list[DerivedQuantity]:
    """Rates of contact, joint and spring. The reference set of docs/spec/model.md, section 4, has
    27 krad/s and 48,000 per s in a lug contact, 16 krad/s and 25,000 per s of the anvil on its
    joint, 390 rad/s of the hammer on its spring.
    """
    m, load = rig.mechanism, rig.load
    hammer, anvil = "mechanism.hammer_inertia_kg_m2", "mechanism.anvil_inertia_kg_m2"
    lug = m["lug_radius_m"] ** 2 * (
        1.0 / m["hammer_inertia_kg_m2"] + 1.0 / m["anvil_inertia_kg_m2"]
    )
    lugs = ("mechanism.lug_radius_m", hammer, anvil)
    found = [
        DerivedQuantity(
            "the rate of the lugs' contact in rad/s",
            math.sqrt(m["contact_stiffness_n_per_m"] * lug),
            1e2,
            MAX_RATE_PER_S,
            ("mechanism.contact_stiffness_n_per_m", *lugs),
        ),
        DerivedQuantity(
            "the rate of the contact's damping per s",
            m["contact_damping_n_s_per_m"] * lug,
            0.0,
            MAX_RATE_PER_S,
            ("mechanism.contact_damping_n_s_per_m", *lugs),
        ),
        DerivedQuantity(
            "the rate of the hammer on its spring in rad/s",
            math.sqrt(m["spring_rate_n_per_m"] / m["hammer_mass_kg"]),
            0.0,
            1e5,
            ("mechanism.spring_rate_n_per_m", "mechanism.hammer_mass_kg"),
        ),
    ]
    if "stiffness_nm_per_rad" in load:
        anvil_rad_s = math.sqrt(load["stiffness_nm_per_rad"] / m["anvil_inertia_kg_m2"])
        damping_per_s = load["damping_nm_s_per_rad"] / m["anvil_inertia_kg_m2"]
        found += [
            DerivedQuantity(
                "the rate of the anvil on its joint in rad/s",
                anvil_rad_s,
                1.0,
                MAX_RATE_PER_S,
                ("load.stiffness_nm_per_rad", anvil),
            ),
            DerivedQuantity(
                "the rate of the joint's damping per s",
                damping_per_s,
                0.0,
                MAX_RATE_PER_S,
                ("load.damping_nm_s_per_rad", anvil),
            ),
        ]
    return found
