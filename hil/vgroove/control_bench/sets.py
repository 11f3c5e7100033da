"""Halves of a matrix: controllers are tuned on one and judged on the other, whose pairs of supply
and load they have not seen.
"""

from collections.abc import Sequence
from itertools import product
from typing import Any

SETS = ("tune", "report")
SUPPLIES_V = (16.0, 17.5, 18.5, 20.5)


def half_of(row: int, column: int) -> str:
    """A chessboard: no pair of the report half is among those of the tuning half."""
    return SETS[(row + column) % 2]


def halved(rows: Sequence[Any], columns: Sequence[Any]) -> list[tuple[str, Any, Any]]:
    """(set, row, column) of the whole matrix."""
    found = product(enumerate(rows), enumerate(columns))
    return [(half_of(r, c), row, column) for (r, row), (c, column) in found]


def seed_of(half: str, *numbers: int) -> int:
    """Seeds of the two halves never meet."""
    seed = 0
    for number in numbers:
        seed = 31 * seed + number
    return 2 * seed + SETS.index(half) + 1


def fifth(cells: Sequence[Any]) -> list[Any]:
    """Every fifth cell: the named fifth of a matrix."""
    return list(cells[::5])


def by_half(rows: Sequence[dict[str, Any]]) -> list[tuple[str, list[dict[str, Any]]]]:
    """(tune, its rows), (report, its rows), and all of them where both are there."""
    found = [(half, [r for r in rows if r["set"] == half]) for half in SETS]
    found = [(half, chosen) for half, chosen in found if chosen]
    return [*found, ("all", list(rows))] if len(found) > 1 else found
