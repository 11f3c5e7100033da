"""Logs: one table of samples over time, from a CSV file, a CAN recording, the board or a simulation
(docs/spec/gap.md, section 1).
"""

import os
import re
from collections.abc import Callable
from pathlib import Path

from vgroove.errors import VgrooveError
from vgroove.log.can_files import read_asc, read_blf, read_mf4
from vgroove.log.csv_file import csv_bytes, csv_header, csv_rows, read_csv, write_csv
from vgroove.log.frames import log_from_session, log_from_stream
from vgroove.log.table import (
    COLUMN_LABELS,
    COLUMN_UNITS,
    MIN_USABLE_SAMPLES,
    Log,
    current_is_unsigned,
)

__all__ = [
    "COLUMN_LABELS",
    "COLUMN_UNITS",
    "LOG_ENDINGS",
    "MIN_USABLE_SAMPLES",
    "Log",
    "csv_bytes",
    "csv_header",
    "csv_rows",
    "current_is_unsigned",
    "log_from_session",
    "log_from_stream",
    "read_log",
    "write_csv",
]

READERS: dict[str, Callable[[Path], Log]] = {
    ".csv": read_csv,
    ".mf4": read_mf4,
    ".blf": read_blf,
    ".asc": read_asc,
}
LOG_ENDINGS = tuple(READERS)
HEAD_BYTES = 4096  # that are compared with the ending
_MAGIC = {".mf4": b"MDF ", ".blf": b"LOGG"}


def read_log(path: str | os.PathLike[str]) -> Log:
    """Read and check a CSV, MF4, BLF or ASC log.

    VgrooveError with file, line and column for everything that docs/spec/gap.md, section 1 rejects.
    """
    path = Path(path)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise VgrooveError(f"{path}: a log ends in .csv, .mf4, .blf or .asc.")
    try:
        _check_ending(path)
        return reader(path)
    except OSError as error:
        raise VgrooveError(f"{path}: cannot be read: {error.strerror or error}.") from error


def _check_ending(path: Path) -> None:
    """VgrooveError unless the first bytes are those of the kind that the ending names."""
    ending = path.suffix.lower()
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    wrong = _wrong_kind(ending, head)
    if wrong:
        raise VgrooveError(f"{path}: its content does not match its ending {ending}: {wrong}.")


def _wrong_kind(ending: str, head: bytes) -> str:
    """Why the first bytes are not those of the ending's kind; empty where they are."""
    for kind, magic in _MAGIC.items():
        if kind != ending and head.startswith(magic):
            return f"it is a {kind[1:].upper()} file"
        if kind == ending and not head.startswith(magic):
            return "its first bytes are not those of one"
    if ending in (".csv", ".asc") and b"\0" in head:
        return "it holds binary data (text must be UTF-8)"
    if ending == ".csv" and re.match(rb"date \w+ \w+ ", head):
        return "it is an ASC file"
    if ending == ".asc" and not re.match(rb"\s*(//.*\s*)*date ", head):
        return "an ASC file begins with its date"
    return ""
