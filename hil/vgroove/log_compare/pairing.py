"""Rows of two logs that are compared with each other: those of equal time, or log B interpolated at
the times of log A.
"""

from dataclasses import dataclass

import numpy as np

from vgroove.errors import VgrooveError
from vgroove.log.table import Log
from vgroove.log_compare.limits import DISCRETE, Limits

# Median intervals of a column between two samples up to which a straight line joins them: the lost
# frames of a damaged line are fewer.
MAX_HOLE = 20.0


@dataclass(frozen=True)
class Pairs:
    """Paired rows: times (n,) in s and the columns (n,) of both logs; `interpolated`: log B was
    sampled at other instants; `only_a`, `only_b`: rows within the common range without a partner;
    `compared`: rows of the log that has fewer rows in the comparison.
    """

    time_s: np.ndarray
    a: dict[str, np.ndarray]
    b: dict[str, np.ndarray]
    interpolated: bool
    only_a: int
    only_b: int
    compared: int


def values_at(log: Log, name: str, time_s: np.ndarray) -> np.ndarray:
    """A column at other times (n,): straight lines between samples, for discrete quantities the
    last sample; NaN before the first and after the last sample, and within a hole: MAX_HOLE
    intervals without a sample.
    """
    discrete = name in DISCRETE
    known = np.full(len(log), True) if discrete else np.isfinite(log[name])
    if not known.any():
        return np.full(len(time_s), np.nan)
    known_s, values = log.time_s[known], log[name][known]
    last = np.searchsorted(known_s, time_s, side="right") - 1
    found = values[np.maximum(last, 0)] if discrete else np.interp(time_s, known_s, values)
    inside = (time_s >= known_s[0]) & (time_s <= known_s[-1])
    return np.where(inside & ~_in_hole(known_s, time_s, last), found, np.nan)


def _in_hole(known_s: np.ndarray, time_s: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Whether each time (n,) lies in a hole: between two successive samples, at known_s (m,), that
    are more than MAX_HOLE median intervals apart. last (n,): index of the last sample at or before
    each time.
    """
    steps_s = np.diff(known_s)
    if not len(steps_s):
        return np.zeros(len(time_s), bool)
    before = np.clip(last, 0, len(steps_s) - 1)
    wide = steps_s[before] > MAX_HOLE * np.median(steps_s)
    return wide & (time_s > known_s[before]) & (time_s < known_s[before + 1])


def pair_rows(a: Log, b: Log, limits: Limits) -> Pairs:
    """The paired rows of two logs; VgrooveError where they have no common time or column."""
    names = [name for name in a.columns if name in b.columns]
    if not names:
        raise VgrooveError(
            f"{a.source} and {b.source} have no column in common: name columns with --map"
        )
    low, high = max(a.time_s[0], b.time_s[0]), min(a.time_s[-1], b.time_s[-1])
    slack = limits.same_time_s
    in_a = np.flatnonzero((a.time_s >= low - slack) & (a.time_s <= high + slack))
    in_b = np.flatnonzero((b.time_s >= low - slack) & (b.time_s <= high + slack))
    if not len(in_a) or not len(in_b):
        raise VgrooveError(
            f"{a.source} ({a.time_s[0]:g} to {a.time_s[-1]:g} s) and {b.source} "
            f"({b.time_s[0]:g} to {b.time_s[-1]:g} s) have no common time: let both begin at the "
            "same instant"
        )
    rows_a, rows_b = _same_times(a.time_s, b.time_s, in_a, slack)
    if len(rows_a) >= limits.paired_share * min(len(in_a), len(in_b)):
        return Pairs(
            a.time_s[rows_a],
            {name: a[name][rows_a] for name in names},
            {name: b[name][rows_b] for name in names},
            False,
            len(in_a) - len(rows_a),
            len(in_b) - len(rows_b),
            len(rows_a),
        )
    time_s = a.time_s[in_a]
    border = -(-len(in_a) // len(in_b)) if len(in_b) > 1 else 1  # rows of A in an interval of B
    columns = {
        name: _without_borders(a[name][in_a], values_at(b, name, time_s), border) for name in names
    }
    columns_a, columns_b = ({name: pair[k] for name, pair in columns.items()} for k in (0, 1))
    return Pairs(time_s, columns_a, columns_b, True, 0, 0, min(len(in_a), len(in_b)))


def _without_borders(a: np.ndarray, b: np.ndarray, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Two columns (n,) in which a value of one log only is missing in both where it stands in a run
    of at most `rows`: sampling instants make such runs, where missing values begin or end.
    """
    alone = np.isfinite(a) != np.isfinite(b)
    turns = np.flatnonzero(np.diff(alone, prepend=False, append=False))
    short = np.zeros(len(a), bool)
    for first, end in zip(turns[::2], turns[1::2], strict=True):
        short[first:end] = end - first <= rows
    return np.where(short, np.nan, a), np.where(short, np.nan, b)


def _same_times(
    time_a: np.ndarray, time_b: np.ndarray, rows: np.ndarray, slack_s: float
) -> tuple[np.ndarray, np.ndarray]:
    """Of the rows of A those with a row of B at the same time, and these rows of B."""
    after = np.clip(np.searchsorted(time_b, time_a[rows]), 1, max(1, len(time_b) - 1))
    after = np.minimum(after, len(time_b) - 1)
    before = np.maximum(after - 1, 0)
    nearer = np.abs(time_b[before] - time_a[rows]) <= np.abs(time_b[after] - time_a[rows])
    nearest = np.where(nearer, before, after)
    same = np.abs(time_b[nearest] - time_a[rows]) <= slack_s
    return rows[same], nearest[same]
