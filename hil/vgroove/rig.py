"""Rigs: what the simulation believes about a tool, as TOML (gap contract, section 2), read strictly
and turned into parameters.
"""

import copy
import difflib
import math
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from vgroove.errors import VgrooveError, refused_by_plant
from vgroove.output import write_text

SCHEMA = "vgroove.rig/1"
DEFAULTS = {"supply.resistance_ohm": 0.0, "bridge.pwm_hz": 20000.0, "load.zero_rad": 0.0}
PLANT_SECTIONS = ("supply", "bridge", "motor", "gearbox", "mechanism", "load")
MECHANISM_EFFECTS = (
    "groove_friction",
    "spring_rate",
    "spring_preload",
    "impact_damping",
    "lug_wear",
    "joint_stiffness",
    "thread_friction",
    "joint_hysteresis",
    "wood_knot",
)  # of the impact mechanism and its joints


@dataclass(frozen=True)
class Key:
    """One key of a rig: what its value must satisfy, in words and as a test, and whether the
    section needs it.
    """

    words: str
    holds: Callable[[Any], bool]
    needed: bool = True


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _number(words: str, holds: Callable[[float], bool], needed: bool = True) -> Key:
    return Key(words, lambda v: _is_number(v) and holds(v), needed)


def _range(low: float, high: float, needed: bool = True) -> Key:
    return _number(f"a number from {low:g} to {high:g}", lambda v: low <= v <= high, needed)


def _maybe(low: float, high: float) -> Key:
    return _range(low, high, needed=False)


def _whole(low: int, high: int, needed: bool = True) -> Key:
    words = f"a whole number from {low} to {high}"
    return Key(
        words, lambda v: isinstance(v, int) and not isinstance(v, bool) and low <= v <= high, needed
    )


def _choice(*names: str, needed: bool = True) -> Key:
    return Key("one of " + ", ".join(names), lambda v: v in names, needed)


def _flag(needed: bool = True) -> Key:
    return Key("true or false", lambda v: isinstance(v, bool), needed)


ANY = _number("a finite number", lambda v: True)
POSITIVE = _number("a number above 0", lambda v: v > 0)
NOT_NEGATIVE = _number("a number of at least 0", lambda v: v >= 0)
RELATIVE = _number("a number above -1", lambda v: v > -1)
MAY_BE = _number("a finite number", lambda v: True, needed=False)
SIGMA = _range(0, 1)
RATE_MOST = 1e6  # per s, of the impact mechanism: what its solver can follow in bounded work

JOINTS = ("locked", "hard_joint", "disc_spring", "wood_screw")
ACTS_ON = {
    "joint_stiffness": JOINTS,
    "thread_friction": JOINTS[1:],
    "joint_hysteresis": ("disc_spring",),
    "wood_knot": JOINTS[1:],
}

