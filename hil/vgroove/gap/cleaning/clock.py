"""When a log's rows really closed: stamps that are taken late or rounded are put back on the even
grid that they scatter around.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

NEAR = 0.5  # of an interval: a stamp further from its place on the grid belongs to no even clock
EXACT = 1e-3  # of an interval: stamps this close to the grid are left as they are
FEWEST_BREAKS = 5  # contradictions between edges and stamps that may come from reversals alone
CLEARLY = 4.0  # times fewer contradictions on the grid
LATE = 0.1  # of an interval: stamps scatter by no more that are written late
PULL = 0.1  # share of a stamp's distance by which the clock that counts rows follows it
FINEST_ROUNDING = 0.02  # of an interval: a last digit below that does not show in a row


def even_grid(time_s: np.ndarray) -> np.ndarray | None:
    """The even grid (n,), rows missing from it allowed, that all stamps lie within half an interval
    of; None where there is none.
    """
    steps = np.diff(time_s)
    # of rounded stamps the median is a digit off
    interval = float(steps[steps < 1.5 * np.median(steps)].mean())
    place = row_numbers(time_s, interval)
    for _ in range(3):  # a long log needs the interval to a small part of its row number
        slope, start = np.polyfit(place, time_s, 1)
        place = np.round((time_s - start) / slope)
        if np.any(np.diff(place) < 1.0):
            return None
    grid = start + slope * place
    return grid if np.abs(time_s - grid).max() < NEAR * slope else None


def row_numbers(time_s: np.ndarray, interval: float) -> np.ndarray:
    """Number (n,) of each row on a clock of about this interval that is pulled after the stamps, so
    that their scatter does not add up.
    """
    place, now = np.zeros(len(time_s)), float(time_s[0])
    for n in range(1, len(time_s)):
        passed = max(1.0, round((float(time_s[n]) - now) / interval))
        place[n] = place[n - 1] + passed
        now += passed * interval
        now += PULL * (float(time_s[n]) - now)
    return place


def is_rounding(time_s: np.ndarray, grid: np.ndarray) -> bool:
    """Whether the distance to the grid is just the last decimal digit of the stamps."""
    interval = float(np.median(np.diff(grid)))
    for digit in 10.0 ** -np.arange(1.0, 7.0):
        if np.all(np.abs(np.round(time_s / digit) * digit - time_s) < 1e-4 * digit):
            return bool(
                digit > FINEST_ROUNDING * interval and np.abs(time_s - grid).max() < 0.6 * digit
            )
    return False


def row_times(
    time_s: np.ndarray, contradictions: Callable[[np.ndarray], int] | None = None
) -> np.ndarray:
    """Times (n,) at which the rows closed: the stamps, or the even grid behind them.

    Uneven rows and scattered stamps look alike in the stamps. The Hall edges separate them: the
    sensor's own timer measures the edge periods, and they follow one another without gaps only on
    the right times. `contradictions` counts the breaks for given row times; None without edges (or
    with a sensor that counts them). Then a scatter below LATE is taken for stamps that a host wrote
    late, because a clock that starts the samples is steadier. Where the scatter is that small,
    edges reject the grid only if it has more breaks than the stamps.
    """
    grid = even_grid(time_s) if len(time_s) > 2 else None
    if grid is None or np.abs(time_s - grid).max() < EXACT * np.median(np.diff(grid)):
        return time_s
    if is_rounding(time_s, grid):
        return grid
    late = bool(np.abs(time_s - grid).max() < LATE * np.median(np.diff(grid)))
    if contradictions is None:
        return grid if late else time_s
    stamped, even = contradictions(time_s), contradictions(grid)
    clear = stamped >= even if late else stamped > FEWEST_BREAKS and stamped > CLEARLY * even
    return grid if clear else time_s


def correct_time_stamps(log: Any, contradictions: Callable[[np.ndarray], int] | None = None) -> Any:
    """The log with the times at which its rows closed, and a warning where these are not its time
    stamps; `contradictions` as in row_times.
    """
    time_s = np.asarray(log.time_s, dtype=float)
    real = row_times(time_s, contradictions)
    if real is time_s:
        return log
    source, off = str(getattr(log, "source", "log")), float(np.abs(time_s - real).max())
    warning = (
        f"{source}: the time stamps scatter by up to {1e3 * off:.2g} ms around an even clock: "
        "the rows are read on that clock"
    )
    moved = [*getattr(log, "warnings", []), warning]
    return replace(log, time_s=real, warnings=moved)
