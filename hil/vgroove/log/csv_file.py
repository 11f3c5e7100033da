"""CSV logs: a header with column names, a row a sample, empty cells or NaN for missing samples.
Separator, decimal comma, comments and index columns are recognised (docs/input_format.md).
"""

import csv
import gzip
import os
import re
import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, islice, repeat
from pathlib import Path

import numpy as np

from vgroove.errors import VgrooveError
from vgroove.log.clock import in_order
from vgroove.log.column_map import NO_MAP, ColumnMap, Place, other_names, other_scales
from vgroove.log.csv_cells import (
    GROUPS,
    Table,
    is_row,
    is_whole,
    refuse_second_time,
    refuse_thousands,
    refuse_two_of_a_name,
)
from vgroove.log.csv_dialect import Dialect, detect_dialect, is_number, number_of, with_point
from vgroove.log.csv_text import CsvText, csv_text
from vgroove.log.dates import LOOKS_LIKE_DATE, seconds_of_date
from vgroove.log.raw_columns import factor_of, refuse_unit_of_dates
from vgroove.log.several_devices import refuse_several_devices
from vgroove.log.table import Log, check_columns, checked
from vgroove.log.units_of_columns import NUMBER, TIME_COLUMN
from vgroove.output import write_bytes

PAIR = re.compile(rf"[^\W\d][^:=]*\s*[:=]\s*{NUMBER.pattern}")  # as speed:12.5
CHUNK_LINES = 100_000  # lines that are converted at once: some 10 MB of text


def read_csv(path: Path, columns: ColumnMap = NO_MAP) -> Log:
    """Read and check a CSV log, compressed where its name ends in .gz; VgrooveError with file, line
    and column.

    The rows are converted in chunks: the text of the whole file would take many times the memory
    of its numbers.
    """
    try:
        return _read(path, columns)
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise VgrooveError(f"{path}: is a damaged or truncated gzip file: {error}.") from error
    except csv.Error as error:
        raise VgrooveError(
            f"{path}: is not CSV: {error}: leave columns of long texts out of the file."
        ) from error


def _read(path: Path, columns: ColumnMap) -> Log:
    text = csv_text(path)
    dialect, most = _dialect(text), text.most_lines
    places, warnings = _check_header(path, dialect, columns)
    warnings += [text.warning] if text.warning else []
    known = [dialect.header.index(place.name) for place in places.values()]
    # one array for all rows: joining the chunks at the end would take the memory twice
    lines, table, count = np.empty(most, int), np.empty((len(known), most)), 0
    with text.open() as file:
        whole = _WholeLines(file)
        rows = _Rows(path, whole, dialect, places[TIME_COLUMN].name)
        for chunk in rows.chunks(known):
            part = slice(count, count := count + len(chunk.lines))
            lines[part], table[:, part] = chunk.lines, chunk.values
    if whole.cut_line:
        warnings.append(f"{path}: line {whole.cut_line}: is left out: {whole.reason}.")
    if rows.repeated:
        warnings.append(
            f"{path}: line {rows.repeated[0]}: holds the names again and is left out"
            + (f", as are {len(rows.repeated) - 1} others." if rows.repeated[1:] else ".")
        )
    cells = Table(path, dialect, text.open)
    _refuse_cells(
        cells,
        {k: table[n, :count] for n, k in enumerate(known)},
        dict(zip(known, places, strict=True)),
    )
    values = dict(zip(places, table[:, :count], strict=True))
    if rows.dates:
        refuse_unit_of_dates(places[TIME_COLUMN], str(path))
        places = places | {TIME_COLUMN: Place(places[TIME_COLUMN].name, 1.0)}
    found, factors = _converted(cells, places, values, warnings)
    time_s = in_order(found.pop(TIME_COLUMN), factors[TIME_COLUMN], warnings, str(path))
    log = Log(time_s, found, str(path), warnings, read_from=other_names(places))
    log = checked(replace(log, scales=other_scales(places, factors)), lines[:count])
    return replace(log, time_s=time_s - time_s[0]) if rows.dates else log


