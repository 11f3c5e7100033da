"""Reads from a log alone how its edge speeds are scaled against its time stamps: edge periods chain
up from row to row only unscaled.
"""

from collections.abc import Callable, Iterable

import numpy as np

from vgroove.gap.hall_edges.edge_periods import MIN_COUNTING_PULSES
from vgroove.gap.hall_edges.reader import (
    SPLIT_S,
    count_chains,
    longest_chain,
    period_error_bounds,
)

COARSE = (3e-4, 1e-3, 3e-3, 0.01, 0.03, 0.1, 0.3)  # relative scales that are tried, both ways
REFINED = 7  # halvings of the step around the best of them
UNSUSPICIOUS = 12  # chains that reversals and stops alone may leave: nothing is looked for
# chains an edge period of a sensor that counts which say nothing: chance lets one of many scales
# chain them better
COUNTED_WELL = 0.01
FEWER = 3.0  # times fewer chains that make a scale believed,
WHOLE = 0.03  # and at most so many chains an edge period
LARGEST = 0.3
# of the scale, that rounding may leave in what two rows that wait for an edge tell of it
WAIT_ERROR = 0.03
WAIT_NEAR = 0.005  # of the scale, besides rounding, within which rows that wait agree,
# so many of them at least: rows of a shaft that slows down agree by chance; the most that are asked
FEWEST_WAITS, MOST_WAITS = 4, 1000
VOTES = 3  # rounds in which stretches agree on a sharper scale
STEPS = 16  # each way, in which a still sharper one is looked for
# rows at which a look shows whether any scale leaves so many times fewer chains
GLANCE_ROWS, HOPEFUL = 600, 1.3


def edge_scale(time_s: np.ndarray, speed_rpm: np.ndarray, pulses: int, lsb_rpm: float) -> float:
    """Factor 1 + g of the speed column against its own edges; 1 where no scale chains them clearly
    better than none.

    A speed read g too high makes each period too short: the edges run away from the rows that show
    them, and the chain tears every few milliseconds over g. A sensor's gain does that, and a
    logger's clock that runs off; a filter behind the sensor tears it at any scale.
    """

    def torn(scale: float, most: int | None = None) -> int:
        return count_chains(time_s, speed_rpm / scale, pulses, lsb_rpm, most)

    as_read, counts = torn(1.0), pulses >= MIN_COUNTING_PULSES
    changes = int(np.count_nonzero(np.diff(speed_rpm[np.isfinite(speed_rpm)])))
    if as_read <= max(UNSUSPICIOUS, counts * COUNTED_WELL * changes):
        return 1.0
    scales = [
        timeout_scale(time_s, speed_rpm, pulses, lsb_rpm),
        *(1.0 + sign * g for g in COARSE for sign in (1.0, -1.0)),
    ]
    if not _hopeful(time_s, speed_rpm, pulses, lsb_rpm, scales):
        return 1.0
    best, count = _finest(torn, as_read, scales)
    if FEWER * count >= as_read or count > max(UNSUSPICIOUS, WHOLE * changes):
        return 1.0
    voted = _voted(time_s, speed_rpm, pulses, lsb_rpm, 1.0 + best)
    if counts:  # the number of edges in its rows is a guess: its chains fit several scales
        return voted if FEWER * torn(voted) < as_read else 1.0 + best

    def chain(scale: float) -> tuple[float, float, int]:
        return longest_chain(time_s, speed_rpm / scale, pulses, lsb_rpm)

    return _sharpened(torn, chain, voted if torn(voted, count) <= count else 1.0 + best)


def _voted(
    time_s: np.ndarray, speed_rpm: np.ndarray, pulses: int, lsb_rpm: float, scale: float
) -> float:
    """The scale near one that chains the edges well that most stretches of them allow: one that
    counts an edge wrong to make up for a scale that is off is outvoted. The edges are read anew
    with each.
    """
    for _ in range(VOTES):
        scale *= 1.0 + most_agreed_value(
            period_error_bounds(time_s, speed_rpm / scale, pulses, lsb_rpm)
        )
    return scale


def most_agreed_value(bounds: np.ndarray) -> float:
    """Middle of the range that lies within the most of the bounds (m, 2); 0 without any."""
    if len(bounds) == 0:
        return 0.0
    ends, opens = bounds.ravel(), np.tile([True, False], len(bounds))
    order = np.lexsort((~opens, ends))
    most = int(np.argmax(np.cumsum(np.where(opens[order], 1, -1))))
    return float(0.5 * (ends[order][most] + ends[order][most + 1]))


