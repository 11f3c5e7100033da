"""Fixtures of the AVR tests: the bench's own test program, built once per session, and the
firmware's ELF files built by `make build`.
"""

import os
import re
import subprocess
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
FLAGS = ["-DF_CPU=16000000UL", "-Os", "-Wall", "-Wextra", "-Werror", "-std=c11"]
MCUS = {"uno": "atmega328p", "mega": "atmega2560"}


@pytest.fixture(scope="session")
def probe_elfs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """ELF of the bench's own test program for each microcontroller."""
    folder = tmp_path_factory.mktemp("probe")
    elfs = {mcu: folder / f"probe_{mcu}.elf" for mcu in MCUS.values()}
    for mcu, elf in elfs.items():
        subprocess.run(
            ["avr-gcc", f"-mmcu={mcu}", *FLAGS, "-o", str(elf), str(HERE / "probe_board.c")],
            check=True,
        )
    return elfs


def _firmware(target: str) -> Path:
    named = os.environ.get(f"VGROOVE_{target.upper()}_ELF")
    folder = "avr-uno-drill" if target == "drill" else f"avr-{target}"
    elf = Path(named) if named else ROOT / "build" / folder / "vgroove.elf"
    assert elf.is_file(), f"{elf} does not exist: run `make build`"
    return elf


@pytest.fixture(scope="session")
def uno_elf() -> Path:
    """The firmware of the impact driver for the ATmega328P."""
    return _firmware("uno")


@pytest.fixture(scope="session")
def drill_elf() -> Path:
    """The firmware of the drill driver for the ATmega328P."""
    return _firmware("drill")


@pytest.fixture(scope="session")
def mega_elf() -> Path:
    """The firmware of both tools for the ATmega2560."""
    return _firmware("mega")


@pytest.fixture(scope="session")
def broken_elf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The firmware for the ATmega328P with one rounding shift of the current changed from 16 to 15,
    built from a copy of the tree.
    """
    folder = tmp_path_factory.mktemp("broken")
    copy, build = folder / "tree", folder / "build"
    copy.mkdir()
    subprocess.run(
        [
            "cp",
            "-r",
            *(str(ROOT / name) for name in ("CMakeLists.txt", "cmake", "firmware")),
            str(copy),
        ],
        check=True,
    )
    source = copy / "firmware" / "drivers" / "current_sense.c"
    body = re.compile(r"(current_sense_mean_q4\([^)]*\) \{.*?>> )(16)(\);)", re.DOTALL)
    text, shifts = body.subn(r"\1TEST_SHIFT\3", source.read_text())
    assert shifts == 1, (
        f"expected one shift by 16 in current_sense_mean_q4() of current_sense.c, found {shifts}"
    )
    source.write_text(text)
    configure = [
        "cmake",
        "-S",
        str(copy),
        "-B",
        str(build),
        "-G",
        "Ninja",
        "--toolchain",
        str(copy / "cmake" / "avr-gcc.cmake"),
    ]
    options = [
        "-DVGROOVE_MCU=atmega328p",
        "-DCMAKE_BUILD_TYPE=MinSizeRel",
        "-DCMAKE_C_FLAGS=-DTEST_SHIFT=15",
    ]
    subprocess.run([*configure, *options], check=True, stdout=subprocess.DEVNULL)
    subprocess.run(["cmake", "--build", str(build)], check=True, stdout=subprocess.DEVNULL)
    return build / "vgroove.elf"
