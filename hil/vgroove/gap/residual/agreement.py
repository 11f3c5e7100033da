"""Figures of agreement between measured and simulated signals."""

import numpy as np

from vgroove.gap.residual.time_warping import overall_rating

CLIP = 10.0
RATING_SAMPLES = 1000  # the metric's cost grows with the square of the samples
LEAST_SAMPLES = 20


def iso18571(
    time_s: np.ndarray, measured: np.ndarray, model: np.ndarray
) -> tuple[float | None, int]:
    """ISO/TS 18571 overall rating 0..1 of a model curve (m,) against a measured one, and the
    samples behind it.

    Both are brought to a uniform grid of at most 1000 samples. None when there are fewer than 20
    samples or the measured curve is flat.
    """
    if len(time_s) < LEAST_SAMPLES or np.ptp(measured) == 0.0:
        return None, 0
    order = np.argsort(time_s, kind="stable")
    count = min(len(time_s), RATING_SAMPLES)
    grid = np.linspace(time_s[order[0]], time_s[order[-1]], count)
    curves = [
        np.column_stack([grid, np.interp(grid, time_s[order], values[order])])
        for values in (measured, model)
    ]
    try:
        rating = overall_rating(curves[0], curves[1], float(grid[1] - grid[0]))
    except (ValueError, ZeroDivisionError, IndexError):
        return None, 0
    return (float(np.clip(rating, 0.0, 1.0)), len(time_s)) if np.isfinite(rating) else (None, 0)
