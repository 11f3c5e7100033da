"""Which blows of a run are clean: the measure of synchronism that studies and benches share."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class CleanBlow:
    """Limits of a clean blow; this project's definition of synchronism (docs/studies.md)."""

    engaged_share: float = 0.5  # least engagement, of the lug height
    period_share: float = 0.10  # largest deviation of the period, of the median period


CLEAN = CleanBlow()
BLOW, REPEAT, REBOUND = 0, 1, 2  # the plant's `kind` of a hit


def hits_between(blows: np.ndarray, start_s: float, end_s: float) -> np.ndarray:
    """Blows and repeats within start_s <= time < end_s; a rebound is part of its blow."""
    hits = blows[blows["kind"] < REBOUND]
    return hits[(hits["time_s"] >= start_s) & (hits["time_s"] < end_s)]


def clean(hits: np.ndarray, lug_height_m: float) -> np.ndarray:
    """Which hits (n,) are clean: no repeat, no lug skipped, engagement and period within CLEAN.

    The period of a blow is the time since the blow before; the first blow has none, and its period
    is not judged.
    """
    first = hits["kind"] == BLOW
    period = np.full(len(hits), np.nan)
    period[first] = np.diff(hits["time_s"][first], prepend=np.nan)
    median = np.nanmedian(period) if np.isfinite(period).any() else np.nan
    regular = ~(np.abs(period - median) > CLEAN.period_share * median)
    return (
        first
        & (hits["skipped"] == 0)
        & (hits["engaged_m"] >= CLEAN.engaged_share * lug_height_m)
        & regular
    )
