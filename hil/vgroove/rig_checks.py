"""Checks of a rig's values together: their time constants and rates must be those of a tool."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from vgroove.errors import VgrooveError, refused_by_plant
from vgroove.gap.catalogue import BY_ID

if TYPE_CHECKING:
    from vgroove.rig import Rig

# Highest rate of the impact mechanism, per second, that its solver follows in bounded work.
MAX_RATE_PER_S = 1e6


@dataclass(frozen=True)
class Figure:
    """What follows from several keys, and within which limits a tool keeps it."""

    words: str
    value: float
    low: float
    high: float
    keys: tuple[str, ...]


def check_tool(rig: "Rig", source: str) -> None:
    """Check that the sections fit one another; VgrooveError, opened by `source`, where not."""
    _check_kinds(rig, source)
    _check_figures(rig, source)
    _check_joint_effects(rig, source)
    _check_impact_tool(rig, source)


def _check_kinds(rig: "Rig", source: str) -> None:
    """Kinds of mechanism, load and input that go together."""
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


def _check_figures(rig: "Rig", source: str) -> None:
    """Values that are possible one by one must make a possible tool; its time constants bound the
    rates that a solver has to follow.
    """
    electrical = _electrical_figures(rig) if rig.input["kind"] != "current_a" else ()
    impact = _impact_figures(rig) if rig.mechanism["kind"] == "impact" else ()
    for figure in (*_mechanical_figures(rig), *electrical, *impact):
        if not figure.low <= figure.value <= figure.high:
            stated = ", ".join(f"{key} {rig.value(key):g}" for key in figure.keys)
            raise VgrooveError(
                f"{source}: {stated}: together they make {figure.words} {figure.value:.3g}, "
                f"which must be from {figure.low:g} to {figure.high:g}; "
                "is one of them in another unit?"
            )


def _check_joint_effects(rig: "Rig", source: str) -> None:
    """An effect of a joint needs a load that it acts on."""
    for effect in rig.effects:
        loads = BY_ID[effect].loads
        if loads and rig.load["kind"] not in loads:
            raise VgrooveError(
                f"{source}: effects.{effect} acts on a load of kind {' or '.join(loads)}, "
                f"not {rig.load['kind']}"
            )


def _check_impact_tool(rig: "Rig", source: str) -> None:
    """Lugs that fit one another, a hammer that starts between them and rises above them: the
    plant's own conditions.
    """
    if rig.mechanism["kind"] == "impact":
        from vgroove import _core

        with refused_by_plant(source):
            _core.check_impact_tool(rig.parameters(), rig.load["kind"])


_MASSES = ("motor.inertia_kg_m2", "gearbox.output_inertia_kg_m2", "gearbox.ratio")


def _mechanical_figures(rig: "Rig") -> list[Figure]:
    added = rig.effects.get("added_inertia", {}).get("kg_m2", 0.0)
    drag = rig.motor["viscous_nm_s_per_rad"]
    found = [
        Figure(
            "the inertia at the motor with the added one in kg m2",
            rig.shaft_inertia_kg_m2 + added,
            1e-12,
            1e6,
            _MASSES,
        )
    ]
    if drag > 0.0:
        keys = ("motor.viscous_nm_s_per_rad", *_MASSES)
        found.append(
            Figure(
                "the time constant J / b in s", rig.shaft_inertia_kg_m2 / drag, 1e-5, math.inf, keys
            )
        )
    return found


def _electrical_figures(rig: "Rig") -> list[Figure]:
    """Time constants: winding 1 us (the fastest coreless motors have 3 us) to 0.3 s, run-up 10 us
    (those: 1 ms) to 1,000 s.
    """
    motor = rig.motor
    resistance, k = motor["resistance_ohm"], motor["torque_constant_nm_per_a"]
    winding, run_up = (
        ("motor.inductance_h", "motor.resistance_ohm"),
        ("motor.resistance_ohm", "motor.torque_constant_nm_per_a", *_MASSES),
    )
    found = [
        Figure(
            "the winding's time constant L / R in s",
            motor["inductance_h"] / resistance,
            1e-6,
            0.3,
            winding,
        ),
        Figure(
            "the run-up time constant J R / k^2 in s",
            rig.shaft_inertia_kg_m2 * resistance / k**2,
            1e-5,
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
            Figure("Coulomb friction over stall torque", share, 0.0, 1.0, stall),
            Figure(
                "the ratio of the resistances",
                pack,
                0.0,
                100.0,
                ("supply.resistance_ohm", "motor.resistance_ohm"),
            ),
        ]
    return found


def _impact_figures(rig: "Rig") -> list[Figure]:
    """Rates of contact, joint and spring. The reference set: 27 krad/s and 48,000 per s in a
    contact, 16 krad/s and 25,000 per s of the anvil on its joint, 390 rad/s of the hammer on its
    spring.
    """
    m, load = rig.mechanism, rig.load
    hammer, anvil = "mechanism.hammer_inertia_kg_m2", "mechanism.anvil_inertia_kg_m2"
    lug = m["lug_radius_m"] ** 2 * (
        1.0 / m["hammer_inertia_kg_m2"] + 1.0 / m["anvil_inertia_kg_m2"]
    )
    lugs = ("mechanism.lug_radius_m", hammer, anvil)
    found = [
        Figure(
            "the rate of the lugs' contact in rad/s",
            math.sqrt(m["contact_stiffness_n_per_m"] * lug),
            1e2,
            MAX_RATE_PER_S,
            ("mechanism.contact_stiffness_n_per_m", *lugs),
        ),
        Figure(
            "the rate of the contact's damping per s",
            m["contact_damping_n_s_per_m"] * lug,
            0.0,
            MAX_RATE_PER_S,
            ("mechanism.contact_damping_n_s_per_m", *lugs),
        ),
        Figure(
            "the rate of the hammer on its spring in rad/s",
            math.sqrt(m["spring_rate_n_per_m"] / m["hammer_mass_kg"]),
            0.0,
            1e5,
            ("mechanism.spring_rate_n_per_m", "mechanism.hammer_mass_kg"),
        ),
    ]
    if "stiffness_nm_per_rad" in load:
        swing = math.sqrt(load["stiffness_nm_per_rad"] / m["anvil_inertia_kg_m2"])
        decay = load["damping_nm_s_per_rad"] / m["anvil_inertia_kg_m2"]
        found += [
            Figure(
                "the rate of the anvil on its joint in rad/s",
                swing,
                1.0,
                MAX_RATE_PER_S,
                ("load.stiffness_nm_per_rad", anvil),
            ),
            Figure(
                "the rate of the joint's damping per s",
                decay,
                0.0,
                MAX_RATE_PER_S,
                ("load.damping_nm_s_per_rad", anvil),
            ),
        ]
    return found
