"""The ADC's trigger is armed in time behind storms of edges and received bytes, at every phase to
the result.
"""

import random
from pathlib import Path

import pytest

from vgroove import board
from vgroove.board import CYCLES_PER_PERIOD, BoardInputs, pack_inputs, read_statistics

# Part, and how long the ADC's interrupt waits at least. The Mega's capture interrupt comes after
# the ADC's, delays it only while it runs.
TARGETS = {"uno_elf": ("atmega328p", 309), "mega_elf": ("atmega2560", 120)}
PERIODS = 20000
FIRST_TOP, FIRST_RESULT, CADENCE = 255, 2241, 2040
STORM_EDGES = 8


def storm(random_: random.Random) -> list[int]:
    """Edges in cycles from a result: hardly further apart than their interrupt takes, the first
    some time before it.
    """
    at, edges = random_.randrange(-250, 60), []
    for _ in range(random_.randrange(2, STORM_EDGES)):
        edges.append(at)
        at += random_.randrange(60, 130)
    return edges


def stormy_tape(seed: int) -> bytes:
    """Periods at rest, every third result in a storm, a byte every other period."""
    random_ = random.Random(seed)
    edges: list[list[int]] = [[] for _ in range(PERIODS + 8)]
    for result in range(FIRST_RESULT + 3 * CADENCE, PERIODS * CYCLES_PER_PERIOD, 3 * CADENCE):
        for edge in storm(random_):
            period, cycle = divmod(result + edge - FIRST_TOP, CYCLES_PER_PERIOD)
            edges[period].append(cycle)
    return b"".join(
        pack_inputs(BoardInputs((512, 720, 100, 154), edges=edges[k], rx=b"\x55" if k % 2 else b""))
        for k in range(PERIODS)
    )


@pytest.mark.parametrize("target", TARGETS)
def test_no_conversion_slips_in_a_storm(
    target: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    (mcu, wait), stats = TARGETS[target], tmp_path / "stats.json"
    board.replay(request.getfixturevalue(target), stormy_tape(1), mcu=mcu, stats=stats)
    report = read_statistics(stats)
    assert report["isr"]["ADC"]["longest_wait_cycles"] > wait, "no storm: it shows nothing"
    assert report["adc"]["conversions"] >= PERIODS / 4 - 2
    assert (
        report["adc"]["shortest_cadence_cycles"]
        == report["adc"]["longest_cadence_cycles"]
        == CADENCE
    )
    assert report["adc"]["channel_races"] == 0 and report["adc"]["lost"] == 0
