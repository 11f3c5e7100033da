"""A simulated board at the pace of the wall clock, its UART on a pseudo-terminal: a vgroove-board
process with a build for real-time runs.
"""

import subprocess
from pathlib import Path

from vgroove.board import TOOLS, find_board_program
from vgroove.errors import VgrooveError

BUILDS = {"impact": "avr-uno-hil", "drill": "avr-uno-drill-hil"}


def real_time_elf(tool: str = "impact") -> Path:
    """The Uno's ELF for real-time runs that `make build` makes for a tool, impact or drill."""
    if tool not in TOOLS:
        raise VgrooveError(f"the tool of a firmware is impact or drill, not {tool}")
    path = Path(__file__).resolve().parents[3] / "build" / BUILDS[tool] / "vgroove.elf"
    if not path.is_file():
        raise VgrooveError(f"there is no {path}: build it with `make build`")
    return path


class PacedBoard:
    """The program vgroove-board (a simulated ATmega) as a process that ends with the context. port:
    device of the pseudo-terminal that is its UART; pace: simulated seconds per second of the wall
    clock.
    """

    def __init__(self, elf: Path, pace: float = 1.0, *options: str) -> None:
        command = [str(find_board_program()), str(elf), "--pty", "--pace", str(pace), *options]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        stdout = self._process.stdout
        self.port = stdout.readline().strip() if stdout is not None else ""
        if not self.port.startswith("/dev/"):
            self.stop()
            raise VgrooveError("vgroove-board has found no pseudo-terminal")

    def __enter__(self) -> "PacedBoard":
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def stop(self) -> int:
        """End the process; returns its exit code."""
        self._process.terminate()
        code = self._process.wait(timeout=20)
        if self._process.stdout is not None:
            self._process.stdout.close()
        return code
