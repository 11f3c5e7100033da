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


def calmed(values: np.ndarray, sigma: float, reach: int = 3) -> np.ndarray:
    """A noisy input without most of its noise and with all of its steps: each sample is the mean of its neighbours within the
    noise of it (a sigma filter; straight lines stay where they are, since both sides count alike)."""
    if sigma <= 0.0:
        return values
    padded = np.pad(values, reach, mode="edge")
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1)
    near = np.abs(around - values[:, None]) < 3.0 * np.sqrt(2.0) * sigma
    near &= near[:, ::-1]  # in pairs: one side alone would move a slope
    return np.where(near, around, 0.0).sum(axis=1) / near.sum(axis=1)
