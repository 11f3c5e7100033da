"""How a CSV file is written: separator, lines before the header, header, index columns."""

import csv
import re
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import islice

from vgroove.log.dates import seconds_of_date
from vgroove.log.stated_units import NO_UNIT
from vgroove.log.units_of_columns import bare, is_unit

DELIMITERS = "\t;,"  # in the order in which they are tried; a comma may be a decimal sign
COMMENTS = ("#", "%")
HEAD_LINES = 1000  # within which the header is looked for
SEPARATOR_LINE = re.compile(r'"?sep=.?"?', re.IGNORECASE)  # with which Excel states the separator
NO_UNIT_CELLS = (*NO_UNIT, "%")  # that a line of units may hold for plain numbers


@dataclass(frozen=True)
class Dialect:
    """Separator of the cells, names of the columns, the line that holds them, the number of lines
    before the first row, the units that a line below the names states (empty: no such line), and
    the number of lines before the names that are no comments (the head that a logger writes).
    """

    delimiter: str
    header: tuple[str, ...]
    header_line: int
    skipped: int
    units: tuple[str, ...] = ()
    head_lines: int = 0


def is_comment(line: str) -> bool:
    """Whether a line is a comment."""
    return line.lstrip().startswith(COMMENTS)


def is_number(cell: str) -> bool:
    """Whether a cell is a number, with a decimal point or a decimal comma."""
    try:
        float(with_point(cell))
    except ValueError:
        return False
    return True


def with_point(cell: str) -> str:
    """The cell with a decimal point instead of a decimal comma."""
    return cell.replace(",", ".")


def detect_dialect(lines: Iterable[str]) -> Dialect | None:
    """The dialect of a file's lines; None for one without any. Names that a comment holds are the
    header where the first other line holds as many numbers.
    """
    numbered = list(islice(enumerate(lines, 1), HEAD_LINES))
    filled = [(n, line) for n, line in numbered if line.strip()]
    plain = [(n, line) for n, line in filled if not is_comment(line)]
    if plain and SEPARATOR_LINE.fullmatch(plain[0][1].strip()):
        plain = plain[1:]
    if not plain:
        return None
    head = _head_lines([line for _, line in plain])
    plain = plain[head:]
    (number, line), after = plain[0], [text for _, text in plain[1:3]]
    delimiter = _delimiter(line, after)
    header = _cells(line, delimiter)
    if all(is_number(cell) for cell in header):
        comments = [t for n, t in filled if n < number]
        units = _units_in_comment(comments[-1:], delimiter, len(header))
        named = _names_in_comment(comments[:-1] if units else comments, delimiter, len(header))
        if named:
            return Dialect(delimiter, named, number - 1, number - 1, units)
    rows = [_cells(text, delimiter) for text in after]
    units, skipped = _line_of_units(rows[0], len(header)) if rows else (), number
    if units:
        rows, skipped = rows[1:], plain[1][0]
    else:
        below = [text for n, text in filled if n > number]
        units = _units_in_comment(below[:1], delimiter, len(header))
    return Dialect(delimiter, _with_index(header, rows), number, skipped, units, head)


def _head_lines(lines: list[str]) -> int:
    """Number of lines before the names of the columns: the names are the first line of names alone
    above a line of numbers or dates. 0 where the first line has as many cells, or no line is such.
    """
    found = next((n for n in range(len(lines) - 1) if _is_header(lines[n], lines[n + 1 :])), 0)
    return found if _count(lines[found]) != _count(lines[0]) else 0


def _count(line: str) -> int:
    return len(_cells(line, _delimiter(line, [])))


def _is_header(line: str, after: list[str]) -> bool:
    """Whether a line holds two names or more, above as many samples, directly or after units."""
    delimiter = _delimiter(line, after[:1])
    names = _cells(line, delimiter)
    if len(names) < 2 or any(map(is_number, names)) or not all(names):
        return False
    rows = [_cells(text, delimiter) for text in after[:2]]
    row = rows[-1] if _line_of_units(rows[0], len(names)) else rows[0]
    return len(row) == len(names) and all(map(_is_sample, row))


def _is_sample(cell: str) -> bool:
    return not cell or is_number(cell) or seconds_of_date(cell) is not None


def _cells(line: str, delimiter: str) -> tuple[str, ...]:
    rows = csv.reader([line.strip("\r\n")], delimiter=delimiter)
    return tuple(cell.strip() for cell in next(rows, []))


def _delimiter(header: str, rows: list[str]) -> str:
    """The separator that a header and the first row hold equally often, else the first one that the
    header holds.
    """
    bare = [re.sub(r'"[^"]*"', "", line) for line in (header, *rows)]
    held = [d for d in DELIMITERS if d in bare[0]]
    equal = [d for d in held if all(line.count(d) == bare[0].count(d) for line in bare)]
    return (equal or held or [","])[0]


def _line_of_units(row: tuple[str, ...], count: int) -> tuple[str, ...]:
    """The units in a row; empty for a row that holds none, or that begins with a number, since
    1,1,1,A may be a row of samples.
    """
    return () if is_number(row[0]) else _units(row, count)


def _units(row: tuple[str, ...], count: int) -> tuple[str, ...]:
    """The units of a row, as (ms), [V] or A, with 1 for plain numbers; empty for a row of
    samples.
    """
    units = tuple(map(bare, row))
    others = [unit for unit in units if unit.lower() not in NO_UNIT_CELLS]
    if len(row) != count or any(map(is_number, others)) or not any(map(is_unit, others)):
        return ()
    return units


def _units_in_comment(comments: list[str], delimiter: str, count: int) -> tuple[str, ...]:
    """The units that a comment holds, which may begin with the unit %; empty without."""
    for line in filter(is_comment, comments):
        cells = _cells(line.strip(), delimiter)
        if cells[0] != "%":
            cells = _cells(line.strip()[1:], delimiter)
        if units := _units(cells, count):
            return units
    return ()


def _names_in_comment(comments: list[str], delimiter: str, count: int) -> tuple[str, ...] | None:
    """The names of the last comment, where they are as many as the columns."""
    if not comments:
        return None
    names = _cells(comments[-1].strip().lstrip("".join(COMMENTS)), delimiter)
    return names if len(names) == count and not any(map(is_number, names)) else None


def _with_index(header: tuple[str, ...], rows: list[tuple[str, ...]]) -> tuple[str, ...]:
    """The header with an unnamed column where the first row has one cell more: the last one where
    it is empty (a separator at the end of each row), the first where it holds names or numbers of
    rows. The header as it is otherwise.
    """
    if not rows or len(rows[0]) != len(header) + 1 or len(header) < 2:
        return header
    if not rows[0][-1]:
        return (*header, "")
    return ("", *header) if _are_row_names([row[0] for row in rows]) else header


def _are_row_names(cells: list[str]) -> bool:
    """Whether the first cells of rows are names or numbers of the rows and no samples: all of them
    words or dates, or whole numbers that increase.
    """
    if not any(map(is_number, cells)):
        return True
    whole = [int(cell) for cell in cells if cell.isdecimal()]
    return len(whole) == len(cells) and all(a < b for a, b in zip(whole, whole[1:], strict=False))
