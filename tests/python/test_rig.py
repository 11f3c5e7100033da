"""Rigs: what the specification allows is read, written back the same and turned into parameters;
everything else is refused by name.
"""

import copy
import json
import re
import tomllib
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest
import tomli_w

from made_log import RIG
from vgroove import _core
from vgroove.errors import VgrooveError
from vgroove.gap.catalogue import CATALOGUE, LOADS
from vgroove.rig import read_rig, rig_from_dict, write_rig
from vgroove.rig_keys import EFFECTS, KINDS, SECTIONS

ROOT = Path(__file__).resolve().parents[2]

SPECIFICATION = ROOT / "docs/spec/gap.md"
SCHEMA = json.loads((ROOT / "hil/vgroove/data/rig.schema.json").read_text())
VALIDATOR = jsonschema.validators.validator_for(SCHEMA)(SCHEMA)


def refused(change: dict, *words: str) -> None:
    """The rig with dotted keys changed (None: left out) is refused with a sentence that holds the
    words.
    """
    data = copy.deepcopy(RIG)
    for key, value in change.items():
        *path, last = key.split("/")
        place = data
        for name in path:
            place = place.setdefault(name, {})
        if value is None:
            del place[last]
        else:
            place[last] = value
    with pytest.raises(VgrooveError) as error:
        rig_from_dict(data, "x.toml")
    for word in ("x.toml", *words):
        assert word in str(error.value)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"schema": None}, ["vgroove.rig/1"]),
        ({"schema": "vgroove.rig/2"}, ["vgroove.rig/1"]),
        ({"motr": {}}, ["motr", "motor"]),
        ({"motor/resistance_omh": 0.2}, ["motor.resistance_omh", "motor.resistance_ohm"]),
        ({"input/slew_per_sec": 6.0}, ["input.slew_per_sec", "input.slew_per_s"]),
        ({"sensors/hall_pulses": 4}, ["sensors.hall_pulses", "sensors.hall_pulses_per_rev"]),
        (
            {"effects/coulomb_frction": {"torque_nm": 0.1}},
            ["effects.coulomb_frction", "effects.coulomb_friction"],
        ),
        (
            {"effects/coulomb_friction": {"torque": 0.1}},
            ["effects.coulomb_friction.torque", "torque_nm"],
        ),
        (
            {"effects/supply_droop": {"volt_per_coulomb": 0.1, "polarisation_s": 1.0}},
            ["effects.supply_droop.polarisation_ohm", "missing"],
        ),
        (
            {"effects/speed_lag": {"time_constant_s": 0.01, "form": "box"}},
            ["effects.speed_lag.form", "filter, delay, mean"],
        ),
        ({"effects/clock_skew": {"relative": 0.06}}, ["effects.clock_skew.relative", "0.05"]),
        ({"effects/hall_dropout": {"probability": 1.5}}, ["effects.hall_dropout.probability"]),
        ({"tolerance/motor.resistance": 0.02}, ["motor.resistance", "motor.resistance_ohm"]),
        (
            {"tolerance/motor.resistance_ohm": -0.02},
            ["tolerance.motor.resistance_ohm", "from 0 to 1"],
        ),
        ({"tolerance/load.mass_kg": 0.02}, ["load.mass_kg"]),
        ({"motor/inertia_kg_m2": 0.0}, ["motor.inertia_kg_m2", "from 1e-11 to 10000", "not 0.0"]),
        ({"motor/resistance_ohm": -0.1}, ["motor.resistance_ohm"]),
        (
            {"motor/viscous_nm_s_per_rad": -1e-9},
            ["motor.viscous_nm_s_per_rad", "from 0 to 100000", "not -1e-09"],
        ),
        ({"motor/inductance_h": float("nan")}, ["motor.inductance_h"]),
        ({"motor/inductance_h": float("inf")}, ["motor.inductance_h"]),
        ({"motor/coulomb_nm": True}, ["motor.coulomb_nm"]),
        ({"motor/coulomb_nm": "0.01"}, ["motor.coulomb_nm"]),
        ({"motor/coulomb_nm": None}, ["motor.coulomb_nm", "missing"]),
        ({"motor": None}, ["[motor]", "missing"]),
        ({"load": None}, ["[load]", "missing"]),
        ({"motor": 3}, ["motor", "section"]),
        ({"name": 3}, ["name"]),
        ({"gearbox/ratio": 0}, ["gearbox.ratio"]),
        ({"input/kind": "torque"}, ["input.kind", "duty, voltage_v, current_a"]),
        ({"input/bus": "guessed"}, ["input.bus", "modelled, measured"]),
        ({"input/slew_per_s": 0.0}, ["input.slew_per_s"]),
        ({"supply/voltage_v": 0.0}, ["supply.voltage_v"]),
        ({"supply": None}, ["supply.voltage_v", "missing"]),
        ({"sensors/hall_pulses_per_rev": 4.5}, ["sensors.hall_pulses_per_rev", "whole"]),
        ({"sensors/current_noise_a": -0.1}, ["sensors.current_noise_a"]),
        ({"mechanism/kind": "hammer"}, ["mechanism.kind", "none, impact"]),
        ({"mechanism/kind": "impact"}, ["mechanism.hammer_inertia_kg_m2", "missing"]),
        ({"load/kind": "pendulum"}, ["load.mass_kg", "missing"]),
        ({"load/kind": "lever"}, ["load.kind"]),
        ({"load/mass_kg": 0.3}, ["load.mass_kg"]),
        (
            {"motor/resistance_ohm": 1e9},
            ["motor.resistance_ohm", "from 0.0001 to 10000", "not 1000000000.0"],
        ),
        ({"motor/inertia_kg_m2": 1e-30}, ["motor.inertia_kg_m2", "1e-30"]),
        ({"motor/inductance_h": 1e-30}, ["motor.inductance_h", "1e-30"]),
        (
            {"tolerance/motor.resistance_ohm": 2},
            ["tolerance.motor.resistance_ohm", "from 0 to 1", "not 2"],
        ),
        ({"motor/inertia_kg_m2": 160}, ["motor.inertia_kg_m2 160", "J R / k^2"]),  # g cm2
        ({"motor/resistance_ohm": 190}, ["motor.resistance_ohm 190", "L / R"]),  # mOhm
        ({"motor/inductance_h": 0.1}, ["motor.inductance_h 0.1", "L / R"]),  # mH
        ({"motor/inductance_h": 100}, ["motor.inductance_h", "not 100"]),  # uH
        # mN m/A
        (
            {"motor/torque_constant_nm_per_a": 10.9},
            ["motor.torque_constant_nm_per_a 10.9", "J R / k^2"],
        ),
        (
            {"motor/coulomb_nm": 12},
            ["motor.coulomb_nm 12", "stall torque 11.6", "from 0 to 1"],
        ),  # mN m
        # mOhm
        (
            {"supply/resistance_ohm": 100},
            ["supply.resistance_ohm 100", "pack resistance over winding resistance"],
        ),
        ({"supply/voltage_v": 18500}, ["supply.voltage_v", "not 18500"]),  # mV
        ({"motor/viscous_nm_s_per_rad": 4.5}, ["motor.viscous_nm_s_per_rad 4.5", "J / b"]),
        (
            {"effects/added_inertia": {"kg_m2": -2e-5}},
            ["inertia at the motor", "motor.inertia_kg_m2 1.6e-05"],
        ),
    ],
)
def test_refused(change: dict, words: list[str]) -> None:
    refused(change, *words)


