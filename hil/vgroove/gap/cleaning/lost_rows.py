"""Marks rows that were sampled but lost on the line to the logger: the row after such a hole holds
means over its own interval, not over the hole.
"""

from dataclasses import dataclass, replace

import numpy as np

from vgroove.gap.cleaning.long_logs import is_thinned, without_thinned
from vgroove.gap.cleaning.sensor_noise import column_sigma
from vgroove.log import Log
from vgroove.rig import Rig


@dataclass(frozen=True)
class LostRowLimits:
    """Limits of the search for lost rows, chosen on the tuning half of the blind set."""

    # of an interval, by which a step between rows may miss a whole number of intervals
    even_error: float = 0.05
    even_share: float = 0.98  # of the steps, that must be whole numbers of intervals
    # share of the rows that may follow a hole: a clock that skips more often has no fixed interval
    max_hole_share: float = 0.1
    # sigma: a row further from both predictions is left out (the command stepped in its hole)
    max_distance_sigma: float = 4.0
    min_evidence: float = 9.0  # evidence_for_lost_rows above which rows are taken as lost: 3 sigma


LIMITS = LostRowLimits()


def rows_after_holes(time_s: np.ndarray) -> np.ndarray:
    """Rows (k,) before which one or several rows are missing from an otherwise even clock; time_s
    (n,), s.
    """
    steps = np.diff(time_s)
    usual = float(np.median(steps)) if len(steps) else 1.0
    count = np.round(steps / usual)
    even = np.abs(steps - count * usual) < LIMITS.even_error * usual
    after = np.flatnonzero(even & (count > 1.0)) + 1
    is_clock = np.mean(even) > LIMITS.even_share
    if is_clock and len(after) <= LIMITS.max_hole_share * len(time_s):
        return after
    return np.zeros(0, dtype=int)


def evidence_for_lost_rows(
    time_s: np.ndarray, values: np.ndarray, after: np.ndarray, sigma: float
) -> float:
    """Twice the log-likelihood ratio of lost rows against a logger that took no rows in the holes,
    from a column of means (n,) with noise sigma in the rows `after` (k,) holes.

    A cubic through the four neighbouring means predicts the value: in the middle of the last
    interval if rows were lost, in the middle of the hole if the row is the mean over the hole.
    """
    middle = time_s - 0.5 * float(np.median(np.diff(time_s)))
    after = after[(after > 1) & (after < len(time_s) - 2)]
    beside = after[:, None] + np.array([-2, -1, 1, 2])
    middle_of_hole = 0.5 * (time_s[after - 1] + time_s[after])
    predicted = [
        lagrange_cubic(middle[beside], values[beside], at) for at in (middle[after], middle_of_hole)
    ]
    miss = np.array([values[after] - value for value in predicted]) / sigma
    used = np.abs(miss).min(axis=0, initial=np.inf) < LIMITS.max_distance_sigma
    return float(np.sum(miss[1, used] ** 2 - miss[0, used] ** 2))


def lagrange_cubic(x: np.ndarray, y: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Value (k,) at `at` (k,) of the cubic through four points (k, 4) each (Lagrange's formula)."""
    total = np.zeros(len(at))
    for j in range(x.shape[1]):
        others = [m for m in range(x.shape[1]) if m != j]
        total += y[:, j] * np.prod([(at - x[:, m]) / (x[:, j] - x[:, m]) for m in others], axis=0)
    return total


def insert_lost_rows(log: Log, rig: Rig) -> Log:
    """The log with an empty row in place of the last missing row of each hole, if its current holds
    means over the last interval alone; else the log itself, whose rows are means since the row
    before (docs/spec/gap.md, section 1).
    """
    time_s = np.asarray(log.time_s, dtype=float)
    after = rows_after_holes(without_thinned(time_s, is_thinned(log.columns, len(time_s))))
    if not len(after) or "current_a" not in log.columns or rig.input["kind"] == "current_a":
        return log
    current = np.asarray(log.columns["current_a"], dtype=float)
    sigma = column_sigma(rig, "current_a", current)
    if not evidence_for_lost_rows(time_s, current, after, sigma) > LIMITS.min_evidence:
        return log
    lost_s = time_s[after] - float(np.median(np.diff(time_s)))
    columns = {
        name: np.insert(np.asarray(values, dtype=float), after, np.nan)
        for name, values in log.columns.items()
    }
    warning = (
        f"{log.source}: rows were lost in {len(after)} places: "
        "the row after each is read as means over its own interval"
    )
    return replace(
        log,
        time_s=np.insert(time_s, after, lost_s),
        columns=columns,
        warnings=[*log.warnings, warning],
    )
