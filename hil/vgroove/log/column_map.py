"""Which column of a file is which column of a log: --map NAME[:UNIT]=COLUMN, and mapping files
(docs/input_format.md).
"""

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vgroove.errors import VgrooveError
from vgroove.log.nearest import nearest_columns
from vgroove.log.table import COLUMN_UNITS
from vgroove.log.units_of_columns import NUMBER, TIME_COLUMN, own_unit, unit_factor

SCHEMA = "vgroove.map/1"
FROM_ZERO = re.compile(rf"(.*?)\bfrom\s+({NUMBER.pattern})")
LOG_COLUMNS = (TIME_COLUMN, *COLUMN_UNITS)


@dataclass(frozen=True)
class MapEntry:
    """A column of a file, by name, that holds a column of a log, in a unit (None: the unit that the
    file states, or else that of the log column); zero: the value of the file that stands for 0.
    """

    name: str
    unit: str | None
    column: str
    zero: float = 0.0


@dataclass(frozen=True)
class Place:
    """Where a log column is found: name in the file, the factor to the log's unit (None where no
    unit is given), and the value of the file that stands for 0.
    """

    name: str
    factor: float | None
    zero: float = 0.0

    def scaled(self, values: np.ndarray, factor: float) -> np.ndarray:
        """Values (n,) of the file in the log's unit, of which `factor` is one of the file."""
        values = values if self.zero == 0.0 else values - self.zero
        return values if factor == 1.0 else values * factor


def other_names(places: Mapping[str, Place]) -> dict[str, str]:
    """Names in the file of the log columns that have another name there."""
    return {column: place.name for column, place in places.items() if place.name != column}


def other_scales(
    places: Mapping[str, Place], factors: Mapping[str, float]
) -> dict[str, tuple[float, float]]:
    """Factor and zero of the log columns whose numbers in the file are others."""
    scales = {column: (factors[column], place.zero) for column, place in places.items()}
    return {column: scale for column, scale in scales.items() if scale != (1.0, 0.0)}


@dataclass(frozen=True)
class ColumnMap:
    """Entries by log column; time_base: the channel of an MF4 file whose times become the rows."""

    entries: tuple[MapEntry, ...] = ()
    time_base: str | None = None

    def places(self, source: str, names: Sequence[str]) -> dict[str, Place]:
        """Log column -> place, for the columns that a file with these names has. VgrooveError for
        an entry whose column the file does not have.
        """
        found = {name: Place(name, None) for name in names if name in LOG_COLUMNS}
        for entry in self.entries:
            if entry.name not in names:
                if entry.column in found:
                    continue
                raise VgrooveError(f"{source}: {_not_there(entry, names)}")
            factor = None if entry.unit is None else unit_factor(entry.unit, entry.column)
            found[entry.column] = Place(entry.name, factor, entry.zero)
        taken = {entry.name: entry.column for entry in self.entries}
        return {c: p for c, p in found.items() if taken.get(p.name, c) == c or p.name != c}


def _not_there(entry: MapEntry, names: Sequence[str]) -> str:
    near = nearest_columns(entry.name.lower(), names)
    nearest = f"; the nearest are {', '.join(near)}" if near else ""
    return f"has no column {entry.name!r}, which --map names for {entry.column}{nearest}."


NO_MAP = ColumnMap()


def column_map(texts: Sequence[str] = (), path: Path | None = None) -> ColumnMap:
    """The map of --map options and of a mapping file; an option replaces the file's entry of the
    same log column. VgrooveError for what is none.
    """
    base = NO_MAP if path is None else read_map(path)
    entries = {entry.column: entry for entry in base.entries}
    given = [parse_entry(text) for text in texts]
    for entry in given:
        if sum(other.column == entry.column for other in given) > 1:
            raise VgrooveError(f"--map: the column {entry.column} is given twice")
        entries[entry.column] = entry
    return ColumnMap(tuple(entries.values()), base.time_base)


def parse_entry(text: str) -> MapEntry:
    """NAME=COLUMN, NAME:UNIT=COLUMN or NAME:UNIT from ZERO=COLUMN; a name that holds a colon ends
    in one more.
    """
    name, equals, column = text.rpartition("=")
    if not equals or not name.strip():
        raise VgrooveError(f'--map {text!r}: must be "NAME=COLUMN" or "NAME:UNIT=COLUMN"')
    return _entry(name.strip(), column.strip(), f"--map {text!r}")


def _entry(text: str, column: str, where: str) -> MapEntry:
    """The entry of NAME or NAME:UNIT and a log column."""
    if column not in LOG_COLUMNS:
        near = nearest_columns(column, LOG_COLUMNS) or list(LOG_COLUMNS)
        raise VgrooveError(f"{where}: {column!r} is no column of a log; near are {', '.join(near)}")
    name, colon, unit = text.rpartition(":")
    if not colon:
        return MapEntry(text, None, column)
    if not unit:
        return MapEntry(name, None, column)
    unit, zero = _unit_and_zero(unit, column)
    try:
        unit_factor(unit, column)
    except VgrooveError as error:
        raise VgrooveError(
            f'{where}: {error}; a name that holds a colon ends in one: "{text}:={column}"'
        ) from error
    return MapEntry(name, unit, column, zero)


def _unit_and_zero(text: str, column: str) -> tuple[str, float]:
    """The unit of "UNIT from ZERO" and the value that stands for 0."""
    found = FROM_ZERO.fullmatch(text.strip())
    if not found:
        return text, 0.0
    return found[1].strip() or own_unit(column), float(found[2])


def read_map(path: Path) -> ColumnMap:
    """A mapping file; VgrooveError says what is wrong in it."""
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise VgrooveError(f"{path}: cannot be read: {error.strerror}") from error
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise VgrooveError(f"{path}: is not TOML: {error}") from error
    unknown = set(data) - {"schema", "time_base", "columns"}
    if data.get("schema") != SCHEMA or unknown or not isinstance(data.get("columns", {}), dict):
        raise VgrooveError(
            f'{path}: must hold schema = "{SCHEMA}", a section [columns], and may hold time_base'
            + (f", not {', '.join(sorted(unknown))}" if unknown else "")
        )
    base = data.get("time_base")
    if base is not None and not isinstance(base, str):
        raise VgrooveError(f"{path}: time_base must be the name of a channel")
    entries = (_file_entry(path, c, value) for c, value in data.get("columns", {}).items())
    return ColumnMap(tuple(entries), base)


def _file_entry(path: Path, column: str, value: Any) -> MapEntry:
    """column = "NAME", "NAME:UNIT" or { name = "NAME", unit = "UNIT" }."""
    where = f"{path}: columns.{column}"
    if isinstance(value, str) and value:
        return _entry(value, column, where)
    if isinstance(value, dict) and isinstance(value.get("name"), str) and set(value) <= KEYS:
        unit = value.get("unit", "")
        if isinstance(unit, str):
            return _entry(f"{value['name']}:{unit}", column, where)
    raise VgrooveError(f'{where}: must be "NAME", "NAME:UNIT" or {{ name = "...", unit = "..." }}')


KEYS = {"name", "unit"}
