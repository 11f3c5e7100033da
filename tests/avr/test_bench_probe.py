"""The bench tool itself, tested on both microcontrollers with its own program, probe_board.c:
functions that simavr alone does not have.
"""

import struct
import subprocess
from pathlib import Path

import pytest

from vgroove.board import (
    OUTPUT_BYTES,
    AvrBoard,
    BoardInputs,
    BoardOutputs,
    find_board_program,
    pack_inputs,
    read_statistics,
)
from vgroove.errors import VgrooveError

MCUS = ("atmega328p", "atmega2560")
ADC = (100, 200, 300, 1023)
FIRST_TOP = 255  # cycles from the start of the timers to period 0


class Probe:
    """The test program on a board: sends a command byte every second period and collects its
    events.
    """

    def __init__(self, board: AvrBoard) -> None:
        self.board = board
        self.periods = 0
        self.last: BoardOutputs | None = None

    def run(
        self,
        commands: bytes = b"",
        periods: int = 100,
        edges: dict[int, tuple[int, ...]] | None = None,
        switches: int = 0,
    ) -> list[tuple[str, int]]:
        """Events of `periods` periods; `edges` by period since the start of this call."""
        sent = bytearray()
        for k in range(periods):
            rx = commands[k // 2 : k // 2 + 1] if k % 2 == 0 else b""
            self.last = self.board.period(BoardInputs(ADC, (edges or {}).get(k, ()), switches, rx))
            sent += self.last.tx
        self.periods += periods
        return [(chr(sent[i]), sent[i + 1] << 8 | sent[i + 2]) for i in range(0, len(sent), 3)]


@pytest.fixture(params=MCUS)
def mcu(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture
def probe(probe_elfs: dict[str, Path], mcu: str) -> Probe:
    with AvrBoard(probe_elfs[mcu], mcu=mcu) as board:
        yield Probe(board)


def test_tick_comes_every_16000_cycles(probe: Probe) -> None:
    stamps = [value for letter, value in probe.run(b"t\x06", 300) if letter == "T"]
    steps = [(b - a) & 0xFFFF for a, b in zip(stamps, stamps[1:], strict=False)]
    assert len(stamps) == 6
    assert all(abs(step - 16000) <= 320 for step in steps)
    assert sum(steps) == pytest.approx(5 * 16000, abs=320)


def test_capture_stamps_are_exact_to_the_cycle(probe: Probe) -> None:
    probe.run(b"c\x01", 10)
    begin = probe.periods * 510 + FIRST_TOP
    stamps = [
        value
        for letter, value in probe.run(periods=40, edges={3: (10, 500), 5: (0,), 6: (509,)})
        if letter == "C"
    ]
    expected = [begin + 3 * 510 + 10, begin + 3 * 510 + 500, begin + 5 * 510, begin + 6 * 510 + 509]
    assert stamps == [(cycle + 4) & 0xFFFF for cycle in expected]  # 4: the noise canceller


def test_noise_canceller_suppresses_a_pulse_of_two_cycles(probe: Probe) -> None:
    probe.run(b"c\x01", 10)
    assert probe.run(periods=40, edges={3: (100, 102)}) == []
    assert len(probe.run(periods=40, edges={3: (100, 400)})) == 2


def test_converter_follows_every_fourth_bottom_and_the_right_channel(
    probe: Probe, mcu: str
) -> None:
    events = [value for letter, value in probe.run(b"a\x08", 200) if letter == "A"]
    assert len(events) == 8
    channels = [value >> 14 for value in events]
    assert channels == [(channels[0] + i) % 4 for i in range(8)]
    assert [value & 0x3FF for value in events[4:]] == [ADC[channel] for channel in channels[4:]]


def test_converter_stops_when_the_trigger_flag_is_not_cleared(probe: Probe) -> None:
    probe.run(b"k\x00", 20)
    first = dict(probe.run(b"n", 40))["N"]
    second = dict(probe.run(b"n", 400))["N"]
    assert second - first <= 1
    probe.run(b"k\x01", 20)


def test_eeprom_is_busy_for_3_4_ms(probe: Probe) -> None:
    events = dict(probe.run(b"e\x05\x77g\x05", 500))
    assert events["E"] * 8 == pytest.approx(54400, abs=100)
    assert events["G"] == 0x77


def test_switches_pull_their_pins_low(probe: Probe) -> None:
    for closed in range(16):
        probe.run(periods=2, switches=closed)
        assert dict(probe.run(b"s", 40, switches=closed))["S"] & 0x0F == 0x0F & ~closed


@pytest.mark.parametrize("reverse", [0, 1])
def test_compare_registers_become_a_signed_compare_value(probe: Probe, reverse: int) -> None:
    probe.run(b"b" + bytes([99, 101, reverse]), 40)
    assert probe.last == BoardOutputs(0, 100 - 255 * reverse, 2, b"")
    probe.run(b"o", 40)
    assert probe.last is not None and probe.last.coast == 1


@pytest.mark.parametrize(
    ("first", "second"),
    [((101, 99), None), ((100, 101), None), ((255, 255), (99, 101)), ((99, 101), (255, 255))],
)
def test_shoot_through_ends_the_run(
    probe_elfs: dict[str, Path], mcu: str, first: tuple[int, int], second: tuple[int, int] | None
) -> None:
    with (
        AvrBoard(probe_elfs[mcu], mcu=mcu) as board,
        pytest.raises(VgrooveError, match="shoot-through.*leg A.*cycle"),
    ):
        probe = Probe(board)
        probe.run(b"b" + bytes([*first, 0]), 60)
        if second:
            probe.run(b"b" + bytes([*second, 0]), 60)


def test_leaving_full_drive_by_way_of_254_keeps_the_dead_time(probe: Probe) -> None:
    for pair in ((99, 101), (253, 255), (255, 255), (253, 255), (0, 0), (9, 11)):
        probe.run(b"b" + bytes([*pair, 0]), 60)
    assert probe.last is not None and probe.last.compare == 10


def test_watchdog_resets_with_its_reset_cause(probe: Probe) -> None:
    assert dict(probe.run(b"r", 40))["R"] == 1
    probe.run(b"w", 1000)
    assert dict(probe.run(b"r", 100))["R"] == 8


def test_brown_out_resets_with_its_reset_cause(probe_elfs: dict[str, Path], mcu: str) -> None:
    with AvrBoard(probe_elfs[mcu], mcu=mcu, brown_out=60_000) as board:
        probe = Probe(board)
        probe.run(periods=200)
        assert dict(probe.run(b"r", 100))["R"] == 4


def test_power_cut_damages_only_the_byte_being_written(
    probe_elfs: dict[str, Path], mcu: str, tmp_path: Path
) -> None:
    memory = tmp_path / "eeprom.bin"
    memory.write_bytes(bytes(range(256)) * 4)
    damaged = set()
    for seed in range(1, 9):
        memory.write_bytes(bytes(range(256)) * 4)
        with (
            AvrBoard(probe_elfs[mcu], mcu=mcu, eeprom=memory, cut=30_000, seed=seed) as board,
            pytest.raises(VgrooveError),
        ):
            Probe(board).run(b"e\x05\x77", 200)
            pytest.fail("the power was not cut")
        board.close()
        content = memory.read_bytes()
        assert content[:5] + content[6:256] == bytes(range(5)) + bytes(range(6, 256))
        damaged.add(content[5])
    assert len(damaged) > 4  # random values, neither the old nor the new one


def test_statistics_count_the_cycles_of_each_interrupt(
    probe_elfs: dict[str, Path], mcu: str, tmp_path: Path
) -> None:
    stats = tmp_path / "stats.json"
    with AvrBoard(probe_elfs[mcu], mcu=mcu, stats=stats) as board:
        Probe(board).run(b"m", 400, edges={50: (7,)})
    report = read_statistics(stats)
    receive = report["isr"]["USART_RX" if mcu == "atmega328p" else "USART0_RX"]
    assert receive["count"] == 1
    assert 40 < receive["worst_cycles"] < 80  # entry, body and RETI
    assert report["tick"]["count"] == 1
    assert report["tick"]["worst_cycles"] > 1000
    assert report["control"]["count"] == 1
    assert 300 < report["control"]["worst_cycles"] < 600
    assert 0.0 < report["isr_share"] < 0.2
    assert report["uart"] == {"baud": 250000, "sent": 0, "received": 1, "overruns": 0}
    assert report["hall"] == {"edges": 1, "captured": 1, "deaf": 0}
    assert report["stack"]["free_bytes"] > 1000


def test_missing_elf_and_wrong_microcontroller_have_messages(
    probe_elfs: dict[str, Path], tmp_path: Path
) -> None:
    with pytest.raises(VgrooveError, match="no firmware at .*none.elf"):
        AvrBoard(tmp_path / "none.elf")
    (tmp_path / "text.elf").write_text("not an ELF")
    with (
        AvrBoard(tmp_path / "text.elf") as board,
        pytest.raises(VgrooveError, match="not an AVR ELF"),
    ):
        board.period(BoardInputs(ADC))
    with (
        AvrBoard(probe_elfs["atmega2560"], mcu="atmega328p") as board,
        pytest.raises(VgrooveError, match="not linked for the atmega328p"),
    ):
        board.period(BoardInputs(ADC))
    with (
        AvrBoard(probe_elfs["atmega328p"], mcu="atmega8") as board,
        pytest.raises(VgrooveError, match="supports atmega328p and atmega2560"),
    ):
        board.period(BoardInputs(ADC))


def test_a_reader_that_ends_before_the_answer_loses_no_statistics(
    probe_elfs: dict[str, Path], tmp_path: Path
) -> None:
    stats, count = tmp_path / "stats.json", 20_000
    command = [find_board_program(), probe_elfs["atmega328p"], "--stretches", "--stats", stats]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        process.stdout.close()
        process.stdin.write(struct.pack("<H", count) + count * pack_inputs(BoardInputs(ADC)))
        process.stdin.close()
        assert process.wait() == 0
    assert read_statistics(stats)["periods"] == count


def test_only_whole_messages_are_sent(probe_elfs: dict[str, Path], mcu: str) -> None:
    message = pack_inputs(BoardInputs(ADC))
    with AvrBoard(probe_elfs[mcu], mcu=mcu) as board:
        for wrong in (b"", message[:-1], message + b"x"):
            with pytest.raises(ValueError, match="whole messages"):
                board.periods(wrong)
        assert len(board.periods(message)) == OUTPUT_BYTES
