"""Logs: one table of samples over time, from a CSV file, a CAN recording, the board or a simulation
(docs/spec/gap.md, section 1).
"""

import os
import re
from collections.abc import Callable
from pathlib import Path

from vgroove.errors import VgrooveError
from vgroove.log.can_files import read_asc, read_blf, read_mf4
from vgroove.log.column_map import NO_MAP, ColumnMap, column_map
from vgroove.log.csv_file import csv_bytes, csv_header, csv_rows, read_csv, write_csv
from vgroove.log.csv_text import UTF_16_MARKS
from vgroove.log.mat_file import read_mat
from vgroove.log.parquet_file import read_parquet
from vgroove.log.table import (
    COLUMN_LABELS,
    COLUMN_UNITS,
    INPUTS,
    MEASURED,
    MIN_USABLE_SAMPLES,
    Log,
    current_is_unsigned,
)
from vgroove.log.tables import as_list, as_log
from vgroove.log.telemetry_log import log_from_session, log_from_stream

__all__ = [
    "COLUMN_LABELS",
    "COLUMN_UNITS",
    "INPUTS",
    "LOG_ENDINGS",
    "MEASURED",
    "MIN_USABLE_SAMPLES",
    "NO_MAP",
    "READERS",
    "ColumnMap",
    "Log",
    "as_list",
    "as_log",
    "column_map",
    "csv_bytes",
    "csv_header",
    "csv_rows",
    "current_is_unsigned",
    "log_from_session",
    "log_from_stream",
    "read_log",
    "write_csv",
]

READERS: dict[str, Callable[[Path, ColumnMap], Log]] = {
    ".csv": read_csv,
    ".csv.gz": read_csv,
    ".mf4": read_mf4,
    ".blf": read_blf,
    ".asc": read_asc,
    ".mat": read_mat,
    ".parquet": read_parquet,
}
LOG_ENDINGS = (".csv", ".mf4", ".blf", ".asc")  # that a recording can be written as
HEAD_BYTES = 4096  # that are compared with the ending
_MAGIC = {
    ".mf4": b"MDF ",
    ".blf": b"LOGG",
    ".csv.gz": b"\x1f\x8b",
    ".mat": b"MATLAB ",
    ".parquet": b"PAR1",
}


def read_log(path: str | os.PathLike[str], columns: ColumnMap = NO_MAP) -> Log:
    """Read and check a log in one of the formats of docs/input_format.md; `columns` says which
    column of the file is which column of the log, beside those of the same name.

    VgrooveError with file, line and column for everything that docs/spec/gap.md, section 1 rejects.
    """
    path = Path(path)
    ending = _ending(path)
    if ending is None:
        raise VgrooveError(f"{path}: {_unknown_ending(path)}.")
    try:
        _check_ending(path, ending)
        return READERS[ending](path, columns)
    except OSError as error:
        raise VgrooveError(f"{path}: cannot be read: {error.strerror or error}.") from error


def _ending(path: Path) -> str | None:
    """The ending of a log file; None for another one."""
    return next((ending for ending in READERS if path.name.lower().endswith(ending)), None)


def _unknown_ending(path: Path) -> str:
    """What to do with a file whose ending is none of a log."""
    try:
        head = _head(path)
    except OSError:
        head = b""
    for ending, magic in _MAGIC.items():
        if head.startswith(magic):
            return f"its content is that of an {ending} file: let its name end so"
    *most, last = READERS
    return (
        f"a log ends in {', '.join(most)} or {last}: export it as one of them (a text with "
        "separated columns is .csv)"
    )


def _head(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(HEAD_BYTES)


def _check_ending(path: Path, ending: str) -> None:
    """VgrooveError unless the first bytes are those of the kind that the ending names."""
    wrong = _wrong_kind(ending, _head(path))
    if wrong:
        raise VgrooveError(f"{path}: its content does not match its ending {ending}: {wrong}.")


def _wrong_kind(ending: str, head: bytes) -> str:
    """Why the first bytes are not those of the ending's kind; empty where they are."""
    for kind, magic in _MAGIC.items():
        if kind != ending and head.startswith(magic):
            return f"it is a {kind[1:].upper()} file"
        if kind == ending and not head.startswith(magic):
            older = ' of version 5 or later: write it by save(..., "-v7")' if kind == ".mat" else ""
            return f"its first bytes are not those of one{older}"
    marked = head.startswith(UTF_16_MARKS)
    if ending == ".asc" and marked:
        return "it is UTF-16, which is read as binary data: save it in the encoding UTF-8"
    if ending in (".csv", ".asc") and b"\0" in head and not marked:
        return "it holds binary data (text must be UTF-8)"
    if ending == ".csv" and re.match(rb"date \w+ \w+ ", head):
        return "it is an ASC file"
    if ending == ".asc" and not re.match(rb"\s*(//.*\s*)*date ", head):
        return "an ASC file begins with its date (let a text with separated columns end in .csv)"
    return ""
