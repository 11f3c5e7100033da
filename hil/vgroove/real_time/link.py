"""Lines to a board: RS232, or a bus of python-can."""

import os
import select
import time
from typing import Protocol

import can
import serial

from vgroove.errors import VgrooveError
from vgroove.port_lock import PortLock
from vgroove.real_time.frames import BAUD, DRIVE
from vgroove.telemetry import OUTBOUND, Counters, Frame, Framer, frame_bytes, frame_crc

KNOWN_IDS = OUTBOUND | {DRIVE}
READ_BYTES = 4096
# On a bus without time field: distances from the last DRIVE's tick that a telemetry frame's time
# may have, the likely ones first.
NEAR_TICKS = (0, -1, 1)


class RunEnded(VgrooveError):
    """The end of a run before its last exchange. reason: in two words, for the run's file."""

    def __init__(self, text: str, reason: str) -> None:
        super().__init__(text)
        self.reason = reason


class Link(Protocol):
    """A line to a board; `counters` counts damage."""

    counters: Counters
    name: str

    def send(self, frames: list[Frame]) -> None:
        """Send frames at once."""
        ...

    def receive(self, timeout_s: float) -> list[Frame]:
        """Frames that have arrived; waits at most `timeout_s` for a first byte or message."""
        ...

    def close(self) -> None:
        """Release the line."""
        ...


class SerialLink:
    """RS232 at 1 MBd. VgrooveError when the port cannot be opened or is in use by another program,
    RunEnded when it is lost.
    """

    def __init__(self, port: str, baud: int = BAUD) -> None:
        self.name, self.counters = f"{port} at {baud} Bd", Counters()
        self._framer = Framer(self.counters, KNOWN_IDS)
        self._lock = PortLock(port)
        try:
            self._port = serial.Serial(port, baud, timeout=0.0, write_timeout=1.0)
        except (serial.SerialException, OSError, ValueError, OverflowError) as error:
            self._lock.release()
            raise VgrooveError(f"{port}: the port cannot be opened: {error}.") from error
        self._descriptor = self._port.fileno() if os.name == "posix" else None

    def send(self, frames: list[Frame]) -> None:
        """Send frames at once."""
        try:
            self._port.write(b"".join(frame_bytes(frame) for frame in frames))
        except (serial.SerialException, OSError) as error:
            raise RunEnded(f"{self.name}: the port was lost: {error}.", "port lost") from error

    def receive(self, timeout_s: float) -> list[Frame]:
        """Frames completed by the bytes that arrive within `timeout_s`."""
        try:
            return self._framer.feed(self._read(timeout_s))
        except (serial.SerialException, OSError, TypeError) as error:
            raise RunEnded(f"{self.name}: the port was lost: {error}.", "port lost") from error

    def _read(self, timeout_s: float) -> bytes:
        if self._descriptor is None:
            self._port.timeout = timeout_s
            first = self._port.read(1)
            return first + self._port.read(self._port.in_waiting) if first else b""
        if not select.select([self._descriptor], [], [], timeout_s)[0]:
            return b""
        data = os.read(self._descriptor, READ_BYTES)
        if not data:
            raise OSError("it has hung up")
        return data

    def close(self) -> None:
        """Close the port."""
        self._port.close()
        self._lock.release()


class BusLink:
    """A bus of python-can, named INTERFACE:CHANNEL such as socketcan:can0.

    CAN frames have no time field: the tick of a DRIVE frame follows from the low byte that it
    carries, the time of a telemetry frame from its CRC, which covers the time.
    """

    def __init__(self, spec: str) -> None:
        interface, _, channel = spec.partition(":")
        self.name, self.counters, self._tick = spec, Counters(), 0
        if not interface or not channel:
            raise VgrooveError(
                f"--bus is INTERFACE:CHANNEL of python-can, such as socketcan:can0, not {spec}"
            )
        try:
            self._bus = can.Bus(interface=interface, channel=channel)
        except Exception as error:  # an interface without its driver or arguments raises any
            raise VgrooveError(f"{spec}: the bus cannot be opened: {error}.") from error

    def send(self, frames: list[Frame]) -> None:
        """Send frames, one message each."""
        try:
            for frame in frames:
                self._bus.send(frame.message())
        except (can.CanError, OSError) as error:
            raise RunEnded(f"{self.name}: the bus was lost: {error}.", "bus lost") from error

    def receive(self, timeout_s: float) -> list[Frame]:
        """Intact frames of a board that arrive within `timeout_s`."""
        frames, deadline = [], time.monotonic() + timeout_s
        try:
            while True:
                wait_s = 0.0 if frames else max(0.0, deadline - time.monotonic())
                message = self._bus.recv(wait_s)
                if message is None:
                    return frames
                frames += self._intact(message)
        except (can.CanError, OSError) as error:
            raise RunEnded(f"{self.name}: the bus was lost: {error}.", "bus lost") from error

    def _intact(self, message: can.Message) -> list[Frame]:
        data = bytes(message.data)
        if message.arbitration_id not in KNOWN_IDS or message.is_extended_id or len(data) != 8:
            return []
        is_drive = message.arbitration_id == DRIVE
        near = [_near(self._tick, data[6])] if is_drive else [self._tick + k for k in NEAR_TICKS]
        for tick in near:
            if tick >= 0 and frame_crc(tick, message.arbitration_id, data) == data[7]:
                self.counters.frames += 1
                self._tick = tick if is_drive else self._tick
                return [Frame(tick, message.arbitration_id, data)]
        if is_drive and frame_crc(0, DRIVE, data) == data[7]:  # a run begins
            self._tick = 0
            return [Frame(0, DRIVE, data)]
        self.counters.corrupt += 1
        return []

    def close(self) -> None:
        """Leave the bus."""
        self._bus.shutdown()


def _near(tick: int, low_byte: int) -> int:
    """The tick with this low byte that is nearest to `tick`."""
    return tick + (low_byte - tick + 128) % 256 - 128
