"""Rows that a logger took and a line lost: the row after such a hole shows means over its own
interval, not over the hole.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from vgroove.gap.cleaning.sensor_noise import column_sigma
from vgroove.rig import Rig

# of an interval, by which a step between rows may miss a whole number of intervals; share that do
# not
EVEN, MOSTLY = 0.05, 0.98
# share of the rows that may come after a hole: a clock that skips more often has no interval of its
# own
RARE = 0.1
FAR = 4.0  # sigma that a row lies off both readings, where a step of the command lies in its hole
SURE = 9.0  # squared sigmas by which the rows together must speak for lost ones


def rows_after_holes(time_s: np.ndarray) -> np.ndarray:
    """Rows (k,) of an otherwise even clock before which one or several rows are missing."""
    steps = np.diff(time_s)
    usual = float(np.median(steps)) if len(steps) else 1.0
    count = np.round(steps / usual)
    even = np.abs(steps - count * usual) < EVEN * usual
    after = np.flatnonzero(even & (count > 1.0)) + 1
    return (
        after
        if np.mean(even) > MOSTLY and len(after) <= RARE * len(time_s)
        else np.zeros(0, dtype=int)
    )


def evidence_for_lost_rows(
    time_s: np.ndarray, values: np.ndarray, after: np.ndarray, sigma: float
) -> float:
    """Squared sigmas by which a column of means (n,) lies, after each hole, nearer to its
    neighbours' curve in the middle of the last interval than to that in the middle of the hole.
    """
    middle = time_s - 0.5 * float(np.median(np.diff(time_s)))
    after = after[(after > 1) & (after < len(time_s) - 2)]
    beside = after[:, None] + np.array([-2, -1, 1, 2])
    whole = 0.5 * (time_s[after - 1] + time_s[after])
    miss = (
        np.array(
            [
                values[after] - cubic(middle[beside], values[beside], at)
                for at in (middle[after], whole)
            ]
        )
        / sigma
    )
    told = np.abs(miss).min(axis=0, initial=np.inf) < FAR
    return float(np.sum(miss[1, told] ** 2 - miss[0, told] ** 2))


def cubic(x: np.ndarray, y: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Value (k,) at `at` (k,) of the cubic through four points (k, 4) each: Lagrange's formula."""
    total = np.zeros(len(at))
    for j in range(x.shape[1]):
        others = [m for m in range(x.shape[1]) if m != j]
        total += y[:, j] * np.prod([(at - x[:, m]) / (x[:, j] - x[:, m]) for m in others], axis=0)
    return total


def insert_lost_rows(log: Any, rig: Rig) -> Any:
    """The log with an empty row where the last row of each hole is missing, if its current shows
    means over the last interval alone; else a row's interval is what the contract says: since the
    row before.
    """
    time_s, after = (
        np.asarray(log.time_s, dtype=float),
        rows_after_holes(np.asarray(log.time_s, dtype=float)),
    )
    if not len(after) or "current_a" not in log.columns or rig.input["kind"] == "current_a":
        return log
    current = np.asarray(log.columns["current_a"], dtype=float)
    if (
        not evidence_for_lost_rows(time_s, current, after, column_sigma(rig, "current_a", current))
        > SURE
    ):
        return log
    lost_s = time_s[after] - float(np.median(np.diff(time_s)))
    columns = {
        name: np.insert(np.asarray(values, dtype=float), after, np.nan)
        for name, values in log.columns.items()
    }
    told = f"{log.source}: rows were lost in {len(after)} places: the row after each is read as means over its own interval"
    return replace(
        log,
        time_s=np.insert(time_s, after, lost_s),
        columns=columns,
        warnings=[*log.warnings, told],
    )
