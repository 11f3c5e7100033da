"""`vgroove flash`: writes the firmware's hex file with avrdude through the board's bootloader and
verifies it by reading back.
"""

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

from vgroove.board import default_elf
from vgroove.errors import VgrooveError

# avrdude's names of protocol and part, and the baud rate. The bootloader of the Uno (Optiboot) has
# the protocol STK500v1, that of the Mega 2560 STK500v2 ("wiring").
PROGRAMMERS = {"uno": ("arduino", "m328p", 115200), "mega": ("wiring", "m2560", 115200)}

ERROR_WORDS = (
    "mismatch",
    "error",
    "cannot",
    "can't",
)  # first the words that state the cause most exactly


def flash_command(port: str, target: str, image: Path) -> list[str]:
    """The avrdude command line: no chip erase (the bootloader erases pages), write, verify by
    reading back.
    """
    if target not in PROGRAMMERS:
        raise VgrooveError(f"--target is uno or mega, not {target}")
    if not image.is_file():
        raise VgrooveError(
            f"there is no firmware at {image}: build it with `make build`, or name a hex file with "
            "--hex"
        )
    avrdude = shutil.which("avrdude")
    if avrdude is None:
        raise VgrooveError("avrdude is missing: run `make setup`")
    programmer, part, baud = PROGRAMMERS[target]
    connection = ["-c", programmer, "-p", part, "-P", port, "-b", str(baud)]
    return [avrdude, "-q", *connection, "-D", "-U", f"flash:w:{image}:i"]


def flash(
    port: str,
    target: str = "uno",
    image: Path | None = None,
    tool: str = "impact",
    on_line: Callable[[str], None] = lambda _: None,
) -> None:
    """Flash and verify `image`, or the firmware built for `tool`, impact or drill; `on_line` is
    called with each line that avrdude prints.

    VgrooveError with avrdude's error when a byte differs or the board does not answer.
    """
    command = flash_command(port, target, image or default_elf(target, tool).with_suffix(".hex"))
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace"
    )
    lines = []
    for line in process.stdout or ():
        if line.strip():
            lines.append(line.rstrip())
            on_line(lines[-1])
    if process.wait() != 0:
        raise VgrooveError(f"avrdude could not flash {port}: {_reason(lines)}")


def _reason(lines: list[str]) -> str:
    """The error message among avrdude's lines, without those about modem control lines (ioctl),
    which a pseudo-terminal does not have.
    """
    relevant = [line.strip() for line in lines if "ioctl" not in line]
    for word in ERROR_WORDS:
        for line in relevant:
            if word in line.lower():
                return line
    return relevant[-1] if relevant else "it printed nothing"
