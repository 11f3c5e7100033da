"""Recognises columns that are sampled more slowly than the rows are written: a bus whose sensor
answers every 20 ms, say, in a log with a row every 5 ms. Each value is then repeated in several
rows. The repeats are taken as missing: they are older than their rows.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vgroove.gap.cleaning.sensor_noise import resolution_of
from vgroove.log import MEASURED, Log
from vgroove.rig import Rig


@dataclass(frozen=True)
class HeldSampleLimits:
    """When a column is one that is sampled more slowly (chosen)."""

    # resolutions by which a value differs from those before and after it, so that a value that is
    # read again would differ too
    min_change: float = 4.0
    min_runs: int = 10  # of such values
    # share of the rows of a sample by which their number may vary, at least one row: either end may
    # fall into the row before or after
    jitter_share: float = 0.5
    usual_share: float = 0.9  # of the values, that are in the usual number of rows


LIMITS = HeldSampleLimits()


def remove_held_samples(logs: Sequence[Log], rig: Rig) -> list[Log]:
    """The logs of one tool with the repeats of values that were sampled more slowly as nan, and a
    warning that names the columns. A speed from Hall edges is held until the next edge and left as
    it is, and so is the column that drives the model.
    """
    by_edges = {"speed_rpm"} if rig.sensors.get("hall_pulses_per_rev") else set()
    names = [n for n in MEASURED if n not in by_edges | {rig.input["kind"]}]
    rows = {name: rows_of_a_sample([_values(log, name) for log in logs]) for name in names}
    slow = {name: count for name, count in rows.items() if count > 1}
    return [_without_repeats(log, slow) for log in logs]


def _values(log: Log, name: str) -> np.ndarray:
    """A column (n,) of a log; empty where it has none."""
    return np.asarray(log.columns.get(name, []), dtype=float)


def _without_repeats(log: Log, slow: Mapping[str, int]) -> Log:
    """The log with the repeats in its columns as nan; slow: rows of a sample, by column."""
    here = {name: rows for name, rows in slow.items() if name in log.columns}
    if not here:
        return log
    kept = {
        name: np.where(repeats(_values(log, name), rows), np.nan, _values(log, name))
        for name, rows in here.items()
    }
    said = ", ".join(f"{name} every {rows} rows" for name, rows in here.items())
    warning = f"{log.source}: sampled more slowly than the rows: {said}; repeats are left out"
    return replace(log, columns=dict(log.columns) | kept, warnings=[*log.warnings, warning])


def rows_of_a_sample(logs: Sequence[np.ndarray]) -> int:
    """Rows in which each sample of a column is written, from its values (n,) in each log; 1 where
    the rows hold new samples.
    """
    found = [np.zeros(0, int), *(_lengths(values[np.isfinite(values)]) for values in logs)]
    lengths = np.concatenate(found)
    if len(lengths) < LIMITS.min_runs:
        return 1
    rows = int(np.median(lengths))
    usual = np.abs(lengths - rows) <= _jitter(rows)
    return rows if rows > 1 and usual.mean() >= LIMITS.usual_share else 1


def _lengths(known: np.ndarray) -> np.ndarray:
    """Rows (k,) with the same value, of the values (n,) that differ by several resolutions from
    those before and after.
    """
    step = resolution_of(known) if len(known) > 1 else 0.0
    begin = np.flatnonzero(np.diff(known)) + 1
    large = np.abs(np.diff(known)[begin - 1]) >= LIMITS.min_change * step
    return np.diff(begin)[large[1:] & large[:-1]]


def repeats(values: np.ndarray, rows: int) -> np.ndarray:
    """Mask (n,) of the rows that repeat the sample before. At rest, where samples are equal, every
    `rows`-th row is one.
    """
    begin = np.flatnonzero(np.diff(values, prepend=np.nan) != 0.0)
    return np.concatenate(
        [_repeats_of(length, rows) for length in np.diff([*begin, len(values)])] or [[]]
    ).astype(bool)


def _jitter(rows: int) -> int:
    """Number by which the rows of a sample may vary about the usual one."""
    return max(1, int(LIMITS.jitter_share * rows))


def _repeats_of(length: int, rows: int) -> Sequence[bool]:
    """Mask (length,) of the repeats among rows of the same value."""
    since = np.arange(length)
    fresh = since == 0 if length <= rows + _jitter(rows) else since % rows == 0
    return ~fresh
