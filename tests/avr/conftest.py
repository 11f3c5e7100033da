"""Builds the test programs of the AVR tests once a session."""

import subprocess
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
FLAGS = ["-DF_CPU=16000000UL", "-Os", "-Wall", "-Wextra", "-Werror", "-std=c11"]
MCUS = ("atmega328p", "atmega2560")


@pytest.fixture(scope="session")
def probe_elfs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The bench's own test program by microcontroller."""
    folder = tmp_path_factory.mktemp("probe")
    elfs = {mcu: folder / f"probe_{mcu}.elf" for mcu in MCUS}
    for mcu, elf in elfs.items():
        subprocess.run(["avr-gcc", f"-mmcu={mcu}", *FLAGS, "-o", str(elf), str(HERE / "probe_board.c")], check=True)
    return elfs