def edges() -> list[tuple[str, float, float]]:
    """Every key of a rig that is a number within a range, with the range its refusal names."""
    found = []
    for section, keys in SECTIONS.items():
        for name, key in keys.items():
            if match := re.search(r"number from (\S+) to (\S+)$", key.words):
                found.append((f"{section}/{name}", float(match[1]), float(match[2])))
    return found


@pytest.mark.parametrize(("key", "low", "high"), edges())
def test_just_outside_a_range_is_refused_and_just_inside_is_the_keys_own_business(
    key: str, low: float, high: float
) -> None:
    whole = key.endswith("hall_pulses_per_rev")
    words = [
        key.replace("/", "."),
        f"from {int(low) if whole else f'{low:g}'} to {int(high) if whole else f'{high:g}'}",
    ]
    refused({key: int(low) - 1 if whole else low - max(abs(low), 1e-12) * 1e-6}, *words)
    refused({key: int(high) + 1 if whole else high * 1.000001}, *words)
    section, name = key.split("/")
    for value in (low, high):
        assert SECTIONS[section][name].holds(int(value) if whole else value)


# Makers' figures, rounded: supply V, winding ohm and H, N m/A, rotor kg m2.
MOTORS = {
    "coreless 6 mm, 0.3 W": (3.0, 8.8, 29e-6, 1.8e-3, 5e-10),
    "coreless 8 mm, 0.5 W": (12.0, 204.0, 1.5e-3, 8.6e-3, 3e-9),
    "toy 130 class, 1 W": (3.0, 1.0, 3e-4, 2.3e-3, 6e-8),
    "graphite brushes, 150 W": (24.0, 0.317, 8.2e-5, 0.0302, 1.42e-5),
    "775 class, 250 W": (18.5, 0.19, 1e-4, 0.0109, 1.6e-5),
    "disc armature, 1 kW": (60.0, 0.3, 5e-5, 0.12, 5e-4),
    "starter, 2 kW": (12.0, 0.012, 3e-5, 0.012, 2e-3),
    "golf cart, 5 kW": (48.0, 0.02, 8e-5, 0.12, 0.03),
    "traction, 10 kW": (96.0, 0.014, 1.2e-4, 0.21, 0.06),
    "mill, 400 kW": (600.0, 0.03, 1e-3, 5.0, 40.0),
}


