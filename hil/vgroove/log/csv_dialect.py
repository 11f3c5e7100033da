"""How a CSV file is written: separator, lines before the header, header, index columns."""

import csv
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import islice

from vgroove.log.dates import seconds_of_date
from vgroove.log.stated_units import NO_UNIT
from vgroove.log.units_of_columns import NUMBER, bare, is_unit

DELIMITERS = "\t;,"  # in the order in which they are tried; a comma may be a decimal sign
COMMENTS = ("#", "%")
HEAD_LINES = 1000  # within which the header is looked for
MAX_HEAD_ROWS = 5  # lines of words directly above the first row: names, units, types, descriptions
SEPARATOR_LINE = re.compile(r'"?sep=.?"?', re.IGNORECASE)  # with which Excel states the separator
# cells of a spreadsheet that failed, in English and German, which begin as a comment does
ERROR_CELL = re.compile(
    r'\s*"?#(?:N/A|NV|DIV/0!|VALUE!|WERT!|NUM!|ZAHL!|REF!|BEZUG!|NAME\?)\s*"?\s*(?:$|[;,\t])'
)
NAN = re.compile(r"[+-]?(?:1\.#(?:QNAN|SNAN|IND)0*|nan\([a-z0-9]*\))", re.IGNORECASE)  # by C
HEXADECIMAL = re.compile("[0-9a-fA-F]+")
MINUS_SIGNS = str.maketrans({"\u2212": "-"})
NO_UNIT_CELLS = (*NO_UNIT, "%")  # that a line of units may hold for plain numbers


@dataclass(frozen=True)
class Dialect:
    """Separator of the cells, names of the columns, the line that holds them, the number of lines
    before the first row, the units that a line beside the names states (empty: no such line), the
    number of lines before the names that are no comments (the head that a logger writes), and that
    of lines of words between the names and the first row. in_cells: the units that the cells of the
    first row end in.
    """

    delimiter: str
    header: tuple[str, ...]
    header_line: int
    skipped: int
    units: tuple[str, ...] = ()
    head_lines: int = 0
    lines_below: int = 0
    in_cells: tuple[str, ...] = ()

    def is_header_again(self, row: Sequence[str]) -> bool:
        """Whether a row is the line of column names once more, as where files were joined."""
        begins = bool(row) and row[0].strip() == self.header[0]
        return begins and tuple(cell.strip() for cell in row) == self.header


@dataclass(frozen=True)
class _Head:
    """The lines of words above the first row: the index of the names among them, their number, the
    names, and the units that one of them states (empty: none).
    """

    at: int
    count: int
    names: tuple[str, ...]
    units: tuple[str, ...]


def is_comment(line: str) -> bool:
    """Whether a line is a comment."""
    return line.lstrip().startswith(COMMENTS) and not ERROR_CELL.match(line)


def is_number(cell: str) -> bool:
    """Whether a cell is a number, with a decimal point or a decimal comma."""
    try:
        number_of(cell)
    except ValueError:
        return False
    return True


def number_of(cell: str) -> float:
    """The number of a cell, also NaN as C libraries print it; ValueError for any other text."""
    try:
        return float(with_point(cell))
    except ValueError:
        if NAN.fullmatch(cell.strip()):
            return float("nan")
        raise


def with_point(cell: str) -> str:
    """The cell with a decimal point instead of a decimal comma, and a hyphen as its minus."""
    return cell.replace(",", ".").translate(MINUS_SIGNS)


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
    before = _head_lines([line for _, line in plain])
    plain = plain[before:]
    number, line = plain[0]
    delimiter = _delimiter(line, [text for _, text in plain[1:3]])
    rows = [_cells(text, delimiter) for _, text in plain[: MAX_HEAD_ROWS + 3]]
    head = _head(rows)
    if any(cell and _is_sample(cell) for cell in rows[0]) and not head.units:
        comments = [t for n, t in filled if n < number]
        units = _units_in_comment(comments[-1:], delimiter, len(rows[0]))
        named = _names_in_comment(comments[:-1] if units else comments, delimiter, len(rows[0]))
        if named:
            return Dialect(delimiter, named, number - 1, number - 1, units)
    units, number, last = head.units, plain[head.at][0], plain[head.count - 1][0]
    if not units:
        below = [text for n, text in filled if n > number]
        units = _units_in_comment(below[:1], delimiter, len(head.names))
    samples = rows[head.count : head.count + 2]
    header = _with_index(head.names, samples)
    in_cells = tuple(map(unit_in_cell, samples[0])) if samples else ()
    units = units or (in_cells if any(in_cells) else ())
    others = max(head.count - 1 - bool(head.units) - head.at, 0)
    return Dialect(delimiter, header, number, last, units, before + head.at, others, in_cells)


