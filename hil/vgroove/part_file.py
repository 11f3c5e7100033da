"""Part files: what a recording writes until it is complete. One process writes a part file; one
that a killed process left is renamed, never overwritten.
"""

import io
import os
from contextlib import suppress
from pathlib import Path
from typing import Any

from vgroove.errors import VgrooveError

try:
    import fcntl
except ImportError:  # Windows, which does not let two processes write one file
    fcntl = None


class UnbufferedFile(io.FileIO):
    """A file without a buffer that writes all bytes or raises: bytes that could not be written are
    not tried again on closing.
    """

    def write(self, data: Any) -> int:
        view = memoryview(data).cast("B")
        total = len(view)
        while view:
            view = view[super().write(view) :]
        return total


def part_of(output: Path) -> Path:
    """The part file of a log, hidden beside it."""
    return output.with_name(f".{output.stem}.part{output.suffix}")


class PartFile:
    """The part file of `output`, open for writing and locked until `release`.

    `recovered` is the new name of a part file that a killed process had left, else None.
    VgrooveError where another process writes the part file; OSError where it cannot be made.
    """

    def __init__(self, output: Path) -> None:
        self.path = part_of(output)
        self.recovered: Path | None = None
        handle = self._create(output)
        while handle is None:
            self.recovered = _keep_left_part(self.path, output) or self.recovered
            handle = self._create(output)
        self.file = UnbufferedFile(handle, "wb")
        # the lock ends with the last copy of the descriptor: it outlasts the closing of the file
        self._lock: int | None = os.dup(handle)

    def _create(self, output: Path) -> int | None:
        """Descriptor of a new, locked part file; None where a part file exists."""
        try:
            handle = os.open(self.path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
        except FileExistsError:
            return None
        if _lock(handle) and _is_at(handle, self.path):
            return handle
        os.close(handle)  # another process took it between the two steps
        raise _taken(output, self.path)

    @property
    def locked(self) -> bool:
        """Whether this process has the part file locked."""
        return self._lock is not None

    def release(self) -> None:
        """Unlock: the part file has got its name or is deleted."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None


def _keep_left_part(part: Path, output: Path) -> Path | None:
    """Rename a part file that no process writes; an empty one is deleted. VgrooveError where a
    process writes it.
    """
    try:
        handle = os.open(part, os.O_RDONLY)
    except FileNotFoundError:
        return None
    try:
        if not _lock(handle):
            raise _taken(output, part)
        if not _is_at(handle, part):
            return None
        if os.fstat(handle).st_size == 0:
            part.unlink()
            return None
        kept = _free_name(output)
        part.rename(kept)
        return kept
    finally:
        os.close(handle)


def _free_name(output: Path) -> Path:
    """The first of NAME.recovered-1.csv, NAME.recovered-2.csv, ... that does not exist."""
    number = 1
    while (name := output.with_stem(f"{output.stem}.recovered-{number}")).exists():
        number += 1
    return name


def _lock(handle: int) -> bool:
    """Lock an open file; False where another process has locked it."""
    if fcntl is None:
        return True
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        return True
    return True


def _is_at(handle: int, path: Path) -> bool:
    """Whether an open file is the one that a path names."""
    with suppress(FileNotFoundError):
        return os.path.samestat(os.fstat(handle), path.stat())
    return False


def _taken(output: Path, part: Path) -> VgrooveError:
    return VgrooveError(
        f"{output}: another process records to this file ({part.name} is in use): end it, or give "
        "another name."
    )
