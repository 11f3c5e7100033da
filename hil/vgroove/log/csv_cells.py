"""What the cells of a CSV file show that their numbers do not: thousands separators, and a second
time column that the columns to its right belong to.
"""

import csv
import operator
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np

from vgroove.errors import VgrooveError
from vgroove.log.csv_dialect import Dialect, is_comment
from vgroove.log.nearest import nearest_columns
from vgroove.log.stated_units import unit_in_name
from vgroove.log.units_of_columns import TIME_COLUMN

THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}[.,]\d{3}")
BELOW_THOUSAND = re.compile(r"[+-]?\d{1,3}")
GROUPS = re.compile(r"[+-]?\d{1,3}(?:[.,' \u2009\u202f\xa0\u2019]\d{3})+(?:[.,]\d+)?")
# fewest different cells with a separator that are judged: of decimals that are written without the
# zeros at their end, a tenth have fewer than three digits
MIN_DIFFERENT = 10
MIN_ROWS_LESS = 5  # by which a column ends before the others


@dataclass(frozen=True)
class Table:
    """A CSV file: its path and dialect, and the function that opens its text."""

    path: Path
    dialect: Dialect
    open: Callable[[], TextIO]

    def cells(self, k: int) -> Iterator[str]:
        """The cells of a column in the rows: without blank lines, comments and a cut last line."""
        with self.open() as file:
            lines = (line for line in islice(file, self.dialect.skipped, None) if is_whole(line))
            for row in csv.reader(lines, delimiter=self.dialect.delimiter):
                if is_row(row) and not self.dialect.is_header_again(row):
                    yield row[k].strip() if k < len(row) else ""


def is_row(cells: Sequence[str]) -> bool:
    """Whether the cells of a line are a row: neither a blank line nor a comment."""
    return any(cell.strip() for cell in cells) and not is_comment(cells[0])


def is_whole(line: str) -> bool:
    """Whether a line has its end: the last one of a file that was cut has none."""
    return line.endswith(("\n", "\r"))


def refuse_thousands(table: Table, k: int, values: np.ndarray) -> None:
    """VgrooveError where the cells of column k, whose numbers are `values` (rows,), have thousands
    separators: whole numbers below 1000, and cells with three digits behind a separator, of which
    one ends in 0 (a writer of decimals without the zeros at their end never writes 1.100).
    """
    if not _may_have_thousands(values):
        return
    grouped, whole = "", False
    for cell in table.cells(k):
        if THOUSANDS.fullmatch(cell):
            grouped = cell if cell.endswith("0") else grouped
        elif BELOW_THOUSAND.fullmatch(cell):
            whole = True
        elif _is_filled(cell):
            return
    if grouped and whole:
        raise VgrooveError(
            f"{table.path}: column {table.dialect.header[k]}: its cells are whole numbers below "
            f"1000, or have three digits behind a separator, as {grouped!r}: write it without "
            "thousands separators (or, if these are decimals, each cell with all of them)."
        )


def _may_have_thousands(values: np.ndarray) -> bool:
    """Whether numbers (rows,) may be those of cells with thousands separators."""
    known = np.abs(values[np.isfinite(values)])
    if known.max(initial=0.0) >= 1000.0:
        return False
    groups = known[known != np.round(known)]
    if groups.min(initial=np.inf) < 1.0 or len(np.unique(groups)) < MIN_DIFFERENT:
        return False
    return bool(np.allclose(groups * 1e3, np.round(groups * 1e3), rtol=0.0, atol=1e-6))


def refuse_second_time(table: Table, columns: dict[int, np.ndarray]) -> None:
    """VgrooveError where one of the columns (rows,), by number, ends before the others, in the row
    in which a time column to its left ends that is not one of them.
    """
    header, last = table.dialect.header, {k: _last(values) for k, values in columns.items()}
    longest = max(last.values(), default=0)
    second = [j for j in range(len(header)) if j not in columns and _is_time(header[j])]
    for k in (k for k in sorted(last) if last[k] <= longest - MIN_ROWS_LESS):
        left = [j for j in second if j < k and min(columns) < j]
        if left and _last_filled(table.cells(left[-1])) == last[k]:
            raise VgrooveError(
                f"{table.path}: column {header[k]}: ends before the others, with the column "
                f"{header[left[-1]]}, which holds its times: save the two as a log of their own, "
                "or resample them to the times of the others."
            )


def refuse_two_of_a_name(table: Table, name: str) -> None:
    """VgrooveError where columns of one name differ; equal ones, as the times that a program writes
    beside each signal, are one column.
    """
    header = table.dialect.header
    first, *others = [k for k, other in enumerate(header) if other == name]
    for k in others:
        if any(map(operator.ne, table.cells(first), table.cells(k))):
            raise VgrooveError(
                f"{table.path}: line {table.dialect.header_line}: the column {name} appears "
                f"{header.count(name)} times, with other values: give each a name of its own in "
                "the header."
            )


def _is_time(name: str) -> bool:
    """Whether a column of a file seems to hold times."""
    stated = unit_in_name(name, TIME_COLUMN)
    return bool(nearest_columns(TIME_COLUMN, [name]) or (stated and stated.factor))


def _last(values: np.ndarray) -> int:
    """The last row (rows,) with a value; -1 without one."""
    return int(np.flatnonzero(np.isfinite(values))[-1]) if np.isfinite(values).any() else -1


def _last_filled(cells: Iterable[str]) -> int:
    return max((row for row, cell in enumerate(cells) if _is_filled(cell)), default=-1)


def _is_filled(cell: str) -> bool:
    """Whether a cell holds a sample: it is neither empty nor NaN."""
    return cell.lower() not in ("", "nan")
