"""MF4 logs of channels with any names, in one or more channel groups with their own times and
units, resampled to the times of one group.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vgroove.errors import VgrooveError
from vgroove.log.column_map import ColumnMap, Place, other_names, other_scales
from vgroove.log.nearest import nearest_columns
from vgroove.log.raw_columns import factor_of
from vgroove.log.table import Log, check_columns, checked
from vgroove.log.units_of_columns import TIME_COLUMN

# Columns that hold their last value between two samples; the others are interpolated linearly.
HELD = ("duty", "coast", "trigger", "state")
MAX_GAP_INTERVALS = 3.0  # median intervals of a channel that are bridged by interpolation


@dataclass(frozen=True)
class Channel:
    """A log column (n,) in the unit of the log with its own times (n,) in s, the name of the
    channel, and what one of its unit is in that of the log.
    """

    name: str
    column: str
    time_s: np.ndarray
    values: np.ndarray
    factor: float

    @property
    def interval_s(self) -> float:
        """Median interval; infinite for a single sample."""
        return float(np.median(np.diff(self.time_s))) if len(self.time_s) > 1 else np.inf


@dataclass(frozen=True)
class Source:
    """An open MF4 file, the unit of its times in s that the map states (None: that of the file),
    and the warnings of its log.
    """

    mdf: Any
    path: Path
    time_factor: float | None
    warnings: list[str]


def log_from_channels(path: Path, mdf: Any, columns: ColumnMap) -> Log:
    """The log of an open MF4 file. The rows are the times of the channel that the map declares as
    `time_base`, else of the fastest channel that a log column is read from.
    """
    masters = {mdf.groups[g].channels[c].name for g, c in mdf.masters_db.items()}
    places = columns.places(str(path), list(mdf.channels_db))
    time = places.pop(TIME_COLUMN, None)
    if time is not None and time.name not in masters:
        raise VgrooveError(
            f"{path}: {time.name} is no time of a channel group (these are "
            f"{', '.join(sorted(masters))}): leave it out of the map, or declare the channel whose "
            "times are the rows as time_base in a mapping file."
        )
    used = {place.name for place in places.values()} | masters
    unknown = [name for name in mdf.channels_db if name not in used]
    check_columns(str(path), {TIME_COLUMN, *places}, unknown)
    warnings = [f"{path}: the unknown column {name} is ignored." for name in unknown]
    source = Source(mdf, path, None if time is None else time.factor, warnings)
    found = [_channel(source, column, place) for column, place in places.items()]
    base = _time_base(source, columns, found)
    resampled = {c.column: _resampled(c, base) for c in found}
    warnings += _resampling_warnings(path, found, base)
    names = other_names(places)
    if len(masters) == 1:
        names |= other_names({TIME_COLUMN: Place(*masters, None)})
    scales = other_scales(places, {channel.column: channel.factor for channel in found})
    return checked(Log(base, resampled, str(path), warnings, read_from=names, scales=scales))


def _channel(source: Source, column: str, place: Place) -> Channel:
    """A log column of the file, in the unit of the log."""
    signal, times = _signal(source, place.name)
    factor = factor_of(place, column, signal.unit, str(source.path), source.warnings)
    values = place.scaled(signal.samples.astype(float), factor)
    return Channel(place.name, column, times, values, factor)


def _signal(source: Source, name: str) -> tuple[Any, np.ndarray]:
    """The channel of a name with the most samples, and its times (n,) in s; VgrooveError where they
    are not numbers, a warning where several groups have it.
    """
    groups, entries = source.mdf.groups, source.mdf.channels_db[name]
    group, index = max(entries, key=lambda entry: groups[entry[0]].channel_group.cycles_nr)
    signal = source.mdf.get(name, group, index)
    if signal.samples.dtype.kind not in "biuf" or signal.samples.ndim != 1:
        raise VgrooveError(f"{source.path}: column {name}: its samples are not numbers.")
    if len(entries) > 1:
        source.warnings.append(
            f"{source.path}: {len(entries)} groups have a channel {name}: that of group "
            f"{group + 1}, which has the most samples, is read; rename it to read another one."
        )
    return signal, np.asarray(signal.timestamps, float) * _time_factor(source, group)


def _time_factor(source: Source, group: int) -> float:
    """Seconds in a unit of a group's times: of the map, else of the time channel of the group."""
    if source.time_factor is not None:
        return source.time_factor
    if group not in source.mdf.masters_db:
        return 1.0
    channel = source.mdf.groups[group].channels[source.mdf.masters_db[group]]
    unit = getattr(channel, "unit", "") or ""  # in MDF 3 times are in s
    place, path = Place(channel.name, None), str(source.path)
    return factor_of(place, TIME_COLUMN, unit, path, source.warnings)


def _time_base(source: Source, columns: ColumnMap, found: list[Channel]) -> np.ndarray:
    """Times (n,) of the rows in s."""
    if columns.time_base is None:
        return min(found, key=lambda channel: channel.interval_s).time_s
    if columns.time_base not in source.mdf.channels_db:
        near = ", ".join(nearest_columns(columns.time_base.lower(), source.mdf.channels_db))
        raise VgrooveError(
            f"{source.path}: has no channel {columns.time_base!r}, which the mapping file declares "
            f"as time_base{'; the nearest are ' + near if near else ''}."
        )
    return _signal(source, columns.time_base)[1]


def _resampled(channel: Channel, base: np.ndarray) -> np.ndarray:
    """The channel at the times `base` (m,) in s: nan outside of its own times (a command holds for
    an interval after its last sample), and where it has no sample for more than MAX_GAP_INTERVALS
    of its intervals.
    """
    known = np.isfinite(channel.values)
    own, values = channel.time_s[known], channel.values[known]
    if np.array_equal(channel.time_s, base) or not len(own):
        return channel.values if len(own) else np.full(len(base), np.nan)
    before = np.searchsorted(own, base, side="right") - 1
    last = own[np.maximum(before, 0)]
    longest_s, end_s = MAX_GAP_INTERVALS * channel.interval_s, own[-1]
    if channel.column in HELD:
        found, missing = values[np.maximum(before, 0)], base - last > longest_s
        end_s += channel.interval_s
    else:
        after = np.minimum(np.searchsorted(own, base, side="left"), len(own) - 1)
        found = np.interp(base, own, values)
        missing = own[after] - last > longest_s
    return np.where(missing | (before < 0) | (base > end_s), np.nan, found)


def _resampling_warnings(path: Path, found: list[Channel], base: np.ndarray) -> list[str]:
    others = [c.name for c in found if not np.array_equal(c.time_s, base)]
    if not others:
        return []
    interval = float(np.median(np.diff(base))) if len(base) > 1 else np.nan
    return [
        f"{path}: {', '.join(others)}: resampled to rows every {interval:.4g} s (commands hold "
        "their last value, other columns are interpolated linearly)."
    ]
