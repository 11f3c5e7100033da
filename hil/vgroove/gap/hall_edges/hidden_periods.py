"""Times of the Hall edges that no log row reports, because several edges fall between two rows."""

from functools import lru_cache
from math import sqrt
from typing import Any

import numpy as np

# s: bound on the error of every reported time: the time stamps of row and edge are rounded to about
# 1 us each
TICK_S = 2e-6
# share of the change between two reported periods by which each hidden period between them may
# differ from uniform acceleration; chosen on the tuning half of the blind set
BEND_SHARE = 0.02
# rows: a period longer than this many row intervals is reported by a row of its own, and at most
# one edge falls into a row; chosen on the tuning half of the blind set
ONE_EDGE_ROWS = 1.5
# periods of a span up to which the shares are kept, 64 KiB each at most, and spans that are summed
# at once
MOST_KEPT = 64
FEW_PERIODS = 7  # up to which plain numbers are faster than an array
# least number of periods, in shares of the smaller rate in the change of rate, from which
# long_span_s() is used: its error is below 1e-6 of the longest period (the next term of its series)
LEAST_EVEN = 8.0


def counted_edge_times(
    previous_s: float, period_s: float, most: int, rows_s: tuple[float, float, float]
) -> np.ndarray:
    """Times (most,), s, from one edge to the first, second, ... edge after it, of a sensor that
    reports the mean period over all edges since the row before (docs/spec/gap.md, section 1).

    rows_s: end of the row read before, end of the last missing row, and end of this row. The edges
    of missing rows are taken to pass at the mean of both reported speeds.
    """
    number, (before, since, now) = np.arange(1, most + 1), rows_s
    if since <= before:
        return period_s * number
    missing_s = 2.0 / (1.0 / previous_s + 1.0 / period_s)
    return missing_s * number + (period_s - missing_s) * np.minimum(
        number, (now - since) / period_s
    )


def accelerated_edge_times(previous_s: float, period_s: float, most: int) -> np.ndarray:
    """Times (most,), s, from one edge to the first, second, ... edge after it. The n-th entry
    assumes that n periods lead from a period of previous_s to one of period_s at uniform
    acceleration: the square of the speed then grows linearly with the angle.
    """
    few = min(most, most_summed(previous_s, period_s))
    first, change = 1.0 / previous_s**2, 1.0 / period_s**2 - 1.0 / previous_s**2
    shares, parts = _kept_shares if few <= MOST_KEPT else _shares_of_spans, []
    for begin in range(0, few, MOST_KEPT):
        share, passed = shares(begin, min(begin + MOST_KEPT, few))
        parts.append((passed / np.sqrt(first + change * share)).sum(axis=1))
    summed = np.concatenate(parts)
    if few == most:
        return summed
    return np.append(summed, long_span_s(previous_s, period_s, np.arange(few + 1, most + 1)))


def most_summed(previous_s: float, period_s: float) -> int:
    """Number of periods between previous_s and period_s up to which their sum is taken one by one,
    and above which long_span_s() states it.
    """
    ratio = max(previous_s, period_s) / min(previous_s, period_s)
    return int(max(MOST_KEPT, LEAST_EVEN * (ratio * ratio - 1.0)))


def span_s(previous_s: float, period_s: float, count: int) -> float:
    """Length, s, of `count` periods that lead from previous_s to period_s at uniform acceleration:
    the last of accelerated_edge_times().
    """
    first, last = 1.0 / (previous_s * previous_s), 1.0 / (period_s * period_s)
    if count <= FEW_PERIODS:
        return sum(1.0 / sqrt(first + (last - first) * n / count) for n in range(1, count + 1))
    if count > most_summed(previous_s, period_s):
        return long_span_s(previous_s, period_s, count)
    rate = first + (last - first) * np.arange(1, count + 1) / count
    return float((1.0 / np.sqrt(rate)).sum())


def long_span_s(previous_s: float, period_s: float, count: Any) -> Any:
    """Length, s, of `count` periods (a number, or (k,)) that lead from previous_s to period_s at
    uniform acceleration: the first terms of the Euler-Maclaurin series of their sum.
    """
    change = 1.0 / period_s**2 - 1.0 / previous_s**2
    mean_s = 2.0 / (1.0 / previous_s + 1.0 / period_s)
    bend = change * (period_s**3 - previous_s**3) / (24.0 * count)
    third = (change / count) ** 3 * (period_s**7 - previous_s**7) / 384.0
    return count * mean_s + 0.5 * (period_s - previous_s) - bend + third


def _shares_of_spans(above: int, most: int) -> tuple[np.ndarray, np.ndarray]:
    """For spans of more than `above` and at most `most` periods (rows) and each period (columns):
    the share of the span at the period's end, and 1 if the period is part of the span; both 0 else.
    """
    number, period = np.arange(above + 1, most + 1)[:, None], np.arange(1, most + 1)
    passed = (period <= number).astype(float)
    share = passed * period / number
    share.flags.writeable = passed.flags.writeable = False
    return share, passed


_kept_shares = lru_cache(maxsize=MOST_KEPT)(_shares_of_spans)


def first_hidden_period(previous_s: float, period_s: float, count: np.ndarray) -> np.ndarray:
    """Length (k,), s, of the first of `count` (k,) periods that lead from previous_s to period_s at
    uniform acceleration.
    """
    return 1.0 / np.sqrt(1.0 / previous_s**2 + (1.0 / period_s**2 - 1.0 / previous_s**2) / count)
