"""python-can's serial bus to the board, which continues after damaged bytes."""

from collections import deque
from contextlib import suppress
from typing import Any

import can
import serial
from can.interfaces.serial.serial_can import SerialBus

from vgroove import telemetry


class ResyncBus(SerialBus):
    """python-can's serial bus whose `recv` continues with the next intact frame after damage;
    `framer` counts what it skipped.
    """

    def __init__(
        self, channel: str, baudrate: int = 250_000, timeout: float = 0.05, **kwargs: Any
    ) -> None:
        self.framer = telemetry.Framer()
        self._received: deque[telemetry.Frame] = deque()
        super().__init__(channel, baudrate=baudrate, timeout=timeout, **kwargs)
        with suppress(AttributeError, NotImplementedError):
            self._ser.exclusive = True

    def read_frames(self) -> list[telemetry.Frame]:
        """Frames completed by the bytes that have arrived; blocks at most `timeout` seconds for a
        first byte. CanOperationError when the port is lost.
        """
        try:
            data = self._ser.read(1)
            data += self._ser.read(self._ser.in_waiting) if data else b""
        except (serial.SerialException, OSError, TypeError) as error:
            raise can.CanOperationError(f"could not read from serial: {error}") from error
        return self.framer.feed(data)

    def write(self, data: bytes) -> None:
        """Send bytes to the board; CanOperationError when the port is lost."""
        if not data:
            return
        try:
            self._ser.write(data)
        except (serial.SerialException, OSError) as error:
            raise can.CanOperationError(f"could not write to serial: {error}") from error

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self._received:
            self._received.extend(self.read_frames())
        return (self._received.popleft().message() if self._received else None), False


def command_message(name: str, sequence: int, time_ms: int, **signals: float) -> can.Message:
    """An inbound frame as python-can sends it; signals in physical values."""
    definition = telemetry.database().get_message_by_name(name)
    sequence_name = next(s.name for s in definition.signals if s.name.endswith("_sequence"))
    frame = telemetry.frame_of_signals(name, time_ms, **signals, **{sequence_name: sequence})
    message = frame.message()
    message.timestamp = (time_ms + 0.5) / 1000  # python-can truncates to ms
    return message
