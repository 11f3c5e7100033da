"""Shares with their confidence intervals."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from scipy.special import ndtri


def wilson(hits: int, count: int, level: float = 0.95) -> tuple[float, float]:
    """Confidence interval of a share hits / count by the score method (Wilson 1927)."""
    if count == 0:
        return 0.0, 1.0
    z = float(ndtri(0.5 + level / 2.0))
    share, square = hits / count, z * z / count
    middle = (share + square / 2.0) / (1.0 + square)
    half = z * np.sqrt(share * (1.0 - share) / count + square / (4.0 * count)) / (1.0 + square)
    return max(0.0, float(middle - half)), min(1.0, float(middle + half))


def rate(flags: Iterable[bool]) -> dict[str, Any]:
    """Share of the true flags with its 95 % interval."""
    flags = list(flags)
    hits = sum(bool(flag) for flag in flags)
    return {
        "hits": hits,
        "of": len(flags),
        "share": hits / len(flags) if flags else None,
        "ci95": list(wilson(hits, len(flags))),
    }
