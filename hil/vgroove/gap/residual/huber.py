"""Huber's loss, which limits the influence of outliers: Huber, Annals of Mathematical Statistics 35
(1964) 73.
"""

from typing import Any

import numpy as np

MIN_RESIDUAL = 1e-9  # sigma; keeps a weight finite at a residual of 0


def huber_weight(residual: np.ndarray, delta: float) -> np.ndarray:
    """Weight of each residual under Huber's loss: 1 up to delta, delta / |r| beyond."""
    return np.minimum(1.0, delta / np.maximum(np.abs(residual), MIN_RESIDUAL))


def huber_loss(residual: np.ndarray, delta: float) -> Any:
    """Huber's loss () or (...) of residuals (m,) or (..., m), summed over the last axis: r^2 up to
    delta, 2 delta |r| - delta^2 beyond.
    """
    size = np.abs(residual)
    near = np.minimum(size, delta)
    return np.vecdot(near, 2.0 * size - near)