def _sharpened(
    torn: Callable[..., int], chain: Callable[[float], tuple[float, float, int]], scale: float
) -> float:
    """The scale near one that chains the edges well at which the longest chain fits its rows best:
    a small error runs away with its end.

    Where chains still tear, edges are counted wrong to make up for a scale that is off: steps that
    move the end by what tears it are tried.
    """
    length_s, share, _ = chain(scale)
    fitted = scale * (1.0 + share)
    if torn(fitted) <= torn(scale) and chain(fitted)[2] == 0:
        return fitted
    best, fewest = scale, torn(scale)
    for k in sorted(range(-STEPS, STEPS + 1), key=abs):
        one = scale * (1.0 + k * SPLIT_S / length_s)
        count = torn(one, fewest)
        if count < fewest:
            best, fewest = one, count
    fitted = best * (1.0 + chain(best)[1])
    return fitted if torn(fitted, fewest) <= fewest else best


def _hopeful(
    time_s: np.ndarray, speed_rpm: np.ndarray, pulses: int, lsb_rpm: float, scales: list[float]
) -> bool:
    """Whether one of the scales may chain the edges: a column that holds none tears everywhere at
    any scale, which a fast stretch shows.
    """
    fast = np.convolve(
        np.nan_to_num(np.abs(speed_rpm)), np.ones(min(GLANCE_ROWS, len(speed_rpm))), mode="valid"
    )
    rows = slice(first := int(np.argmax(fast)), first + GLANCE_ROWS)

    def torn(scale: float) -> int:
        return count_chains(time_s[rows], speed_rpm[rows] / scale, pulses, lsb_rpm)

    as_read = torn(1.0)
    return as_read <= UNSUSPICIOUS or any(HOPEFUL * torn(scale) < as_read for scale in scales)


def timeout_scale(time_s: np.ndarray, speed_rpm: np.ndarray, pulses: int, lsb_rpm: float) -> float:
    """Factor of the speed column that most rows that wait for an edge tell, 1 where too few do.

    A pitch over what such a row shows is the time without an edge: read too short by the factor, it
    grows by so much less than the time from row to row. Few counts of pieces tell a scale from afar
    where a fast shaft hides edges; this one needs no guess.
    """
    shows = np.isfinite(speed_rpm) & (speed_rpm != 0.0)
    time, speed = time_s[shows], speed_rpm[shows]
    wait = 60.0 / pulses / np.abs(speed)
    rounding = 0.5 * lsb_rpm * wait / np.abs(speed)
    grown, error = np.diff(wait) / np.diff(time), (rounding[1:] + rounding[:-1]) / np.diff(time)
    alike = speed[1:] * speed[:-1] > 0.0
    told = (
        alike
        & (np.abs(grown - 1.0 / (1.0 - LARGEST**2)) < LARGEST / (1.0 - LARGEST**2))
        & (error < WAIT_ERROR)
    )
    sharpest = np.argsort(error[told], kind="stable")[:MOST_WAITS]
    grown, error = grown[told][sharpest], error[told][sharpest] + WAIT_NEAR
    agree = np.abs(grown[:, None] - grown) < np.minimum(error[:, None], error)
    votes = agree.sum(axis=1)
    if votes.max(initial=0) < FEWEST_WAITS:
        return 1.0
    most = agree[np.argmax(votes)]
    return float(1.0 / np.average(grown[most], weights=error[most] ** -2.0))


def _finest(
    torn: Callable[[float, int], int], as_read: int, scales: list[float]
) -> tuple[float, int]:
    """Relative scale near one of these with the fewest pieces, the smaller of equals, and that
    number. One that leaves more than the best so far is counted no further.
    """
    tried = {0.0: as_read}

    def best_with(scales: Iterable[float]) -> float:
        for g in scales:
            if g not in tried and abs(g) <= LARGEST:
                tried[g] = torn(1.0 + g, min(tried.values()))
        return min(tried, key=lambda g: (tried[g], abs(g)))

    best = best_with(scale - 1.0 for scale in scales)
    step = 0.5 * max(abs(best), COARSE[0])
    for _ in range(REFINED):
        best = best_with((best - step, best + step))
        step *= 0.5
    level = [g for g in tried if tried[g] == tried[best]]
    middle = 0.5 * (min(level) + max(level))
    return (middle if torn(1.0 + middle, tried[best]) <= tried[best] else best), tried[best]
