"""The unit of a log's times where the rig does not state log_hz: milliseconds, microseconds or
nanoseconds that are read as seconds make every transient of the simulation too short; minutes,
hours or days make it too long.
"""

from dataclasses import dataclass

import numpy as np

from vgroove.gap.log_check.finding import Finding
from vgroove.gap.log_check.nominal import mean_error, nominal_pairs
from vgroove.gap.log_check.plausible import LEAST_INTERVAL_S
from vgroove.log import Log
from vgroove.rig import Rig
from vgroove.units import TIME_UNITS


@dataclass(frozen=True)
class TimeRules:
    """When the times of a log are in another unit. Checked as FactorRules are."""

    better: float = 0.3  # share of the simulation's error that may be left with the other unit
    # the same for a log whose rows are farther apart than slow_rows time constants of the motor:
    # such a log would show no transient at all
    better_if_slow: float = 0.9
    slow_rows: float = 3.0
    least_error: float = 0.02  # relative error of the simulation that a wrong unit makes at least
    # the same for a longer unit: the slower simulation also mends the transients of an altered
    # tool, whose error is 0.26 at most on the measured logs; half of those in minutes exceed 0.4
    least_error_longer: float = 0.4
    # error that the other unit may leave: a signal that is not explained at all has 1
    max_error: float = 0.5
    max_interval_s: float = 1.0  # of the rows in a longer unit: bounds the work of a simulation


RULES = TimeRules()


def best_time_factor(log: Log, rig: Rig) -> float:
    """Seconds in a unit of the log's times: 1, or that of another unit that explains its signals
    much better.
    """
    interval = float(np.median(np.diff(np.asarray(log.time_s, float))))
    own, slow_s = time_errors(log, rig, 1.0), RULES.slow_rows * rig.speed_time_constant_s
    limit = RULES.better_if_slow if interval > slow_s else RULES.better
    best, least = 1.0, min(limit * own, RULES.max_error)
    for size in TIME_UNITS if own >= RULES.least_error else ():
        # rows that are farther apart with the other unit would show no transient
        longest = np.inf if size > 1.0 else min(slow_s, RULES.max_interval_s)
        clear = size > 1.0 or own >= RULES.least_error_longer
        if not clear or not LEAST_INTERVAL_S <= interval / size <= longest:
            continue
        if (error := time_errors(log, rig, 1.0 / size)) < least:
            best, least = 1.0 / size, error
    return best


def time_errors(log: Log, rig: Rig, factor: float) -> float:
    """Mean relative error of the nominal signals, each times its best factor, where the times times
    `factor` are seconds.
    """
    return mean_error(nominal_pairs(log, rig, factor), scaled=True)


def time_finding(log: Log, rig: Rig, factor: float) -> Finding:
    """The refusal of a log whose times are in the unit with this factor."""
    unit = min(TIME_UNITS.items(), key=lambda item: abs(np.log(item[0] * factor)))[1]
    before, after = time_errors(log, rig, 1.0), time_errors(log, rig, factor)
    text = (
        f"column time_s: read as {unit} the simulation's relative error falls from {before:.2g} to "
        f'{after:.2g}: are the times in {unit}? Read them with --map "time_s:{unit}=time_s"'
    )
    return Finding(text, refuses=True)
