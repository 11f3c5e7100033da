"""Figures of agreement between measured and simulated signals."""

import numpy as np

from vgroove.gap.residual.time_warping import overall_rating

CLIP_SIGMAS = 10.0  # residuals are clipped here in a gap: docs/spec/gap.md, section 5
MAX_RATED_SAMPLES = 1000  # the rating's cost grows with the square of the samples
MIN_RATED_SAMPLES = 20  # fewer samples are no curve that can be rated


def iso18571(
    time_s: np.ndarray, measured: np.ndarray, model: np.ndarray
) -> tuple[float | None, int]:
    """ISO/TS 18571 overall rating 0..1 of a model curve (m,) against a measured one, and the number
    of samples that it is computed from.

    Both are interpolated on a uniform grid of at most MAX_RATED_SAMPLES. None when there are fewer
    than MIN_RATED_SAMPLES or the measured curve is flat.
    """
    if len(time_s) < MIN_RATED_SAMPLES or np.ptp(measured) == 0.0:
        return None, 0
    order = np.argsort(time_s, kind="stable")
    count = min(len(time_s), MAX_RATED_SAMPLES)
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


def mean_rating(rated: list[tuple[float | None, int]]) -> float | None:
    """Mean of ratings weighted by their samples; None where no curve could be rated."""
    known = [(rating, count) for rating, count in rated if rating is not None]
    if not known:
        return None
    return float(np.average([r for r, _ in known], weights=[c for _, c in known]))
