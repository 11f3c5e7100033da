"""Missing samples of a hammering tool's log: short ones are interpolated in log and simulation
alike; statistics of windows with longer ones are not judged.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy.ndimage

from vgroove.errors import VgrooveError
from vgroove.gap.cleaning.missing_values import hold_last_value
from vgroove.gap.residual.immutable import freeze_arrays
from vgroove.gap.residual.impact.cycle_windows import CycleWindows
from vgroove.log import Log

# part of a cycle that a straight line may replace: the highest harmonics of the cycle's shape would
# change more over a longer one
LONGEST_PART = 0.125
MOST_GROWTH = 10.0  # inserted rows, as a multiple of a log's rows


@dataclass(frozen=True)
class Fill:
    """Rows (k,) of a column without a value, the rows before and after with one, and the weight
    (k,) of the latter on the straight line between them.
    """

    rows: np.ndarray
    before: np.ndarray
    after: np.ndarray
    weight: np.ndarray

    def __post_init__(self) -> None:
        freeze_arrays(self)

    def filled(self, values: np.ndarray) -> np.ndarray:
        """Values (B, n) of a simulation with the rows on those lines; n may be less than the rows
        of the log.
        """
        known = np.maximum(self.rows, self.after) < values.shape[1]
        rows, weight = self.rows[known], self.weight[known]
        out = values.copy()
        line = (1.0 - weight) * values[:, self.before[known]]
        out[:, rows] = line + weight * values[:, self.after[known]]
        return out


def fills_of(time_s: np.ndarray, columns: Mapping[str, np.ndarray]) -> dict[str, Fill]:
    """For each column (n,) with missing samples, how they are filled."""
    return {
        name: _fill(time_s, np.isfinite(values))
        for name, values in columns.items()
        if np.isfinite(values).any() and not np.isfinite(values).all()
    }


def _fill(time_s: np.ndarray, known: np.ndarray) -> Fill:
    """Linear interpolation for the rows without a value; known (n,): which rows have one. Before
    the first and after the last of these their values are held.
    """
    places, rows = np.flatnonzero(known), np.flatnonzero(~known)
    at = np.searchsorted(places, rows)
    before, after = places[np.maximum(at - 1, 0)], places[np.minimum(at, len(places) - 1)]
    length_s = time_s[after] - time_s[before]
    weight = (time_s[rows] - time_s[before]) / np.where(length_s > 0.0, length_s, 1.0)
    return Fill(rows, before, after, np.clip(weight, 0.0, 1.0))


def incomplete_windows(windows: CycleWindows, values: np.ndarray) -> np.ndarray:
    """Whether each window (W,), or one cycle before or after it, has a longer run of missing
    samples in a column (n,) than may be interpolated.
    """
    cycle = windows.cycle_rows
    return incomplete_spans(windows.first - cycle, windows.rows + 2 * cycle, cycle, values)


def incomplete_spans(first: np.ndarray, rows: int, cycle: int, values: np.ndarray) -> np.ndarray:
    """Whether each span (M,) has a longer run of missing samples in a column (n,) than may be
    interpolated. A span has `rows` rows, the first of which are given as first (M,); cycle: rows of
    an impact cycle.
    """
    long = run_lengths(~np.isfinite(values)) > LONGEST_PART * cycle
    count = np.concatenate([[0], np.cumsum(long)])
    low, high = (np.clip(first + k, 0, len(values)) for k in (0, rows))
    return count[high] > count[low]


def run_lengths(mask: np.ndarray) -> np.ndarray:
    """Length of the run of True in which each row (n,) lies, 0 where it is False."""
    runs, _ = scipy.ndimage.label(mask)
    return np.where(mask, np.bincount(runs)[runs], 0)


def skipped_rows(intervals: np.ndarray) -> np.ndarray:
    """Rows (n,) that are missing within each interval (n,). An interval is taken together with the
    shorter of its neighbours, because a stamp that is late makes the next interval shorter.
    """
    usual = float(np.median(intervals))
    beside = np.minimum(np.append(intervals[1:], usual), np.insert(intervals[:-1], 0, usual))
    short = np.minimum(beside, usual)
    return np.maximum(np.round((intervals + short) / usual).astype(int) - 2, 0)


def with_even_rows(log: Log, command: str) -> Log:
    """The log with empty rows, equally spaced, where its time stamps skip some: windows of a
    hammering log are counted in rows. The column `command` is interpolated, because the model is
    driven through the pause. VgrooveError for pauses that make the log MOST_GROWTH times as long.
    """
    time_s = np.asarray(log.time_s, float)
    intervals = np.diff(time_s)
    skipped = skipped_rows(intervals)
    if not skipped.any():
        return log
    if skipped.sum() > MOST_GROWTH * len(time_s):
        raise VgrooveError(
            f"{log.source}: rows are missing for {intervals[skipped > 0].sum():.4g} s, more than "
            f"{MOST_GROWTH:g} times as many as there are: keep one run of the tool (--from, --to)"
        )
    after = np.repeat(np.arange(1, len(time_s)), skipped)
    number = np.arange(1, len(after) + 1) - np.repeat(np.cumsum(skipped) - skipped, skipped)
    step_s = np.repeat(intervals / (skipped + 1), skipped)
    lost_s = time_s[after - 1] + number * step_s
    columns = {
        name: np.insert(np.asarray(values, float), after, np.nan)
        for name, values in log.columns.items()
    }
    every_s = np.insert(time_s, after, lost_s)
    if command in columns:
        columns[command] = np.interp(every_s, time_s, hold_last_value(log.columns[command]))
    warning = f"{log.source}: {len(after)} rows are missing; they are inserted without values"
    return replace(log, time_s=every_s, columns=columns, warnings=[*log.warnings, warning])
