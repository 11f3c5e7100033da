"""Reads speed columns whose rows report the last of several Hall edges, of a sensor that misses
edges: finds the periods of several pitches and the timeout samples.

A missed edge lowers a row's speed, never raises it. The motion is therefore the line through
neighbouring rows that most of them lie on and none lies above. A row below it by a whole factor
reports a period of several pitches; any other row below it is a timeout sample after a missed edge.
"""

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from vgroove.gap.cleaning.sensor_noise import MAD_TO_SIGMA
from vgroove.gap.hall_edges.edge_periods import MIN_COUNTING_PULSES, EdgePeriods
from vgroove.gap.hall_edges.missed_edges import MAX_PITCHES
from vgroove.gap.hall_edges.reader import read_edge_periods
from vgroove.gap.hall_edges.row_reader import LIMITS as ROW_LIMITS

SIDE = 4  # rows on each side through which the line goes
PAIRS = np.array(list(combinations(range(2 * SIDE + 1), 2))).T
MIN_LONG_PERIODS = 5  # periods of several pitches in a log below which none is accepted
PORTION_ROWS = 2000  # rows that are processed together: bounds the memory


@dataclass(frozen=True)
class MissedRowLimits:
    """Limits of the line through neighbouring rows, chosen on the tuning half of the blind set."""

    # relative mismatch within which a row lies on the line, at least and at most
    min_mismatch: float = 0.003
    max_mismatch: float = 0.015
    mismatch_sigma: float = 6.0  # mismatch in standard deviations of the rows on the line
    above_weight: float = 2.0  # votes that one row above the line costs
    slope_weight: float = 1e-3  # votes per slope, log(speed) a row: of equal lines the flatter wins


LIMITS = MissedRowLimits()


def motion(level: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """log(speed) of the motion at each row (m,), and the standard deviation of the rows on its
    line, from level: log(speed) of the rows (m,).

    Consensus line: of the lines through all pairs of the 2 SIDE + 1 rows around, the one with the
    most rows on it (RANSAC with every sample: Fischler, Bolles, Comm. ACM 24(6), 1981).
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
        np.sum(np.abs(off) < LIMITS.max_mismatch, axis=2)
        - LIMITS.above_weight * np.sum(off > LIMITS.max_mismatch, axis=2)
        - LIMITS.slope_weight * np.abs(slope)
    )
    best = np.arange(len(level)), np.nanargmax(votes, axis=1)
    on = np.where(np.abs(off[best]) < LIMITS.max_mismatch, off[best], np.nan)
    shift = np.nanmedian(on, axis=1)
    return start[best] + shift, MAD_TO_SIGMA * np.nanmedian(np.abs(on - shift[:, None]), axis=1)


def classify_rows(
    time_s: np.ndarray, speed_rpm: np.ndarray, pulses: int
) -> tuple[np.ndarray, np.ndarray]:
    """Edges missed in the period that each row (n,) reports, and whether it is a timeout sample
    after a missed edge; 0 and False for rows into which at most one edge falls.
    """
    missed, timeout = np.zeros(len(speed_rpm), dtype=int), np.zeros(len(speed_rpm), dtype=bool)
    # at a higher speed several edges fall into a row, which reports the last one
    hiding_rpm = 60.0 / pulses / float(np.median(np.diff(time_s)))
    for part in one_direction_parts(speed_rpm):
        size = np.abs(speed_rpm[part])
        if len(part) <= 2 * SIDE or size.max() < hiding_rpm:
            continue
        line, sigma = motion(np.log(size))
        below = line - np.log(size)
        pitches = np.clip(np.round(np.exp(below)), 1.0, MAX_PITCHES)
        allowed = np.clip(LIMITS.mismatch_sigma * sigma, LIMITS.min_mismatch, LIMITS.max_mismatch)
        whole_factor = np.abs(below - np.log(pitches)) < allowed
        hides = np.exp(line) > hiding_rpm
        missed[part] = np.where(hides & whole_factor, pitches - 1.0, 0.0)
        timeout[part] = hides & ~whole_factor & (below > 0.0)
    return missed, timeout


def one_direction_parts(speed_rpm: np.ndarray) -> list[np.ndarray]:
    """Rows of each part of the column (n,) of one direction without missing rows, at most
    PORTION_ROWS long.
    """
    known = np.flatnonzero(np.isfinite(speed_rpm) & (speed_rpm != 0.0))
    if len(known) == 0:
        return []
    ends = (
        (np.diff(np.sign(speed_rpm[known])) != 0.0)
        | (np.diff(known) > ROW_LIMITS.missing_rows)
        | (np.arange(1, len(known)) % PORTION_ROWS == 0)
    )
    return np.split(known, np.flatnonzero(ends) + 1)


def read_edges_with_missed(
    time_s: np.ndarray, speed_rpm: np.ndarray, pulses: int, lsb_rpm: float
) -> EdgePeriods:
    """Edge periods of a speed column (n,), rpm, of a sensor that may miss edges; periods of several
    pitches are found where rows report only the last of several edges.

    The reader locates edges by counting pitches, for which each row's speed must be that of one
    pitch. Timeout samples after missed edges are left out: they report the time since an edge that
    is not the last one.
    """
    missed, timeout = classify_rows(time_s, speed_rpm, pulses)
    if pulses >= MIN_COUNTING_PULSES or np.count_nonzero(missed) < MIN_LONG_PERIODS:
        return read_edge_periods(time_s, speed_rpm, pulses, lsb_rpm)
    found = read_edge_periods(
        time_s, np.where(timeout, np.nan, speed_rpm * (1.0 + missed)), pulses, lsb_rpm
    )
    missed_here = np.where(found.timeout, 0, missed[found.row])
    count = found.count - np.where(
        found.timeout, 0, np.cumsum(missed_here * np.sign(found.speed_rpm).astype(int))
    )
    return replace(
        found,
        start_s=found.end_s - (found.end_s - found.start_s) * (1.0 + missed_here),
        speed_rpm=found.speed_rpm / (1.0 + missed_here),
        count=count,
        missed=missed_here,
    )