def _head(rows: list[tuple[str, ...]]) -> _Head:
    """The lines of words above the first row of samples, of which the first one that has a name for
    each column, each once, and states no units holds the names.
    """
    size, units, count = len(rows[0]), (), 1
    above = _units(rows[0], size) if not all(map(is_number, rows[0])) else ()
    while count < min(len(rows), MAX_HEAD_ROWS):
        found = _line_of_units(rows[count], size)
        if not found and not _is_words(rows[count], size):
            break
        units, count = units or found, count + 1
    if not _are_names(rows[0]):
        for at in range(1, count):
            if _are_names(rows[at]) and not _units(rows[at], size):
                return _Head(at, count, rows[at], above or units)
    return _Head(0, count, rows[0], units)


def _is_words(row: tuple[str, ...], size: int) -> bool:
    """Whether a line below the names holds words alone, such as types, and no sample."""
    return len(row) == size > 1 and any(row) and not any(map(_begins_with_number, row))


def _are_names(row: tuple[str, ...]) -> bool:
    """Whether each cell of a line may be the name of a column of its own."""
    return all(row) and len(set(row)) == len(row) and not any(map(is_number, row))


def unit_in_cell(cell: str) -> str:
    """The unit behind the number of a cell, as in 0.002 sec, 12mA and 5 %; empty without one, and
    where number and unit may be the digits of a hexadecimal number.
    """
    number = NUMBER.match(with_point(cell))
    unit = cell[number.end() :] if number else ""
    if not unit.strip() or not is_unit(unit) or HEXADECIMAL.fullmatch(unit):
        return ""
    return unit.strip()


def _begins_with_number(cell: str) -> bool:
    """Whether a cell may be a sample: a number, also one with a unit behind it, NaN, or a date."""
    return is_number(cell) or bool(NUMBER.match(with_point(cell)))


def _head_lines(lines: list[str]) -> int:
    """Number of lines before the lines of words that end above the first row: the names are the
    first line of names alone directly above a line of numbers or dates or above its units, else
    above further words. 0 where the first line begins them or holds as many names, or no line is
    such.
    """
    first = _cells(lines[0], _delimiter(lines[0], lines[1:2]))
    if _is_head(first, lines[0], lines[1:], MAX_HEAD_ROWS):
        return 0
    for most in (1, MAX_HEAD_ROWS):
        for n in range(1, len(lines) - 1):
            names = _cells(lines[n], _delimiter(lines[n], lines[n + 1 : n + 2]))
            if _are_names(names) and _is_head(names, lines[n], lines[n + 1 :], most):
                return 0 if len(first) == len(names) and _are_names(first) else n
    return 0


def _is_head(names: tuple[str, ...], line: str, after: list[str], most: int) -> bool:
    """Whether a line holds two cells or more, above as many samples, directly, after units, or
    after lines of words, `most` in all.
    """
    delimiter = _delimiter(line, after[:1])
    head = _head([names, *(_cells(text, delimiter) for text in after[:MAX_HEAD_ROWS])])
    row = _cells(after[head.count - 1], delimiter) if head.count <= len(after) else ()
    few = head.count - bool(head.units) <= most
    return few and len(row) == len(names) > 1 and all(map(_is_sample, row))


def _is_sample(cell: str) -> bool:
    number = is_number(cell) or bool(unit_in_cell(cell))
    return not cell or number or seconds_of_date(cell) is not None


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