def _converted(
    table: Table, places: dict[str, Place], values: dict[str, np.ndarray], warnings: list[str]
) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """The log columns (rows,) in their own units, and what one of the file's unit is in these."""
    units = dict(zip(table.dialect.header, table.dialect.units, strict=False))
    factors = {
        column: factor_of(place, column, units.get(place.name, ""), str(table.path), warnings)
        for column, place in places.items()
    }
    found = {c: places[c].scaled(v, factors[c]) for c, v in values.items()}
    return found, factors


def _refuse_cells(table: Table, columns: dict[int, np.ndarray], names: dict[int, str]) -> None:
    """VgrooveError for columns (rows,), by number, whose cells mean other numbers or times, or rows
    of several devices; names: those of the columns in the log.
    """
    for name in {table.dialect.header[k] for k in columns}:
        refuse_two_of_a_name(table, name)
    for k, values in columns.items():
        refuse_thousands(table, k, values)
    refuse_second_time(table, columns)
    refuse_several_devices(table, columns, names)


def _dialect(text: CsvText) -> Dialect:
    """How the file is written; VgrooveError where it is empty or no CSV."""
    path = text.path
    try:
        with text.open() as file:
            dialect = detect_dialect(file)
    except csv.Error as error:
        raise VgrooveError(f"{path}: the head of the file is not CSV: {error}.") from error
    if dialect is None:
        raise VgrooveError(f"{path}: line 1: no header: the file is empty.")
    return dialect


class _WholeLines:
    """The lines of an open file (newline="") without a last line that has no line end; its number
    is then `cut_line`, and why it is left out `reason`. The first line is always kept.
    """

    def __init__(self, file: Iterable[str]) -> None:
        self._file, self.cut_line, self.reason = file, 0, ""

    def __iter__(self) -> Iterator[str]:
        for number, line in enumerate(self._file, 1):
            if number > 1 and not is_whole(line):
                self.cut_line, zeros = number, line.count("\0")
                self.reason = "its line end is missing, so that it may have been cut"
                if zeros:
                    self.reason = f"it holds {zeros} bytes 0, that a logger reserved and left empty"
                return
            yield line


@dataclass
class _Chunk:
    """Successive rows: their line numbers (m,) and the values (known, m) of the known columns."""

    lines: np.ndarray
    values: np.ndarray


