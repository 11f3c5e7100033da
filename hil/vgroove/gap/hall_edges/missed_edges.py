"""Estimates how many Hall edges a sensor missed: periods that are two to five pitches long while
the periods beside them show no such drop of the speed.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts load when they are first used

from vgroove.array_cache import cached_by_content
from vgroove.gap.hall_edges.edge_periods import EdgePeriods

MAX_PITCHES = 5  # most pitches that one period may hold
PORTION_PERIODS = 1000  # periods whose costs are computed together: bounds the memory
KEPT_PARTS = 64  # results that are kept: speed channel and state observer need the same one


@dataclass(frozen=True)
class MissedEdgeLimits:
    """Limits of the search for missed edges, chosen on the tuning half of the blind set."""

    # standard deviation of the second difference of log(speed) from motion alone
    bend_sigma: float = 0.12
    edge_cost: float = 4.0  # sigma^2: cost of one missed edge
    max_bend_cost: float = 30.0  # sigma^2: largest cost of one second difference (outliers)
    # largest difference of log(speed) between a corrected period and the median beside it
    max_mismatch: float = 0.12
    beside: int = 3  # corrected periods on each side in that median
    gap_periods: float = 1.5  # periods without an edge that separate two sequences
    # periods on each side of a missed edge whose time it may have shifted, or in which another may
    # have been missed unseen
    near_periods: int = 12


LIMITS = MissedEdgeLimits()


def estimate_missed_edges(edges: EdgePeriods) -> np.ndarray:
    """Number of edges (m,) that the sensor missed in each period, at least the known number
    edges.missed; 0 for timeout samples.
    """
    missed, measured = np.zeros(len(edges.row), dtype=int), np.flatnonzero(~edges.timeout)
    speed = edges.speed_rpm[measured]
    length = (edges.end_s - edges.start_s)[measured]
    gap_s = np.abs(edges.start_s[measured][1:] - edges.end_s[measured][:-1])
    apart = gap_s > LIMITS.gap_periods * np.maximum(length[:-1], length[1:])
    cuts = np.flatnonzero(apart | (np.sign(speed[1:]) != np.sign(speed[:-1]))) + 1
    for part in np.split(np.arange(len(measured)), cuts):
        if len(part) > 2 * LIMITS.beside:
            level = np.log(np.abs(speed[part]))
            missed[measured[part]] = consistent_missed_edges(level, most_likely_pitches(level))
    return missed if edges.missed is None else np.maximum(missed, edges.missed)


@cached_by_content(most=KEPT_PARTS)
def most_likely_pitches(level: np.ndarray) -> np.ndarray:
    """Number of pitches (m,) in each period that gives the smoothest speed; level: log(speed) (m,).

    The Viterbi algorithm (Forney, Proc. IEEE 61(3), 1973) over the states (pitches of one period,
    pitches of the next): a transition costs the squared second difference of the corrected level,
    a missed edge LIMITS.edge_cost.
    """
    step = np.log(np.arange(1, MAX_PITCHES + 1))
    price = LIMITS.edge_cost * np.arange(MAX_PITCHES)
    cost, back = price[:, None] + price[None, :], []
    corrected = level[:, None] + step
    for first in range(2, len(level), PORTION_PERIODS):
        for bend_cost in _bend_costs(corrected[first - 2 : first + PORTION_PERIODS]):
            total = cost[:, :, None] + bend_cost + price
            back.append(total.argmin(axis=0))
            cost = total.min(axis=0)
    one, two = np.unravel_index(int(np.argmin(cost)), cost.shape)
    found = [two, one]
    for choice in back[::-1]:
        found.append(choice[found[-1], found[-2]])
    pitches = np.array(found[::-1]) + 1
    pitches.flags.writeable = False
    return pitches


def _bend_costs(corrected: np.ndarray) -> np.ndarray:
    """Cost (m - 2, pitches of i - 2, of i - 1, of i) of the second differences of the corrected
    levels (m, pitches).
    """
    bend = (
        corrected[2:, None, None, :]
        - 2.0 * corrected[1:-1, None, :, None]
        + corrected[:-2, :, None, None]
    )
    return np.minimum((bend / LIMITS.bend_sigma) ** 2, LIMITS.max_bend_cost)


def consistent_missed_edges(level: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Missed edges (m,), count - 1, of the periods whose corrected level agrees with the median
    beside it; 0 elsewhere. level: log(speed) (m,); count: pitches (m,).
    """
    corrected = level + np.log(count)
    around = np.lib.stride_tricks.sliding_window_view(
        np.pad(corrected, LIMITS.beside, mode="edge"), 2 * LIMITS.beside + 1
    )
    mismatch = np.abs(corrected - np.median(around, axis=1))
    return np.where(mismatch < LIMITS.max_mismatch, count - 1, 0)


def add_missed_to_count(edges: EdgePeriods, missed: np.ndarray) -> EdgePeriods:
    """The periods with the missed edges (m,) added to their signed count of edges."""
    unseen = np.cumsum(np.where(edges.timeout, 0, missed * np.sign(edges.speed_rpm).astype(int)))
    return replace(edges, count=np.where(edges.timeout, edges.count, edges.count + unseen))


def widen_beside_missed(edges: EdgePeriods, missed: np.ndarray) -> EdgePeriods:
    """The periods with their half width enlarged by half a pitch near missed edges (m,), because
    rows that report the last of several periods locate it by counting edges.
    """
    half_pitch_s = 0.5 * (edges.end_s - edges.start_s) / (1.0 + missed)
    slack_s = np.where(near_missed(missed), half_pitch_s, 0.0)
    return replace(edges, slack_s=edges.slack_s + slack_s)


def near_missed(missed: np.ndarray) -> np.ndarray:
    """Whether a period (m,) or one near it lacks an edge; missed (m,): missed edges of each."""
    if len(missed) == 0:
        return missed > 0
    return scipy.ndimage.maximum_filter1d(missed, 2 * LIMITS.near_periods + 1) > 0


def as_single_pitches(edges: EdgePeriods, missed: np.ndarray) -> EdgePeriods:
    """The periods shortened to their last pitch, as a sensor that misses no edge reports them; edge
    jitter is estimated from these.
    """
    share = 1.0 / (1.0 + missed)
    return replace(
        edges,
        start_s=edges.end_s - (edges.end_s - edges.start_s) * share,
        speed_rpm=edges.speed_rpm / share,
    )
