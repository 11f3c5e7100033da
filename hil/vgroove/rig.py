"""Rigs: what the simulation believes about a tool, as TOML (gap contract, section 2), read strictly and turned into parameters."""

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

from vgroove.errors import VgrooveError
from vgroove.output import write_text

SCHEMA = "vgroove.rig/1"
DEFAULTS = {"supply.resistance_ohm": 0.0, "bridge.pwm_hz": 20000.0, "load.zero_rad": 0.0}
PLANT_SECTIONS = ("supply", "bridge", "motor", "gearbox", "load")


@dataclass(frozen=True)
class Key:
    """One key of a rig: what its value must satisfy, in words and as a test, and whether the section needs it."""

    words: str
    holds: Callable[[Any], bool]
    needed: bool = True


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _number(words: str, holds: Callable[[float], bool], needed: bool = True) -> Key:
    return Key(words, lambda v: _is_number(v) and holds(v), needed)


def _whole(words: str, holds: Callable[[int], bool], needed: bool = True) -> Key:
    return Key(words, lambda v: isinstance(v, int) and not isinstance(v, bool) and holds(v), needed)


def _choice(*names: str, needed: bool = True) -> Key:
    return Key("one of " + ", ".join(names), lambda v: v in names, needed)


ANY = _number("a finite number", lambda v: True)
POSITIVE = _number("a number above 0", lambda v: v > 0)
NOT_NEGATIVE = _number("a number of at least 0", lambda v: v >= 0)
RELATIVE = _number("a number above -1", lambda v: v > -1)
MAY_BE = _number("a finite number", lambda v: True, needed=False)
MAY_BE_POSITIVE = _number("a number above 0", lambda v: v > 0, needed=False)
MAY_BE_NOT_NEGATIVE = _number("a number of at least 0", lambda v: v >= 0, needed=False)
COUNT = _whole("a whole number above 0", lambda v: v > 0)

SECTIONS: dict[str, dict[str, Key]] = {
    "input": {"kind": _choice("duty", "voltage_v", "current_a"), "slew_per_s": MAY_BE_POSITIVE,
              "bus": _choice("modelled", "measured", needed=False)},
    "supply": {"voltage_v": MAY_BE_POSITIVE, "resistance_ohm": MAY_BE_NOT_NEGATIVE},
    "bridge": {"pwm_hz": MAY_BE_POSITIVE},
    "motor": {"resistance_ohm": POSITIVE, "inductance_h": POSITIVE, "torque_constant_nm_per_a": POSITIVE, "inertia_kg_m2": POSITIVE,
              "viscous_nm_s_per_rad": NOT_NEGATIVE, "coulomb_nm": NOT_NEGATIVE},
    "gearbox": {"ratio": POSITIVE, "output_inertia_kg_m2": NOT_NEGATIVE},
    "sensors": {"log_hz": MAY_BE_POSITIVE, "current_noise_a": MAY_BE_NOT_NEGATIVE, "current_lsb_a": MAY_BE_NOT_NEGATIVE,
                "speed_noise_rpm": MAY_BE_NOT_NEGATIVE, "speed_lsb_rpm": MAY_BE_NOT_NEGATIVE,
                "hall_pulses_per_rev": _whole("a whole number of at least 0", lambda v: v >= 0, needed=False),
                "hall_timeout_s": MAY_BE_POSITIVE, "supply_noise_v": MAY_BE_NOT_NEGATIVE, "position_lsb_rad": MAY_BE_NOT_NEGATIVE},
}
_JOINT = {"stiffness_nm_per_rad": POSITIVE, "damping_nm_s_per_rad": NOT_NEGATIVE}
KINDS: dict[str, dict[str, dict[str, Key]]] = {
    "mechanism": {
        "none": {},
        "impact": {
            "hammer_inertia_kg_m2": POSITIVE, "hammer_mass_kg": POSITIVE, "groove_lead_m_per_rad": POSITIVE, "groove_radius_m": POSITIVE,
            "vertex_rad": NOT_NEGATIVE, "travel_rad": POSITIVE, "spring_preload_n": NOT_NEGATIVE, "spring_rate_n_per_m": POSITIVE,
            "lug_count": COUNT, "lug_height_m": POSITIVE, "lug_radius_m": POSITIVE, "lug_overlap_rad": POSITIVE,
            "contact_stiffness_n_per_m": POSITIVE, "contact_damping_n_s_per_m": NOT_NEGATIVE, "contact_ramp_m": POSITIVE,
            "anvil_inertia_kg_m2": POSITIVE, "hammer_start_rad": MAY_BE},
    },
    "load": {
        "none": {},
        "torque": {},
        "pendulum": {"mass_kg": POSITIVE, "length_m": POSITIVE, "zero_rad": MAY_BE},
        "hard_joint": {**_JOINT, "run_torque_nm": NOT_NEGATIVE, "slip_slope_nm_per_rad": NOT_NEGATIVE, "loosen_ratio": NOT_NEGATIVE},
        "disc_spring": {**_JOINT, "run_torque_nm": NOT_NEGATIVE, "parallel": COUNT, "series": COUNT, "friction": NOT_NEGATIVE,
                        "from_turns": NOT_NEGATIVE},
        "wood_screw": {**_JOINT, "start_nm": NOT_NEGATIVE, "end_nm": POSITIVE, "turns": POSITIVE, "seat_nm": POSITIVE, "seat_deg": POSITIVE,
                       "stripped_ratio": NOT_NEGATIVE, "from_turns": NOT_NEGATIVE, "loosen_ratio": NOT_NEGATIVE},
    },
}
_PROBABILITY = _number("a number between 0 and 1", lambda v: 0 <= v <= 1)
_SKEW = _number("a number within +-0.05", lambda v: abs(v) <= 0.05)
EFFECTS: dict[str, dict[str, Key]] = {
    "supply_resistance": {"resistance_ohm": ANY},
    "supply_droop": {"volt_per_coulomb": ANY, "polarisation_ohm": ANY, "polarisation_s": POSITIVE},
    "dead_time": {"dead_time_s": ANY},
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
    "coupler_compliance": {"stiffness_nm_per_rad": POSITIVE, "damping_ratio": NOT_NEGATIVE, "inertia_kg_m2": NOT_NEGATIVE},
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
    "speed_lag": {"time_constant_s": NOT_NEGATIVE, "form": _choice("filter", "delay", needed=False)},
    "hall_eccentricity": {"amplitude_rad": ANY, "phase_rad": MAY_BE},
    "hall_dropout": {"probability": _PROBABILITY},
    "supply_gain": {"relative": RELATIVE},
    "transport_delay": {"delay_s": NOT_NEGATIVE},
    "clock_skew": {"relative": _SKEW, "clock": _choice("logger", "command", needed=False)},
}
# Words in a rig that are numbers in the parameter vector: (effect, key) -> (parameter, word that reads 1).
WORDS = {("speed_lag", "form"): ("effects.speed_lag.delay_form", "delay"),
         ("clock_skew", "clock"): ("effects.clock_skew.command_clock", "command")}


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

    def value(self, key: str) -> float:
        """Value of a dotted key such as motor.resistance_ohm, the default where the file leaves it out; KeyError for an unknown one."""
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
        data.setdefault("effects", {}).update({name: dict(values) for name, values in effects.items()})
        return rig_from_dict(data, "the changed rig")

    def parameters(self) -> np.ndarray:
        """The plant's parameter vector (P,) in the order of vgroove._core.PARAMETERS, effects of the rig included."""
        from vgroove import _core

        theta = np.array(_core.parameter_defaults(), dtype=float)
        position = {name: i for i, name in enumerate(_core.PARAMETERS)}
        for key, value in self._flat().items():
            if key in position:
                theta[position[key]] = value
            elif key.startswith("effects."):
                raise VgrooveError(f"the plant of a tool without impact mechanism has no {key}")
        return theta

    def _flat(self) -> dict[str, float]:
        flat = {f"{s}.{k}": v for s in PLANT_SECTIONS for k, v in getattr(self, s).items() if _is_number(v)}
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
        for section in ("input", "supply", "bridge", "motor", "gearbox", "mechanism", "load", "sensors", "tolerance", "effects"):
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
    """Read and validate a rig; VgrooveError with the file, the key and the nearest known one for anything the contract does not allow."""
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
    sections["effects"] = {e: _section(values, EFFECTS[e], source, f"effects.{e}") for e, values in effects.items()}
    rig = Rig(**sections, tolerance=_table(data.get("tolerance", {}), source, "tolerance"), name=data.get("name"))
    _check_tolerance(rig, source)
    if rig.input["kind"] == "duty" and not rig.bus_is_measured and "voltage_v" not in rig.supply:
        raise VgrooveError(f"{source}: supply.voltage_v is missing: duty as input and a modelled bus need the open-circuit voltage")
    return rig