@pytest.mark.parametrize("name", MOTORS)
@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_motors_of_every_size_pass(name: str, scale: float) -> None:
    voltage, resistance, inductance, k, inertia = MOTORS[name]
    stall = k * voltage / resistance
    motor = {
        "resistance_ohm": resistance,
        "inductance_h": inductance * scale,
        "torque_constant_nm_per_a": k,
        "inertia_kg_m2": inertia / scale,
        "viscous_nm_s_per_rad": 0.01 * stall * k / voltage,
        "coulomb_nm": 0.05 * stall * scale,
    }
    data = {
        **copy.deepcopy(RIG),
        "motor": motor,
        "supply": {"voltage_v": voltage, "resistance_ohm": 0.2 * resistance},
    }
    data["gearbox"] = {"ratio": 1.0, "output_inertia_kg_m2": inertia}
    assert rig_from_dict(data, "x").motor == motor


@pytest.mark.parametrize(
    ("inductance_h", "passes"), [(1e-8, True), (1e-6, True), (2e-6, True), (2.1e-6, False)]
)
def test_an_inductance_too_small_for_a_motor_stands_for_an_unknown_one(
    inductance_h: float, passes: bool
) -> None:
    """Beside 5 ohm all of them have a time constant below 1 us; the last one may be of a motor
    whose resistance is stated in milliohm.
    """
    data = copy.deepcopy(RIG)
    data["motor"] |= {"inductance_h": inductance_h, "resistance_ohm": 5.0}
    data["motor"]["torque_constant_nm_per_a"] = 0.5
    if passes:
        assert rig_from_dict(data, "x").motor["inductance_h"] == inductance_h
    else:
        with pytest.raises(VgrooveError, match="motor.inductance_h"):
            rig_from_dict(data, "x")


