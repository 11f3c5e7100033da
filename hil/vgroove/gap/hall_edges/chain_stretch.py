"""Estimates the relative stretch of chains of Hall edges: the share by which all edge periods would
have to be longer to agree with the times of the rows that report them.
"""

from dataclasses import dataclass
from math import inf

import numpy as np
import scipy  # its parts load when they are first used

from vgroove.gap.hall_edges.chain import EdgeChain, consistent_pieces
from vgroove.gap.hall_edges.edge_periods import MIN_COUNTING_PULSES
from vgroove.gap.hall_edges.hidden_periods import ONE_EDGE_ROWS
from vgroove.gap.hall_edges.row_reader import RowReader


@dataclass(frozen=True)
class StretchLimits:
    """Limits of the stretch estimate, chosen on the tuning half of the blind set."""

    segment_edges: int = 64  # edges of one segment: a wrong edge count affects one segment only
    slack_s: float = 5e-6  # s: error of the time between two edges besides summed rounding
    min_apart_s: float = 1e-3  # s: two edges closer than this give too wide a bound
    most: float = 2e-3  # relative stretch above which a chain is broken into several
    tolerance: float = 1e-7  # relative stretch to which the minimum is searched


LIMITS = StretchLimits()


def longest_chain(
    time_s: np.ndarray, speed_rpm: np.ndarray, pulses_per_rev: int, lsb_rpm: float
) -> tuple[float, float, int]:
    """Duration, s, of the longest chain of edge periods; its relative stretch, at which the largest
    violation of the bounds of its rows is smallest; and the number of contradictions in all chains.
    """
    chains = list(RowReader(time_s, speed_rpm, pulses_per_rev, lsb_rpm).chains_in_order())
    longest = max(chains, key=lambda one: one.offset_s[-1])
    offset, (low, high, _) = np.asarray(longest.offset_s), longest.bounds()
    found = scipy.optimize.minimize_scalar(
        # largest violation; convex, since it is a maximum of functions linear in the stretch
        lambda stretch: np.max(low - stretch * offset) - np.min(high - stretch * offset),
        method="bounded",
        bounds=(-LIMITS.most, LIMITS.most),
        options={"xatol": LIMITS.tolerance},
    )
    contradictions = sum(len(consistent_pieces(*chain.bounds())) - 1 for chain in chains)
    return float(offset[-1]), float(found.x), contradictions


def period_error_bounds(
    time_s: np.ndarray, speed_rpm: np.ndarray, pulses_per_rev: int, lsb_rpm: float
) -> np.ndarray:
    """Smallest and largest relative stretch (m, 2) of the periods that each segment of a chain, of
    LIMITS.segment_edges edges, allows within the bounds of its rows.

    Of a sensor that counts edges only those segments are used in which each edge has a row of its
    own.
    """
    counts, found = pulses_per_rev >= MIN_COUNTING_PULSES, []
    for chain in list(RowReader(time_s, speed_rpm, pulses_per_rev, lsb_rpm).chains_in_order()):
        hidden = chain.hides_edges(time_s, ONE_EDGE_ROWS) & counts
        cuts = np.union1d(
            np.arange(0, len(hidden), LIMITS.segment_edges), np.flatnonzero(np.diff(hidden)) + 1
        )
        for first, last in zip(cuts, [*cuts[1:], len(hidden)], strict=True):
            if not hidden[first]:
                found.append(_segment_bounds(chain.part(first, last)))
    bounds = np.array(found).reshape(-1, 2)
    return bounds[np.isfinite(bounds).all(axis=1) & (bounds[:, 0] <= bounds[:, 1])]


def _segment_bounds(chain: EdgeChain) -> tuple[float, float]:
    """As period_error_bounds, of one segment: any two of its edges bound the time between them."""
    (low, high, drift), (one, other) = chain.bounds(), np.triu_indices(len(chain.row), 1)
    apart = np.diff(np.asarray(chain.offset_s)[[one, other]], axis=0)[0]
    slack = drift[other] - drift[one] + LIMITS.slack_s
    far = apart > LIMITS.min_apart_s
    one, other, apart, slack = (values[far] for values in (one, other, apart, slack))
    return (
        float(np.max((low[other] - high[one] - slack) / apart, initial=-inf)),
        float(np.min((high[other] - low[one] + slack) / apart, initial=inf)),
    )
