"""Golden vectors of the fixed-point code, evaluated on both simulated microcontrollers: equal to
the host bit for bit.
"""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from vgroove.board import AvrBoard, BoardInputs

ROOT = Path(__file__).resolve().parents[2]
TARGETS = {"atmega328p": "uno", "atmega2560": "mega"}
PERIODS_MAX = 31372 * 20  # PWM periods: 20 s
SOURCES = ("tests/avr/vectors_main.c", "tests/vectors/vectors.c", "firmware/hal/avr/serial.c")
FLAGS = [
    "-DF_CPU=16000000UL",
    "-std=c11",
    "-Os",
    "-flto",
    "-ffunction-sections",
    "-fdata-sections",
    "-Wl,--gc-sections",
    "-Wall",
]


def build(mcu: str, elf: Path, tree: Path = ROOT) -> Path:
    """Builds the vectors' program for the target with the firmware sources of `tree`."""
    folders = (tree / "firmware" / name for name in ("core", "drivers", "controllers"))
    sources = [str(path) for folder in folders for path in sorted(folder.glob("*.c"))] + [
        str(ROOT / source) for source in SOURCES
    ]
    include = [f"-I{tree / 'firmware'}", f"-I{ROOT / 'tests' / 'vectors'}"]
    subprocess.run(
        ["avr-gcc", f"-mmcu={mcu}", *FLAGS, *include, "-o", str(elf), *sources], check=True
    )
    return elf


def output_of(elf: Path, mcu: str) -> str:
    """Text that the program sends up to its summary line."""
    text = bytearray()
    with AvrBoard(elf, mcu=mcu) as board:
        for _ in range(PERIODS_MAX):
            text += board.period(BoardInputs((512, 740, 102, 154))).tx
            if b" of " in text and text.endswith(b"\n"):
                return text.decode()
    pytest.fail(f"no summary after {PERIODS_MAX} periods; the target sent {bytes(text)!r}")


@pytest.mark.parametrize("mcu", TARGETS)
def test_golden_vectors_pass_bit_for_bit(mcu: str, tmp_path: Path) -> None:
    output = output_of(build(mcu, tmp_path / "vectors.elf"), mcu)
    passed, count = map(int, re.search(r"pass (\d+) of (\d+)\n", output).groups())
    assert count > 100
    assert passed == count, output


def test_a_lost_widening_is_caught(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "firmware", tmp_path / "firmware")
    source = tmp_path / "firmware" / "drivers" / "analog.c"
    text = source.read_text()
    assert "(uint32_t)counts" in text, "analog.c has no widening that this test could remove"
    source.write_text(text.replace("(uint32_t)counts", "(uint16_t)counts"))
    output = output_of(build("atmega328p", tmp_path / "vectors.elf", tmp_path), "atmega328p")
    passed, count = map(int, re.search(r"pass (\d+) of (\d+)\n", output).groups())
    assert passed < count
    assert "fail " in output