# Ranges: from motors of a few milliwatts (0.3 W: 5e-10 kg m2, 0.5 mN m/A, 100 ohm) to 10 kW and
# more, and linear axes read with the same keys (EMPS: 95 kg, 35 N/V). They are wide: what they
# refuse is no tool, or a number in another unit.
SECTIONS: dict[str, dict[str, Key]] = {
    "input": {
        "kind": _choice("duty", "voltage_v", "current_a"),
        "slew_per_s": _maybe(1e-4, 1e8),
        "bus": _choice("modelled", "measured", needed=False),
    },
    "supply": {"voltage_v": _maybe(0.01, 5e3), "resistance_ohm": _maybe(0, 1e3)},
    "bridge": {"pwm_hz": _maybe(10, 1e7)},
    "motor": {
        "resistance_ohm": _range(1e-4, 1e4),
        "inductance_h": _range(1e-8, 10),
        "torque_constant_nm_per_a": _range(1e-5, 1e4),
        "inertia_kg_m2": _range(1e-11, 1e4),
        "viscous_nm_s_per_rad": _range(0, 1e5),
        "coulomb_nm": _range(0, 1e5),
    },
    "gearbox": {"ratio": _range(1e-4, 1e5), "output_inertia_kg_m2": _range(0, 1e6)},
    "sensors": {
        "log_hz": _maybe(0.1, 1e6),
        "current_noise_a": _maybe(0, 1e5),
        "current_lsb_a": _maybe(0, 1e5),
        "speed_noise_rpm": _maybe(0, 1e5),
        "speed_lsb_rpm": _maybe(0, 1e5),
        "hall_pulses_per_rev": _whole(0, 1_000_000, needed=False),
        "hall_timeout_s": _maybe(1e-4, 1e3),
        "supply_noise_v": _maybe(0, 1e4),
        "position_lsb_rad": _maybe(0, 1e3),
    },
}
# physics.md section 3
_FRICTION_LAW = {
    "torque_nm": _range(0, 1e5),
    "breakaway_ratio": _maybe(1, 10),
    "breakaway_rad_s": _maybe(1e-6, 1e4),
    "viscous_nm_s_per_rad": _maybe(0, 1e5),
    "form": _choice("stribeck", "exponential", needed=False),
    "threshold_rad_s": _maybe(1e-9, 1e4),
    "decay_s_per_rad": _maybe(0, 1e6),
}
_JOINT = {"stiffness_nm_per_rad": _range(1e-3, 1e9), "damping_nm_s_per_rad": _range(0, 1e6)}
KINDS: dict[str, dict[str, dict[str, Key]]] = {
    "mechanism": {
        "none": {},
        "impact": {
            "hammer_inertia_kg_m2": _range(1e-8, 1e2),
            "hammer_mass_kg": _range(1e-4, 1e3),
            "groove_lead_m_per_rad": _range(1e-5, 1),
            "groove_radius_m": _range(1e-4, 1),
            "vertex_rad": _range(0, 3),
            "travel_rad": _range(1e-2, 100),
            "spring_preload_n": _range(0, 1e6),
            "spring_rate_n_per_m": _range(1, 1e9),
            "lug_count": _whole(1, 100),
            "lug_height_m": _range(1e-5, 1),
            "lug_radius_m": _range(1e-4, 1),
            "lug_overlap_rad": _range(1e-3, 6.3),
            "contact_stiffness_n_per_m": _range(1e2, 1e12),
            "contact_damping_n_s_per_m": _range(0, 1e8),
            "contact_ramp_m": _range(1e-9, 0.1),
            "anvil_inertia_kg_m2": _range(1e-9, 1e2),
            "hammer_start_rad": _maybe(-100, 100),
            "hammer_groove_lead_m_per_rad": _maybe(1e-5, 1),
            "hammer_groove_radius_m": _maybe(1e-4, 1),
            "contact_exponent": _maybe(1, 3),
            "friction_static": _maybe(0, 2),
            "friction_kinetic": _maybe(0, 2),
            "friction_speed_m_per_s": _maybe(1e-6, 10),
            "arm_inertia_kg_m2": _maybe(1e-6, 1e3),
            "arm_stiffness_nm_per_rad": _maybe(0, 1e6),
            "arm_damping_nm_s_per_rad": _maybe(0, 1e5),
        },
        "drill_driver": {
            "shaft_stiffness_nm_per_rad": _range(1e-3, 1e9),
            "shaft_damping_nm_s_per_rad": _range(1e-6, 1e6),
            "clutch_nm": _range(1e-4, 1e5),
            "pulse": _flag(needed=False),
            "pulse_on_a": _maybe(0, 1e5),
            "pulse_off_a": _maybe(0, 1e5),
            "pulse_coast_s": _maybe(1e-4, 10),
            "pulse_drive_s": _maybe(1e-4, 10),
            "pulse_average_s": _maybe(1e-4, 10),
        },
    },
    "load": {
        "none": {},
        "torque": {},
        "pendulum": {
            "mass_kg": _range(1e-6, 1e5),
            "length_m": _range(1e-5, 1e2),
            "zero_rad": _maybe(-1e6, 1e6),
        },
        "locked": {**_JOINT},
        "free": {**_FRICTION_LAW},
        "chuck": {
            **_FRICTION_LAW,
            "from_s": _range(0, 1e4),
            "to_s": _range(0, 1e4),
            "rise_nm_per_rad": _maybe(0, 1e8),
            "rise_from_rad": _maybe(-1e6, 1e6),
            "rise_most_nm": _maybe(0, 1e8),
        },
        "hard_joint": {
            **_JOINT,
            "run_torque_nm": _range(0, 1e5),
            "slip_slope_nm_per_rad": _range(0, 1e8),
            "loosen_ratio": _range(0, 10),
        },
        "disc_spring": {
            **_JOINT,
            "run_torque_nm": _range(0, 1e5),
            "parallel": _whole(1, 1000),
            "series": _whole(1, 1000),
            "friction": _range(0, 2),
            "from_turns": _range(0, 1e4),
            "disc_outer_m": _maybe(1e-4, 10),
            "disc_inner_m": _maybe(1e-5, 10),
            "disc_thickness_m": _maybe(1e-5, 1),
            "disc_cone_m": _maybe(1e-6, 1),
            "bolt_pitch_m": _maybe(1e-5, 0.1),
            "bolt_flank_m": _maybe(1e-4, 1),
            "bolt_head_m": _maybe(1e-4, 1),
        },
        "wood_screw": {
            **_JOINT,
            "start_nm": _range(0, 1e5),
            "end_nm": _range(1e-6, 1e5),
            "turns": _range(1e-2, 1e4),
            "seat_nm": _range(1e-6, 1e5),
            "seat_deg": _range(1e-2, 1e5),
            "stripped_ratio": _range(0, 10),
            "from_turns": _range(0, 1e4),
            "loosen_ratio": _range(0, 10),
        },
    },
}
_PROBABILITY = _number("a number between 0 and 1", lambda v: 0 <= v <= 1)
_SKEW = _number("a number within +-0.05", lambda v: abs(v) <= 0.05)
EFFECTS: dict[str, dict[str, Key]] = {
    "supply_resistance": {"resistance_ohm": ANY},
    "supply_droop": {"volt_per_coulomb": ANY, "polarisation_ohm": ANY, "polarisation_s": POSITIVE},
    "dead_time": {"dead_time_s": ANY, "form": _choice("mean", "edges", needed=False)},
    "bridge_resistance": {"resistance_ohm": ANY},
    "winding_resistance": {"relative": RELATIVE},
    "winding_heating": {"kelvin_per_joule": ANY, "cooling_s": POSITIVE},
    "brush_drop": {"voltage_v": ANY},
    "inductance": {"relative": RELATIVE},
    "torque_constant": {"relative": RELATIVE},
    "magnetic_saturation": {"saturation_a": POSITIVE},
    "coulomb_friction": {"torque_nm": ANY},
    "stribeck_friction": {"breakaway_nm": ANY, "speed_rad_s": POSITIVE},
    "viscous_friction": {"nm_s_per_rad": ANY},
    "quadratic_drag": {"nm_s2_per_rad2": ANY},
    "asymmetric_friction": {"forward_nm": ANY, "backward_nm": ANY},
    "directional_viscous": {"nm_s_per_rad": ANY},
    "cogging_torque": {"torque_nm": ANY, "periods_per_rev": POSITIVE, "phase_rad": MAY_BE},
    "added_inertia": {"kg_m2": ANY},
    "cold_grease": {"nm_s_per_rad": ANY, "time_s": POSITIVE},
    "load_dependent_friction": {"relative": ANY},
    "gear_eccentricity": {"torque_nm": ANY, "phase_rad": MAY_BE},
    "coupler_compliance": {
        "stiffness_nm_per_rad": POSITIVE,
        "damping_ratio": NOT_NEGATIVE,
        "inertia_kg_m2": NOT_NEGATIVE,
    },
    "gear_backlash": {"play_rad": NOT_NEGATIVE},
    "groove_friction": {"coefficient": NOT_NEGATIVE},
    "spring_rate": {"relative": RELATIVE},
    "spring_preload": {"relative": RELATIVE},
    "impact_damping": {"relative": RELATIVE},
    "lug_wear": {"height_m": ANY},
    "joint_stiffness": {"relative": RELATIVE},
    "thread_friction": {"relative": RELATIVE},
    "joint_hysteresis": {"relative": ANY},
    "wood_knot": {"torque_nm": ANY, "from_rad": ANY, "to_rad": ANY},
    "current_lag": {"time_constant_s": NOT_NEGATIVE},
    "current_gain": {"relative": RELATIVE},
    "current_offset": {"offset_a": ANY},
    "current_saturation": {"limit_a": POSITIVE},
    "speed_gain": {"relative": RELATIVE},
    "speed_lag": {
        "time_constant_s": NOT_NEGATIVE,
        "form": _choice("filter", "delay", needed=False),
    },
    "hall_eccentricity": {"amplitude_rad": ANY, "phase_rad": MAY_BE},
    "hall_dropout": {"probability": _PROBABILITY},
    "supply_gain": {"relative": RELATIVE},
    "transport_delay": {"delay_s": NOT_NEGATIVE},
    "clock_skew": {"relative": _SKEW, "clock": _choice("logger", "command", needed=False)},
}
# Words in a rig that are numbers in the parameter vector: (effect, key) -> (parameter, word that
# reads 1); and of the load.
WORDS = {
    ("dead_time", "form"): ("effects.dead_time.at_edges", "edges"),
    ("speed_lag", "form"): ("effects.speed_lag.delay_form", "delay"),
    ("clock_skew", "clock"): ("effects.clock_skew.command_clock", "command"),
}
LOAD_FORM = ("load.exponential", "exponential")


