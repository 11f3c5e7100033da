"""The ADC is prepared for its next trigger in time, also during bursts of edges and received bytes,
at every phase relative to the result.
"""

import random
from pathlib import Path

import pytest

from vgroove import board
from vgroove.board import CYCLES_PER_PERIOD, BoardInputs, pack_inputs, read_statistics

# Microcontroller, and cycles by which the bursts must delay the ADC interrupt at least once. On the
# Mega the capture interrupt has a lower priority than the ADC's and delays it only while it runs.
TARGETS = {"uno_elf": ("atmega328p", 309), "mega_elf": ("atmega2560", 120)}
PERIODS = 20000
FIRST_TOP, FIRST_RESULT, CADENCE = 255, 2241, 2040  # CPU cycles, docs/firmware.md, Timing
BURST_EDGES = 8


def burst(random_: random.Random) -> list[int]:
    """Cycles of edges relative to a result, 60 to 130 cycles apart (their interrupt takes 86 or
    97); the first comes up to 250 cycles before the result.
    """
    at, edges = random_.randrange(-250, 60), []
    for _ in range(random_.randrange(2, BURST_EDGES)):
        edges.append(at)
        at += random_.randrange(60, 130)
    return edges


def burst_tape(seed: int, every: int) -> bytes:
    """PWM periods at rest, a burst and a byte at one of `every` results."""
    random_ = random.Random(seed)
    edges: list[list[int]] = [[] for _ in range(PERIODS + 8)]
    received = set()
    step = every * CADENCE
    for result in range(FIRST_RESULT + step, PERIODS * CYCLES_PER_PERIOD, step):
        received.add((result - FIRST_TOP) // CYCLES_PER_PERIOD + 1)
        for edge in burst(random_):
            period, cycle = divmod(result + edge - FIRST_TOP, CYCLES_PER_PERIOD)
            edges[period].append(cycle)
    return b"".join(
        pack_inputs(
            BoardInputs((512, 720, 100, 154), edges=edges[k], rx=b"\x55" if k in received else b"")
        )
        for k in range(PERIODS)
    )


@pytest.mark.parametrize("target", TARGETS)
def test_bursts_of_interrupts_delay_no_conversion(
    target: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    (mcu, wait), stats = TARGETS[target], tmp_path / "stats.json"
    board.replay(request.getfixturevalue(target), burst_tape(1, 3), mcu=mcu, stats=stats)
    report = read_statistics(stats)
    assert report["isr"]["ADC"]["longest_wait_cycles"] > wait, "the bursts cause no delay"
    assert report["adc"]["conversions"] >= PERIODS / 4 - 2
    assert (
        report["adc"]["shortest_cadence_cycles"]
        == report["adc"]["longest_cadence_cycles"]
        == CADENCE
    )
    assert report["adc"]["channel_races"] == 0 and report["adc"]["lost"] == 0


def test_interrupts_that_prepare_the_adc_change_no_register(uno_elf: Path, tmp_path: Path) -> None:
    """With few bursts, so that the receive queue is never full. RX prepares on the Uno alone, where
    a byte comes before the ADC interrupt that a burst delays.
    """
    stats = tmp_path / "stats.json"
    board.replay(uno_elf, burst_tape(1, 24), mcu="atmega328p", stats=stats)
    costs = read_statistics(stats)["isr"]
    receive = costs["USART_RX"]
    assert receive["worst_cycles"] > receive["mean_cycles"] + 5, "RX has not prepared"
    assert [name for name, cost in costs.items() if cost["changed"]] == []