@pytest.mark.parametrize(("inertia_kg_m2", "passes"), [(7e-10, True), (5e-10, False)])
def test_most_of_an_inertia_may_be_missing(inertia_kg_m2: float, passes: bool) -> None:
    """0.19 ohm and 0.0109 N m/A: a run-up of 1 us at 6.25e-10 kg m2."""
    data = copy.deepcopy(RIG)
    data["motor"] |= {"inertia_kg_m2": inertia_kg_m2, "viscous_nm_s_per_rad": 0.0}
    data["gearbox"] = {"ratio": 1.0, "output_inertia_kg_m2": 0.0}
    if passes:
        assert rig_from_dict(data, "x").motor["inertia_kg_m2"] == inertia_kg_m2
    else:
        with pytest.raises(VgrooveError, match="run-up"):
            rig_from_dict(data, "x")


@pytest.mark.parametrize("kind", ["current_a", "voltage_v"])
def test_a_linear_axis_passes(kind: str) -> None:
    """95 kg read as kg m2, 35 N/V as N m/A, 204 N s/m, 20 N; and a current as input leaves the
    winding's numbers alone.
    """
    data = copy.deepcopy(RIG)
    data["input"] = {"kind": kind}
    data["motor"] = {
        "resistance_ohm": 1.0,
        "inductance_h": 1e-3,
        "torque_constant_nm_per_a": 35.15,
        "inertia_kg_m2": 95.1,
        "viscous_nm_s_per_rad": 203.5,
        "coulomb_nm": 20.4,
    }
    data["gearbox"] = {"ratio": 1.0, "output_inertia_kg_m2": 1e-9}
    assert rig_from_dict(data, "x")
    data["motor"]["torque_constant_nm_per_a"] = 0.01  # J R / k^2 would be 1e6 s
    if kind == "current_a":
        assert rig_from_dict(data, "x")
    else:
        with pytest.raises(VgrooveError, match="run-up"):
            rig_from_dict(data, "x")


def test_a_heavy_pendulum_passes() -> None:
    """It swings and does not run up: its inertia is part of the shaft's, but of no time constant
    that is checked. That of an impact tool hangs on the anvil.
    """
    data = copy.deepcopy(RIG)
    data["load"] = {"kind": "pendulum", "mass_kg": 1e5, "length_m": 100.0, "zero_rad": 0.0}
    found = rig_from_dict(data, "the test's rig")
    of_drive = data["motor"]["inertia_kg_m2"] + (
        data["gearbox"]["output_inertia_kg_m2"] / data["gearbox"]["ratio"] ** 2
    )
    assert found.drive_inertia_kg_m2 == pytest.approx(of_drive)
    pendulum = 1e9 / data["gearbox"]["ratio"] ** 2
    assert found.shaft_inertia_kg_m2 == pytest.approx(of_drive + pendulum)
    hammering = replace(found, mechanism={"kind": "impact"})
    assert hammering.shaft_inertia_kg_m2 == pytest.approx(of_drive)


def test_files_that_are_not_rigs_are_refused(tmp_path: Path) -> None:
    bad = {"none.toml": None, "text.toml": b"motor = [", "binary.toml": b"\xff\xfe\x00"}
    for name, content in bad.items():
        if content is not None:
            (tmp_path / name).write_bytes(content)
        with pytest.raises(VgrooveError, match=re.escape(name)):
            read_rig(tmp_path / name)


def test_a_measured_bus_needs_no_voltage() -> None:
    data = copy.deepcopy(RIG)
    del data["supply"]
    data["input"]["bus"] = "measured"
    assert rig_from_dict(data, "x").bus_is_measured


