"""Fills missing samples of columns that must have a value in every row: inputs and loads."""

import numpy as np

# share of the rows that must hold a value for a column to count as sampled in every row; below it
# the column is slower than the log and holds its values (chosen: sparse columns hold far less)
MIN_KNOWN_SHARE = 0.9


def has_values(columns: dict[str, np.ndarray], name: str) -> bool:
    """True if the column of that name (n,) exists and holds at least one finite value."""
    return name in columns and bool(np.isfinite(np.asarray(columns[name], float)).any())


def hold_last_value(values: np.ndarray) -> np.ndarray:
    """The column (n,) with missing samples (nan) replaced by the last value before them, the first
    ones by the first value; zeros without any value.
    """
    known = np.isfinite(values)
    if not known.any():
        return np.zeros_like(values)
    last = np.maximum.accumulate(np.where(known, np.arange(len(values)), -1))
    return np.ascontiguousarray(values[np.where(last >= 0, last, known.argmax())])


def interpolate_missing(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The column (n,) at times time_s (n,), s, with missing samples on the straight line between
    their neighbours; zeros without any value.
    """
    known = np.isfinite(values)
    return np.interp(time_s, time_s[known], values[known]) if known.any() else np.zeros_like(values)


def interpolate_to_known_levels(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """As interpolate_missing, rounded to the nearest value that the column (n,) holds elsewhere: a
    quantised column keeps its levels. A column that is sampled more slowly than the rows holds its
    last value.
    """
    known = np.isfinite(values)
    if np.mean(known) < MIN_KNOWN_SHARE:
        return hold_last_value(values)
    levels = np.unique(values[known])
    line = interpolate_missing(time_s, values)
    low = levels[np.maximum(np.searchsorted(levels, line, side="right") - 1, 0)]
    high = levels[np.minimum(np.searchsorted(levels, line), len(levels) - 1)]
    return np.where(known, values, np.where(line - low < high - line, low, high))
