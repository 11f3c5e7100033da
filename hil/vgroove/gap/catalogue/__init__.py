"""The catalogue of effects: one entry for each effect; every list of effects is read from here.

The modules are named after the subsystems; loads/ holds one entry for each kind of load. Standard
library only, with relative imports: the plant's build imports this package without the others to
write the plant's parameters (plant/generate_effects.py).
"""

from collections.abc import Iterable

from . import (
    bridge,
    gearbox,
    load,
    mechanism,
    motor_electrical,
    motor_mechanical,
    sensor_current,
    sensor_speed,
    sensor_supply,
    supply,
    timing,
)
from .entry import (
    MIN_PERIODS,
    OUTPUT_TURN,
    Effect,
    Form,
    Load,
    LoadKey,
    Parameter,
    Periodic,
    Scales,
    Separation,
)
from .loads import JOINTS, LOADS, LOADS_BEHIND, load_parameters

__all__ = [
    "BY_ID",
    "CATALOGUE",
    "CONVENTIONS_AT_LOWER_BOUND",
    "FORMS_BEYOND_SPECIFICATION",
    "FRICTION_LAWS",
    "JOINTS",
    "LESS_LIKELY",
    "LOADS",
    "LOADS_BEHIND",
    "MIN_PERIODS",
    "NEEDS",
    "OUTPUT_TURN",
    "PERIODIC",
    "SENSORS",
    "SEPARATIONS",
    "SPECIAL_CASES",
    "Effect",
    "Form",
    "Load",
    "LoadKey",
    "Parameter",
    "Periodic",
    "Scales",
    "Separation",
    "available",
    "contains",
    "equations",
    "equations_and_sensors",
    "equivalents",
    "load_parameters",
]

_SUBSYSTEMS = (
    supply,
    bridge,
    motor_electrical,
    motor_mechanical,
    gearbox,
    mechanism,
    load,
    sensor_current,
    sensor_speed,
    sensor_supply,
    timing,
)

CATALOGUE: tuple[Effect, ...] = tuple(e for module in _SUBSYSTEMS for e in module.EFFECTS)
BY_ID = {effect.id: effect for effect in CATALOGUE}
SUBSYSTEMS = tuple(dict.fromkeys(effect.subsystem for effect in CATALOGUE))
SENSORS = frozenset(name for name in SUBSYSTEMS if name.startswith("sensor_"))

# What a log must hold to show an effect: the flags of Effect.needs in words.
NEEDS = {
    "voltage": "a voltage drives the model",
    "duty": "a duty drives the model",
    "current_input": "a current drives the model",
    "current": "a judged current",
    "speed": "a judged speed",
    "motion": "a judged speed or angle",
    "rows": "no impact mechanism",
    "supply": "a judged bus voltage",
    "edges": "a speed made from Hall edges",
    "both": "both directions of rotation",
    "load": "a known load torque or a pendulum",
    "output": "a load or an inertia behind the gear",
    "impact": "an impact mechanism",
}

# General effects and the special cases that they contain as a limit: a rival that only generalises
# the selected effect is no rival.
SPECIAL_CASES: dict[str, tuple[str, ...]] = {
    general.id: specials
    for general in CATALOGUE
    if (specials := tuple(e.id for e in CATALOGUE if general.id in e.special_case_of))
}
FRICTION_LAWS = frozenset(e.id for e in CATALOGUE if e.friction_law)
PERIODIC = {e.id: e.periodic for e in CATALOGUE if e.periodic}
# Flags and values of the forms that the agreed catalogue does not define
FORMS_BEYOND_SPECIFICATION = frozenset(
    (e.flag_name, float(e.form.words.index(word)))
    for e in CATALOGUE
    if e.form
    for word in e.form.beyond_specification
)
CONVENTIONS_AT_LOWER_BOUND = frozenset(
    e.name(p) for e in CATALOGUE for p in e.parameters if p.low_is_convention
)
SEPARATIONS = {frozenset({e.id, s.other}): s for e in CATALOGUE for s in e.separations}
LESS_LIKELY = frozenset(e.id for e in CATALOGUE if e.less_likely)

# Equations of the model that the effects of a subsystem enter, where an entry states no others.
_EQUATIONS = {
    "supply": ("voltage",),
    "bridge": ("voltage",),
    "motor_electrical": ("voltage",),
    "motor_mechanical": ("torque",),
    "gearbox": ("torque",),
    "timing": ("command",),
}


def equations(effect_id: str) -> frozenset[str]:
    """Equations of the model that an effect enters; for a sensor's effect, the sensor's name."""
    effect = BY_ID[effect_id]
    return frozenset(effect.equations or _EQUATIONS.get(effect.subsystem, (effect.subsystem,)))


def equations_and_sensors(effect_id: str) -> frozenset[str]:
    """Equations whose effects an error in the form of this effect can imitate: those that it enters
    and all sensors; for an effect of a sensor, its own sensor only.
    """
    own = equations(effect_id)
    return own if BY_ID[effect_id].subsystem in SENSORS else own | SENSORS


def _classes(flags: frozenset[str]) -> list[tuple[str, ...]]:
    """Equivalence classes on logs with these flags of NEEDS, the likelier member first."""
    return [
        (effect.id, other)
        for effect in CATALOGUE
        for other, conditions in effect.identical_to
        if set(conditions) <= flags
    ]


def equivalents(effect_id: str, flags: frozenset[str]) -> tuple[str, ...]:
    """Other members of the effect's equivalence class on logs with these flags (docs/spec/gap.md,
    section 3): they predict the same logs.
    """
    classes = _classes(flags)
    return tuple(o for group in classes if effect_id in group for o in group if o != effect_id)


def contains(general: tuple[str, ...], special: tuple[str, ...]) -> bool:
    """Whether a set of effects contains another one: each effect of the special set, or a
    generalisation of it, is in the general set, one for one.
    """
    rest = list(special)
    for effect in general:
        covered = next((s for s in rest if s == effect or s in SPECIAL_CASES.get(effect, ())), None)
        if covered is not None:
            rest.remove(covered)
    return not rest


def available(flags: frozenset[str], without: Iterable[str] = ()) -> list[Effect]:
    """Effects that logs with these flags can show; of an equivalence class the likelier member."""
    chosen = [e for e in CATALOGUE if e.id not in without and set(e.needs) <= flags]
    present = {e.id for e in chosen}
    implied = {group[1] for group in _classes(flags) if group[0] in present}
    return [e for e in chosen if e.id not in implied]
