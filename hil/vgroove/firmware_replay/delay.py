"""Delay between the logged command and the motor's current, at the end and the begin of a drive.

At the end of a drive the current of the opened bridge falls to 0 within a row; what flows in later
rows is the delay times the current before. A current that decays instead of staying and then
falling is that of a slow sensor, not of a late bridge. At the begin the current follows the
commanded voltage from rest; the delay is that of the least sum of squares.
"""

from dataclasses import dataclass

import numpy as np

from vgroove.firmware_replay.rows import COMPARE_TOP
from vgroove.log import Log


@dataclass(frozen=True)
class DelayLimits:
    """Limits of the delay's estimate (chosen on the tuning half of the bench).

    late_ms: a longer delay is a late actuation. least_a: of the current at the end of a drive.
    """

    late_ms: float = 0.9
    least_a: float = 5.0


LIMITS = DelayLimits()
FALL_ROWS, BEFORE_ROWS, BEGIN_ROWS, REST_ROWS = 16, 3, 20, 100
FALL_LAG_MS = 0.2  # current of the winding after the bridge has opened
BEGIN_LAG_MS = 0.5  # winding and filter of the current
DELAYS_MS = np.arange(0.0, 14.0, 0.25)


def actuation_delay_ms(log: Log) -> float | None:
    """Delay in ms (negative: none within the resolution); None where no drive shows it."""
    opened = log["coast"] > 0.5 if "coast" in log else log["duty"] == 0.0
    current_a = np.nan_to_num(log["current_a"])
    falls = [_fall_ms(current_a, opened, k) for k in np.flatnonzero(np.diff(opened * 1) == 1) + 1]
    known = [fall for fall in falls if fall is not None]
    if known:
        return float(np.median(known)) - FALL_LAG_MS
    return _begin_ms(log, current_a, opened)


def _fall_ms(current_a: np.ndarray, opened: np.ndarray, row: int) -> float | None:
    before = np.mean(current_a[max(row - BEFORE_ROWS, 0) : row])
    after = current_a[row : row + FALL_ROWS]
    if abs(before) < LIMITS.least_a or not opened[row : row + FALL_ROWS].all():
        return None
    if len(after) < FALL_ROWS:
        return None
    length_ms = float(np.sum(after) / before)
    return FALL_LAG_MS if _decays(after / before, length_ms) else length_ms


def _decays(current: np.ndarray, length_ms: float) -> bool:
    """Whether a current (rows,) as a share of that before, whose sum is a length of time, is rather
    an exponential decay than a full current for that time; both are means over rows of 1 ms.
    """
    row = np.arange(len(current))
    stays = np.clip(length_ms - row, 0.0, 1.0)
    constant_ms = max(length_ms, FALL_LAG_MS)
    decays = constant_ms * (np.exp(-row / constant_ms) - np.exp(-(row + 1) / constant_ms))
    return bool(np.sum((current - decays) ** 2) < np.sum((current - stays) ** 2))


def _begin_ms(log: Log, current_a: np.ndarray, opened: np.ndarray) -> float | None:
    driven = np.flatnonzero(~opened & (log["duty"] != 0.0))
    if not len(driven) or driven[0] < BEFORE_ROWS:
        return None
    first = int(driven[0])
    rows = np.arange(first - BEFORE_ROWS, min(first + BEGIN_ROWS, len(current_a)))
    rest_a = np.mean(current_a[max(first - REST_ROWS, 0) : first])
    along_a = (current_a[rows] - rest_a) * np.sign(log["duty"][first])
    duty = np.maximum(np.abs(log["duty"]) - 1.0 / COMPARE_TOP, 0.0)  # without the dead time
    applied_v = np.where(opened, 0.0, duty * log["supply_v"])
    errors = [_misfit(along_a, applied_v, rows, rows - first - d, d) for d in DELAYS_MS]
    return float(DELAYS_MS[int(np.argmin(errors))]) - BEGIN_LAG_MS


def _misfit(
    along_a: np.ndarray, applied_v: np.ndarray, rows: np.ndarray, since: np.ndarray, delay: float
) -> float:
    """Sum of squares of a current with a part along the delayed voltage, and a back-EMF that grows
    with the square of the time.
    """
    delayed_v = np.interp(rows - delay, np.arange(len(applied_v)), applied_v)
    parts = np.stack([delayed_v, np.maximum(since, 0.0) ** 2], axis=1)
    gains = np.linalg.lstsq(parts, along_a, rcond=None)[0]
    return float(np.sum((along_a - parts @ gains) ** 2))
