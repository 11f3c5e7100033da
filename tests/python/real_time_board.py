"""A simulated board at the pace of the wall clock behind a pseudo-terminal, and lines that damage
what they carry, for the tests of real-time runs.
"""

import threading
from collections.abc import Callable
from pathlib import Path

import can

from vgroove.real_time import SerialLink, simulated_board
from vgroove.real_time.link import KNOWN_IDS
from vgroove.real_time.simulated_board import real_time_elf
from vgroove.telemetry import Frame

ROOT = Path(__file__).resolve().parents[2]
# Seconds of the board in one of the wall clock: on a busy machine the kernel delays the bytes of a
# pseudo-terminal by more than the 5 ms after which the board opens the bridge.
PACE = 0.05


hil_elf = real_time_elf


class PacedBoard(simulated_board.PacedBoard):
    """A simulated board at PACE."""

    def __init__(self, elf: Path, pace: float = PACE, *options: str) -> None:
        super().__init__(elf, pace, *options)


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
