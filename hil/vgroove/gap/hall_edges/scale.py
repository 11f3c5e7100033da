"""Estimates from a log alone the factor between its Hall speeds and its time stamps: edge periods
follow one another from row to row without contradiction only at the right factor.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial

import numpy as np

from vgroove.gap.hall_edges.chain import SPLIT_S
from vgroove.gap.hall_edges.chain_stretch import longest_chain, period_error_bounds
from vgroove.gap.hall_edges.edge_periods import MIN_COUNTING_PULSES
from vgroove.gap.hall_edges.reader import count_chains


@dataclass(frozen=True)
class ScaleLimits:
    """Limits of the search for the scale, chosen on the tuning half of the blind set."""

    # relative errors of scale that are tried first, in both directions
    coarse: tuple[float, ...] = (3e-4, 1e-3, 3e-3, 0.01, 0.03, 0.1, 0.3)
    halvings: int = 7  # of the search step around the best of them
    largest: float = 0.3  # largest relative error of scale that is considered
    # chains that reversals and stops alone may cause: with at most so many the scale is taken as 1
    usual_chains: int = 12
    # usual chains per edge period of a sensor that counts edges: up to so many no scale is
    # searched, since one of many scales would leave fewer chains by chance
    usual_counted_share: float = 0.01
    fewer_chains: float = 3.0  # factor by which a scale must reduce the number of chains
    max_chain_share: float = 0.03  # chains per edge period above which no scale is accepted
    vote_rounds: int = 3  # rounds in which the bounds of the segments refine the scale
    fine_steps: int = 16  # steps in each direction of the last refinement
    # a search in the fastest rows alone decides whether the column is searched: one scale must
    # reduce the chains there by this factor
    preview_rows: int = 600
    preview_fewer: float = 1.3


@dataclass(frozen=True)
class TimeoutScaleLimits:
    """Limits of the scale from timeout samples, chosen on the tuning half of the blind set."""

    max_error: float = 0.03  # relative error of scale from rounding above which a pair is rejected
    agree: float = 0.005  # relative difference, in addition to rounding, within which pairs agree
    min_pairs: int = 4  # pairs that must agree: rows of a shaft that slows down agree by chance
    max_pairs: int = 1000  # pairs that are compared: bounds the memory, which grows as the square


LIMITS = ScaleLimits()
TIMEOUT_LIMITS = TimeoutScaleLimits()

# number of chains (scale, most to count) and properties of the longest chain (scale)
ChainCount = Callable[..., int]
LongestChain = Callable[[float], tuple[float, float, int]]


@dataclass(frozen=True)
class _Column:
    """A speed column (n,) with its row times, edges per turn and resolution."""

    time_s: np.ndarray
    speed_rpm: np.ndarray
    pulses: int
    lsb_rpm: float

    def chains(self, scale: float, most: int | None = None) -> int:
        """Number of chains if the speeds are divided by a scale."""
        return count_chains(self.time_s, self.speed_rpm / scale, self.pulses, self.lsb_rpm, most)

    def fastest(self, rows: int) -> "_Column":
        """The part of so many rows in which the shaft is fastest."""
        size = np.nan_to_num(np.abs(self.speed_rpm))
        fast = np.convolve(size, np.ones(min(rows, len(size))), mode="valid")
        first = int(np.argmax(fast))
        part = slice(first, first + rows)
        return _Column(self.time_s[part], self.speed_rpm[part], self.pulses, self.lsb_rpm)


def edge_scale(
    time_s: np.ndarray, speed_rpm: np.ndarray, pulses: int, lsb_rpm: float, gaps: int = 0
) -> float:
    """Factor 1 + g between the speed column (n,), rpm, and its own edges; 1 where no factor gives
    clearly fewer chains than 1 does.

    A speed that is logged too high by the share g makes each period too short. The sum of the
    periods then drifts away from the times of the rows, and the chain breaks about every
    (few milliseconds) / g. Causes are a wrong gain of the sensor or a wrong clock of the logger. A
    filter behind the sensor breaks the chain at any factor. `gaps`: intervals that a reduced log
    leaves out, each of which ends a chain.
    """
    column = _Column(time_s, speed_rpm, pulses, lsb_rpm)
    as_read, counts = column.chains(1.0), pulses >= MIN_COUNTING_PULSES
    changes = int(np.count_nonzero(np.diff(speed_rpm[np.isfinite(speed_rpm)])))
    usual = max(LIMITS.usual_chains, counts * LIMITS.usual_counted_share * changes)
    if as_read - gaps <= usual:
        return 1.0
    scales = [
        timeout_scale(time_s, speed_rpm, pulses, lsb_rpm),
        *(1.0 + sign * g for g in LIMITS.coarse for sign in (1.0, -1.0)),
    ]
    if not _any_reduces_chains(column, scales):
        return 1.0
    best, count = _fewest_chains(column.chains, as_read, scales)
    most = max(LIMITS.usual_chains, LIMITS.max_chain_share * changes)
    if LIMITS.fewer_chains * count >= as_read or count > most:
        return 1.0
    voted = _voted_scale(column, 1.0 + best)
    if counts:  # the number of edges in its rows is uncertain: its chains fit several scales
        return voted if LIMITS.fewer_chains * column.chains(voted) < as_read else 1.0 + best
    start = voted if column.chains(voted, count) <= count else 1.0 + best
    return _refined(column.chains, partial(_longest_chain, column), start)


def _longest_chain(column: _Column, scale: float) -> tuple[float, float, int]:
    """Properties of the column's longest chain if the speeds are divided by a scale."""
    return longest_chain(column.time_s, column.speed_rpm / scale, column.pulses, column.lsb_rpm)


