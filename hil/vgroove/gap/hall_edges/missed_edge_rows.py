"""Reads rows that show only the last of several Hall edges as if the sensor missed none: periods of
several pitches, and waits.

A missed edge lowers a row's speed, never raises it: the motion is the line through neighbouring
rows that most of them lie on and none lies above. A row below it by a whole factor shows a period
of several pitches, any other one waits for an edge that was missed.
"""

from dataclasses import replace
from itertools import combinations

import numpy as np

from vgroove.gap.cleaning.sensor_noise import MAD_TO_SIGMA
from vgroove.gap.hall_edges.edge_periods import MIN_COUNTING_PULSES, EdgePeriods
from vgroove.gap.hall_edges.missed_edges import MAX_PITCHES
from vgroove.gap.hall_edges.reader import MISSING_ROWS_LIMIT, read_edge_periods

SIDE = 4  # rows on each side through which the line goes
PAIRS = np.array(list(combinations(range(2 * SIDE + 1), 2))).T
FINEST, COARSEST = 0.003, 0.015  # of the speed, by which a row on the line may miss it
SPREADS = 6.0  # of the rows on the line: how far one may lie from it
ABOVE = 2.0  # rows on the line that one above it outweighs
MIN_LONG_PERIODS = 5  # periods of several pitches in a log, below which none is believed
PORTION = 2000  # rows at once: what is held in memory


def motion(level: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Logarithm of the motion's speed at each row (m,) from that of the rows' speeds (m,), and what
    the rows on the line scatter by.
    """
    x = np.arange(2 * SIDE + 1) - SIDE
    around = np.lib.stride_tricks.sliding_window_view(
        np.pad(level, SIDE, constant_values=np.nan), len(x)
    )
    one, other = PAIRS
    slope = (around[:, other] - around[:, one]) / (x[other] - x[one])
    start = around[:, one] - slope * x[one]
    off = around[:, None, :] - start[:, :, None] - slope[:, :, None] * x
    votes = (
        np.sum(np.abs(off) < COARSEST, axis=2)
        - ABOVE * np.sum(off > COARSEST, axis=2)
        - 1e-3 * np.abs(slope)
    )
    best = np.arange(len(level)), np.nanargmax(votes, axis=1)
    on = np.where(np.abs(off[best]) < COARSEST, off[best], np.nan)
    shift = np.nanmedian(on, axis=1)
    return start[best] + shift, MAD_TO_SIGMA * np.nanmedian(np.abs(on - shift[:, None]), axis=1)


def classify_rows(
    time_s: np.ndarray, speed_rpm: np.ndarray, pulses: int
) -> tuple[np.ndarray, np.ndarray]:
    """Edges missed in the period that each row (n,) shows, and whether it waits; 0 and False for
    rows that hide no edges.
    """
    missed, waits = np.zeros(len(speed_rpm), dtype=int), np.zeros(len(speed_rpm), dtype=bool)
    hiding_rpm = 60.0 / pulses / float(np.median(np.diff(time_s)))
    for part in stretches(speed_rpm):
        size = np.abs(speed_rpm[part])
        if len(part) <= 2 * SIDE or size.max() < hiding_rpm:
            continue
        line, spread = motion(np.log(size))
        below = line - np.log(size)
        pitches = np.clip(np.round(np.exp(below)), 1.0, MAX_PITCHES)
        on, hides = (
            np.abs(below - np.log(pitches)) < np.clip(SPREADS * spread, FINEST, COARSEST),
            np.exp(line) > hiding_rpm,
        )
        missed[part] = np.where(hides & on, pitches - 1.0, 0.0)
        waits[part] = hides & ~on & (below > 0.0)
    return missed, waits


def stretches(speed_rpm: np.ndarray) -> list[np.ndarray]:
    """Rows of each stretch that turns one way without a hole, no longer than a portion."""
    known = np.flatnonzero(np.isfinite(speed_rpm) & (speed_rpm != 0.0))
    if len(known) == 0:
        return []
    ends = (
        (np.diff(np.sign(speed_rpm[known])) != 0.0)
        | (np.diff(known) > MISSING_ROWS_LIMIT)
        | (np.arange(1, len(known)) % PORTION == 0)
    )
    return np.split(known, np.flatnonzero(ends) + 1)


def read_edges_with_missed(
    time_s: np.ndarray, speed_rpm: np.ndarray, pulses: int, lsb_rpm: float
) -> EdgePeriods:
    """Edge periods of a speed column, those that are several pitches long included where rows show
    only the last of several edges.

    Where an edge lies follows from counting pitches, for which a row's speed must be that of one.
    Rows that wait say nothing of a sensor that misses edges: they are left out.
    """
    missed, waits = classify_rows(time_s, speed_rpm, pulses)
    if pulses >= MIN_COUNTING_PULSES or np.count_nonzero(missed) < MIN_LONG_PERIODS:
        return read_edge_periods(time_s, speed_rpm, pulses, lsb_rpm)
    found = read_edge_periods(
        time_s, np.where(waits, np.nan, speed_rpm * (1.0 + missed)), pulses, lsb_rpm
    )
    unseen = np.where(found.timeout, 0, missed[found.row])
    count = found.count - np.where(
        found.timeout, 0, np.cumsum(unseen * np.sign(found.speed_rpm).astype(int))
    )
    return replace(
        found,
        start_s=found.end_s - (found.end_s - found.start_s) * (1.0 + unseen),
        speed_rpm=found.speed_rpm / (1.0 + unseen),
        count=count,
        missed=unseen,
    )
