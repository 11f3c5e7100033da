"""Rows that a logger took and a line lost: the row after such a hole shows means over its own interval, not over the hole."""

from dataclasses import replace
from typing import Any

import numpy as np

from vgroove.gap.noise import column_sigma
from vgroove.rig import Rig

EVEN = 0.05  # of an interval, by which a step between rows may miss a whole number of intervals
RARE = 0.1  # share of the rows that may come after a hole: a clock that skips more often has no interval of its own
FAR = 4.0  # sigma that a row lies off both readings, where a step of the command lies in its hole


def after_holes(time_s: np.ndarray) -> np.ndarray:
    """Rows (k,) of an otherwise even clock before which one or several rows are missing."""
    steps = np.diff(time_s)
    usual = float(np.median(steps)) if len(steps) else 1.0
    count = np.round(steps / usual)
    even = np.abs(steps - count * usual).max(initial=0.0) < EVEN * usual
    after = np.flatnonzero(count > 1.0) + 1
    return after if even and len(after) <= RARE * len(time_s) else np.zeros(0, dtype=int)


def spans_hole(time_s: np.ndarray, values: np.ndarray, after: np.ndarray, sigma: float) -> bool:
    """Whether a column of means (n,) holds after a hole what lies nearer to the neighbours' line in the middle of the hole than in the
    middle of the last interval."""
    usual = float(np.median(np.diff(time_s)))
    after = after[(after > 1) & (after < len(time_s) - 1)]
    before, later = values[after - 1], values[after + 1]
    middle = time_s - 0.5 * usual
    own, whole = middle[after], 0.5 * (time_s[after - 1] + time_s[after])
    slope = (later - before) / (middle[after + 1] - middle[after - 1])
    miss = np.array([values[after] - before - slope * (at - middle[after - 1]) for at in (own, whole)]) / sigma
    told = np.abs(miss).min(axis=0) < FAR
    return bool(np.sum(miss[0, told] ** 2 - miss[1, told] ** 2) > 0.0)


def with_lost_rows(log: Any, rig: Rig) -> Any:
    """The log with an empty row where the last row of each hole is missing, unless its current shows means over the whole of the hole."""
    time_s, current = np.asarray(log.time_s, dtype=float), log.columns.get("current_a")
    after = after_holes(time_s)
    if not len(after):
        return log
    if current is not None and rig.input["kind"] != "current_a":
        current = np.asarray(current, dtype=float)
        if spans_hole(time_s, current, after, column_sigma(rig, "current_a", current)):
            return log
    lost_s = time_s[after] - float(np.median(np.diff(time_s)))
    columns = {name: np.insert(np.asarray(values, dtype=float), after, np.nan) for name, values in log.columns.items()}
    told = f"{log.source}: rows were lost in {len(after)} places: the row after each is read as means over its own interval"
    return replace(log, time_s=np.insert(time_s, after, lost_s), columns=columns, warnings=[*log.warnings, told])
