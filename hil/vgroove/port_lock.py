"""A lock on a serial port, so that two programs do not use it at once."""

import errno
import os

from vgroove.errors import VgrooveError

if os.name == "posix":
    import fcntl

IN_USE = (errno.EAGAIN, errno.EBUSY)  # of flock; of a port that was opened with TIOCEXCL


class PortLock:
    """Locks a port (flock, which pyserial's `exclusive` uses) until it is released. It must be made
    before the port is opened: opening sets the rate and discards received bytes, also those of the
    program that uses the port.

    VgrooveError where another program has locked the port, or its name is empty. A port that cannot
    be opened is not locked, and one of Windows can be opened once only.
    """

    def __init__(self, port: str) -> None:
        self._handle: int | None = None
        if not port:
            raise VgrooveError("the name of the port is empty: give it as /dev/ttyACM0 or COM3.")
        if os.name != "posix":
            return
        try:
            self._handle = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            fcntl.flock(self._handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            self.release()
            if error.errno in IN_USE:
                raise VgrooveError(
                    f"{port}: the port is in use by another program: end it, or name another port."
                ) from error

    def release(self) -> None:
        """Release the port, which may be locked again then."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None
