"""Recovers the times at which a log's rows ended: time stamps that scatter around an even grid,
because they were taken late or rounded, are replaced by that grid.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from vgroove.log import Log


@dataclass(frozen=True)
class ClockLimits:
    """Limits of the choice between time stamps and even grid; lengths in intervals between rows.
    Those without a derivation were chosen on the tuning half of the blind set.
    """

    usual_step: float = 1.5  # steps below this many median steps hold no missing row
    max_distance: float = 0.5  # of a stamp from its grid point: beyond it belongs to another one
    same_distance: float = 1e-3  # below, stamps and grid are equal and the stamps are kept
    late_distance: float = 0.1  # largest distance of stamps that a host takes late
    loop_gain: float = 0.1  # share of a stamp's deviation by which the loop's clock is corrected
    line_fits: int = 3  # fits of a line to the numbered rows, each of which refines the interval
    # contradictions of edges and stamps: reversals alone cause at most so many
    usual_contradictions: int = 5
    fewer_contradictions: float = 4.0  # factor by which the grid must reduce them
    # smallest rounding that is recognised, in intervals
    finest_rounding: float = 0.02
    decimals: tuple[int, ...] = (1, 2, 3, 4, 5, 6)  # of stamps in s that may be rounded
    digit_mismatch: float = 1e-4  # of the last digit: largest error of a rounded stamp (arithmetic)
    rounding_error: float = 0.6  # of the last digit: distance to the grid from rounding alone


LIMITS = ClockLimits()


def even_grid(time_s: np.ndarray) -> np.ndarray | None:
    """The even grid (n,), s, that all stamps (n,) lie within half an interval of; rows may be
    missing from it. None where there is none.
    """
    steps = np.diff(time_s)
    # the mean, because the median of rounded stamps is off by up to a digit
    interval = float(steps[steps < LIMITS.usual_step * np.median(steps)].mean())
    place = row_numbers(time_s, interval)
    for _ in range(LIMITS.line_fits):
        slope, start = np.polyfit(place, time_s, 1)
        place = np.round((time_s - start) / slope)
        if np.any(np.diff(place) < 1.0):
            return None
    grid = start + slope * place
    return grid if np.abs(time_s - grid).max() < LIMITS.max_distance * slope else None


def row_numbers(time_s: np.ndarray, interval_s: float) -> np.ndarray:
    """Number (n,) of each row on an even clock of about this interval, s.

    A first-order phase-locked loop: the clock is corrected towards each stamp by loop_gain, so that
    neither the scatter of the stamps nor an error of the interval accumulates.
    """
    place, now = np.zeros(len(time_s)), float(time_s[0])
    for n in range(1, len(time_s)):
        passed = max(1.0, round((float(time_s[n]) - now) / interval_s))
        place[n] = place[n - 1] + passed
        now += passed * interval_s
        now += LIMITS.loop_gain * (float(time_s[n]) - now)
    return place


def is_rounding(time_s: np.ndarray, grid: np.ndarray) -> bool:
    """Whether the stamps (n,) differ from the grid (n,) only by rounding to a decimal digit."""
    interval = float(np.median(np.diff(grid)))
    spacing = 4.0 * np.spacing(np.abs(time_s).max())  # of seconds since 1970: 1e-6
    for digit in 10.0 ** -np.array(LIMITS.decimals, dtype=float):
        error = np.abs(np.round(time_s / digit) * digit - time_s)
        if np.all(error < LIMITS.digit_mismatch * digit + spacing):
            return bool(
                digit > LIMITS.finest_rounding * interval
                and np.abs(time_s - grid).max() < LIMITS.rounding_error * digit
            )
    return False


def row_times(
    time_s: np.ndarray, contradictions: Callable[[np.ndarray], int] | None = None
) -> np.ndarray:
    """Times (n,), s, at which the rows ended: the stamps (n,), or the even grid behind them.

    The stamps alone do not show whether the rows are uneven or only the stamps scatter. The Hall
    edges show it: the sensor's own timer measures the edge periods, and these follow one another
    without contradictions only at the true row times. `contradictions` counts them for given times.

    Without edges (None) a scatter below late_distance is taken as late stamps of a host, because
    the clock that starts the samples is steadier. With edges, a scatter that small is kept only if
    the grid has more contradictions than the stamps.
    """
    grid = even_grid(time_s) if len(time_s) > 2 else None
    if grid is None:
        return time_s
    interval, distance = np.median(np.diff(grid)), np.abs(time_s - grid).max()
    if distance < LIMITS.same_distance * interval:
        return time_s
    if is_rounding(time_s, grid):
        return grid
    late = bool(distance < LIMITS.late_distance * interval)
    if contradictions is None:
        return grid if late else time_s
    stamped, even = contradictions(time_s), contradictions(grid)
    clear = (
        stamped >= even
        if late
        else stamped > LIMITS.usual_contradictions and stamped > LIMITS.fewer_contradictions * even
    )
    return grid if clear else time_s


def correct_time_stamps(log: Log, contradictions: Callable[[np.ndarray], int] | None = None) -> Log:
    """The log with the times at which its rows ended, and a warning where these are not its time
    stamps; `contradictions` as in row_times.
    """
    time_s = np.asarray(log.time_s, dtype=float)
    real = row_times(time_s, contradictions)
    if real is time_s:
        return log
    off_ms = 1e3 * float(np.abs(time_s - real).max())
    warning = (
        f"{log.source}: the time stamps scatter by up to {off_ms:.2g} ms around an even clock: "
        "the times of that clock are used"
    )
    return replace(log, time_s=real, warnings=[*log.warnings, warning])
