"""Clocks that begin again: counters of 16 or 32 bits, with or without sign, and times of day, of
which a log is read with the periods added up; and what else makes times go back.
"""

import numpy as np

DAY_S, HALF_DAY_S, HOUR_S = 86_400.0, 43_200.0, 3_600.0
COUNTER_BITS = (16, 32)
# periods of counters of 32 bits that a logger writes in s, as micros() and millis() of Arduino
COUNTERS_S = {"2^32 us": 2.0**32 * 1e-6, "2^32 ms": 2.0**32 * 1e-3}
ROUNDING_S = 1e-6  # of stamps since 1970
PARTS_S = {"second": 1.0, "minute": 60.0, "hour": 3600.0}
# median intervals that a row may follow the one before the clock's restart; if that is longer, the
# longest pause between two other rows and one interval, since stamps are rounded
MAX_INTERVALS = 3.0
MIN_ROUNDED_SHARE = 0.05  # of equal successive times, which then are rounded and not rows twice
# where milliseconds without leading zeros go back within a second: from .5 ... .9 to .10 ... .19
LATE, EARLY = (0.5, 1.0), (0.1, 0.2)


def unwrapped(time_s: np.ndarray, tick_s: float) -> tuple[np.ndarray, str]:
    """Times (n,) in s, with a period added after each restart of a clock that lets the rows go on
    within their intervals, and a sentence on it; the times as they are without such a clock.
    tick_s: unit of the numbers of the file.
    """
    back = np.diff(time_s) < 0.0
    if not back.any() or not np.isfinite(time_s).all():
        return time_s, ""
    periods = {"a day": DAY_S}
    periods |= {f"2^{bits} ticks": 2.0**bits * tick_s for bits in COUNTER_BITS} | COUNTERS_S
    for name, period_s in periods.items():
        signed_s = 0.5 * period_s if time_s.min() < 0.0 and period_s != DAY_S else 0.0
        if _restarts(time_s + signed_s, period_s):
            added = np.concatenate([[0.0], np.cumsum(np.where(back, period_s, 0.0))])
            times = f"{np.count_nonzero(back)} times" if np.count_nonzero(back) > 1 else "once"
            return (
                time_s + added,
                f"the clock begins again {times}, after {name}: the period is added.",
            )
    return time_s, ""


def in_order(time_s: np.ndarray, tick_s: float, warnings: list[str], source: str) -> np.ndarray:
    """Times (n,) in s with the periods of a clock that begins again added; a warning says so."""
    added, said = unwrapped(time_s, tick_s)
    if said:
        warnings.append(f"{source}: column time_s: {said}")
    return added


def _restarts(time_s: np.ndarray, period_s: float) -> bool:
    """Whether times (n,) in s step back, as those of a clock with this period, s, and no others."""
    steps = np.diff(time_s)
    forward = steps[steps > 0.0]
    if (
        not len(forward)
        or not (steps < 0.0).any()
        or time_s.min() < 0.0
        or time_s.max() >= period_s
    ):
        return False
    onward = steps[steps < 0.0] + period_s
    rounding_s, usual_s = 4.0 * np.finfo(float).eps * period_s, float(np.median(forward))
    longest_s = max(MAX_INTERVALS * usual_s, forward.max() + usual_s) + rounding_s
    return bool((onward > 0.0).all() and (onward <= longest_s).all())


def time_mend(time_s: np.ndarray) -> str:
    """What to do with times (n,) in s that do not increase."""
    steps = np.diff(time_s)
    if np.mean(steps == 0.0) > MIN_ROUNDED_SHARE:
        return (
            "many rows have the time of the row before: write it with more digits, or the rows of "
            "each device as a log of its own"
        )
    back = int(np.count_nonzero(steps < 0.0))
    if not back:
        return "delete the rows that are there twice"
    if back > 0.5 * len(steps):
        return "it goes back in most rows: sort the rows by time"
    if _is_of_half_days(time_s):
        return "is it a clock of 12 hours? Write the hours as 0 to 23"
    for name, period_s in PARTS_S.items():
        if _restarts(time_s, period_s):
            return f"it is the part of a {name} alone: add the column that counts the {name}s"
    if _lacks_zeros(time_s):
        return (
            "are the digits behind the point milliseconds without leading zeros, .9 before .10? "
            "Write them with three digits"
        )
    often = "once" if back == 1 else f"{back} times"
    return f"it goes back {often}: give each recording as a log of its own, in the order of time"


def _is_of_half_days(time_s: np.ndarray) -> bool:
    """Whether times (n,) in s that step back are those of a 12-hour clock, on which 1:00 follows
    12:59.
    """
    if time_s.min() < 0.0 or time_s.max() >= HALF_DAY_S + HOUR_S:
        return False
    within = time_s % HALF_DAY_S
    return not (np.diff(within) < 0.0).any() or _restarts(within, HALF_DAY_S)


def _lacks_zeros(time_s: np.ndarray) -> bool:
    """Whether most steps back of the times (n,) are those of milliseconds without zeros."""
    at = np.flatnonzero(np.diff(time_s) < 0.0)
    second = np.floor(time_s[at + 1] + ROUNDING_S)
    before, after = time_s[at] - second + ROUNDING_S, time_s[at + 1] - second + ROUNDING_S
    late = (before >= LATE[0]) & (before < LATE[1])
    early = (after >= EARLY[0]) & (after < EARLY[1])
    return len(at) > 1 and bool(np.mean(late & early) > 0.5)