@dataclass(frozen=True)
class Rig:
    """A validated rig; each section holds the keys that the file holds, SI units in their names."""

    input: dict[str, Any]
    motor: dict[str, float]
    gearbox: dict[str, float]
    mechanism: dict[str, Any]
    load: dict[str, Any]
    supply: dict[str, float] = field(default_factory=dict)
    bridge: dict[str, float] = field(default_factory=dict)
    sensors: dict[str, Any] = field(default_factory=dict)
    tolerance: dict[str, float] = field(default_factory=dict)
    effects: dict[str, dict[str, Any]] = field(default_factory=dict)
    name: str | None = None

    @property
    def bus_is_measured(self) -> bool:
        """Whether the supply_v column drives the model instead of being judged."""
        return self.input.get("bus", "modelled") == "measured"

    @property
    def shaft_inertia_kg_m2(self) -> float:
        """Inertia at the motor's shaft, the gearbox's output referred to it."""
        return (
            self.motor["inertia_kg_m2"]
            + self.gearbox["output_inertia_kg_m2"] / self.gearbox["ratio"] ** 2
        )

    def value(self, key: str) -> float:
        """Value of a dotted key such as motor.resistance_ohm, the default where the file leaves it
        out; KeyError for an unknown one.
        """
        section, name = key.split(".", 1)
        values = getattr(self, section)
        return values[name] if name in values else DEFAULTS[key]

    def with_values(self, values: Mapping[str, float]) -> "Rig":
        """The same rig with other values of dotted keys, validated again."""
        data = self.as_dict()
        for key, value in values.items():
            section, name = key.split(".", 1)
            data.setdefault(section, {})[name] = value
        return rig_from_dict(data, "the changed rig")

    def with_effects(self, effects: Mapping[str, Mapping[str, Any]]) -> "Rig":
        """The same rig with effects added or, where it has them already, replaced."""
        data = self.as_dict()
        data.setdefault("effects", {}).update(
            {name: dict(values) for name, values in effects.items()}
        )
        return rig_from_dict(data, "the changed rig")

    def parameters(self) -> np.ndarray:
        """The plant's parameter vector (P,) in the order of vgroove._core.PARAMETERS, effects of
        the rig included.
        """
        from vgroove import _core

        if self.mechanism["kind"] == "drill_driver":
            raise VgrooveError(
                f"{self.name or 'the rig'}: a drill driver is no drivetrain with effects and a log's input: "
                "`vgroove sim`, `vgroove run` and `vgroove study steps` run it"
            )
        unknown = [
            e for e in self.effects if e in MECHANISM_EFFECTS and self.mechanism["kind"] != "impact"
        ]
        if unknown:
            raise VgrooveError(
                f"the plant of a tool without impact mechanism has no effects.{unknown[0]}"
            )
        theta = np.array(_core.parameter_defaults(), dtype=float)
        position = {name: i for i, name in enumerate(_core.PARAMETERS)}
        for key, value in self._flat().items():
            if key in position:
                theta[position[key]] = value
            elif key.startswith("effects."):
                raise VgrooveError(
                    f"this build of the plant has no {key}: run `pip install -e .` in the tree again"
                )
        return theta

    def drill_parameters(self) -> dict[str, float]:
        """The drill driver's parameters by name, defaults for what the rig leaves out; VgrooveError
        for a rig that is none.
        """
        from vgroove import _core

        name = self.name or "the rig"
        if self.mechanism["kind"] != "drill_driver":
            raise VgrooveError(
                f'{name}: this needs [mechanism] kind = "drill_driver" and [load] kind = "chuck"'
            )
        if self.effects:
            raise VgrooveError(
                f"{name}: the drill driver has no effects, so not {next(iter(self.effects))}"
            )
        if self.input["kind"] != "duty" or self.bus_is_measured:
            raise VgrooveError(
                f"{name}: a duty and its own supply drive the drill driver, not {self.input['kind']} and a measured bus"
            )
        known = _core.drill_parameters()
        found = {key: value for key, value in self._flat().items() if key in known}
        if "slew_per_s" in self.input:
            found["drive.ramp_s"] = 1.0 / self.input["slew_per_s"]
        return known | found

    def _flat(self) -> dict[str, float]:
        flat = {
            f"{s}.{k}": float(v)
            for s in PLANT_SECTIONS
            for k, v in getattr(self, s).items()
            if isinstance(v, int | float)
        }
        if "form" in self.load:
            flat[LOAD_FORM[0]] = float(self.load["form"] == LOAD_FORM[1])
        for effect, values in self.effects.items():
            for key, value in values.items():
                parameter, word = WORDS.get((effect, key), (f"effects.{effect}.{key}", None))
                flat[parameter] = float(value == word) if word else float(value)
        return flat

    def as_dict(self) -> dict[str, Any]:
        """The rig as the file states it; nothing shared with this object."""
        data: dict[str, Any] = {"schema": SCHEMA}
        if self.name is not None:
            data["name"] = self.name
        for section in (
            "input",
            "supply",
            "bridge",
            "motor",
            "gearbox",
            "mechanism",
            "load",
            "sensors",
            "tolerance",
            "effects",
        ):
            values = getattr(self, section)
            if values or section in ("mechanism", "load"):
                data[section] = copy.deepcopy(values)
        return data


