"""The simulated board's UART as a pseudo-terminal that recorders open like a serial port; nothing
is lost while somebody reads.
"""

import fcntl
import os
import select
import struct
import termios
import time
import tty

from vgroove.errors import VgrooveError

# a serial library flushes its input while it opens a port; a real board is still in its bootloader
# then
SETTLE_S = 0.3
DRAIN_S = 5.0
# the kernel refills what the reader sees from a hidden buffer, later on a busy machine: empty once
# is not yet drained
QUIET_S = 0.3


class PtyLine:
    """One end is the board; the other, `name`, is a raw terminal for the reader. A context manager.

    While a reader has the port open, sending blocks until there is room. While none has, bytes are
    dropped, as on a wire.
    """

    def __init__(self) -> None:
        try:
            self._master, slave = os.openpty()
        except OSError as error:
            raise VgrooveError(f"no pseudo-terminal is to be had: {error.strerror}") from error
        tty.setraw(slave)
        self.name = os.ttyname(slave)
        # from now on the master tells by a hang-up whether somebody has the port open
        os.close(slave)
        os.set_blocking(self._master, False)
        self._poll = select.poll()
        self._poll.register(self._master, select.POLLOUT | select.POLLIN)
        self.dropped = 0

    def __enter__(self) -> "PtyLine":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _state(self, wait_ms: int = 0) -> int:
        events = self._poll.poll(wait_ms)
        return events[0][1] if events else 0

    def has_reader(self) -> bool:
        """Whether somebody has the port open."""
        return not self._state() & select.POLLHUP

    def wait_for_reader(self, limit_s: float | None = None) -> bool:
        """Wait until somebody has opened the port and is settled; False when the limit passes
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
        """Hand bytes to the reader; blocks while its buffer is full, drops them when the port is
        closed.
        """
        while data:
            state = self._state(100)
            if state & select.POLLHUP:
                self.dropped += len(data)
                return
            if state & select.POLLOUT:
                data = data[self._write(data) :]

    def _write(self, data: bytes) -> int:
        try:
            return os.write(self._master, data)
        except BlockingIOError:
            return 0

    def receive(self, time_s: float = 0.0) -> bytes:
        """What the reader has written since the last call."""
        del time_s
        try:
            return os.read(self._master, 4096) if self._state() & select.POLLIN else b""
        except (BlockingIOError, OSError):
            return b""

    def _unread(self) -> int:
        slave = os.open(self.name, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            return struct.unpack("i", fcntl.ioctl(slave, termios.FIONREAD, b"\0" * 4))[0]
        finally:
            os.close(slave)

    def drain(self) -> None:
        """Wait until the reader has taken everything, has gone, or has taken nothing for DRAIN_S."""
        left, since = self._unread(), time.monotonic()
        while self.has_reader() and time.monotonic() - since < (DRAIN_S if left else QUIET_S):
            time.sleep(0.02)
            now_left = self._unread()
            if now_left != left:
                left, since = now_left, time.monotonic()

    def close(self) -> None:
        """Hang up."""
        if self._master >= 0:
            os.close(self._master)
            self._master = -1
