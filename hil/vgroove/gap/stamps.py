"""When a log's rows really closed: stamps that are taken late or rounded are put back on the even
grid that they scatter around.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from vgroove.gap.edges import COUNTING_PULSES, count_chains
from vgroove.rig import Rig

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
    place = tracked(time_s, interval)
    for _ in range(3):  # a long log needs the interval to a small part of its row number
        slope, start = np.polyfit(place, time_s, 1)
        place = np.round((time_s - start) / slope)
        if np.any(np.diff(place) < 1.0):
            return None
    grid = start + slope * place
    return grid if np.abs(time_s - grid).max() < NEAR * slope else None


def tracked(time_s: np.ndarray, interval: float) -> np.ndarray:
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


def breaks(time_s: np.ndarray, speed_rpm: np.ndarray, rig: Rig) -> int:
    """Chains of Hall edges that the rows of a speed column fall into: more where the stamps
    contradict the edge periods.
    """
    return count_chains(
        time_s, speed_rpm, rig.sensors["hall_pulses_per_rev"], rig.sensors.get("speed_lsb_rpm", 0.0)
    )


def is_rounding(time_s: np.ndarray, grid: np.ndarray) -> bool:
    """Whether the distance to the grid is just the last decimal digit of the stamps."""
    interval = float(np.median(np.diff(grid)))
    for digit in 10.0 ** -np.arange(1.0, 7.0):
        if np.all(np.abs(np.round(time_s / digit) * digit - time_s) < 1e-4 * digit):
            return bool(
                digit > FINEST_ROUNDING * interval and np.abs(time_s - grid).max() < 0.6 * digit
            )
    return False


def row_times(time_s: np.ndarray, columns: dict[str, np.ndarray], rig: Rig) -> np.ndarray:
    """Times (n,) at which the rows closed: the stamps, or the grid behind them.

    Rows that are really uneven and stamps that scatter look alike in the stamps; the Hall edges
    tell them apart, since their periods are measured by the sensor's own timer and chain up to the
    right rows only on the right time base. Where no edges tell (none, or a sensor that counts them)
    a small scatter is taken for stamps that are written late, as by a host: a clock that starts the
    samples is steadier. Edges that tell little (a short log, few pulses a turn) have to speak
    against that.
    """
    grid = even_grid(time_s) if len(time_s) > 2 else None
    if grid is None or np.abs(time_s - grid).max() < EXACT * np.median(np.diff(grid)):
        return time_s
    if is_rounding(time_s, grid):
        return grid
    late = bool(np.abs(time_s - grid).max() < LATE * np.median(np.diff(grid)))
    if (
        not 0 < rig.sensors.get("hall_pulses_per_rev", 0) < COUNTING_PULSES
        or "speed_rpm" not in columns
    ):
        return grid if late else time_s
    stamped, even = (breaks(t, columns["speed_rpm"], rig) for t in (time_s, grid))
    clear = stamped >= even if late else stamped > FEWEST_BREAKS and stamped > CLEARLY * even
    return grid if clear else time_s


def on_its_clock(log: Any, rig: Rig) -> Any:
    """The log with the times at which its rows closed, and a warning where they are not its stamps."""
    time_s = np.asarray(log.time_s, dtype=float)
    columns = {name: np.asarray(values, dtype=float) for name, values in log.columns.items()}
    real = row_times(time_s, columns, rig)
    if real is time_s:
        return log
    source, off = str(getattr(log, "source", "log")), float(np.abs(time_s - real).max())
    warning = f"{source}: the time stamps scatter by up to {1e3 * off:.2g} ms around an even clock: the rows are read on that clock"
    moved = [*getattr(log, "warnings", []), warning]
    return replace(log, time_s=real, warnings=moved)
