"""Rigs: what the simulation assumes about a tool, as TOML (docs/spec/gap.md, section 2), validated
and turned into parameters of the plant.
"""

import copy
import difflib
import tomllib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from vgroove.errors import VgrooveError
from vgroove.gap.catalogue import BY_ID, LOADS, Form
from vgroove.gap.catalogue.keys import Key, choice
from vgroove.output import write_text
from vgroove.rig_checks import check_tool
from vgroove.rig_keys import EFFECTS, KINDS, SECTIONS, TOLERANCE, TOLERATED_SECTIONS

SCHEMA = "vgroove.rig/1"
DEFAULTS = {"supply.resistance_ohm": 0.0, "bridge.pwm_hz": 20000.0, "load.zero_rad": 0.0}
PLANT_SECTIONS = ("supply", "bridge", "motor", "gearbox", "mechanism", "load")
REQUIRED_SECTIONS = ("input", "motor", "gearbox", "mechanism", "load")


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
    clip: dict[str, float] = field(default_factory=dict)
    name: str | None = None

    @property
    def bus_is_measured(self) -> bool:
        """Whether the supply_v column drives the model instead of being judged."""
        return self.input.get("bus", "modelled") == "measured"

    @property
    def stall_current_a(self) -> float | None:
        """Current in A that the supply drives through the winding at rest, by the resistance of the
        winding alone; None without a stated supply.
        """
        supply = self.supply.get("voltage_v")
        return None if supply is None else supply / self.motor["resistance_ohm"]

    @property
    def drive_inertia_kg_m2(self) -> float:
        """Inertia at the motor's shaft, the gearbox's output referred to it, without the load."""
        output = self.gearbox["output_inertia_kg_m2"]
        return self.motor["inertia_kg_m2"] + output / self.gearbox["ratio"] ** 2

    @property
    def shaft_inertia_kg_m2(self) -> float:
        """Total inertia referred to the motor's shaft: drive_inertia_kg_m2 plus that of a pendulum
        on the gearbox's output. The pendulum of an impact tool is on the anvil and not included.
        """
        if self.load["kind"] != "pendulum" or self.mechanism["kind"] != "none":
            return self.drive_inertia_kg_m2
        pendulum = self.load["mass_kg"] * self.load["length_m"] ** 2
        return self.drive_inertia_kg_m2 + pendulum / self.gearbox["ratio"] ** 2

    @property
    def back_emf_damping_nm_s_per_rad(self) -> float:
        """Damping k^2 / R of the shaft by the back-EMF where a voltage drives the motor
        (docs/spec/model.md, section 2).
        """
        return self.motor["torque_constant_nm_per_a"] ** 2 / self.motor["resistance_ohm"]

    @property
    def speed_time_constant_s(self) -> float:
        """Time constant in s of the shaft's speed: inertia over viscous damping, plus that by the
        back-EMF unless a current drives the motor; inf without both.
        """
        driven_by_current = self.input["kind"] == "current_a"
        braking = 0.0 if driven_by_current else self.back_emf_damping_nm_s_per_rad
        damping = self.motor["viscous_nm_s_per_rad"] + braking
        return self.shaft_inertia_kg_m2 / damping if damping > 0.0 else np.inf

    def value(self, key: str) -> float:
        """Value of a dotted key such as motor.resistance_ohm, the default where the file leaves it
        out; KeyError for an unknown one.
        """
        section, name = key.split(".", 1)
        values = getattr(self, section)
        return values[name] if name in values else DEFAULTS[key]

    def with_values(self, values: Mapping[str, float]) -> "Rig":
        """A copy with other values of dotted keys, validated again."""
        data = self.as_dict()
        for key, value in values.items():
            section, name = key.split(".", 1)
            data.setdefault(section, {})[name] = value
        return rig_from_dict(data, "the changed rig")

    def with_clip(self, clip: Mapping[str, float]) -> "Rig":
        """A copy that states where the residuals of a gap are clipped, in sigmas by column."""
        return replace(self, clip=dict(clip))

    @property
    def command_holds_after(self) -> bool:
        """Whether rows are instants: the command of a row holds from the row on."""
        return self.input.get("hold", "before") == "after"

    def with_effects(self, effects: Mapping[str, Mapping[str, Any]]) -> "Rig":
        """A copy with effects added or, where the rig has them already, replaced."""
        data = self.as_dict()
        data.setdefault("effects", {}).update(
            {name: dict(values) for name, values in effects.items()}
        )
        return rig_from_dict(data, "the changed rig")

    def parameters(self) -> np.ndarray:
        """The plant's parameter vector (P,) in the order of vgroove._core.PARAMETERS, with the
        effects of the rig; VgrooveError for a drill driver.
        """
        from vgroove import _core

        if self.mechanism["kind"] == "drill_driver":
            raise VgrooveError(
                f"{self.name or 'the rig'}: a drill driver cannot be simulated with the effects or "
                "the input of a log: use `vgroove sim`, `vgroove run` or `vgroove study steps`"
            )
        for effect in self.effects:
            if "impact" in BY_ID[effect].needs and self.mechanism["kind"] != "impact":
                raise VgrooveError(
                    f"the plant of a tool without impact mechanism has no effects.{effect}"
                )
        theta = np.array(_core.parameter_defaults(), dtype=float)
        position = {name: i for i, name in enumerate(_core.PARAMETERS)}
        for key, value in self._flat().items():
            if key in position:
                theta[position[key]] = value
            elif key.startswith("effects."):
                raise VgrooveError(
                    f"this build of the plant has no {key}: build it again with `make build`"
                )
        return theta

    def drill_parameters(self) -> dict[str, float]:
        """The drill driver's parameters by name, defaults for what the rig leaves out; VgrooveError
        for a rig of another tool, or one that states what the drill driver does not have.
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
                f"{name}: the drill driver needs a duty as input and a modelled bus, "
                f"not {self.input['kind']} and a {self.input.get('bus', 'modelled')} bus"
            )
        known = _core.drill_parameters()
        found = {key: value for key, value in self._flat().items() if key in known}
        if "slew_per_s" in self.input:
            found["drive.ramp_s"] = 1.0 / self.input["slew_per_s"]
        return known | found

    def _flat(self) -> dict[str, float]:
        """The rig's numbers by dotted key; the value of a form key as the plant's flag, 0 or 1."""
        flat = {}
        for section in PLANT_SECTIONS:
            form = LOADS[self.load["kind"]].form if section == "load" else None
            flat |= _numbers(section, getattr(self, section), form)
        for effect, values in self.effects.items():
            flat |= _numbers(f"effects.{effect}", values, BY_ID[effect].form)
        return flat

    def as_dict(self) -> dict[str, Any]:
        """The rig as the file states it, as a deep copy."""
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
            "clip",
        ):
            values = getattr(self, section)
            if values or section in ("mechanism", "load"):
                data[section] = copy.deepcopy(values)
        return data


def _numbers(where: str, values: Mapping[str, Any], form: Form | None) -> dict[str, float]:
    """Numbers of a table by dotted key; the flag of a form is the index of its word."""
    flat = {f"{where}.{k}": float(v) for k, v in values.items() if isinstance(v, int | float)}
    if form and form.key in values:
        flat[f"{where}.{form.flag}"] = float(form.words.index(values[form.key]))
    return flat


def read_toml(path: str | Path) -> dict[str, Any]:
    """The tables of a TOML file; VgrooveError says why it cannot be read."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise VgrooveError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise VgrooveError(f"{path}: is not a text file") from error
    except ValueError as error:
        raise VgrooveError(f"{path!r}: is no path: {error}") from error
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise VgrooveError(f"{path}: is not TOML: {error}") from error


