"""A whole run of the real ELF at 115,200 Bd: every second row is sent, none is lost, within the
cycles of a tick.
"""

from itertools import pairwise
from pathlib import Path

import pytest
from budget import TICK_CYCLES_MAX
from equality import damaged, sent_bytes
from exercise import record_tape
from test_power_cut import inputs

from vgroove import board, telemetry
from vgroove.board import read_statistics

TARGETS = {"uno_elf": "atmega328p", "mega_elf": "atmega2560"}


def save_slow_rate(elf: Path, mcu: str, memory: Path) -> None:
    """Save the baud rate in the board's EEPROM by a command."""
    index = next(
        i
        for i, parameter in enumerate(telemetry.parameter_list())
        if parameter.name.lower().startswith("baud")
    )
    write = telemetry.frame_of_signals(
        "PARAM_WRITE", 0, write_index=index, write_value=1, write_sequence=1
    )
    board.replay(elf, inputs(2 * 31372, telemetry.frame_bytes(write), 9000), mcu=mcu, eeprom=memory)


@pytest.mark.parametrize("target", TARGETS)
def test_every_second_row_arrives_and_none_is_lost(
    target: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    elf, mcu, memory, stats = (
        request.getfixturevalue(target),
        TARGETS[target],
        tmp_path / "eeprom.bin",
        tmp_path / "stats.json",
    )
    save_slow_rate(elf, mcu, memory)
    sent = sent_bytes(board.replay(elf, record_tape()[0], mcu=mcu, eeprom=memory, stats=stats))
    frames, report = telemetry.Framer().feed(sent), read_statistics(stats)
    fast = [frame.time_ms for frame in frames if frame.id == telemetry.FAST]
    assert len(fast) > 4990 and {after - before for before, after in pairwise(fast)} == {2}
    session = telemetry.Session()
    session.feed(frames)
    assert session.counters.lost == 0 and session.counters.corrupt == 0 and damaged(sent) == 0
    assert set(telemetry.OUTBOUND) == {frame.id for frame in frames}
    assert report["uart"]["baud"] < 120000
    assert report["tick"]["worst_cycles"] <= TICK_CYCLES_MAX