def test_parameters_are_the_rig_in_the_plants_order() -> None:
    data = copy.deepcopy(RIG)
    data["effects"] = {
        "coulomb_friction": {"torque_nm": 0.004},
        "speed_lag": {"time_constant_s": 0.002, "form": "delay"},
        "clock_skew": {"relative": 0.01, "clock": "logger"},
    }
    theta = dict(zip(_core.PARAMETERS, rig_from_dict(data, "x").parameters(), strict=True))
    neutral = dict(zip(_core.PARAMETERS, _core.parameter_defaults(), strict=True))
    stated = {
        f"{s}.{k}": v for s in ("supply", "bridge", "motor", "gearbox") for k, v in RIG[s].items()
    }
    stated |= {
        "effects.coulomb_friction.torque_nm": 0.004,
        "effects.speed_lag.time_constant_s": 0.002,
        "effects.speed_lag.lag_form": 1.0,
        "effects.clock_skew.relative": 0.01,
    }
    assert theta == {**neutral, **stated}


def test_every_parameter_of_the_plant_is_a_key_of_a_rig() -> None:
    known = {f"{s}.{k}" for s, keys in SECTIONS.items() for k in keys}
    known |= {f"{s}.{k}" for s, kinds in KINDS.items() for keys in kinds.values() for k in keys}
    known |= {f"effects.{e}.{k}" for e, keys in EFFECTS.items() for k in keys}
    known |= {effect.flag_name for effect in CATALOGUE if effect.form}
    known |= {f"load.{load.form.flag}" for load in LOADS.values() if load.form}
    assert set(_core.PARAMETERS) <= known


def test_an_effect_of_the_impact_mechanism_needs_one() -> None:
    data = {**copy.deepcopy(RIG), "effects": {"lug_wear": {"height_m": 1e-3}}}
    with pytest.raises(VgrooveError, match="lug_wear"):
        rig_from_dict(data, "x").parameters()


@pytest.mark.parametrize(
    ("effect", "values", "kind"),
    [
        ("joint_hysteresis", {"relative": 0.3}, "hard_joint"),
        ("thread_friction", {"relative": 0.3}, "locked"),
        ("wood_knot", {"torque_nm": 2.0, "from_rad": 0.0, "to_rad": 1.0}, "locked"),
        ("joint_stiffness", {"relative": 0.1}, "torque"),
    ],
)
def test_an_effect_of_a_joint_needs_one_that_it_acts_on(
    effect: str, values: dict, kind: str
) -> None:
    tool = read_rig(ROOT / "rigs" / "impact_driver.toml")
    keys = (
        {"stiffness_nm_per_rad", "damping_nm_s_per_rad"}
        if kind == "locked"
        else set(tool.load)
        if kind == "hard_joint"
        else set()
    )
    load = {key: value for key, value in tool.load.items() if key in keys} | {"kind": kind}
    with pytest.raises(
        VgrooveError, match=f"effects.{effect} acts on a load of kind .*, not {kind}"
    ):
        rig_from_dict(tool.as_dict() | {"load": load, "effects": {effect: values}}, "a rig")
    assert (
        rig_from_dict(tool.as_dict() | {"load": load, "effects": {}}, "a rig").load["kind"] == kind
    )


def test_changed_rigs_come_back_from_their_file(tmp_path: Path) -> None:
    rig = rig_from_dict({**copy.deepcopy(RIG), "tolerance": {"motor.resistance_ohm": 0.02}}, "x")
    changed = rig.with_values({"motor.resistance_ohm": 0.2}).with_effects(
        {"cogging_torque": {"torque_nm": 0.01, "periods_per_rev": 6.0}}
    )
    write_rig(changed, tmp_path / "out.toml")
    back = read_rig(tmp_path / "out.toml")
    assert back == changed and back != rig
    assert back.value("motor.resistance_ohm") == 0.2 and back.value("supply.resistance_ohm") == 0.0
    assert rig.motor["resistance_ohm"] == 0.19
    assert not np.array_equal(rig.parameters(), back.parameters())
    with pytest.raises(VgrooveError, match="motor.resistance_ohm"):
        rig.with_values({"motor.resistance_ohm": -1.0})


