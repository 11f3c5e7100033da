"""Halves of a matrix of cells: controllers are tuned on one half and evaluated on the other, which
has other pairs of supply and load.
"""

from collections.abc import Sequence
from itertools import product
from typing import Any

SETS = ("tune", "report")
SUPPLIES_V = (16.0, 17.5, 18.5, 20.5)
SEED_BASE = 31  # more than the values of any quantity of a cell


def half_of(row: int, column: int) -> str:
    """Half of a cell by its row and column, as the colours of a chessboard."""
    return SETS[(row + column) % 2]


def halved(rows: Sequence[Any], columns: Sequence[Any]) -> list[tuple[str, Any, Any]]:
    """(set, row, column) of the whole matrix."""
    found = product(enumerate(rows), enumerate(columns))
    return [(half_of(r, c), row, column) for (r, row), (c, column) in found]


def seed_of(half: str, *numbers: int) -> int:
    """A seed for the numbers that identify a cell. The first one, that of the draw, may be of any
    size, the others lie in 0..SEED_BASE - 1. No two lists of the same length have the same seed;
    those of the two halves differ (odd and even). ValueError for a number out of range.
    """
    if min(numbers) < 0 or max(numbers[1:], default=0) >= SEED_BASE:
        raise ValueError(f"numbers of a cell must lie in 0..{SEED_BASE - 1}: {numbers}")
    seed = 0
    for number in numbers:
        seed = SEED_BASE * seed + number
    return 2 * seed + SETS.index(half) + 1


def fifth(cells: Sequence[Any]) -> list[Any]:
    """Every fifth cell, for quick runs (`--fifth`)."""
    return list(cells[::5])


def by_half(rows: Sequence[dict[str, Any]]) -> list[tuple[str, list[dict[str, Any]]]]:
    """(half, its rows) for each half that has rows, and ("all", all rows) where both have."""
    found = [(half, [r for r in rows if r["set"] == half]) for half in SETS]
    found = [(half, chosen) for half, chosen in found if chosen]
    return [*found, ("all", list(rows))] if len(found) > 1 else found
