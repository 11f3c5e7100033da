"""Meaning and an example value of each key of a rig: the source of the commented rig that
`vgroove rig new` writes, and of the tables in docs/input_format.md. Ranges come from the keys
themselves (rig_keys.py).

The example is the reference impact driver of docs/spec/model.md, sections 4 and 6, which states
the source of each value there. Those of the sensors and of the pendulum are examples without a
source.
"""

from collections.abc import Mapping
from typing import Any

import tomli_w

from vgroove.errors import VgrooveError
from vgroove.gap.catalogue.keys import Key
from vgroove.rig_keys import KINDS, SECTIONS, TOLERANCE

# dotted key: meaning, example
MEANINGS: dict[str, tuple[str, Any]] = {
    "input.kind": ("the column that drives the model", "duty"),
    "input.slew_per_s": ("the command's rate, unit of the command per s; absent: it steps", 6.0),
    "input.bus": ("modelled: supply_v is judged; measured: it drives the model", "modelled"),
    "input.hold": (
        "before: a row's command held in the interval before it; after: from the row on",
        "before",
    ),
    "supply.voltage_v": ("open-circuit voltage; needed with duty and a modelled bus", 18.5),
    "supply.resistance_ohm": ("resistance of the pack; absent: 0", 0.1),
    "bridge.pwm_hz": ("frequency of the bridge; absent: 20000", 20000),
    "motor.resistance_ohm": ("winding, from terminal to terminal", 0.19),
    "motor.inductance_h": ("winding", 1e-4),
    "motor.torque_constant_nm_per_a": ("equals the back-EMF constant in V s/rad", 0.0109),
    "motor.inertia_kg_m2": ("rotor alone", 1.6e-5),
    "motor.viscous_nm_s_per_rad": ("friction torque that grows with the speed", 4.5e-6),
    "motor.coulomb_nm": ("friction torque that does not depend on the speed", 0.012),
    "gearbox.ratio": ("motor speed over output speed", 5.6),
    "gearbox.output_inertia_kg_m2": ("all that turns behind the gear", 6e-5),
    "sensors.log_hz": ("rows per s", 1000),
    "sensors.current_noise_a": ("standard deviation; absent: estimated from the log", 0.15),
    "sensors.current_lsb_a": ("step of the converter", 0.1),
    "sensors.speed_noise_rpm": ("standard deviation beside the step and the edges", 0.0),
    "sensors.speed_lsb_rpm": ("step of the column", 0.5),
    "sensors.hall_pulses_per_rev": ("edges a motor turn; 0: speed not made from edges", 4),
    "sensors.hall_timeout_s": ("time without an edge after which the speed reads 0", 0.05),
    "sensors.supply_noise_v": ("standard deviation", 0.02),
    "sensors.position_lsb_rad": ("step of the encoder, at the motor", 0.0),
    "sensors.clock_ppm": ("standard deviation of the logger's clock; absent: 20000", 100),
    "mechanism.hammer_inertia_kg_m2": ("hammer about its axis", 4.5e-5),
    "mechanism.hammer_mass_kg": ("hammer", 0.19),
    "mechanism.groove_lead_m_per_rad": ("axial travel of the V-groove per turn angle", 4.4e-3),
    "mechanism.groove_radius_m": ("radius of the groove", 0.01),
    "mechanism.vertex_rad": ("e of the rounded vertex (docs/spec/model.md, section 4)", 0.05),
    "mechanism.travel_rad": ("end of the groove", 2.8),
    "mechanism.spring_preload_n": ("spring force at rest", 220.0),
    "mechanism.spring_rate_n_per_m": ("spring rate", 29400.0),
    "mechanism.lug_count": ("lugs of hammer and anvil", 2),
    "mechanism.lug_height_m": ("height of a lug", 4.5e-3),
    "mechanism.lug_radius_m": ("radius at which lugs touch", 0.015),
    "mechanism.lug_overlap_rad": ("angle of hammer lug and anvil lug together", 1.0),
    "mechanism.contact_stiffness_n_per_m": ("of a lug contact", 3e7),
    "mechanism.contact_damping_n_s_per_m": ("of a lug contact", 2e3),
    "mechanism.contact_ramp_m": ("penetration over which the damping sets in", 1e-5),
    "mechanism.anvil_inertia_kg_m2": ("anvil with socket", 1.2e-5),
    "load.stiffness_nm_per_rad": ("elastic twist of the joint", 3000.0),
    "load.damping_nm_s_per_rad": ("damping of the twist", 0.3),
    "load.run_torque_nm": ("slip torque before the joint loads up", 0.3),
    "load.slip_slope_nm_per_rad": ("slip torque gained per head angle", 700.0),
    "load.loosen_ratio": ("slip torque backwards over forwards", 0.75),
    "load.start_nm": ("slip torque at the surface of the wood", 0.5),
    "load.end_nm": ("slip torque at full depth", 6.0),
    "load.turns": ("turns to full depth", 36.0),
    "load.seat_nm": ("slip torque when the head is seated", 12.0),
    "load.seat_deg": ("angle from full depth to the seat", 90.0),
    "load.stripped_ratio": ("torque of a stripped thread over that of the seat", 0.35),
    "load.from_turns": ("turns done at the start of the log", 4.0),
    "load.parallel": ("disc springs in parallel", 4),
    "load.series": ("disc springs in series", 42),
    "load.friction": ("coefficient of thread and head", 0.12),
    "load.mass_kg": ("point mass on the output shaft", 0.49),
    "load.length_m": ("distance of the mass from the axis", 0.1),
    "load.zero_rad": ("output angle at which it hangs at rest", 0.0),
}
# values of a kind where they are not those of the drive alone: behind the gear of an impact driver
# turns the spindle; a wood screw is softer than a bolted joint
SPINDLE = {"gearbox.output_inertia_kg_m2": 6e-6}
BY_KIND: dict[str, dict[str, float]] = {
    "hard_joint": SPINDLE,
    "disc_spring": SPINDLE,
    "wood_screw": {
        **SPINDLE,
        "load.stiffness_nm_per_rad": 100.0,
        "load.loosen_ratio": 0.6,
        "load.from_turns": 12.0,
    },
}
# kinds of `vgroove rig new`: mechanism and load
TEMPLATES = {
    "free": ("none", "none"),
    "torque": ("none", "torque"),
    "pendulum": ("none", "pendulum"),
    "hard_joint": ("impact", "hard_joint"),
    "disc_spring": ("impact", "disc_spring"),
    "wood_screw": ("impact", "wood_screw"),
}
BASE = ("input", "supply", "bridge", "motor", "gearbox")