def read_rig(path: str | Path) -> Rig:
    """Read and validate a rig; VgrooveError with the file, the key and the nearest known one for
    anything that docs/spec/gap.md, section 2, does not allow.
    """
    return rig_from_dict(read_toml(path), str(path))


def read_joints(paths: Sequence[str | Path], rig: Rig, logs: int) -> list[Rig]:
    """The rig with the [load] of each file, in the order of the logs; empty without files.
    VgrooveError where there are not as many as logs, a file holds anything else, or the tool does
    not hammer.
    """
    if not paths:
        return []
    if rig.mechanism["kind"] != "impact":
        raise VgrooveError('--joint: only a rig with [mechanism] kind = "impact" has a joint')
    if len(paths) != logs:
        raise VgrooveError(f"--joint: {len(paths)} for {logs} logs: give one for each log, or none")
    tools = []
    for path in paths:
        data = read_toml(path)
        if set(data) - {"schema", "name"} != {"load"}:
            raise VgrooveError(f"{path}: a joint is a file with the table [load] alone")
        kept = {k: v for k, v in rig.tolerance.items() if not k.startswith("load.")}
        same = _table(data["load"], str(path), "load").get("kind") == rig.load["kind"]
        table = rig.as_dict() | {"load": data["load"]}
        table["tolerance"] = rig.tolerance if same else kept
        tools.append(rig_from_dict(table, str(path)))
    return tools


def write_rig(rig: Rig, path: str | Path) -> None:
    """Write a rig, whole or not at all, so that read_rig gives the same one back."""
    write_text(path, tomli_w.dumps(rig.as_dict()))


