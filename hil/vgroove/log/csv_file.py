"""CSV logs: a header with column names, a row a sample, empty cells or NaN for missing samples."""

import csv
import io
import os
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from vgroove.errors import VgrooveError
from vgroove.log.table import COLUMN_UNITS, Log, check_columns, checked
from vgroove.output import write_bytes


def read_csv(path: Path) -> Log:
    """Read and check a CSV log; VgrooveError with file, line and column."""
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise VgrooveError(
            f"{path}: its content does not match its ending .csv: byte {error.start} is not UTF-8 "
            "text."
        ) from error
    header, lines, rows = _split_rows(path, text)
    warnings = _check_header(path, header)
    known = [k for k, name in enumerate(header) if name == "time_s" or name in COLUMN_UNITS]
    underscores = text.find("_", text.find("\n")) >= 0
    cells = list(zip(*rows, strict=True)) or [()] * len(header)
    reader = _CellReader(path, lines, underscores)
    columns = {header[k]: reader.numbers(header[k], cells[k]) for k in known}
    time_s = columns.pop("time_s")
    return checked(Log(time_s, columns, str(path), warnings), lines)


def _split_rows(path: Path, text: str) -> tuple[list[str], list[int], list[list[str]]]:
    """Header, and the line number and cells of each row that is not blank."""
    lines, rows = [], []
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        for row in reader:
            if row:
                lines.append(reader.line_num)
                rows.append(row)
    except csv.Error as error:
        raise VgrooveError(f"{path}: line {reader.line_num}: is not CSV: {error}.") from error
    if not rows:
        raise VgrooveError(f"{path}: line 1: no header: the file is empty.")
    header = [cell.strip() for cell in rows[0]]
    for line, row in zip(lines[1:], rows[1:], strict=True):
        if len(row) != len(header):
            raise VgrooveError(
                f"{path}: line {line}: has {len(row)} cells, the header has {len(header)} columns."
            )
    return header, lines[1:], rows[1:]


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _check_header(path: Path, header: list[str]) -> list[str]:
    """Warnings for columns that are ignored; VgrooveError unless the header names the time, an
    input and another measured signal, each once.
    """
    if any(_is_number(name) for name in header):
        number = next(k for k, name in enumerate(header) if _is_number(name))
        raise VgrooveError(
            f"{path}: line 1, column {number + 1}: no header: {header[number]} is a number, "
            "not a name."
        )
    if len(header) == 1 and re.search(r"[;\t]", header[0]):
        raise VgrooveError(f"{path}: line 1: columns must be separated by commas.")
    for name in header:
        if name and header.count(name) > 1:
            raise VgrooveError(
                f"{path}: line 1: the column {name} appears {header.count(name)} times."
            )
    check_columns(str(path), header)
    return [
        f"{path}: line 1: the unknown column {name or '(no name)'} is ignored."
        for name in header
        if name not in (*COLUMN_UNITS, "time_s")
    ]


class _CellReader:
    """Converts the cells of a file to numbers; `lines` are the rows' line numbers."""

    def __init__(self, path: Path, lines: list[int], underscores: bool) -> None:
        self._path, self._lines, self._underscores = path, lines, underscores

    def numbers(self, name: str, cells: Sequence[str]) -> np.ndarray:
        """Cells of a column as floats (n,), NaN for empty ones; VgrooveError for the first cell
        that is no number or infinite.
        """
        try:
            if self._underscores:
                raise ValueError  # float() would accept 1_0 as 10
            values = np.fromiter(map(float, cells), float, len(cells))
        except ValueError:
            rows = zip(self._lines, cells, strict=True)
            values = np.array([self._number(name, line, cell) for line, cell in rows], float)
        infinite = np.isinf(values)
        if infinite.any():
            at = int(np.argmax(infinite))
            place = f"{self._path}: line {self._lines[at]}, column {name}"
            raise VgrooveError(f"{place}: {cells[at].strip()} is infinite.")
        return values

    def _number(self, name: str, line: int, cell: str) -> float:
        if not cell.strip():
            return float("nan")
        if "_" in cell or not _is_number(cell):
            place = f"{self._path}: line {line}, column {name}"
            raise VgrooveError(f"{place}: {cell!r} is not a number.")
        return float(cell)


def csv_header(names: Iterable[str]) -> bytes:
    """First line of a CSV log."""
    return (",".join(["time_s", *names]) + "\n").encode()


def csv_rows(time_s: np.ndarray, columns: Iterable[np.ndarray]) -> bytes:
    """Rows of a CSV log: time to the last bit (stamps since 1970 need 17 digits), the rest to 12
    digits, missing samples as NaN.
    """
    table = [np.asarray(column, float).tolist() for column in (time_s, *columns)]
    line = "%r" + ",%.12g" * (len(table) - 1) + "\n"
    return "".join(line % row for row in zip(*table, strict=True)).replace("nan", "NaN").encode()


def write_csv(log: Log, path: str | os.PathLike[str]) -> None:
    """Write a log as CSV, whole or not at all; VgrooveError when it cannot be written."""
    write_bytes(path, csv_header(log.columns) + csv_rows(log.time_s, log.columns.values()))
