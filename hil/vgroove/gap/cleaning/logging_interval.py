"""Interval at which a logger observes the tool: that of its rows, or that of its pauses where it
writes bursts of rows.
"""

import numpy as np

# A pause is longer than both (s, intervals; chosen on the tuning half of the blind set,
# docs/gap_bench.md)
MIN_PAUSE_S, MIN_PAUSE_INTERVALS = 0.02, 8
# pauses that a logger makes at least if it writes bursts of rows (chosen): fewer are losses, or the
# joints of recordings that somebody put together
MIN_PAUSES_OF_BURSTS = 8


def pauses_of(time_s: np.ndarray, interval_s: float) -> np.ndarray:
    """Indices (k,) of the rows that are followed by a pause: the time to the next row exceeds
    MIN_PAUSE_S and MIN_PAUSE_INTERVALS intervals. time_s (n,): times of the rows, s.
    """
    return np.flatnonzero(np.diff(time_s) > max(MIN_PAUSE_S, MIN_PAUSE_INTERVALS * interval_s))


def median_interval_s(time_s: np.ndarray) -> float:
    """Median interval in s between rows at time_s (n,), s."""
    return float(np.median(np.diff(time_s)))


def logging_interval_s(time_s: np.ndarray) -> float:
    """Usual time in s between two observations of a logger, from the times of its rows, time_s
    (n,), s: the median row interval, or the median pause where it writes short bursts of rows.
    """
    usual_s = median_interval_s(time_s)
    pauses = pauses_of(time_s, usual_s)
    if len(pauses) < MIN_PAUSES_OF_BURSTS:
        return usual_s
    bounds = np.concatenate([[0], pauses + 1, [len(time_s)]])
    burst_s = float(np.median(time_s[bounds[1:] - 1] - time_s[bounds[:-1]]))
    pause_s = float(np.median(np.diff(time_s)[pauses]))
    return pause_s if burst_s < pause_s else usual_s
