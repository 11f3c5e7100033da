"""Measures on chains of Hall edges by which factor all edge periods are too short for the times of
the rows that report them.
"""

from dataclasses import dataclass
from math import inf

import numpy as np
from scipy.optimize import minimize_scalar

from vgroove.gap.hall_edges.chain import EdgeChain, consistent_pieces
from vgroove.gap.hall_edges.edge_periods import MIN_COUNTING_PULSES
from vgroove.gap.hall_edges.hidden_periods import ONE_EDGE_ROWS
from vgroove.gap.hall_edges.row_reader import RowReader


@dataclass(frozen=True)
class StretchLimits:
    """Limits of the stretch estimate, chosen on the tuning half of the blind set."""

    edges: int = 64  # edges of one stretch: an edge counted wrong spoils no more than these
    slack_s: float = 5e-6  # s: error of the time between two edges besides summed rounding
    min_apart_s: float = 1e-3  # s: edges closer than this give no useful bound
    most: float = 2e-3  # relative stretch up to which a chain holds together
    tolerance: float = 1e-7  # relative stretch to which the minimum is searched


LIMITS = StretchLimits()


def longest_chain(
    time_s: np.ndarray, speed_rpm: np.ndarray, pulses_per_rev: int, lsb_rpm: float
) -> tuple[float, float, int]:
    """Length, s, of the longest chain of edge periods; the relative amount by which all periods
    would have to be longer to lie best within the bounds of its rows (least largest violation);
    and how many contradictions all chains hold.
    """
    chains = list(RowReader(time_s, speed_rpm, pulses_per_rev, lsb_rpm).chains_in_order())
    longest = max(chains, key=lambda one: one.offset_s[-1])
    offset, (low, high, _) = np.asarray(longest.offset_s), longest.bounds()
    found = minimize_scalar(
        # the largest of straight lines: convex
        lambda share: np.max(low - share * offset) - np.min(high - share * offset),
        method="bounded",
        bounds=(-LIMITS.most, LIMITS.most),
        options={"xatol": LIMITS.tolerance},
    )
    contradictions = sum(len(consistent_pieces(*chain.bounds())) - 1 for chain in chains)
    return float(offset[-1]), float(found.x), contradictions


def period_error_bounds(
    time_s: np.ndarray, speed_rpm: np.ndarray, pulses_per_rev: int, lsb_rpm: float
) -> np.ndarray:
    """Least and largest relative amount (m, 2) by which all periods may be longer for each stretch
    of LIMITS.edges edges to lie within the bounds of its rows.

    Of a sensor that counts edges only those stretches are used whose edges are reported by rows of
    their own.
    """
    counts, found = pulses_per_rev >= MIN_COUNTING_PULSES, []
    for chain in list(RowReader(time_s, speed_rpm, pulses_per_rev, lsb_rpm).chains_in_order()):
        hidden = chain.hides_edges(time_s, ONE_EDGE_ROWS) & counts
        cuts = np.union1d(
            np.arange(0, len(hidden), LIMITS.edges), np.flatnonzero(np.diff(hidden)) + 1
        )
        for first, last in zip(cuts, [*cuts[1:], len(hidden)], strict=True):
            if not hidden[first]:
                found.append(_stretch_bounds(chain.part(first, last)))
    bounds = np.array(found).reshape(-1, 2)
    return bounds[np.isfinite(bounds).all(axis=1) & (bounds[:, 0] <= bounds[:, 1])]


def _stretch_bounds(chain: EdgeChain) -> tuple[float, float]:
    """As period_error_bounds, of one stretch: any two of its edges bound the time between them."""
    (low, high, drift), (one, other) = chain.bounds(), np.triu_indices(len(chain.row), 1)
    apart = np.diff(np.asarray(chain.offset_s)[[one, other]], axis=0)[0]
    slack = drift[other] - drift[one] + LIMITS.slack_s
    far = apart > LIMITS.min_apart_s
    one, other, apart, slack = (values[far] for values in (one, other, apart, slack))
    return (
        float(np.max((low[other] - high[one] - slack) / apart, initial=-inf)),
        float(np.min((high[other] - low[one] + slack) / apart, initial=inf)),
    )
