"""A position that jumps by its whole range: an angle within one turn, or a counter that was set."""

from dataclasses import dataclass

import numpy as np

from vgroove.gap.log_check.finding import Finding
from vgroove.log import Log


@dataclass(frozen=True)
class WrapRules:
    """When a position is an angle within one turn (values chosen; no log of tests/data
    comes near).
    """

    jump: float = 0.6  # of its range, between two rows
    calm: float = 0.2  # of its range, that the rows before and after a jump may change by
    min_jumps: int = 3  # for a warning; one that opposes the motion is enough to refuse the log
    motion_share: float = 0.05  # of the rows, before and after a jump, within which a motion shows
    motion_rows: tuple[int, int] = (5, 1000)  # limits of this number of rows
    least_motion: float = 0.02  # of its range; a smaller change may be noise of a shaft at rest
    max_gap: float = 3.0  # median intervals of a jump; a longer one may hide a motion
    min_range_rad: float = 3.0  # a smaller range is one of a shaft at rest
    min_rows: int = 20


WRAP = WrapRules()


def wrapped_finding(log: Log) -> list[Finding]:
    """A finding on a position that jumps back by its whole range: an angle within one turn."""
    if "position_rad" not in log.columns:
        return []
    values = np.asarray(log.columns["position_rad"], float)
    known = np.isfinite(values)
    values, time_s = values[known], np.asarray(log.time_s, float)[known]
    if len(values) < WRAP.min_rows or np.ptp(values) < WRAP.min_range_rad:
        return []
    reach = float(np.ptp(values))
    jumps = _calm_jumps(values, reach)
    count, opposed = np.count_nonzero(jumps), _opposes_motion(jumps, values, time_s)
    if count < WRAP.min_jumps and not opposed:
        return []
    times = "once" if count == 1 else f"{count} times"
    text = (
        f"column position_rad: jumps {times} by about its whole range of {reach:.4g}: it "
        f"{'is' if opposed else 'may be'} an angle within one turn (add up the turns with "
        "numpy.unwrap, whose period is one turn in the unit of the column, or leave the column "
        "out), or the counter was set to another value (homing): cut the log there"
    )
    return [Finding(text, refuses=opposed, warns=not opposed)]


def _calm_jumps(values: np.ndarray, reach: float) -> np.ndarray:
    """Whether each step (rows - 1,) is a jump by the range, between small steps."""
    steps = np.abs(np.diff(values)) / reach
    beside = np.maximum(np.append(steps[1:], np.inf), np.append(np.inf, steps[:-1]))
    return (steps > WRAP.jump) & (beside < WRAP.calm)


def _opposes_motion(jumps: np.ndarray, values: np.ndarray, time_s: np.ndarray) -> bool:
    """Whether the position turns one way before and after a jump, and jumps the other way. jumps
    (rows - 1,): the steps between rows that are jumps; those over a gap of the log do not count.
    """
    intervals = np.diff(time_s)
    jumps = jumps & (intervals <= WRAP.max_gap * np.median(intervals))
    rows = int(np.clip(WRAP.motion_share * len(values), *WRAP.motion_rows))
    least = WRAP.least_motion * np.ptp(values)
    for row in np.flatnonzero(jumps):
        before = -_motion(values[max(row - rows, 0) : row + 1][::-1], least)
        after = _motion(values[row + 1 : row + 2 + rows], least)
        step = values[row + 1] - values[row]
        if before * step < 0.0 and after * step < 0.0:
            return True
    return False


def _motion(values: np.ndarray, least: float) -> float:
    """The first change from the first of the values that exceeds `least`; 0 without one."""
    changes = values - values[0]
    return float(changes[np.argmax(np.abs(changes) > least)])