class _Rows:
    """The rows of an open file (newline="") of a dialect, read in chunks of CHUNK_LINES lines.
    dates: whether the column `time_name` holds dates, which become seconds. repeated: the lines
    that hold the names again, as a logger writes them when it starts again.
    """

    def __init__(self, path: Path, file: Iterable[str], dialect: Dialect, time_name: str) -> None:
        self.dates, self._time_name = False, time_name
        self.repeated: list[int] = []
        self._path, self._file, self._line = path, iter(file), dialect.skipped
        self.header, self._delimiter, self._dialect = dialect.header, dialect.delimiter, dialect
        for _ in range(dialect.skipped):
            next(self._file)

    def chunks(self, known: Sequence[int]) -> Iterator[_Chunk]:
        """The rows, with the columns of these indices."""
        while lines := list(islice(self._file, CHUNK_LINES)):
            yield self._fast(lines, known) or self._careful(lines, known)

    def _fast(self, lines: list[str], known: Sequence[int]) -> _Chunk | None:
        """The rows of these lines, read by NumPy, which is fast. None if a line is blank, has an
        open quote or a quote within a cell, too few or too many cells, or a cell that is no finite
        number.
        """
        delimiter, text = self._delimiter, "".join(lines)
        if "_" in text:
            return None
        if '"' in text:  # a quoted separator makes the number of cells another one
            inner = rf'[^{delimiter}\r\n]"[^{delimiter}\r\n]'
            if re.search(inner, text) or any(line.count('"') % 2 for line in lines):
                return None
            lines = [line.replace('"', "") for line in lines]
        if set(map(str.count, lines, repeat(delimiter))) != {len(self.header) - 1}:
            return None
        if delimiter != "," and "," in text:
            lines = [with_point(line) for line in lines]
        try:
            values = np.loadtxt(lines, delimiter=delimiter, comments=None, usecols=known, ndmin=2)
        except ValueError:
            return None
        if len(values) != len(lines) or np.isinf(values).any():
            return None
        first = self._line + 1
        self._line += len(lines)
        return _Chunk(np.arange(first, first + len(lines)), values.T)

    def _careful(self, lines: list[str], known: Sequence[int]) -> _Chunk:
        """The rows of these lines cell by cell; VgrooveError for those that cannot be read."""
        numbers, rows = [], []
        for line, row in self._split(lines):
            if len(row) != len(self.header):
                raise VgrooveError(self._wrong_count(line, row))
            numbers.append(line)
            rows.append(row)
        cells = list(zip(*rows, strict=True)) or [()] * len(self.header)
        reader = _CellReader(self._path, numbers)
        values = np.array([self._values(reader, k, cells[k]) for k in known])
        return _Chunk(np.array(numbers, int), values)

    def _values(self, reader: "_CellReader", k: int, cells: Sequence[str]) -> np.ndarray:
        """Column k of the file as numbers (m,)."""
        name = self.header[k]
        if name == self._time_name and cells and LOOKS_LIKE_DATE.match(cells[0].strip()):
            self.dates = True
            return reader.dates(name, cells)
        if unit := dict(enumerate(self._dialect.in_cells)).get(k):
            cells = reader.without_unit(name, cells, unit)
        return reader.numbers(name, cells)

    def _wrong_count(self, line: int, row: list[str]) -> str:
        """The message for a row with another number of cells than the header."""
        decimal = len(row) > len(self.header) and self._delimiter == ","
        decimal = decimal and all(cell.strip().lstrip("+-").isdigit() for cell in row)
        why = ""
        if decimal:
            why = (
                " Numbers with a decimal comma need another separator: write the file with "
                "semicolons or tabs."
            )
        elif len(row) > len(self.header):
            why = " Give each column a name in the header, in the order of the cells."
        return (
            f"{self._path}: line {line}: has {len(row)} cells, the header has {len(self.header)} "
            f"columns.{why}"
        )

    def _split(self, lines: list[str]) -> Iterator[tuple[int, list[str]]]:
        """Line number and cells of each row that is neither blank nor a comment and begins in these
        lines; a quoted cell may go on in the lines that follow.
        """
        reader = csv.reader(chain(lines, self._file), strict=True, delimiter=self._delimiter)
        before = self._line
        try:
            while reader.line_num < len(lines):
                row = next(reader, None)
                self._line = before + reader.line_num
                if row is None:
                    return
                if self._dialect.is_header_again(row):
                    self.repeated.append(self._line)
                elif is_row(row):
                    yield self._line, row
        except csv.Error as error:
            line = before + reader.line_num
            raise VgrooveError(f"{self._path}: line {line}: is not CSV: {error}.") from error


