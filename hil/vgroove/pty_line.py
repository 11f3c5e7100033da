"""The simulated board's UART as a pseudo-terminal, which a recorder opens like a serial port;
nothing is lost while a reader has it open.
"""

import fcntl
import os
import select
import struct
import termios
import time
import tty

from vgroove.errors import VgrooveError
from vgroove.telemetry import Framer

# A serial library flushes its input while it opens a port, during which a real board is in its
# bootloader: nothing is sent for this time.
SETTLE_S = 0.3
DRAIN_S = 5.0  # a reader that reads nothing for this time counts as stopped
# The kernel refills the reader's buffer from another one, with delay on a busy machine: the line is
# drained when the buffer has been empty for this time.
QUIET_S = 0.3
POLL_MS = 100  # for room in the buffer
READ_BYTES = 4096
BUFFER_BYTES = 4095  # of the reader's buffer in the kernel
BATCH_BYTES = 1024  # written at once
ROOM_S = 0.001  # between two looks for room in it


class PtyLine:
    """A pseudo-terminal: this end is the board's, `name` is the device of the reader's end. A
    context manager.

    While a reader has the port open, sending blocks until there is room; otherwise bytes are
    dropped, as on a wire. The beginning of a frame waits for its end: a reader that asks for a
    whole frame within a short time limit, like python-can, would stop at a half one.
    """

    def __init__(self) -> None:
        try:
            self._master, slave = os.openpty()
        except OSError as error:
            raise VgrooveError(f"no pseudo-terminal is available: {error.strerror}") from error
        tty.setraw(slave)
        self.name = os.ttyname(slave)
        # with this end closed, a hang-up on the master shows that no reader has the port open
        os.close(slave)
        os.set_blocking(self._master, False)
        self._poll = select.poll()
        self._poll.register(self._master, select.POLLOUT | select.POLLIN)
        self._framer, self._waiting = Framer(), b""
        self.dropped = 0

    def __enter__(self) -> "PtyLine":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _state(self, wait_ms: int = 0) -> int:
        events = self._poll.poll(wait_ms)
        return events[0][1] if events else 0

    def has_reader(self) -> bool:
        """Whether a reader has the port open."""
        return not self._state() & select.POLLHUP

    def wait_for_reader(self, limit_s: float | None = None) -> bool:
        """Wait until a reader has opened the port, and SETTLE_S more; False when `limit_s` passes
        first.
        """
        begin = time.monotonic()
        while not self.has_reader():
            if limit_s is not None and time.monotonic() - begin > limit_s:
                return False
            time.sleep(0.01)
        time.sleep(SETTLE_S)
        return True

    def send(self, data: bytes) -> None:
        """Send bytes to the reader except an incomplete frame at their end, which waits for the
        next call; blocks while the reader's buffer is full, drops them when the port is closed.
        """
        self._framer.feed(data)
        data = self._waiting + data
        complete = len(data) - self._framer.held
        self._waiting = data[complete:]
        self._send_now(data[:complete])

    def _send_now(self, data: bytes) -> None:
        while data:
            state = self._state(POLL_MS)
            if state & select.POLLHUP:
                self.dropped += len(data)
                return
            batch = data[:BATCH_BYTES]
            if state & select.POLLOUT and self._unread() + len(batch) <= BUFFER_BYTES:
                data = data[self._write(batch) :]
            else:
                time.sleep(ROOM_S)

    def _write(self, data: bytes) -> int:
        try:
            return os.write(self._master, data)
        except BlockingIOError:
            return 0

    def receive(self, time_s: float = 0.0) -> bytes:
        """Bytes that the reader has written since the last call."""
        del time_s
        try:
            return os.read(self._master, READ_BYTES) if self._state() & select.POLLIN else b""
        except (BlockingIOError, OSError):
            return b""

    def _unread(self) -> int:
        slave = os.open(self.name, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            return struct.unpack("i", fcntl.ioctl(slave, termios.FIONREAD, b"\0" * 4))[0]
        finally:
            os.close(slave)

    def drain(self) -> None:
        """Wait until the reader has read everything, has closed, or reads nothing for DRAIN_S."""
        left, since = self._unread(), time.monotonic()
        while self.has_reader() and time.monotonic() - since < (DRAIN_S if left else QUIET_S):
            time.sleep(0.02)
            unread = self._unread()
            if unread != left:
                left, since = unread, time.monotonic()

    def close(self) -> None:
        """Close the board's end, so that the reader gets a hang-up."""
        if self._master >= 0:
            os.close(self._master)
            self._master = -1
