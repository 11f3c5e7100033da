"""Power cut during a parameter save on the real ELF: the next start loads the old value or the new
one.
"""

from pathlib import Path

import pytest
from equality import sent_bytes

from vgroove import board, telemetry
from vgroove.board import BoardInputs, pack_inputs, read_statistics
from vgroove.errors import VgrooveError

REST = BoardInputs((512, 740, 102, 154))  # ADC counts: 0 A, 18.5 V, trigger released, 25 degC
OLD, NEW = 197, 150  # raw values of slew_per_ms_q15
# PWM periods, 31,372 in a second
WRITE_AT, WRITE_PERIODS, START_PERIODS = 9000, 31372 * 2, 31372
BYTE_CYCLES = 54_400  # write time of an EEPROM byte, 3.4 ms


def slew_index() -> int:
    return next(
        i
        for i, parameter in enumerate(telemetry.parameter_list())
        if parameter.name.lower().startswith("slew")
    )


def inputs(periods: int, frame: bytes = b"", at: int = 0) -> bytes:
    """Packed inputs of a board at rest that receives a frame, a byte every second period."""
    messages = [pack_inputs(REST)] * periods
    for k, byte in enumerate(frame):
        messages[at + 2 * k] = pack_inputs(REST._replace(rx=bytes([byte])))
    return b"".join(messages)


def write_frame() -> bytes:
    frame = telemetry.frame_of_signals(
        "PARAM_WRITE", 0, write_index=slew_index(), write_value=NEW, write_sequence=1
    )
    return telemetry.frame_bytes(frame)


def value_after_start(elf: Path, memory: Path) -> float:
    """Value of the parameter that the board reports after a start with this EEPROM."""
    sent = sent_bytes(board.replay(elf, inputs(START_PERIODS), eeprom=memory))
    frames = [
        telemetry.decode(frame)
        for frame in telemetry.Framer().feed(sent)
        if frame.id == telemetry.PARAM
    ]
    return next(frame["param_value"] for frame in frames if frame["param_index"] == slew_index())


@pytest.fixture(scope="module")
def whole_write(uno_elf: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[int, int]:
    """(first cycle, bytes) of an undisturbed save, which takes effect."""
    folder = tmp_path_factory.mktemp("write")
    memory, stats = folder / "eeprom.bin", folder / "stats.json"
    board.replay(
        uno_elf, inputs(WRITE_PERIODS, write_frame(), WRITE_AT), eeprom=memory, stats=stats
    )
    assert value_after_start(uno_elf, memory) == NEW
    eeprom = read_statistics(stats)["eeprom"]
    return eeprom["first_write_cycle"], eeprom["writes"]


@pytest.mark.parametrize("share", [0.005, 0.1, 0.25, 0.4, 0.5, 0.6, 0.75, 0.9, 0.985, 0.999])
def test_old_or_new_value_survives(
    share: float, uno_elf: Path, whole_write: tuple[int, int], tmp_path: Path
) -> None:
    first, count = whole_write
    cut = first + int(share * count * BYTE_CYCLES)
    memory = tmp_path / "eeprom.bin"
    board.replay(
        uno_elf,
        inputs(WRITE_PERIODS, write_frame(), WRITE_AT),
        eeprom=memory,
        cut=cut,
        seed=int(share * 1000),
    )
    assert value_after_start(uno_elf, memory) in (OLD, NEW)


def test_the_cut_ends_the_run(uno_elf: Path) -> None:
    with board.AvrBoard(uno_elf, cut=1_000_000) as avr, pytest.raises(VgrooveError):
        for _ in range(3000):
            avr.period(REST)
        pytest.fail("the run did not end")
