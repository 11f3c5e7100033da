"""Flashing with avrdude through a simulated bootloader on a pty; its flash is compared byte
for byte with the hex file.
"""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from stk500_bootloader import FLASH_BYTES, Bootloader
from vgroove.errors import VgrooveError
from vgroove.flash import flash, flash_command

pytestmark = pytest.mark.skipif(
    shutil.which("avrdude") is None, reason="avrdude is not installed (make setup)"
)
ROOT = Path(__file__).resolve().parents[2]
PROBE = ROOT / "tests" / "avr" / "probe_board.c"


def hex_bytes(path: Path) -> dict[int, int]:
    """Address -> byte of an Intel hex file; the checksum of each record is asserted."""
    image = {}
    for line in path.read_text().split():
        record = bytes.fromhex(line[1:])
        assert sum(record) & 0xFF == 0
        count, address, kind = record[0], record[1] << 8 | record[2], record[3]
        if kind == 0:
            image |= {address + i: byte for i, byte in enumerate(record[4 : 4 + count])}
    return image


@pytest.fixture(scope="module")
def image(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The firmware's hex file, made from its ELF as the build does; before the first `make build`
    from the test program tests/avr/probe_board.c.
    """
    folder = tmp_path_factory.mktemp("flash")
    elf = ROOT / "build" / "avr-uno" / "vgroove.elf"
    if not elf.is_file():
        elf = folder / "probe.elf"
        subprocess.run(
            [
                "avr-gcc",
                "-mmcu=atmega328p",
                "-DF_CPU=16000000UL",
                "-Os",
                "-std=c11",
                "-o",
                elf,
                PROBE,
            ],
            check=True,
        )
    made = folder / "vgroove.hex"
    subprocess.run(
        ["avr-objcopy", "-O", "ihex", "-R", ".eeprom", "-R", ".fuse", "-R", ".lock", elf, made],
        check=True,
    )
    return made


def test_flash_writes_every_byte_of_the_image(image: Path) -> None:
    expected = hex_bytes(image)
    assert len(expected) > 1000
    with Bootloader() as board:
        flash(board.name, "uno", image)
        assert board.left_programming
    assert {address: board.flash[address] for address in expected} == expected
    assert all(board.flash[address] == 0xFF for address in range(max(expected) + 129, FLASH_BYTES))


def test_one_corrupt_byte_fails(image: Path) -> None:
    with Bootloader(corrupt_at=0x155) as board, pytest.raises(VgrooveError, match="mismatch"):
        flash(board.name, "uno", image)


def test_command_line_flashes_and_exits_2_on_corruption(image: Path) -> None:
    command = [sys.executable, "-m", "vgroove.cli", "flash"]
    with Bootloader() as board:
        assert (
            subprocess.run(
                [*command, board.name, "--hex", image], capture_output=True, check=False
            ).returncode
            == 0
        )
    with Bootloader(corrupt_at=2) as board:
        failed = subprocess.run(
            [*command, board.name, "--hex", image], capture_output=True, text=True, check=False
        )
    assert failed.returncode == 2
    assert "avrdude could not flash" in failed.stderr


def test_unusable_input_gives_a_message(tmp_path: Path, image: Path) -> None:
    with pytest.raises(VgrooveError, match="no firmware at .*none.hex"):
        flash("/dev/null", "uno", tmp_path / "none.hex")
    with pytest.raises(VgrooveError, match="uno or mega"):
        flash_command("/dev/null", "nano", image)
    assert flash_command("COM3", "mega", image)[2:8] == [
        "-c",
        "wiring",
        "-p",
        "m2560",
        "-P",
        "COM3",
    ]