def _voted_scale(column: _Column, scale: float) -> float:
    """The scale near `scale` that the bounds of most segments of edges allow; segments with a wrong
    edge count are a minority. The edges are read again in each round.
    """
    for _ in range(LIMITS.vote_rounds):
        bounds = period_error_bounds(
            column.time_s, column.speed_rpm / scale, column.pulses, column.lsb_rpm
        )
        scale *= 1.0 + most_agreed_value(bounds)
    return scale


def most_agreed_value(bounds: np.ndarray) -> float:
    """Middle of the range common to the largest number of intervals (m, 2); 0 without any."""
    if len(bounds) == 0:
        return 0.0
    ends, opens = bounds.ravel(), np.tile([True, False], len(bounds))
    order = np.lexsort((~opens, ends))
    most = int(np.argmax(np.cumsum(np.where(opens[order], 1, -1))))
    return float(0.5 * (ends[order][most] + ends[order][most + 1]))


def _refined(chains: ChainCount, longest: LongestChain, scale: float) -> float:
    """The scale near `scale` at which the longest chain agrees best with its rows: the end of a
    long chain depends most on the scale.

    Where bounds of a chain contradict one another, wrong edge counts may compensate a wrong scale:
    then scales are tried in steps that move the end of the chain by SPLIT_S.
    """
    length_s, share, _ = longest(scale)
    fitted = scale * (1.0 + share)
    if chains(fitted) <= chains(scale) and longest(fitted)[2] == 0:
        return fitted
    best, fewest = scale, chains(scale)
    for k in sorted(range(-LIMITS.fine_steps, LIMITS.fine_steps + 1), key=abs):
        one = scale * (1.0 + k * SPLIT_S / length_s)
        count = chains(one, fewest)
        if count < fewest:
            best, fewest = one, count
    fitted = best * (1.0 + longest(best)[1])
    return fitted if chains(fitted, fewest) <= fewest else best


def _any_reduces_chains(column: _Column, scales: list[float]) -> bool:
    """Whether one of the scales reduces the number of chains in the fastest rows, or these have
    few: a column without edge periods has many at any scale.
    """
    fast = column.fastest(LIMITS.preview_rows)
    as_read = fast.chains(1.0)
    return as_read <= LIMITS.usual_chains or any(
        LIMITS.preview_fewer * fast.chains(scale) < as_read for scale in scales
    )


def timeout_scale(time_s: np.ndarray, speed_rpm: np.ndarray, pulses: int, lsb_rpm: float) -> float:
    """Factor of the speed column (n,), rpm, that most pairs of timeout samples give; 1 where too
    few agree.

    One pitch divided by the value of a timeout sample is the time since the last edge divided by
    the factor: from row to row it grows by the time between the rows divided by the factor. Unlike
    the number of chains this does not depend on the number of edges in a row.
    """
    growth, error = _timeout_growth(time_s, speed_rpm, pulses, lsb_rpm)
    sharpest = np.argsort(error, kind="stable")[: TIMEOUT_LIMITS.max_pairs]
    growth, error = growth[sharpest], error[sharpest] + TIMEOUT_LIMITS.agree
    agree = np.abs(growth[:, None] - growth) < np.minimum(error[:, None], error)
    votes = agree.sum(axis=1)
    if votes.max(initial=0) < TIMEOUT_LIMITS.min_pairs:
        return 1.0
    most = agree[np.argmax(votes)]
    return float(1.0 / np.average(growth[most], weights=error[most] ** -2.0))


def _timeout_growth(
    time_s: np.ndarray, speed_rpm: np.ndarray, pulses: int, lsb_rpm: float
) -> tuple[np.ndarray, np.ndarray]:
    """Growth (k,) of (one pitch / speed) from row to row, divided by the time between the rows,
    and its error from rounding, of the pairs of rows that may be timeout samples at a scale within
    LIMITS.largest.
    """
    shows = np.isfinite(speed_rpm) & (speed_rpm != 0.0)
    time, speed = time_s[shows], speed_rpm[shows]
    since_s = 60.0 / pulses / np.abs(speed)
    rounding = 0.5 * lsb_rpm * since_s / np.abs(speed)
    growth, error = np.diff(since_s) / np.diff(time), (rounding[1:] + rounding[:-1]) / np.diff(time)
    one_direction = speed[1:] * speed[:-1] > 0.0
    # growth from 1 / (1 + largest) to 1 / (1 - largest)
    largest = LIMITS.largest
    possible = np.abs(growth - 1.0 / (1.0 - largest**2)) < largest / (1.0 - largest**2)
    used = one_direction & possible & (error < TIMEOUT_LIMITS.max_error)
    return growth[used], error[used]


def _fewest_chains(chains: ChainCount, as_read: int, scales: list[float]) -> tuple[float, int]:
    """Relative error of scale with the fewest chains, near one of the scales, and that number of
    chains; of equal ones the smallest error. Counting stops at more chains than the best has.
    """
    tried = {0.0: as_read}

    def best_with(errors: Iterable[float]) -> float:
        for g in errors:
            if g not in tried and abs(g) <= LIMITS.largest:
                tried[g] = chains(1.0 + g, min(tried.values()))
        return min(tried, key=lambda g: (tried[g], abs(g)))

    best = best_with(scale - 1.0 for scale in scales)
    step = 0.5 * max(abs(best), LIMITS.coarse[0])
    for _ in range(LIMITS.halvings):
        best = best_with((best - step, best + step))
        step *= 0.5
    level = [g for g in tried if tried[g] == tried[best]]
    middle = 0.5 * (min(level) + max(level))
    return (middle if chains(1.0 + middle, tried[best]) <= tried[best] else best), tried[best]
