"""The measured machines under tests/data: rig, logs, accepted diagnosis and reference figures of
each, and the comparison of a verdict with the accepted diagnosis.
"""

import re
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

DATA = Path(__file__).resolve().parents[1] / "data"
README = DATA / "real" / "README.md"
SCHEMA = "vgroove.answer/1"
# a row `| figure | value and unit | tolerance |` of README
FIGURE = re.compile(r"^\| ([^|]+) \| (-?[\d.]+)(?: ([^|]+))? \| ([\d.]+) \|$", re.MULTILINE)


@dataclass(frozen=True)
class Wanted:
    """An effect that must be named: one of `ids`; under `ambiguous` one of `rivals` may stand in
    its place; ranges: parameter -> accepted interval.
    """

    ids: list[str]
    first: bool = False
    rivals: list[str] = field(default_factory=list)
    ranges: dict[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Answer:
    """Accepted diagnosis of a machine (tests/data/real/README.md)."""

    machine: str
    verdicts: list[str]
    effects: list[Wanted]
    allowed: list[str]
    closed_min: float | None


@dataclass(frozen=True)
class Machine:
    """A measured machine: its folder and name, rig and logs to diagnose, accepted diagnosis."""

    name: str
    folder: Path
    rig: Path
    logs: list[Path]
    answer: Answer


def read_machine(folder: Path) -> Machine:
    """The machine of a folder with rig.toml and answer.toml."""
    text = tomllib.loads((folder / "answer.toml").read_text(encoding="utf-8"))
    if text.pop("schema") != SCHEMA:
        raise ValueError(f"{folder / 'answer.toml'}: the schema is not {SCHEMA}")
    logs = [(folder / name).resolve() for name in text.pop("logs")]
    effects = [Wanted(**entry) for entry in text.pop("effects")]
    answer = Answer(effects=effects, closed_min=text.pop("closed_min", None), **text)
    return Machine(folder.name, folder, folder / "rig.toml", logs, answer)


def machines() -> list[Machine]:
    """All measured machines, in alphabetical order of their folders."""
    return [read_machine(path.parent) for path in sorted(DATA.glob("**/answer.toml"))]


def reference_figures(name: str) -> dict[str, tuple[str, str, float]]:
    """Label -> value as text, unit and tolerance of the reference fit of a machine, as README
    states them; empty where it has no table.
    """
    sections = re.split(r"^### ", README.read_text(encoding="utf-8"), flags=re.MULTILINE)
    mine = next((part for part in sections if part.split("\n")[0] == name), "")
    return {
        label: (value, unit, float(tolerance))
        for label, value, unit, tolerance in FIGURE.findall(mine)
    }


def faults(answer: Answer, verdict: dict[str, Any]) -> list[str]:
    """What is wrong with a verdict, a sentence each; none where it is the accepted diagnosis."""
    kind, selected = verdict.get("verdict"), verdict.get("selected", [])
    found = [] if kind in answer.verdicts else [f"the verdict is {kind}"]
    may_replace = kind == "ambiguous"
    named = {id_ for w in answer.effects for id_ in (*w.ids, *(w.rivals if may_replace else []))}
    for extra in (name for name in selected if name not in named | set(answer.allowed)):
        found.append(f"{extra} is named")
    for wanted in answer.effects:
        found += wanted_faults(wanted, verdict, may_replace)
    if may_replace:
        found += rival_faults(answer, verdict)
    closed = verdict.get("gap", {}).get("closed")
    if answer.closed_min is not None and (closed is None or closed < answer.closed_min):
        found.append(f"closes {closed}, at least {answer.closed_min} is asked for")
    return found


def wanted_faults(wanted: Wanted, verdict: dict[str, Any], may_replace: bool) -> list[str]:
    """What is wrong with the naming of one effect and with its parameters."""
    selected = verdict.get("selected", [])
    hits = [name for name in selected if name in wanted.ids]
    title = " or ".join(wanted.ids)
    if not hits:
        rivals = {entry["id"] for entry in verdict.get("indistinguishable", [])}
        replaced = may_replace and set(selected) & set(wanted.rivals) and rivals & set(wanted.ids)
        return [] if replaced else [f"{title} is not named"]
    if wanted.first and selected[0] not in wanted.ids:
        return [f"{title} is not named first"]
    return [
        f"{hits[0]}: {name} {value:.4g} is outside {low:g}..{high:g}"
        for name, (low, high) in wanted.ranges.items()
        if not low <= (value := parameter(verdict, hits[0], name)) <= high
    ]


def parameter(verdict: dict[str, Any], effect: str, name: str) -> float:
    """Value of a parameter of an effect of the verdict; NaN where it has none."""
    entry = next((e for e in verdict.get("effects", []) if e["id"] == effect), {})
    return float(entry.get("parameters", {}).get(name, {}).get("value", "nan"))


def rival_faults(answer: Answer, verdict: dict[str, Any]) -> list[str]:
    """Rivals of an ambiguous verdict that are not among the accepted ones."""
    groups = [{*wanted.ids, *wanted.rivals} for wanted in answer.effects]
    found = []
    for entry in verdict.get("indistinguishable", []):
        pair = {entry["id"], entry.get("instead_of")}
        if pair & set(answer.allowed) or any(pair <= group for group in groups):
            continue
        found.append(f"{entry['id']} is a rival of {entry.get('instead_of')}")
    return found
