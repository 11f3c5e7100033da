"""The measured machines of tests/data/real: the reference fits print what the README states and use
nothing of the package, each folder is complete, and verdicts are compared with the accepted answer.
"""

import ast
import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from real_machines import DATA, README, Answer, Machine, Wanted, faults, machines, reference_figures
from vgroove.gap import diagnose
from vgroove.gap.catalogue import CATALOGUE
from vgroove.log import read_log
from vgroove.rig import read_rig

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "proof"))

import measured_machines  # noqa: E402

SCRIPTS = sorted((DATA / "real").glob("*/reference_fit.py"))
PRINTED = re.compile(r"^(.+): (-?[\d.e+-]+)(?: (.+))?$", re.MULTILINE)
FUNCTION_LINES = 35  # of a reference fit: it is read together with its table
PROOF_ALONE = ("emps", "robotino_m1_delay_coulomb", "servo_cogging")
NAMES = [machine.name for machine in machines()]


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda p: p.parent.name)
def test_a_reference_fit_prints_the_figures_of_the_readme(script: Any) -> None:
    done = subprocess.run(
        [sys.executable, script], capture_output=True, text=True, check=True, timeout=60
    )
    stated = reference_figures(script.parent.name)
    printed = {label: (float(v), unit) for label, v, unit in PRINTED.findall(done.stdout)}
    assert list(printed) == list(stated)
    for label, (value, unit, tolerance) in stated.items():
        assert printed[label] == (pytest.approx(float(value), abs=tolerance + 1e-9), unit), label


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda p: p.parent.name)
def test_a_reference_fit_uses_neither_the_package_nor_long_functions(script: Any) -> None:
    tree = ast.parse(script.read_text(encoding="utf-8"))
    modules = {
        name.split(".")[0]
        for node in ast.walk(tree)
        for name in (
            [alias.name for alias in node.names]
            if isinstance(node, ast.Import)
            else [node.module or ""]
            if isinstance(node, ast.ImportFrom)
            else []
        )
    }
    assert modules <= {"sys", "tomllib", "pathlib", "numpy", "scipy"}
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    assert max((node.end_lineno or 0) - node.lineno + 1 for node in functions) <= FUNCTION_LINES


@pytest.mark.parametrize("machine", machines(), ids=NAMES)
def test_a_machine_is_complete(machine: Machine) -> None:
    known = {effect.id for effect in CATALOGUE}
    answer = machine.answer
    named = [id_ for wanted in answer.effects for id_ in (*wanted.ids, *wanted.rivals)]
    assert named and {*named, *answer.allowed} <= known
    assert set(answer.verdicts) <= {"none", "effect", "partial", "ambiguous", "unlisted"}
    rig = read_rig(machine.rig)
    for log in machine.logs:
        assert rig.input["kind"] in read_log(log).columns
    stated = README if machine.folder.parent == README.parent else machine.folder / "README.md"
    text = stated.read_text(encoding="utf-8")
    assert "icence" in text and "Origin" in text
    assert stated != README or f"### {machine.name}\n" in text


def diagnosis_marks(machine: Machine) -> list[pytest.MarkDecorator]:
    """Each diagnosis is a group of its own, so that the workers share them; the longest take too
    long for every change.
    """
    group = pytest.mark.xdist_group(f"machine {machine.name}")
    return [group, pytest.mark.proof] if machine.name in PROOF_ALONE else [group]


@pytest.mark.parametrize(
    "machine",
    [pytest.param(m, marks=diagnosis_marks(m)) for m in machines()],
    ids=NAMES,
)
def test_the_diagnosis_of_a_measured_machine_is_the_accepted_one(machine: Machine) -> None:
    found = diagnose(machine.logs, read_rig(machine.rig)).as_dict()
    assert faults(machine.answer, found) == []


def verdict(selected: list[str], **others: Any) -> dict[str, Any]:
    """A verdict in which each named effect has a size of 1."""
    effects = [{"id": name, "parameters": {"size": {"value": 1.0}}} for name in selected]
    return {"verdict": "effect", "selected": selected, "effects": effects} | others


ANSWER = Answer(
    machine="",
    verdicts=["effect", "ambiguous"],
    effects=[
        Wanted(["delay"], first=True, ranges={"size": (0.5, 2.0)}),
        Wanted(["friction"], rivals=["dead_time"]),
    ],
    allowed=["small"],
    closed_min=0.35,
)
CLOSED = {"gap": {"closed": 0.5}}
TIE = [{"id": "friction", "instead_of": "dead_time"}]


def test_the_accepted_diagnosis_has_no_faults() -> None:
    assert faults(ANSWER, verdict(["delay", "friction"], **CLOSED)) == []
    assert faults(ANSWER, verdict(["delay", "small", "friction"], **CLOSED)) == []
    tie = verdict(["delay", "dead_time"], verdict="ambiguous", indistinguishable=TIE, **CLOSED)
    assert faults(ANSWER, tie) == []


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        (verdict(["delay"], **CLOSED), "friction is not named"),
        (verdict(["friction", "delay"], **CLOSED), "delay is not named first"),
        (verdict(["delay", "friction", "lag"], **CLOSED), "lag is named"),
        (verdict(["delay", "dead_time"], indistinguishable=TIE, **CLOSED), "dead_time is named"),
        (verdict(["delay", "friction"], gap={"closed": 0.3}), "closes 0.3"),
        (verdict(["delay", "friction"], gap={"closed": None}), "closes None"),
        (verdict(["delay", "friction"], verdict="none", **CLOSED), "the verdict is none"),
        (verdict(["delay", "friction"], effects=[], **CLOSED), "size nan is outside"),
        (
            verdict(
                ["delay", "friction"],
                verdict="ambiguous",
                indistinguishable=[{"id": "lag", "instead_of": "delay"}],
                **CLOSED,
            ),
            "lag is a rival of delay",
        ),
    ],
)
def test_a_wrong_diagnosis_is_caught(wrong: dict[str, Any], sentence: str) -> None:
    assert any(sentence in fault for fault in faults(ANSWER, wrong))


def test_the_page_holds_the_results() -> None:
    assert measured_machines.PAGE.read_text(encoding="utf-8") == measured_machines.page(
        measured_machines.PAGE.read_text(encoding="utf-8")
    ), "run `python tests/proof/measured_machines.py --page`"
    result = json.loads(measured_machines.RESULT.read_text(encoding="utf-8"))
    assert [row["name"] for row in result["machines"]] == NAMES
    assert result["right"] == sum(row["right"] for row in result["machines"])


def test_keys_that_a_verdict_lacks_are_empty_cells() -> None:
    machine = machines()[0]
    row = measured_machines.entry(machine, {"verdict": "exit code 2"}, 1.0)
    assert not row["right"] and row["gap"]["before"] is None
    cells = measured_machines.verdict_row(row)
    assert cells[1] == "`exit code 2`" and cells[2] == cells[6] == "" and cells[4] == " /  / "


def test_figures_of_a_verdict_are_in_its_row() -> None:
    signal = {"unit": "rpm", "before": 20.0, "retuned": 20.0, "after": 5.0, "rms": 100.0}
    gap = {"before": 9.0, "retuned": 8.0, "after": 2.0, "by_signal": {"speed_rpm": signal}}
    named = verdict(["coulomb_friction"], gap=gap)
    cells = measured_machines.verdict_row(measured_machines.entry(machines()[0], named, 1.0))
    assert cells[4] == "9 / 8 / 2"
    assert cells[6] == "speed_rpm: 20 / 20 / 5 rpm (20 / 20 / 5 %)"
