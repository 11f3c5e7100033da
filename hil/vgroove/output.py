"""Writes files whole or not at all, several together all or none, and checks before the work that
they can be written. The name - is standard output.
"""

import json
import os
import stat
import sys
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from vgroove.errors import VgrooveError

PART_PREFIX, PART_SUFFIX = ".vgroove-", ".part"
STDOUT = Path("-")


def _is_device(path: Path) -> bool:
    """Whether it is a terminal, pipe or device such as /dev/stdout, which is written in place."""
    if path == STDOUT:
        return True
    return path.exists() and (os.path.abspath(path).startswith("/dev/") or not path.is_file())


def _mode(path: Path) -> int:
    """Permissions of the file that is replaced, or those of a new file."""
    if path.exists():
        return stat.S_IMODE(path.stat().st_mode)
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """A binary file that replaces `path` when the block ends without an exception, and is deleted
    otherwise. Raises OSError.
    """
    path = Path(path)
    if path == STDOUT:
        sys.stdout.flush()
        yield sys.stdout.buffer
        sys.stdout.buffer.flush()
        return
    if _is_device(path):
        device = path.open("wb")
        try:
            yield device
            device.flush()
        finally:
            with suppress(OSError):  # of bytes that could not be written
                device.close()
        return
    path = Path(os.path.realpath(path))
    handle, part = tempfile.mkstemp(prefix=PART_PREFIX, suffix=PART_SUFFIX, dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.chmod(part, _mode(path))
        os.replace(part, path)
    except BaseException:
        with suppress(OSError):
            os.unlink(part)
        raise


def unwritable(path: str | os.PathLike[str], error: OSError) -> VgrooveError:
    """The error for a file that could not be written."""
    return VgrooveError(f"{path}: cannot be written: {error.strerror or error}.")


def write_bytes(path: str | os.PathLike[str], content: bytes) -> None:
    """Write a file whole or not at all; VgrooveError when it cannot be written."""
    try:
        with replacing(path) as file:
            file.write(content)
    except OSError as error:
        raise unwritable(path, error) from error


def write_all(files: Iterable[tuple[Path, bytes | str]]) -> None:
    """Write several files, all or none; texts in UTF-8. VgrooveError when one cannot be written.

    The files get their names after the content of all is on the disk. Standard output and devices,
    from which nothing can be taken back, are written last of the contents.
    """
    with ExitStack() as opened:
        for path, content in sorted(files, key=lambda file: _is_device(file[0])):
            try:
                file = opened.enter_context(replacing(path))
                file.write(content.encode() if isinstance(content, str) else content)
                _to_disk(file)
            except OSError as error:
                raise unwritable(path, error) from error


def _to_disk(file: BinaryIO) -> None:
    file.flush()
    if stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        os.fsync(file.fileno())


def json_text(content: Any, allow_nan: bool = False) -> str:
    """A value as the text of a JSON file. NaN and infinity, which are no JSON, raise ValueError
    unless `allow_nan` is set.
    """
    return json.dumps(content, indent=1, allow_nan=allow_nan) + "\n"


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a text in UTF-8, whole or not at all; VgrooveError when it cannot be written."""
    write_bytes(path, text.encode())


def write_json(path: str | os.PathLike[str], content: Any, allow_nan: bool = False) -> None:
    """Write `json_text` of a value, whole or not at all; VgrooveError when it cannot be written."""
    write_text(path, json_text(content, allow_nan))


def check_outputs(outputs: Iterable[Path | None], inputs: Iterable[Path] = ()) -> None:
    """VgrooveError for an output that could not be written; to be called before the work.

    None (an output that is not wanted), the devices of /dev and standard output are accepted. No
    two outputs, and no output and input, may be the same file; one may be standard output.
    """
    taken = {os.path.realpath(path): path for path in inputs}
    outputs = [path for path in outputs if path is not None]
    if outputs.count(STDOUT) > 1:
        raise VgrooveError("-: is given twice: standard output takes one of the files.")
    for path in outputs:
        try:
            _check_output(path)
        except OSError as error:
            raise unwritable(path, error) from error
        except ValueError as error:
            raise VgrooveError(f"{str(path)!r} is not the name of a file: {error}.") from error
        if _is_device(path):
            continue
        place = os.path.realpath(path)
        if place in taken:
            raise VgrooveError(f"{path}: is given twice, as {taken[place]} and as a file to write.")
        taken[place] = path


def _check_output(path: Path) -> None:
    """Try what replacing() needs: a writable file of that name and a new file in its folder."""
    if path == STDOUT:
        return
    if path.is_dir():
        raise VgrooveError(f"{path}: cannot be written: it is a folder.")
    if not path.parent.is_dir():
        raise VgrooveError(f"{path}: cannot be written: the folder {path.parent} does not exist.")
    with suppress(FileNotFoundError):
        path.stat()  # raises OSError for a name that the file system does not accept
        if not os.access(path, os.W_OK):
            raise VgrooveError(f"{path}: cannot be written: it is read-only.")
    if not _is_device(path):
        with tempfile.NamedTemporaryFile(
            prefix=PART_PREFIX, suffix=PART_SUFFIX, dir=Path(os.path.realpath(path)).parent
        ):
            pass
