"""python-can's serial bus to the board, which continues after damaged bytes."""

import io
import os
import select
import subprocess
import sys
from collections import deque
from contextlib import suppress
from typing import Any

import can
import serial
from can.interfaces.serial.serial_can import SerialBus

from vgroove import telemetry
from vgroove.errors import VgrooveError
from vgroove.port_lock import PortLock

if os.name == "posix":
    import fcntl


READ_BYTES = 65_536
PIPE_BYTES = 1 << 20  # of the pipe from the reading process: 10 s at 1 MBd
F_SETPIPE_SZ = 1031  # of Linux
READY = b"R"
# The reading process. It ends with its parent, and gets real-time priority where that is permitted.
# READY comes first.
PUMP = f"""
import ctypes, os, select, sys
port, priority = int(sys.argv[1]), 15
try:
    ctypes.CDLL(None).prctl(1, 9)
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
except (OSError, AttributeError):
    pass
os.write(1, {READY!r})
while True:
    select.select([port], [], [])
    data = os.read(port, 65536)
    if not data:
        break
    os.write(1, data)
"""


class PortReader:
    """Reads a port in a process of its own, so that the kernel's buffer (4 KiB, 41 ms at 1 MBd) is
    emptied while the program decodes, writes, or waits for a processor. For systems with POSIX
    descriptors; others read in the program itself. The constructor returns when the process reads;
    OSError when it cannot be started.
    """

    def __init__(self, port: serial.Serial) -> None:
        self._port, self._process = port, None
        if os.name != "posix":
            return
        try:
            descriptor = port.fileno()
        except io.UnsupportedOperation:  # the port of a network, rfc2217://
            return
        self._process = subprocess.Popen(
            [sys.executable, "-S", "-c", PUMP, str(descriptor)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            pass_fds=(descriptor,),
            start_new_session=True,  # Ctrl-C and a closed terminal are the program's
        )
        self._pipe = self._process.stdout.fileno()
        with suppress(OSError):
            fcntl.fcntl(self._pipe, F_SETPIPE_SZ, PIPE_BYTES)
        if os.read(self._pipe, len(READY)) != READY:
            self.stop()
            raise OSError("the process that reads the port has ended at its start")

    def take(self, timeout_s: float) -> bytes:
        """Bytes that have arrived; waits at most `timeout_s` for a first one. OSError when the
        port is lost.
        """
        if self._process is None:
            data = self._port.read(1)
            return data + self._port.read(self._port.in_waiting) if data else b""
        if not select.select([self._pipe], [], [], timeout_s)[0]:
            return b""
        data = os.read(self._pipe, READ_BYTES)
        if not data:
            raise OSError("the device has hung up")
        return data

    def stop(self) -> None:
        """End the reading process."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process.stdout.close()


class ResyncBus(SerialBus):
    """python-can's serial bus whose `recv` continues with the next intact frame after damage;
    `framer` counts what it skipped. Bytes are read by another process (PortReader). VgrooveError
    where another program uses the port.
    """

    def __init__(
        self, channel: str, baudrate: int = 250_000, timeout: float = 0.05, **kwargs: Any
    ) -> None:
        self.framer = telemetry.Framer()
        self._received: deque[telemetry.Frame] = deque()
        self._lock, self._timeout_s = PortLock(channel), timeout
        try:
            super().__init__(channel, baudrate=baudrate, timeout=timeout, **kwargs)
        except BaseException:
            self._lock.release()
            raise
        try:
            self._reader = PortReader(self._ser)
        except OSError as error:
            super().shutdown()
            self._lock.release()
            raise can.CanInitializationError(f"could not read from serial: {error}") from error

    def read_frames(self) -> list[telemetry.Frame]:
        """Frames completed by the bytes that have arrived; blocks at most `timeout` seconds for a
        first byte. CanOperationError when the port is lost.
        """
        try:
            data = self._reader.take(self._timeout_s)
        except (serial.SerialException, OSError, TypeError, AttributeError) as error:
            raise can.CanOperationError(f"could not read from serial: {error}") from error
        return self.framer.feed(data)

    def shutdown(self) -> None:
        """End the reading process and close the port."""
        if hasattr(self, "_reader"):
            self._reader.stop()
        super().shutdown()
        self._lock.release()

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


def open_bus(port: str, baud: int) -> ResyncBus:
    """The bus at a port; VgrooveError where it cannot be opened at this rate."""
    try:
        return ResyncBus(port, baudrate=baud)
    except (serial.SerialException, can.CanError, OSError, ValueError, OverflowError) as error:
        raise VgrooveError(f"{port}: the port cannot be opened: {error}.") from error


def command_message(name: str, sequence: int, time_ms: int, **signals: float) -> can.Message:
    """An inbound frame as python-can sends it; signals in physical values."""
    definition = telemetry.database().get_message_by_name(name)
    sequence_name = next(s.name for s in definition.signals if s.name.endswith("_sequence"))
    frame = telemetry.frame_of_signals(name, time_ms, **signals, **{sequence_name: sequence})
    message = frame.message()
    message.timestamp = (time_ms + 0.5) / 1000  # python-can truncates to ms
    return message
