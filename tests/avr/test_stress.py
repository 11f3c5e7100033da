"""The budgets on the tapes with the longest ticks that the search of stress.py has found; such
tapes are equal bit for bit on both boards.
"""

from dataclasses import asdict, replace

import pytest
from budget import CONTROL_CYCLES_MAX, TICK_CYCLES_MAX
from builds import BUILDS
from equality import bridge_differences, differences, periods_of, sent_bytes
from stress import (
    FOLDBACK_A,
    MODES,
    Stress,
    acknowledged,
    corpus,
    random_stress,
    statistics,
    stress_tape,
)

from vgroove import sil

ISR_SHARE_MAX = 0.15
FLOOD = Stress("duty", 7, "line rate", {"foldback_a": FOLDBACK_A})
GUARD = 2  # tapes of each mode and build that guard every change
RATE_AT_LEAST = 15  # ACKs in 1.3 s of bytes without a pause


def build_of(mode: str) -> str:
    """The Uno's build with the mode."""
    return "drill_elf" if mode == "drill" else "uno_elf"


def keeps_budgets(found: dict) -> None:
    """Asserts the budgets of tick, step and interrupts, and that interrupts change no register."""
    assert found["tick"]["worst_cycles"] <= TICK_CYCLES_MAX
    assert found["tick"]["late"] == 0
    assert found["control"]["worst_cycles"] <= CONTROL_CYCLES_MAX
    assert found["isr_share_worst_100ms"] <= ISR_SHARE_MAX
    assert [name for name, cost in found["isr"].items() if cost["changed"]] == []


def first_of_each() -> list[tuple[str, Stress]]:
    """GUARD tapes of each mode and build, the first of the corpus: it lists those of a mode with
    the longest tick first. The others take too long for every change.
    """
    found: dict[tuple[str, str], list[tuple[str, Stress]]] = {}
    for name, stress in corpus():
        found.setdefault((name, stress.mode), []).append((name, stress))
    return [row for rows in found.values() for row in rows[:GUARD]]


FIRST = first_of_each()


@pytest.mark.parametrize(
    ("name", "stress"),
    [
        pytest.param(
            name,
            stress,
            id=f"{name} {stress.mode} {stress.seed}",
            marks=[] if (name, stress) in FIRST else pytest.mark.proof,
        )
        for name, stress in corpus()
    ],
)
def test_the_longest_ticks_found_keep_the_budgets(
    name: str, stress: Stress, request: pytest.FixtureRequest
) -> None:
    keeps_budgets(statistics(stress, request.getfixturevalue(name), BUILDS[name].mcu)[0])


def test_a_flooded_line_keeps_the_budgets_and_is_answered(request: pytest.FixtureRequest) -> None:
    found, out = statistics(FLOOD, request.getfixturevalue("uno_elf"), "atmega328p")
    keeps_budgets(found)
    assert acknowledged(out) >= RATE_AT_LEAST


@pytest.mark.parametrize("mode", MODES)
def test_stressed_boards_are_equal_bit_for_bit(mode: str, request: pytest.FixtureRequest) -> None:
    stress = replace(random_stress(mode, 3), line="paced")
    elf = request.getfixturevalue(build_of(mode))
    avr = statistics(stress, elf, "atmega328p")[1]
    native = sil.replay(stress_tape(stress), target=1, eeprom=stress.eeprom())
    assert differences(sent_bytes(native), sent_bytes(avr)) == [], asdict(stress)
    assert bridge_differences(periods_of(native), periods_of(avr)) == []
