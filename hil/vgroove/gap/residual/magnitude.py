"""Robust magnitude of a logged column: the unit in which sizes of effects are expressed."""

import numpy as np


def robust_magnitude(values: np.ndarray, fallback: float) -> float:
    """99th percentile of the magnitudes of a column (n,), in its unit; the fallback where the
    column is empty or zero throughout.
    """
    good = np.abs(values[np.isfinite(values)])
    top = float(np.percentile(good, 99)) if good.size else 0.0
    return top if top > 1e-12 else fallback
