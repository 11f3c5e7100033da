"""Makes a log from named arrays: a file that is no text, a table of another library, a dict."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from typing import Any

import numpy as np

from vgroove.errors import VgrooveError
from vgroove.log.clock import in_order
from vgroove.log.column_map import ColumnMap, Place, other_names, other_scales
from vgroove.log.stated_units import (
    end_warning,
    needed_factor,
    refuse_contradiction,
    remark_warning,
    unit_at_end,
    unit_in_name,
    unit_of_place,
)
from vgroove.log.table import Log, check_columns, checked
from vgroove.log.units_of_columns import TIME_COLUMN, WITH_UNIT


@dataclass(frozen=True)
class RawColumns:
    """Columns of a source by name: `values` reads one as an array (n,), `units` states the units
    that the source knows.
    """

    source: str
    names: Sequence[str]
    values: Callable[[str], Any]
    units: Mapping[str, str] = field(default_factory=dict)


def factor_of(place: Place, column: str, unit: str, source: str, warnings: list[str]) -> float:
    """Factor from a column of a source to the log's unit: of the map's unit, else of the unit that
    the source or the name of its column states, else of the unit that the name ends in, else 1,
    with a warning where the name has a remark or ends in a unit.
    VgrooveError for a unit that is not known and for two that differ.
    """
    if place.factor is not None:
        return place.factor
    stated, named = unit_of_place(unit, column), unit_in_name(place.name, column)
    if column not in WITH_UNIT:
        return next((u.factor for u in (stated, named) if u and u.factor), 1.0)
    if stated and named:
        refuse_contradiction(stated, named, place.name, column, source)
    if found := stated or named:
        return needed_factor(found, place.name, column, source)
    remarks, end = remark_warning(place.name, column, source), None
    if not remarks and not unit.strip() and (end := unit_at_end(place.name, column)):
        remarks = [end_warning(end, place.name, column, source)]
    warnings += [remark for remark in remarks if remark not in warnings]
    return end.factor if end else 1.0


def log_from_raw(raw: RawColumns, columns: ColumnMap) -> Log:
    """The checked log of a source; VgrooveError where it is none."""
    places = columns.places(raw.source, raw.names)
    used = {place.name for place in places.values()}
    unknown = [name for name in raw.names if name not in used]
    check_columns(raw.source, places, unknown)
    warnings = [f"{raw.source}: the unknown column {name} is ignored." for name in unknown]
    found: dict[str, np.ndarray] = {}
    factors = dict.fromkeys(places, 1.0)
    for column, place in places.items():
        array = np.asarray(raw.values(place.name)).squeeze()
        values = numbers(array, f"{raw.source}: column {place.name}")
        if is_dates(array):
            refuse_unit_of_dates(place, raw.source)
            found[column] = values
            continue
        unit = raw.units.get(place.name, "")
        factors[column] = factor_of(place, column, unit, raw.source, warnings)
        found[column] = place.scaled(values, factors[column])
    time_s = found.pop(TIME_COLUMN)
    for column, values in found.items():
        if len(values) != len(time_s):
            raise VgrooveError(
                f"{raw.source}: column {places[column].name} has {len(values)} samples, the time "
                f"has {len(time_s)}."
            )
    time_s = in_order(time_s, factors[TIME_COLUMN], warnings, raw.source)
    log = Log(time_s, found, raw.source, warnings, read_from=other_names(places))
    return checked(replace(log, scales=other_scales(places, factors)))


def is_dates(array: np.ndarray) -> bool:
    """Whether an array holds dates or durations, which are seconds whatever unit they are in."""
    first = array.ravel()[0] if array.size and array.dtype.kind == "O" else None
    return array.dtype.kind in "mM" or hasattr(first, "timestamp")


def refuse_unit_of_dates(place: Place, source: str) -> None:
    """VgrooveError where the map states a unit for a column of dates."""
    if place.factor is not None:
        raise VgrooveError(
            f"{source}: column {place.name}: holds dates, which have no unit: say "
            f'--map "{place.name}{":" * (":" in place.name)}={TIME_COLUMN}".'
        )


def numbers(values: Any, where: str) -> np.ndarray:
    """An array (n,) of floats, times in s since the first one for dates; VgrooveError for what
    holds no numbers.
    """
    array = np.asarray(values).squeeze()
    if array.dtype.kind in "mM":
        start = array[:1] if array.dtype.kind == "M" else 0
        return (array - start) / np.timedelta64(1, "s")
    if is_dates(array):
        start = array.ravel()[0].timestamp()  # dates with a time zone
        return np.array([moment.timestamp() - start for moment in array.ravel()])
    if array.dtype.kind == "O" and all(isinstance(v, Decimal | None) for v in array.ravel()):
        array = array.astype(float)
    elif array.dtype.kind == "O":
        array = np.array([np.nan if v is None else v for v in array.ravel()])
    if array.dtype.kind not in "biuf" or array.ndim != 1:
        raise VgrooveError(f"{where}: its samples are not numbers.")
    return array.astype(float)


def mapped(log: Log, columns: ColumnMap) -> Log:
    """A log whose columns are read in the units that a map states; the log itself without one."""
    if not columns.entries:
        return log
    arrays = {TIME_COLUMN: log.time_s} | log.columns
    found = log_from_raw(RawColumns(log.source, list(arrays), arrays.__getitem__), columns)
    names, scales = found.read_from, found.scales
    return replace(log, time_s=found.time_s, columns=found.columns, read_from=names, scales=scales)
