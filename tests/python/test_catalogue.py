"""The catalogue of effects: entries are complete and consistent, and pages and rigs follow them."""

import json
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from gap_toy import SCALES
from vgroove import _core
from vgroove.gap.catalogue import (
    BY_ID,
    CATALOGUE,
    LOADS,
    NEEDS,
    OUTPUT_TURN,
    Effect,
    load_parameters,
)
from vgroove.gap.catalogue.listing import effect_rows, markdown_table
from vgroove.rig_keys import EFFECTS, KINDS

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "hil/vgroove/gap/catalogue"
BEGIN, END = "<!-- catalogue -->\n", "\n<!-- end catalogue -->"
TOOL = replace(SCALES, amp=30.0, torque=0.3, inertia=2e-5, motor_inertia=1.6e-5, supply_ohm=0.1)


@pytest.mark.parametrize("effect", CATALOGUE, ids=lambda e: e.id)
def test_an_entry_is_complete(effect: Effect) -> None:
    assert effect.equation and effect.parameters and set(effect.needs) <= set(NEEDS)
    assert set(effect.special_case_of) <= set(BY_ID) - {effect.id}
    assert {other for other, _ in effect.identical_to} <= set(BY_ID) - {effect.id}
    assert set(effect.loads) <= set(LOADS)
    assert set(effect.switch) <= {p.name for p in effect.own_parameters}
    if effect.periodic:
        names = {p.name for p in effect.parameters}
        assert effect.periodic.amplitude in names and "phase_rad" in names
        periods = effect.periodic.periods
        assert periods in names or periods == OUTPUT_TURN or isinstance(periods, float)


@pytest.mark.parametrize("effect", CATALOGUE, ids=lambda e: e.id)
def test_sizes_bounds_and_starts_fit_one_another(effect: Effect) -> None:
    for parameter in effect.parameters:
        size, low, high = (f(TOOL) for f in (parameter.size, parameter.low, parameter.high))
        assert size > 0.0 and low < high, parameter.name
        assert all(low <= start * size <= high for start in parameter.starts), parameter.name


def test_a_battery_loses_at_most_its_voltage() -> None:
    """Within a log, by discharge or by the slowest polarisation that is looked for; no search goes
    beyond.
    """
    by_charge, polarisation, time = BY_ID["supply_droop"].parameters
    assert {p.physical for p in (by_charge, polarisation)} == {"high"}
    lost_share = 1.0 - math.exp(-TOOL.duration / time.high(TOOL))
    assert polarisation.high(TOOL) * TOOL.amp * lost_share == pytest.approx(TOOL.volt, rel=0.03)
    share_of_amp = TOOL.volt / (by_charge.high(TOOL) * TOOL.duration * TOOL.amp)
    assert share_of_amp == pytest.approx(0.05)  # a mean current of a twentieth of the largest


@pytest.mark.parametrize("effect", CATALOGUE, ids=lambda e: e.id)
def test_a_rig_accepts_what_the_search_may_find(effect: Effect) -> None:
    for parameter in effect.own_parameters:
        middle = parameter.size(TOOL) * max(parameter.starts[0], 0.5)
        assert EFFECTS[effect.id][parameter.name].holds(middle), parameter.name
        assert not EFFECTS[effect.id][parameter.name].holds(math.inf)


def test_the_plant_has_the_parameters_of_effects_and_loads_with_their_neutral_values() -> None:
    plant = dict(zip(_core.PARAMETERS, map(float, _core.parameter_defaults()), strict=True))
    effects = {f"effects.{e.id}.{n}": v for e in CATALOGUE for n, v in e.flat.items()}
    loads = {f"load.{name}": value for name, value in load_parameters().items()}
    listed = {k: v for k, v in plant.items() if k.startswith(("effects.", "load."))}
    assert listed == effects | loads


def test_rigs_know_each_load_by_its_entry() -> None:
    assert {kind: set(keys) for kind, keys in KINDS["load"].items()} == {
        kind: set(load.rig_keys) for kind, load in LOADS.items()
    }


def test_two_loads_with_two_defaults_for_one_key_are_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from vgroove.gap.catalogue import loads

    other = [replace(key, default=1.0) for key in LOADS["wood_screw"].keys]
    monkeypatch.setitem(loads.LOADS, "again", replace(LOADS["wood_screw"], keys=tuple(other)))
    with pytest.raises(ValueError, match="two defaults"):
        loads.load_parameters()


def test_the_specification_shows_the_catalogue() -> None:
    page = (ROOT / "docs/spec/gap.md").read_text(encoding="utf-8")
    shown = page[page.index(BEGIN) + len(BEGIN) : page.index(END)]
    assert shown == markdown_table(), "write `vgroove effects --markdown` between the marks"


def test_the_command_lists_every_effect(tmp_path: Path) -> None:
    target = tmp_path / "effects.json"
    command = [sys.executable, "-m", "vgroove.cli", "effects", "--json", str(target)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert json.loads(target.read_text())["effects"] == json.loads(json.dumps(effect_rows()))
    assert all(f"  {effect.id} " in done.stdout for effect in CATALOGUE)


def test_the_command_shows_one_effect_and_refuses_an_unknown_one() -> None:
    command = [sys.executable, "-m", "vgroove.cli", "effects"]
    one = subprocess.run([*command, "coupler_compliance"], capture_output=True, text=True)
    assert one.returncode == 0 and "stiffness_nm_per_rad [N m/rad]: a number above 0" in one.stdout
    unknown = subprocess.run([*command, "friction"], capture_output=True, text=True)
    assert unknown.returncode == 2 and "no effect friction" in unknown.stderr


def test_the_package_is_importable_by_the_build_alone() -> None:
    """The plant's build imports it with the standard library only (-S: no site packages)."""
    code = "import catalogue; assert len(catalogue.CATALOGUE) > 40"
    subprocess.run(
        [sys.executable, "-S", "-c", code], cwd=PACKAGE.parent, check=True, capture_output=True
    )


@pytest.mark.parametrize("first", ["vgroove.rig", "vgroove.gap", "vgroove.gap.catalogue"])
def test_rigs_and_the_catalogue_import_in_any_order(first: str) -> None:
    code = f"import {first}, vgroove.rig, vgroove.gap"
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
