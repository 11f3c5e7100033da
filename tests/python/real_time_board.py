"""A simulated board at the pace of the wall clock behind a pseudo-terminal, and lines that damage
what they carry, for the tests of real-time runs.
"""

import subprocess
import threading
from collections.abc import Callable
from pathlib import Path

import can

from vgroove.board import find_board_program
from vgroove.real_time import SerialLink
from vgroove.real_time.link import KNOWN_IDS
from vgroove.telemetry import Frame

ROOT = Path(__file__).resolve().parents[2]
# Seconds of the board in one of the wall clock: on a busy machine the kernel delays the bytes of a
# pseudo-terminal by more than the 5 ms after which the board opens the bridge.
PACE = 0.1


def hil_elf(tool: str = "impact") -> Path:
    """The ELF for real-time runs that `make build` makes."""
    folder = "avr-uno-drill-hil" if tool == "drill" else "avr-uno-hil"
    path = ROOT / "build" / folder / "vgroove.elf"
    assert path.is_file(), f"{path} does not exist: run `make build`"
    return path


class PacedBoard:
    """A vgroove-board process at the pace of the wall clock; a context manager. `port` is the
    device of its UART.
    """

    def __init__(self, elf: Path, pace: float = PACE, *options: str) -> None:
        command = [str(find_board_program()), str(elf), "--pty", "--pace", str(pace), *options]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self._process.stdout is not None
        self.port = self._process.stdout.readline().strip()
        assert self.port.startswith("/dev/"), f"no pseudo-terminal: {self.port!r}"

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


class ChangedLink:
    """A line that changes frames on their way: `to_board` and `from_board` return the frames that
    arrive instead of the given ones.
    """

    def __init__(
        self,
        link: SerialLink,
        to_board: Callable[[list[Frame]], list[Frame]] = lambda frames: frames,
        from_board: Callable[[list[Frame]], list[Frame]] = lambda frames: frames,
    ) -> None:
        self._link, self._to_board, self._from_board = link, to_board, from_board
        self.name, self.counters = link.name, link.counters

    def send(self, frames: list[Frame]) -> None:
        """Send what is left of the frames."""
        self._link.send(self._to_board(frames))

    def receive(self, timeout_s: float) -> list[Frame]:
        """What is left of the frames that have arrived."""
        return self._from_board(self._link.receive(timeout_s))

    def close(self) -> None:
        """Close the line below."""
        self._link.close()


class BusGateway:
    """Carries frames between a board's serial line and a bus of python-can, as a gateway with a CAN
    controller would; their time field does not pass. A context manager.
    """

    def __init__(self, port: str, bus: can.BusABC) -> None:
        self._link, self._bus, self._stop = SerialLink(port), bus, threading.Event()
        self._tick = 0
        self._threads = [
            threading.Thread(target=work, daemon=True) for work in (self._to_bus, self._to_board)
        ]

    def __enter__(self) -> "BusGateway":
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        for thread in self._threads:
            thread.join()
        self._link.close()

    def _to_bus(self) -> None:
        while not self._stop.is_set():
            for frame in self._link.receive(0.05):
                assert frame.id in KNOWN_IDS
                self._tick = frame.time_ms
                message = can.Message(
                    arbitration_id=frame.id, data=frame.data, is_extended_id=False
                )
                self._bus.send(message)

    def _to_board(self) -> None:
        while not self._stop.is_set():
            message = self._bus.recv(0.05)
            if message is not None:
                data = bytes(message.data)
                tick = self._tick + (data[6] - self._tick + 128) % 256 - 128
                self._link.send([Frame(max(0, tick), message.arbitration_id, data)])
