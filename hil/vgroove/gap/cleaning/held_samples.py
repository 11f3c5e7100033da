"""Recognises columns that are sampled more slowly than the rows are written: a bus whose sensor
answers every 20 ms, say, in a log with a row every 5 ms. Each value is then repeated in several
rows. The repeats are taken as missing: they are older than their rows.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vgroove.gap.cleaning.logging_interval import median_interval_s
from vgroove.gap.cleaning.sensor_noise import resolution_of
from vgroove.log import MEASURED, Log
from vgroove.rig import Rig


@dataclass(frozen=True)
class HeldSampleLimits:
    """When a column is one that is sampled more slowly (chosen)."""

    # small changes by which a value differs from those before and after it, so that a value that is
    # read again would differ too; a small change: the resolution, and this quantile of the changes.
    # Codes of a coarse sensor, which all differ by one step, are no such values.
    min_change: float = 4.0
    small_quantile: float = 0.1
    min_runs: int = 10  # of such values
    # share of the time between two samples by which it may vary, at least one row: either end may
    # fall into the row before or after
    jitter_share: float = 0.5
    usual_share: float = 0.9  # of the values, that are held for the usual time
    min_rows: float = 1.5  # rows of a sample; of fewer the rows are taken as samples


LIMITS = HeldSampleLimits()


def remove_held_samples(logs: Sequence[Log], rig: Rig) -> list[Log]:
    """The logs of one tool with the repeats of values that were sampled more slowly as nan, and a
    warning that names the columns. A log that shows too little is read as the others of its tool. A
    speed from Hall edges is held until the next edge and left as it is, and so is the column that
    drives the model.
    """
    by_edges = {"speed_rpm"} if rig.sensors.get("hall_pulses_per_rev") else set()
    names = [n for n in MEASURED if n not in by_edges | {rig.input["kind"]}]
    found: list[dict[str, int]] = [{} for _ in logs]
    for name in names:
        for rows, one in zip(rows_of_samples(logs, name), found, strict=True):
            if rows > 1:
                one[name] = rows
    return [_without_repeats(log, rows) for log, rows in zip(logs, found, strict=True)]


def rows_of_samples(logs: Sequence[Log], name: str) -> list[int]:
    """For each log, the number of rows that hold the same sample of a column; 1 if every row is a
    new sample. It is 1 for all logs if one of them shows that the sensor is faster.
    """
    own = [sample_period_s(log, name) for log in logs]
    held = [period for period in own if period]
    usual_s = float(np.median(held)) if held else 0.0
    is_faster = [
        period == 0.0 and LIMITS.min_rows * _row_s(log) < usual_s
        for log, period in zip(logs, own, strict=True)
    ]
    if not held or any(is_faster):
        return [1] * len(logs)
    periods = [usual_s if period is None else period for period in own]
    return [max(1, round(p / _row_s(log))) for log, p in zip(logs, periods, strict=True)]


def sample_period_s(log: Log, name: str) -> float | None:
    """Time in s for which a log holds each sample of a column; 0 where its rows hold new samples,
    None where it shows too few large changes to tell.
    """
    values = _values(log, name)
    rows = np.flatnonzero(np.isfinite(values))
    change = np.diff(values[rows])
    begin = np.flatnonzero(change)
    if len(begin) < LIMITS.min_runs:
        return None
    size = np.abs(change[begin])
    small = max(resolution_of(values), float(np.quantile(size, LIMITS.small_quantile)))
    large = size >= LIMITS.min_change * small
    lengths = np.diff(rows[begin + 1])[large[1:] & large[:-1]]
    if len(lengths) < LIMITS.min_runs:
        return None
    usual = float(np.median(lengths))
    is_usual = np.abs(lengths - usual) <= _jitter(usual)
    # no value changes between two samples: larger changes within them are those of a faster sensor
    is_whole = np.diff(rows[begin[size > small] + 1]) >= usual - _jitter(usual)
    held = min(is_usual.mean(), is_whole.mean()) >= LIMITS.usual_share
    return usual * _row_s(log) if held and usual >= LIMITS.min_rows else 0.0


def repeated_rows(values: np.ndarray, rows: int) -> np.ndarray:
    """Mask (n,) of the rows that repeat the sample before. At rest, where samples are equal, every
    `rows`-th row is a new one.
    """
    known = np.flatnonzero(np.isfinite(values))
    begins = np.diff(values[known], prepend=np.nan) != 0.0
    start = known[begins]
    run = np.cumsum(begins) - 1
    since, lasts = known - start[run], np.diff(start, append=len(values))[run]
    number = np.where(lasts <= rows + _jitter(rows), 0, since // rows)
    again = np.zeros(len(values), bool)
    again[known] = ~begins & (np.diff(number, prepend=-1) == 0)
    return again


def _without_repeats(log: Log, slow: Mapping[str, int]) -> Log:
    """The log with nan in place of repeated values. slow: by column, the number of rows that hold
    the same sample.
    """
    masks = {name: repeated_rows(_values(log, name), rows) for name, rows in slow.items()}
    masks = {name: again for name, again in masks.items() if again.any()}
    if not masks:
        return log
    kept = {name: np.where(again, np.nan, _values(log, name)) for name, again in masks.items()}
    said = ", ".join(f"{n} every {1e3 * slow[n] * _row_s(log):.3g} ms" for n in masks)
    warning = f"{log.source}: sampled more slowly than the rows: {said}; repeats are left out"
    return replace(log, columns=dict(log.columns) | kept, warnings=[*log.warnings, warning])


def _jitter(rows: float) -> float:
    """Number by which the rows of a sample may vary about the usual one."""
    return max(1.0, LIMITS.jitter_share * rows)


def _row_s(log: Log) -> float:
    """Median interval between the rows of a log, s."""
    return median_interval_s(np.asarray(log.time_s, dtype=float))


def _values(log: Log, name: str) -> np.ndarray:
    """A column (n,) of a log; empty where it has none."""
    return np.asarray(log.columns.get(name, []), dtype=float)