def _check_header(
    path: Path, dialect: Dialect, columns: ColumnMap
) -> tuple[dict[str, Place], list[str]]:
    """The place of each log column, and warnings for columns that are ignored; VgrooveError unless
    the header names the time, an input and another measured signal, each once.
    """
    header, where = dialect.header, f"{path}: line {dialect.header_line}"
    if header[0].startswith("{"):
        raise VgrooveError(
            f"{where}: holds a JSON object: write the names once, in the first line, and the "
            "values alone below them, separated by commas."
        )
    if len(header) > 1 and all(map(PAIR.fullmatch, header)):
        raise VgrooveError(
            f"{where}: each cell is a name and a value ({header[0]}): write the names once, in the "
            "first line, and the values alone below them."
        )
    if any(map(is_number, header)) and not dialect.units:
        number = next(k for k, name in enumerate(header) if is_number(name))
        raise VgrooveError(
            f"{where}, column {number + 1}: no header: {header[number]} is a number, not a name."
        )
    places = columns.places(where, header)
    used = {place.name for place in places.values()}
    unknown = [name for name in header if name not in used]
    if len(header) == 1:
        raise VgrooveError(
            f"{where}: one column only: columns are separated by commas, semicolons or tabs: write "
            "the file with one of them."
        )
    check_columns(where, places, unknown)
    warnings = [
        f"{where}: the unknown column {name or '(no name)'} is ignored." for name in unknown
    ]
    if dialect.head_lines:
        warnings.append(f"{where}: {dialect.head_lines} lines before the names are left out.")
    if dialect.lines_below:
        warnings.append(f"{where}: {dialect.lines_below} lines of words below it are left out.")
    return places, warnings


class _CellReader:
    """Converts cells to numbers; `lines` are the line numbers of their rows."""

    def __init__(self, path: Path, lines: list[int]) -> None:
        self._path, self._lines = path, lines

    def numbers(self, name: str, cells: Sequence[str]) -> np.ndarray:
        """Cells of a column as floats (n,), NaN for empty ones; VgrooveError for the first cell
        that is no number or infinite.
        """
        try:
            if any("_" in cell for cell in cells):
                raise ValueError  # float() would accept 1_0 as 10
            values = np.fromiter(map(float, map(with_point, cells)), float, len(cells))
        except ValueError:
            rows = zip(self._lines, cells, strict=True)
            values = np.array([self._number(name, line, cell) for line, cell in rows], float)
        infinite = np.isinf(values)
        if infinite.any():
            at = int(np.argmax(infinite))
            place = f"{self._path}: line {self._lines[at]}, column {name}"
            raise VgrooveError(f"{place}: {cells[at].strip()} is infinite.")
        return values

    def without_unit(self, name: str, cells: Sequence[str], unit: str) -> list[str]:
        """Cells of a column without the unit that its first cell ends in; VgrooveError for the
        first filled cell that does not.
        """
        for line, cell in zip(self._lines, cells, strict=True):
            if not (cell.strip().endswith(unit) or cell.strip().lower() in ("", "nan")):
                raise VgrooveError(
                    f"{self._path}: line {line}, column {name}: {cell!r} is not in {unit}, as the "
                    "first cell of the column is: write all of them in one unit."
                )
        return [cell.strip().removesuffix(unit) for cell in cells]

    def dates(self, name: str, cells: Sequence[str]) -> np.ndarray:
        """Dates of a column as seconds (n,); VgrooveError for the first cell that is none."""
        seconds = [seconds_of_date(cell) for cell in cells]
        if None in seconds:
            at = seconds.index(None)
            raise VgrooveError(
                f"{self._path}: line {self._lines[at]}, column {name}: {cells[at]!r} is not a "
                "number or a date: write seconds, or dates as 2026-03-31 12:00:00.001."
            )
        return np.array(seconds, float)

    def _number(self, name: str, line: int, cell: str) -> float:
        if not cell.strip():
            return float("nan")
        if "_" in cell or not is_number(cell):
            place = f"{self._path}: line {line}, column {name}"
            if GROUPS.fullmatch(cell.strip()):
                raise VgrooveError(f"{place}: {cell!r}: write it without thousands separators.")
            raise VgrooveError(
                f"{place}: {cell!r} is not a number (a missing sample is an empty cell or NaN)."
            )
        return number_of(cell)


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


def csv_bytes(log: Log) -> bytes:
    """A log as the content of a CSV file."""
    return csv_header(log.columns) + csv_rows(log.time_s, log.columns.values())


def write_csv(log: Log, path: str | os.PathLike[str]) -> None:
    """Write a log as CSV, whole or not at all; VgrooveError when it cannot be written."""
    write_bytes(path, csv_bytes(log))
