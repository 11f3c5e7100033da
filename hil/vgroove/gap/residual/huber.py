"""Huber's loss, which limits the influence of outliers: Huber, Annals of Mathematical Statistics 35
(1964) 73.
"""

import numpy as np

MIN_RESIDUAL = 1e-9  # sigma; keeps a weight finite at a residual of 0


def huber_weight(residual: np.ndarray, delta: float) -> np.ndarray:
    """Weight of each residual under Huber's loss: 1 up to delta, delta / |r| beyond."""
    return np.minimum(1.0, delta / np.maximum(np.abs(residual), MIN_RESIDUAL))


def huber_loss(residual: np.ndarray, delta: float) -> float:
    """Huber's loss of residuals: r^2 up to delta, 2 delta |r| - delta^2 beyond."""
    size = np.abs(residual)
    near = np.minimum(size, delta)
    return float(near @ (2.0 * size - near))