def _table(values: Any, source: str, where: str) -> dict[str, Any]:
    if not isinstance(values, Mapping):
        raise VgrooveError(f"{source}: {where} must be a section, not {values!r}")
    return dict(values)


def _no_unknown(values: Mapping[str, Any], known: Any, source: str, prefix: str) -> None:
    for key in values:
        if key not in known:
            near = difflib.get_close_matches(str(key), [str(k) for k in known], n=1, cutoff=0.0)
            raise VgrooveError(f"{source}: unknown key {prefix}{key}; the nearest known one is {prefix}{near[0]}" if near
                               else f"{source}: unknown key {prefix}{key}; there is none known here")


def _section(values: Any, keys: Mapping[str, Key], source: str, where: str) -> dict[str, Any]:
    values = _table(values, source, where)
    _no_unknown(values, keys, source, where + ".")
    for name, key in keys.items():
        if name not in values and key.needed:
            raise VgrooveError(f"{source}: {where}.{name} is missing")
        if name in values and not key.holds(values[name]):
            raise VgrooveError(f"{source}: {where}.{name} must be {key.words}, not {values[name]!r}")
    return values


def _kind_section(values: Any, kinds: Mapping[str, Mapping[str, Key]], source: str, where: str) -> dict[str, Any]:
    values = _table(values, source, where)
    if values.get("kind") not in kinds:
        raise VgrooveError(f"{source}: {where}.kind must be one of {', '.join(kinds)}, not {values.get('kind')!r}")
    return _section(values, {"kind": _choice(*kinds), **kinds[values["kind"]]}, source, where)


def _check_tolerance(rig: Rig, source: str) -> None:
    keys = {f"{s}.{k}" for s in ("supply", "bridge", "motor", "gearbox") for k in SECTIONS[s]}
    keys |= {f"{s}.{k}" for s in KINDS for k in KINDS[s][getattr(rig, s)["kind"]]}
    _no_unknown(rig.tolerance, sorted(keys), source, "tolerance.")
    for key, value in rig.tolerance.items():
        if not NOT_NEGATIVE.holds(value):
            raise VgrooveError(f"{source}: tolerance.{key} must be {NOT_NEGATIVE.words}, not {value!r}")