def template_kind(kind: str) -> tuple[str, str]:
    """Mechanism and load of a template; VgrooveError with the known ones."""
    if kind not in TEMPLATES:
        raise VgrooveError(f"--kind: {kind} is not one of {', '.join(TEMPLATES)}")
    return TEMPLATES[kind]


def template_text(kind: str) -> str:
    """A complete rig of a kind as commented TOML: each key with its meaning and range."""
    mechanism, load = template_kind(kind)
    lines = [
        "# A rig: what the simulation assumes about a tool (docs/input_format.md). The values are",
        "# those of the reference impact driver: replace each by that of your tool. Keys that are",
        "# optional can be left out.",
        'schema = "vgroove.rig/1"',
        'name = "my tool"',
    ]
    for section in BASE:
        lines += section_lines(section, SECTIONS[section], kind)
    for section, chosen in (("mechanism", mechanism), ("load", load)):
        header, *keys = section_lines(section, KINDS[section][chosen], kind)
        lines += [header, f'kind = "{chosen}"', *keys]
    lines += section_lines("sensors", SECTIONS["sensors"], kind)
    return "\n".join([*lines, *tolerance_lines()]) + "\n"


def section_lines(section: str, keys: Mapping[str, Key], kind: str) -> list[str]:
    """The header of a section and the lines of each key that has a meaning here."""
    lines = [f"[{section}]"]
    for name, key in keys.items():
        if f"{section}.{name}" in MEANINGS:
            lines += key_lines(section, name, key, kind)
    return lines


def key_lines(section: str, name: str, key: Key, kind: str) -> list[str]:
    """A comment with meaning and accepted values of a key, and the key with its example."""
    where = f"{section}.{name}"
    meaning, example = MEANINGS[where]
    need = "" if key.needed else "optional; "
    value = BY_KIND.get(kind, {}).get(where, example)
    return [f"# {need}{meaning}", f"# {key.words}", tomli_w.dumps({name: value}).strip()]


def tolerance_lines() -> list[str]:
    """The section of tolerances, with one example."""
    return [
        "[tolerance]",
        f"# 1 sigma, relative, of a value above, {TOLERANCE.words}; absent: the value is exact",
        '"motor.resistance_ohm" = 0.02',
        '"motor.torque_constant_nm_per_a" = 0.01',
    ]


def key_table(section: str, keys: Mapping[str, Key]) -> list[str]:
    """Rows of a Markdown table: key, need, accepted values, meaning."""
    rows = ["| key | needed | values | meaning |", "| --- | --- | --- | --- |"]
    for name, key in keys.items():
        meaning = MEANINGS[f"{section}.{name}"][0]
        need = "yes" if key.needed else "no"
        rows.append(f"| `{section}.{name}` | {need} | {key.words} | {meaning} |")
    return rows