def rig_from_dict(data: Mapping[str, Any], source: str) -> Rig:
    """The rig of a file's tables, validated; VgrooveError, whose message begins with `source`."""
    if data.get("schema") != SCHEMA:
        raise VgrooveError(f'{source}: schema must be "{SCHEMA}", not {data.get("schema")!r}')
    _no_unknown(data, ("schema", "name", *SECTIONS, *KINDS, "tolerance", "effects"), source, "")
    if not isinstance(data.get("name", ""), str):
        raise VgrooveError(f"{source}: name must be a text")
    sections = _sections(data, source)
    _check_missing(data, source)
    rig = Rig(
        **sections,
        tolerance=_table(data.get("tolerance", {}), source, "tolerance"),
        name=data.get("name"),
    )
    _check_tolerance(rig, source)
    check_tool(rig, source)
    return rig


def _sections(data: Mapping[str, Any], source: str) -> dict[str, dict[str, Any]]:
    """Every section of a rig but [tolerance], each key checked on its own."""
    sections = {s: _section(data[s], keys, source, s) for s, keys in SECTIONS.items() if s in data}
    kinds = {s: KINDS[s] for s in KINDS if s in data}
    sections |= {s: _kind_section(data[s], of, source, s) for s, of in kinds.items()}
    effects = _table(data.get("effects", {}), source, "effects")
    _no_unknown(effects, EFFECTS, source, "effects.")
    sections["effects"] = {
        e: _section(values, EFFECTS[e], source, f"effects.{e}") for e, values in effects.items()
    }
    return sections


def _missing_section(section: str) -> str:
    """A section that a rig lacks, with the keys that it needs."""
    known = {name: key for name, key in SECTIONS.get(section, {}).items() if key.needed}
    return f"the section [{section}] with {', '.join(known) or 'kind'}"


def _check_missing(data: Mapping[str, Any], source: str) -> None:
    """VgrooveError that names all sections and keys that a rig lacks."""
    missing = [_missing_section(s) for s in REQUIRED_SECTIONS if s not in data]
    needed = {s: keys for s, keys in SECTIONS.items() if s in data}
    needed |= {s: KINDS[s][data[s]["kind"]] for s in KINDS if s in data}
    needed |= {f"effects.{e}": EFFECTS[e] for e in data.get("effects", {})}
    for where, keys in needed.items():
        given = data["effects"][where[8:]] if where.startswith("effects.") else data[where]
        missing += [f"{where}.{k}" for k, key in keys.items() if key.needed and k not in given]
    given = data.get("input", {})
    modelled = given.get("kind") == "duty" and given.get("bus", "modelled") == "modelled"
    if modelled and "voltage_v" not in data.get("supply", {}):
        missing.append("supply.voltage_v (needed with duty and a modelled bus)")
    if missing:
        verb = "is" if len(missing) == 1 else "are"
        raise VgrooveError(f"{source}: {', '.join(missing)} {verb} missing")


def _table(values: Any, source: str, where: str) -> dict[str, Any]:
    if not isinstance(values, Mapping):
        raise VgrooveError(f"{source}: {where} must be a section, not {values!r}")
    return dict(values)


def _no_unknown(
    values: Mapping[str, Any], known: Collection[str], source: str, prefix: str
) -> None:
    for key in values:
        if key not in known:
            near = difflib.get_close_matches(str(key), [str(k) for k in known], n=1, cutoff=0.0)
            raise VgrooveError(
                f"{source}: unknown key {prefix}{key}; the nearest known one is {prefix}{near[0]}"
                if near
                else f"{source}: unknown key {prefix}{key}; no key is allowed here"
            )


def _section(values: Any, keys: Mapping[str, Key], source: str, where: str) -> dict[str, Any]:
    values = _table(values, source, where)
    _no_unknown(values, keys, source, where + ".")
    for name, key in keys.items():
        if name in values and not key.holds(values[name]):
            raise VgrooveError(
                f"{source}: {where}.{name} must be {key.words}, not {values[name]!r}"
            )
    return values


def _kind_section(
    values: Any, kinds: Mapping[str, Mapping[str, Key]], source: str, where: str
) -> dict[str, Any]:
    values = _table(values, source, where)
    kind = values.get("kind")
    if not isinstance(kind, str) or kind not in kinds:
        raise VgrooveError(
            f"{source}: {where}.kind must be one of {', '.join(kinds)}, not {kind!r}"
        )
    return _section(values, {"kind": choice(*kinds), **kinds[kind]}, source, where)


def _check_tolerance(rig: Rig, source: str) -> None:
    keys = {f"{s}.{k}" for s in TOLERATED_SECTIONS for k in SECTIONS[s]}
    keys |= {f"{s}.{k}" for s in KINDS for k in KINDS[s][getattr(rig, s)["kind"]]}
    _no_unknown(rig.tolerance, sorted(keys), source, "tolerance.")
    for key, value in rig.tolerance.items():
        if not TOLERANCE.holds(value):
            raise VgrooveError(
                f"{source}: tolerance.{key} must be {TOLERANCE.words}, not {value!r}"
            )
