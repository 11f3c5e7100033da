"""Columns of a log with their missing samples filled, for what must have a value in every row: inputs and loads."""

import numpy as np


def held(values: np.ndarray) -> np.ndarray:
    """Missing samples take the last value before them, the first ones the first value there is."""
    known = np.isfinite(values)
    if not known.any():
        return np.zeros_like(values)
    last = np.maximum.accumulate(np.where(known, np.arange(len(values)), -1))
    return np.ascontiguousarray(values[np.where(last >= 0, last, known.argmax())])


def filled(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Missing samples lie on the straight line between their neighbours."""
    known = np.isfinite(values)
    return np.interp(time_s, time_s[known], values[known]) if known.any() else np.zeros_like(values)