def specified_rigs() -> list[dict]:
    """Every complete rig in the specification; a lone load is put into the impact rig."""
    blocks = [
        tomllib.loads(text)
        for text in re.findall(r"```toml\n(.*?)```", SPECIFICATION.read_text(), re.S)
    ]
    impact = next(b for b in blocks if b.get("mechanism", {}).get("kind") == "impact")
    return [b if "schema" in b else {**impact, **b} for b in blocks]


def test_rigs_of_the_specification_of_the_data_and_of_the_tree_are_read_and_pass_the_schema(
    tmp_path: Path,
) -> None:
    paths = [*sorted((ROOT / "tests/data").rglob("rig.toml")), *sorted((ROOT / "rigs").iterdir())]
    rigs = specified_rigs() + [tomllib.loads(path.read_text()) for path in paths]
    assert len(rigs) >= 5 + 13 + 7
    VALIDATOR.check_schema(SCHEMA)
    for data in rigs:
        VALIDATOR.validate(data)
        rig = rig_from_dict(data, "x")
        write_rig(rig, tmp_path / "rig.toml")
        assert read_rig(tmp_path / "rig.toml") == rig
        VALIDATOR.validate(tomllib.loads((tmp_path / "rig.toml").read_text()))


RULES = {
    "true or false": {"type": "boolean"},
    "a finite number": {"type": "number"},
    "a number above 0": {"type": "number", "exclusiveMinimum": 0},
    "a number of at least 0": {"type": "number", "minimum": 0},
    "a number above -1": {"type": "number", "exclusiveMinimum": -1},
    "a number between 0 and 1": {"type": "number", "minimum": 0, "maximum": 1},
    "a number within +-0.05": {"type": "number", "minimum": -0.05, "maximum": 0.05},
}


def rule(words: str) -> dict:
    """What the schema says of a value that must satisfy these words."""
    if match := re.fullmatch(r"a (whole )?number from (\S+) to (\S+)", words):
        kind = "integer" if match[1] else "number"
        return {"type": kind, "minimum": float(match[2]), "maximum": float(match[3])}
    if words.startswith("one of "):
        return {"enum": words.removeprefix("one of ").split(", ")}
    return RULES[words]


def test_keys_needs_and_ranges_are_the_schemas() -> None:
    schema = copy.deepcopy(SCHEMA["properties"])
    pairs = [(keys, schema[name]) for name, keys in SECTIONS.items()]
    pairs += [(EFFECTS[name], option) for name, option in schema["effects"]["properties"].items()]
    for name, kinds in KINDS.items():
        options = {o["properties"]["kind"].pop("const"): o for o in schema[name]["oneOf"]}
        assert options.keys() == kinds.keys()
        for kind, option in options.items():
            assert option["properties"].pop("kind") == {} and option["required"].pop(0) == "kind"
            pairs.append((kinds[kind], option))
    assert schema["effects"]["properties"].keys() == EFFECTS.keys()
    for keys, option in pairs:
        assert not option["additionalProperties"]
        assert {k: rule(key.words) for k, key in keys.items()} == option["properties"]
        assert [k for k, key in keys.items() if key.needed] == option["required"]


def test_the_specification_names_each_key_and_range() -> None:
    text = SPECIFICATION.read_text()
    sections = [*SECTIONS.values(), *(keys for kinds in KINDS.values() for keys in kinds.values())]
    for name, key in ((name, key) for keys in sections for name, key in keys.items()):
        lines = [line for line in text.splitlines() if re.search(rf"\b{name}`", line)]
        assert lines, name
        if match := re.search(r"number from (\S+) to (\S+)$", key.words):
            assert any(f"{match[1]}..{match[2]}" in line for line in lines), (name, key.words)
    for effect, keys in EFFECTS.items():
        needed = ", ".join(name for name, key in keys.items() if key.needed)
        assert f"`{effect}` [{needed}]" in text


def test_our_own_rigs_are_read() -> None:
    paths = sorted((ROOT / "rigs").glob("*.toml"))
    assert paths
    for path in paths:
        assert tomli_w.dumps(read_rig(path).as_dict())
