"""Columns of a log with their missing samples filled, for what must have a value in every row:
inputs and loads.
"""

import numpy as np

MIN_KNOWN_SHARE = 0.9  # share of the rows that know a column which is read anew in each


def hold_last_value(values: np.ndarray) -> np.ndarray:
    """Missing samples take the last value before them, the first ones the first value there is."""
    known = np.isfinite(values)
    if not known.any():
        return np.zeros_like(values)
    last = np.maximum.accumulate(np.where(known, np.arange(len(values)), -1))
    return np.ascontiguousarray(values[np.where(last >= 0, last, known.argmax())])


def interpolate_missing(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Missing samples lie on the straight line between their neighbours."""
    known = np.isfinite(values)
    return np.interp(time_s, time_s[known], values[known]) if known.any() else np.zeros_like(values)


def interpolate_to_known_levels(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """As filled, by values that occur: a rounded column keeps its steps. A column that comes less
    often than the rows holds its values.
    """
    known = np.isfinite(values)
    if np.mean(known) < MIN_KNOWN_SHARE:
        return hold_last_value(values)
    occur = np.unique(values[known])
    line = interpolate_missing(time_s, values)
    low = occur[np.maximum(np.searchsorted(occur, line, side="right") - 1, 0)]
    high = occur[np.minimum(np.searchsorted(occur, line), len(occur) - 1)]
    return np.where(known, values, np.where(line - low < high - line, low, high))
