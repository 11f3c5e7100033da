"""docs/input_format.md and `vgroove rig new` state the keys that the code reads; a rig that lacks
several keys is refused with all of them.
"""

import re
import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner

from telemetry_board import ROOT
from vgroove.cli import app
from vgroove.errors import VgrooveError
from vgroove.gap.catalogue import LOADS_BEHIND
from vgroove.input_format import tables, with_tables
from vgroove.rig import read_rig, rig_from_dict
from vgroove.rig_keys import KINDS, SECTIONS
from vgroove.rig_template import MEANINGS, TEMPLATES, template_text

PAGE = ROOT / "docs/input_format.md"


def test_the_tables_of_the_page_are_those_of_the_code() -> None:
    text = PAGE.read_text()
    assert with_tables(text) == text
    assert set(re.findall(r"<!-- table (\w+) -->", text)) == set(tables())


def test_the_pages_name_the_tools_of_which_a_log_is_compared() -> None:
    found = []
    for page, sentence in (
        (PAGE, r"a log is compared with ([^.;]*)"),
        (ROOT / "docs/rig.md", r"Logs are compared with rigs of mechanism ([^.;]*)"),
    ):
        (named,) = re.findall(sentence, page.read_text().replace("\n", " "))
        found.append(set(re.findall(r"`(\w+)`", named)) & set(KINDS["mechanism"]))
    assert found == [set(LOADS_BEHIND)] * 2
    loads = re.search(r"Mechanism `none`, with load ([^:]*)", (ROOT / "docs/rig.md").read_text())
    assert set(re.findall(r"`(\w+)`", loads[1])) == set(LOADS_BEHIND["none"])


def test_every_base_key_has_a_meaning_and_every_meaning_a_key() -> None:
    wanted = {f"{s}.{k}" for s in SECTIONS if s != "clip" for k in SECTIONS[s]}
    known = wanted | {f"{s}.{k}" for s in KINDS for keys in KINDS[s].values() for k in keys}
    assert wanted <= set(MEANINGS) <= known
    for mechanism, load in TEMPLATES.values():
        for section, kind in (("mechanism", mechanism), ("load", load)):
            needed = {f"{section}.{k}" for k, key in KINDS[section][kind].items() if key.needed}
            assert needed <= set(MEANINGS)


@pytest.mark.parametrize("kind", TEMPLATES)
def test_a_new_rig_is_valid_as_it_is_and_each_key_has_its_comment(
    kind: str, tmp_path: Path
) -> None:
    path = tmp_path / "new.toml"
    assert CliRunner().invoke(app, ["rig", "new", str(path), "--kind", kind]).exit_code == 0
    rig = read_rig(path)
    assert (rig.mechanism["kind"], rig.load["kind"]) == TEMPLATES[kind]
    lines = path.read_text().splitlines()
    assert max(map(len, lines)) <= 100
    for before, line in zip(lines, lines[1:], strict=False):
        if "=" in line and not line.startswith(("#", '"', "kind", "schema", "name")):
            assert before.startswith("# "), line


def test_a_new_rig_goes_to_standard_output_and_overwrites_nothing(tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["rig", "new"])
    assert rig_from_dict(tomllib.loads(done.stdout), "new").load["kind"] == "none"
    path = tmp_path / "mine.toml"
    path.write_text("mine")
    again = CliRunner().invoke(app, ["rig", "new", str(path)])
    assert isinstance(again.exception, VgrooveError) and path.read_text() == "mine"
    wrong = CliRunner().invoke(app, ["rig", "new", "--kind", "bicycle"])
    assert "wood_screw" in str(wrong.exception)


def test_all_missing_keys_are_named_at_once() -> None:
    data = tomllib.loads(template_text("wood_screw"))
    del data["motor"]["inertia_kg_m2"], data["motor"]["coulomb_nm"], data["gearbox"]
    del data["load"]["seat_nm"], data["mechanism"]["travel_rad"]
    data["effects"] = {"winding_heating": {"cooling_s": 10.0}}
    del data["supply"]["voltage_v"]
    with pytest.raises(VgrooveError) as caught:
        rig_from_dict(data, "x.toml")
    for name in (
        "the section [gearbox] with ratio, output_inertia_kg_m2",
        "supply.voltage_v",
        "motor.inertia_kg_m2",
        "motor.coulomb_nm",
        "load.seat_nm",
        "mechanism.travel_rad",
        "effects.winding_heating.kelvin_per_joule",
    ):
        assert name in str(caught.value)


def test_a_misspelt_key_is_named_before_the_missing_one() -> None:
    data = tomllib.loads(template_text("free"))
    data["motor"]["inertia_kgm2"] = data["motor"].pop("inertia_kg_m2")
    with pytest.raises(VgrooveError, match="nearest known one is motor.inertia_kg_m2"):
        rig_from_dict(data, "x.toml")
