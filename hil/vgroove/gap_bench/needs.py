"""Counts and table of docs/gap_bench.md: how often each effect is named, by what its log holds."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from vgroove.gap_bench.scored import Scored
from vgroove.html_page import Table

SMOOTH_PROFILES = ("ramps", "hand", "chirp")


@dataclass(frozen=True)
class Group:
    """A property of a log: its value by the answer of a case, and (value, header) of its
    columns.
    """

    value: Callable[[dict[str, Any]], str]
    columns: tuple[tuple[str, str], ...]


GROUPS = {
    "input": Group(
        lambda a: a["input"],
        (("duty", "duty"), ("voltage_v", "voltage"), ("current_a", "current")),
    ),
    "bus": Group(
        lambda a: a["bus"],
        (("modelled", "bus compared"), ("measured", "bus drives"), ("absent", "no bus")),
    ),
    "speed from": Group(
        lambda a: a["sensor"],
        (("hall", "Hall"), ("encoder", "encoder"), ("tachometer", "tacho"), ("angle", "angle")),
    ),
    "direction": Group(
        lambda a: "both ways" if a["two_way"] else "one way",
        (("one way", "one way"), ("both ways", "both ways")),
    ),
    "load": Group(
        lambda a: "loaded" if a["load"] else "free", (("free", "free"), ("loaded", "loaded"))
    ),
    "command": Group(
        lambda a: "smooth" if a["profile"] in SMOOTH_PROFILES else "steps",
        (("steps", "steps"), ("smooth", "smooth")),
    ),
}


def count_needs(cases: Sequence[Scored]) -> dict[str, dict[str, Any]]:
    """For each effect, group and value: {"hits": right answers, "of": cases} of the single
    cases.
    """
    out: dict[str, dict[str, Any]] = {}
    for c in (c for c in cases if c.kind == "single"):
        mine = out.setdefault(c.answer["ids"][0], {})
        for name, group in GROUPS.items():
            cells = mine.setdefault(name, {})
            cell = cells.setdefault(group.value(c.answer), {"hits": 0, "of": 0})
            cell["hits"] += int(c.right)
            cell["of"] += 1
    return dict(sorted(out.items()))


def needs_table(needs: dict[str, dict[str, Any]]) -> str:
    """Markdown: a row for each effect, a column for each value of GROUPS, right answers / cases; a
    dot where there was no case.
    """
    columns = [(name, column) for name, group in GROUPS.items() for column in group.columns]
    rows = [
        [f"`{effect}`", *(cell_text(groups.get(name, {}).get(key)) for name, (key, _) in columns)]
        for effect, groups in needs.items()
    ]
    return Table("needs", "", ["effect", *(head for _, (_, head) in columns)], rows).as_markdown()


def cell_text(cell: dict[str, int] | None) -> str:
    """Right answers / cases."""
    return f"{cell['hits']}/{cell['of']}" if cell else "."
