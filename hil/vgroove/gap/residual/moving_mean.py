"""Moving mean of a column."""

import numpy as np


def moving_mean(values: np.ndarray, width: int) -> np.ndarray:
    """Centred moving mean (n,) of values (n,) over an odd number of rows; beyond the ends the first
    and the last value count.
    """
    padded = np.pad(values, width // 2, mode="edge")
    return np.convolve(padded, np.full(width, 1.0 / width), mode="valid")
