"""Figures of agreement between measured and simulated signals."""

import numpy as np

from vgroove.gap.residual.time_warping import overall_rating

# Residuals of a gap are clipped at MIN_CLIP_SIGMAS times the larger of 1 and noise_ratio() of the
# input rig's residuals: docs/spec/gap.md, section 5
MIN_CLIP_SIGMAS = 10.0
QUANTILE, QUANTILE_OF_NOISE = 0.95, 1.96  # of the magnitude of residuals, and of unit normal noise
MAX_RATED_SAMPLES = 1000  # the rating's cost grows with the square of the samples
MIN_RATED_SAMPLES = 20  # fewer samples are no curve that can be rated


def clip_sigmas(size: np.ndarray) -> float:
    """Where the residuals of a signal are clipped in a gap, in sigmas, from the magnitudes (m,) of
    the input rig's judged residuals; the same for every model, so that a gap far above the noise is
    not hidden.
    """
    return MIN_CLIP_SIGMAS * max(1.0, noise_ratio(size))


def noise_ratio(size: np.ndarray) -> float:
    """95 % quantile of magnitudes (m,) of residuals, in sigmas, divided by that of unit normal
    noise: about 1 for noise; 0 without any.
    """
    return float(np.quantile(size, QUANTILE)) / QUANTILE_OF_NOISE if len(size) else 0.0


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
