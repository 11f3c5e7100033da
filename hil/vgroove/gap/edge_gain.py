"""Reads from a log alone how its edge speeds are scaled against its time stamps: edge periods chain up from row to row only unscaled."""

from collections.abc import Callable, Iterable

import numpy as np

from vgroove.gap.edges import SPLIT_S, count_chains, longest_chain

COARSE = (3e-4, 1e-3, 3e-3, 0.01, 0.03, 0.1, 0.3)  # relative scales that are tried, both ways
REFINED = 7  # halvings of the step around the best of them
UNSUSPICIOUS = 12  # chains that reversals and stops alone may leave: nothing is looked for
FEWER = 3.0  # times fewer chains that make a scale believed,
WHOLE = 0.03  # and at most so many chains an edge period
LARGEST = 0.3
STEPS = 16  # each way, in which a sharper scale is looked for
GLANCE_ROWS, HOPEFUL = 600, 1.3  # rows at which a look shows whether any scale leaves so many times fewer chains


def edge_scale(time_s: np.ndarray, speed_rpm: np.ndarray, pulses: int, lsb_rpm: float) -> float:
    """Factor 1 + g of the speed column against its own edges; 1 where no scale chains them clearly better than none.

    A speed read g too high makes each period too short: the edges run away from the rows that show them, and the chain tears every few
    milliseconds over g. A sensor's gain does that, and a logger's clock that runs off; a filter behind the sensor tears it at any scale.
    """
    def torn(scale: float, most: int | None = None) -> int:
        return count_chains(time_s, speed_rpm / scale, pulses, lsb_rpm, most)

    as_read = torn(1.0)
    if as_read <= UNSUSPICIOUS or not _hopeful(time_s, speed_rpm, pulses, lsb_rpm):
        return 1.0
    best, count = _finest(torn, as_read)
    changes = int(np.count_nonzero(np.diff(speed_rpm[np.isfinite(speed_rpm)])))
    if FEWER * count >= as_read or count > max(UNSUSPICIOUS, WHOLE * changes):
        return 1.0

    def chain(scale: float) -> tuple[float, float, int]:
        return longest_chain(time_s, speed_rpm / scale, pulses, lsb_rpm)

    return _sharpened(torn, chain, 1.0 + best)


def _sharpened(torn: Callable[..., int], chain: Callable[[float], tuple[float, float, int]], scale: float) -> float:
    """The scale near one that chains the edges well at which the longest chain fits its rows best: a small error runs away with its end.

    Where chains still tear, edges are counted wrong to make up for a scale that is off: steps that move the end by what tears it are tried.
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


def _hopeful(time_s: np.ndarray, speed_rpm: np.ndarray, pulses: int, lsb_rpm: float) -> bool:
    """Whether some scale may chain the edges: a column that holds none tears everywhere at any scale, which a fast stretch shows."""
    fast = np.convolve(np.nan_to_num(np.abs(speed_rpm)), np.ones(min(GLANCE_ROWS, len(speed_rpm))), mode="valid")
    rows = slice(first := int(np.argmax(fast)), first + GLANCE_ROWS)

    def torn(scale: float) -> int:
        return count_chains(time_s[rows], speed_rpm[rows] / scale, pulses, lsb_rpm)

    as_read = torn(1.0)
    return as_read <= UNSUSPICIOUS or any(HOPEFUL * torn(1.0 + sign * g) < as_read for g in COARSE for sign in (1.0, -1.0))


def _finest(torn: Callable[[float, int], int], as_read: int) -> tuple[float, int]:
    """Relative scale with the fewest pieces, the smaller of equals, and that number. A scale that leaves more than the best so far is
    counted no further."""
    tried = {0.0: as_read}

    def best_with(scales: Iterable[float]) -> float:
        for g in scales:
            if g not in tried and abs(g) <= LARGEST:
                tried[g] = torn(1.0 + g, min(tried.values()))
        return min(tried, key=lambda g: (tried[g], abs(g)))

    best = best_with(sign * g for g in COARSE for sign in (1.0, -1.0))
    step = 0.5 * max(abs(best), COARSE[0])
    for _ in range(REFINED):
        best = best_with((best - step, best + step))
        step *= 0.5
    level = [g for g in tried if tried[g] == tried[best]]
    middle = 0.5 * (min(level) + max(level))
    return (middle if torn(1.0 + middle, tried[best]) <= tried[best] else best), tried[best]
