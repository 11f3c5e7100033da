"""Counts Hall edges that a sensor passed over: periods that are two, three or four pitches long
where the motion beside them runs on.
"""

from dataclasses import replace

import numpy as np
from scipy.ndimage import maximum_filter1d

from vgroove.gap.hall_edges.edge_periods import EdgePeriods

MAX_PITCHES = 5  # pitches that one period may hold
BEND = 0.12  # of the logarithm of speed from period to period that motion bends by
PRICE = 4.0  # of one missed edge, in squared bends
WORST = 30.0  # a bend costs no more
NEAR = 0.12  # of the speed beside it, by which a corrected period may miss it
REACH = 12  # periods on each side of a missed edge whose place in time it may have shifted
BESIDE = 3  # corrected periods on each side that it is held against


def estimate_missed_edges(edges: EdgePeriods) -> np.ndarray:
    """Edges (m,) that each period seems to have missed, or is known to; 0 for rows that still wait
    for an edge.
    """
    missed, whole = np.zeros(len(edges.row), dtype=int), np.flatnonzero(~edges.timeout)
    speed = edges.speed_rpm[whole]
    apart = np.abs(edges.start_s[whole][1:] - edges.end_s[whole][:-1]) > 1.5 * np.maximum(
        *_neighbours(edges, whole)
    )
    cuts = np.flatnonzero(apart | (np.sign(speed[1:]) != np.sign(speed[:-1]))) + 1
    for part in np.split(np.arange(len(whole)), cuts):
        if len(part) > 2 * BESIDE:
            missed[whole[part]] = consistent_missed_edges(
                np.log(np.abs(speed[part])), most_likely_pitches(np.log(np.abs(speed[part])))
            )
    return missed if edges.missed is None else np.maximum(missed, edges.missed)


def _neighbours(edges: EdgePeriods, whole: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lengths of each whole period but the last, and of the one after it."""
    length = (edges.end_s - edges.start_s)[whole]
    return length[:-1], length[1:]


def most_likely_pitches(level: np.ndarray) -> np.ndarray:
    """Pitches (m,) in each period that make the logarithms of speed (m,) bend least (Viterbi over
    pairs of neighbours).
    """
    step = np.log(np.arange(1, MAX_PITCHES + 1))
    price = PRICE * np.arange(MAX_PITCHES)
    cost, back = price[:, None] + price[None, :], []
    for i in range(2, len(level)):
        # axes: pitches of i - 2, of i - 1, of i
        bend = (
            (level[i] + step)[None, None, :]
            - 2.0 * (level[i - 1] + step)[None, :, None]
            + (level[i - 2] + step)[:, None, None]
        )
        total = cost[:, :, None] + np.minimum((bend / BEND) ** 2, WORST) + price
        back.append(np.argmin(total, axis=0))
        cost = total.min(axis=0)
    one, two = np.unravel_index(int(np.argmin(cost)), cost.shape)
    found = [two, one]
    for choice in back[::-1]:
        found.append(choice[found[-1], found[-2]])
    return np.array(found[::-1]) + 1


def consistent_missed_edges(level: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Missed edges (m,) of those periods that fall in with the corrected speed beside them."""
    corrected = level + np.log(count)
    around = np.lib.stride_tricks.sliding_window_view(
        np.pad(corrected, BESIDE, mode="edge"), 2 * BESIDE + 1
    )
    return np.where(np.abs(corrected - np.median(around, axis=1)) < NEAR, count - 1, 0)


def add_missed_to_count(edges: EdgePeriods, missed: np.ndarray) -> EdgePeriods:
    """The periods with what the sensor passed over in their count of edges."""
    unseen = np.cumsum(np.where(edges.timeout, 0, missed * np.sign(edges.speed_rpm).astype(int)))
    return replace(edges, count=np.where(edges.timeout, edges.count, edges.count + unseen))


def widen_beside_missed(edges: EdgePeriods, missed: np.ndarray) -> EdgePeriods:
    """The periods with what a missed edge leaves open beside it: rows that show only the last of
    several periods place it by counting.
    """
    near = maximum_filter1d(missed, 2 * REACH + 1) > 0 if len(missed) else missed > 0
    return replace(
        edges,
        slack_s=edges.slack_s
        + np.where(near, 0.5 * (edges.end_s - edges.start_s) / (1.0 + missed), 0.0),
    )


def as_single_pitches(edges: EdgePeriods, missed: np.ndarray) -> EdgePeriods:
    """The periods cut down to one pitch each, as a sensor that misses nothing shows the last of
    them: what edge jitter is read from.
    """
    share = 1.0 / (1.0 + missed)
    return replace(
        edges,
        start_s=edges.end_s - (edges.end_s - edges.start_s) * share,
        speed_rpm=edges.speed_rpm / share,
    )