def read_toml(path: str | Path) -> dict[str, Any]:
    """The tables of a TOML file; VgrooveError says why it cannot be read."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise VgrooveError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise VgrooveError(f"{path}: is not a text file") from error
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise VgrooveError(f"{path}: is not TOML: {error}") from error


def read_rig(path: str | Path) -> Rig:
    """Read and validate a rig; VgrooveError with the file, the key and the nearest known one for
    anything the contract does not allow.
    """
    return rig_from_dict(read_toml(path), str(path))


def write_rig(rig: Rig, path: str | Path) -> None:
    """Write a rig, whole or not at all, so that read_rig gives the same one back."""
    write_text(path, tomli_w.dumps(rig.as_dict()))


def rig_from_dict(data: Mapping[str, Any], source: str) -> Rig:
    """Validate what a rig file holds; `source` opens every message."""
    if data.get("schema") != SCHEMA:
        raise VgrooveError(f'{source}: schema must be "{SCHEMA}", not {data.get("schema")!r}')
    known = ("schema", "name", *SECTIONS, *KINDS, "tolerance", "effects")
    _no_unknown(data, known, source, "")
    if not isinstance(data.get("name", ""), str):
        raise VgrooveError(f"{source}: name must be a text")
    for section in ("input", "motor", "gearbox", "mechanism", "load"):
        if section not in data:
            raise VgrooveError(f"{source}: the section [{section}] is missing")
    sections = {s: _section(data[s], keys, source, s) for s, keys in SECTIONS.items() if s in data}
    sections |= {s: _kind_section(data[s], kinds, source, s) for s, kinds in KINDS.items()}
    effects = _table(data.get("effects", {}), source, "effects")
    _no_unknown(effects, EFFECTS, source, "effects.")
    sections["effects"] = {
        e: _section(values, EFFECTS[e], source, f"effects.{e}") for e, values in effects.items()
    }
    rig = Rig(
        **sections,
        tolerance=_table(data.get("tolerance", {}), source, "tolerance"),
        name=data.get("name"),
    )
    _check_tolerance(rig, source)
    if (rig.mechanism["kind"] == "drill_driver") != (rig.load["kind"] == "chuck"):
        raise VgrooveError(
            f'{source}: [mechanism] kind = "drill_driver" and [load] kind = "chuck" go together'
        )
    if rig.input["kind"] == "duty" and not rig.bus_is_measured and "voltage_v" not in rig.supply:
        raise VgrooveError(
            f"{source}: supply.voltage_v is missing: duty as input and a modelled bus need the open-circuit voltage"
        )
    if rig.load["kind"] == "free" and rig.mechanism["kind"] != "none":
        raise VgrooveError(
            f'{source}: [load] kind = "free" is a friction behind the gear and needs [mechanism] kind = "none"; '
            'the anvil of an impact mechanism is free with [load] kind = "none"'
        )
    _check_together(rig, source)
    _check_joint_effects(rig, source)
    _check_impact_tool(rig, source)
    return rig


@dataclass(frozen=True)
class Figure:
    """What follows from several keys, and within which limits a tool keeps it."""

    words: str
    value: float
    low: float
    high: float
    keys: tuple[str, ...]


def _check_together(rig: Rig, source: str) -> None:
    """Keys that are each possible must give a tool that is: their time constants bound what a
    solver has to follow.
    """
    electrical = _electrical_figures(rig) if rig.input["kind"] != "current_a" else ()
    impact = _impact_figures(rig) if rig.mechanism["kind"] == "impact" else ()
    for figure in (*_mechanical_figures(rig), *electrical, *impact):
        if not figure.low <= figure.value <= figure.high:
            stated = ", ".join(f"{key} {rig.value(key):g}" for key in figure.keys)
            raise VgrooveError(
                f"{source}: {stated}: together they make {figure.words} {figure.value:.3g}, "
                f"which must be from {figure.low:g} to {figure.high:g}; is one of them in another unit?"
            )


def _check_joint_effects(rig: Rig, source: str) -> None:
    """An effect of a joint needs one that it can act on."""
    for effect, loads in ACTS_ON.items():
        if effect in rig.effects and rig.load["kind"] not in loads:
            raise VgrooveError(
                f"{source}: effects.{effect} acts on a load of kind {' or '.join(loads)}, not {rig.load['kind']}"
            )


def _check_impact_tool(rig: Rig, source: str) -> None:
    """Lugs that fit one another, a hammer that starts between them and rises above them: the
    plant's own conditions.
    """
    if rig.mechanism["kind"] == "impact":
        from vgroove import _core

        with refused_by_plant(source):
            _core.check_impact_tool(rig.parameters(), rig.load["kind"])


_MASSES = ("motor.inertia_kg_m2", "gearbox.output_inertia_kg_m2", "gearbox.ratio")


def _mechanical_figures(rig: Rig) -> list[Figure]:
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


def _electrical_figures(rig: Rig) -> list[Figure]:
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


def _impact_figures(rig: Rig) -> list[Figure]:
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
            RATE_MOST,
            ("mechanism.contact_stiffness_n_per_m", *lugs),
        ),
        Figure(
            "the rate of the contact's damping per s",
            m["contact_damping_n_s_per_m"] * lug,
            0.0,
            RATE_MOST,
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
                RATE_MOST,
                ("load.stiffness_nm_per_rad", anvil),
            ),
            Figure(
                "the rate of the joint's damping per s",
                decay,
                0.0,
                RATE_MOST,
                ("load.damping_nm_s_per_rad", anvil),
            ),
        ]
    return found


def _table(values: Any, source: str, where: str) -> dict[str, Any]:
    if not isinstance(values, Mapping):
        raise VgrooveError(f"{source}: {where} must be a section, not {values!r}")
    return dict(values)


def _no_unknown(values: Mapping[str, Any], known: Any, source: str, prefix: str) -> None:
    for key in values:
        if key not in known:
            near = difflib.get_close_matches(str(key), [str(k) for k in known], n=1, cutoff=0.0)
            raise VgrooveError(
                f"{source}: unknown key {prefix}{key}; the nearest known one is {prefix}{near[0]}"
                if near
                else f"{source}: unknown key {prefix}{key}; there is none known here"
            )


def _section(values: Any, keys: Mapping[str, Key], source: str, where: str) -> dict[str, Any]:
    values = _table(values, source, where)
    _no_unknown(values, keys, source, where + ".")
    for name, key in keys.items():
        if name not in values and key.needed:
            raise VgrooveError(f"{source}: {where}.{name} is missing")
        if name in values and not key.holds(values[name]):
            raise VgrooveError(
                f"{source}: {where}.{name} must be {key.words}, not {values[name]!r}"
            )
    return values


def _kind_section(
    values: Any, kinds: Mapping[str, Mapping[str, Key]], source: str, where: str
) -> dict[str, Any]:
    values = _table(values, source, where)
    if values.get("kind") not in kinds:
        raise VgrooveError(
            f"{source}: {where}.kind must be one of {', '.join(kinds)}, not {values.get('kind')!r}"
        )
    return _section(values, {"kind": _choice(*kinds), **kinds[values["kind"]]}, source, where)


def _check_tolerance(rig: Rig, source: str) -> None:
    keys = {f"{s}.{k}" for s in ("supply", "bridge", "motor", "gearbox") for k in SECTIONS[s]}
    keys |= {f"{s}.{k}" for s in KINDS for k in KINDS[s][getattr(rig, s)["kind"]]}
    _no_unknown(rig.tolerance, sorted(keys), source, "tolerance.")
    for key, value in rig.tolerance.items():
        if not SIGMA.holds(value):
            raise VgrooveError(f"{source}: tolerance.{key} must be {SIGMA.words}, not {value!r}")
