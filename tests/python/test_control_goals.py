"""The goals of the controllers' bench can be missed: a drive that fails is counted against its
goal, and draws, intervals and options are what they state.
"""

from itertools import combinations
from typing import Any

from vgroove.control_bench import (
    blows_drawn,
    screwing_drawn,
    sync_drawn,
    torque_adapted,
    torque_drawn,
    vibration_drawn,
)

DRAWN = {
    "torque": torque_drawn.cells(1),
    "sync": sync_drawn.cells(),
    "blows": blows_drawn.cells(),
    "screwing": screwing_drawn.cells(),
    "vibration": vibration_drawn.cells(),
    "torque of other tools": torque_adapted.cells(1),
}


def seeds_of(cells: list[dict[str, Any]]) -> set[int]:
    return {cell["seed"] for cell in cells}


def test_no_two_parts_have_the_same_draws() -> None:
    for (one, cells), (other, more) in combinations(DRAWN.items(), 2):
        assert not seeds_of(cells) & seeds_of(more), f"{one} and {other}"
