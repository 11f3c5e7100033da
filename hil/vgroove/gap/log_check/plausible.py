"""Checks that need no simulation: values that no tool reaches, columns without a value, and a row
interval that the rig's log_hz contradicts.
"""

import numpy as np

from vgroove.gap.log_check.finding import Finding
from vgroove.log import MEASURED, Log
from vgroove.rig import Rig

# Largest magnitude of a column: a factor of 10 above the largest machine that the ranges of a rig
# include (rig_keys.py: hundreds of kilowatts, 5 kV), for positions what a log of hours adds up to
LARGEST = {
    "duty": 1e4,  # in percent or as a compare value it is refused with its own sentence
    "voltage_v": 1e7,  # 5 kV in mV: the factor 1000 has its own sentence
    "supply_v": 1e7,
    "current_a": 1e7,
    "speed_rpm": 1e7,
    "position_rad": 1e9,
    "load_nm": 1e9,
}
# The interval may differ from that of log_hz by less than this factor: the median one, or the mean
# one of a logger that writes its rows in batches.
MAX_RATE_FACTOR = 3.0
# times as seconds: the factor that the stamps are too large by, within this relative tolerance
TIME_UNITS = {1e3: "ms", 1e6: "us", 1e9: "ns"}
TIME_TOLERANCE = 0.5


def plausibility_findings(log: Log) -> list[Finding]:
    """Findings on values that no tool reaches, and on a log that measures nothing."""
    found = [
        Finding(
            f"column {name}: reaches {top:.4g}, more than any tool (at most {LARGEST[name]:g}): "
            "the column is damaged or in another unit",
            refuses=True,
        )
        for name, top in _largest(log).items()
        if top > LARGEST[name]
    ]
    empty = [n for n in MEASURED if n in log.columns and not np.isfinite(log.columns[n]).any()]
    return found + [Finding(f"column {name}: holds no value") for name in empty]


def _largest(log: Log) -> dict[str, float]:
    """Largest magnitude of each column with a limit that holds a value."""
    return {
        name: float(np.nanmax(np.abs(log.columns[name])))
        for name in LARGEST
        if name in log.columns and np.isfinite(log.columns[name]).any()
    }


def rate_finding(log: Log, rig: Rig) -> list[Finding]:
    """A finding where both the median and the mean row interval are far from that of the rig's
    log_hz.
    """
    log_hz = rig.sensors.get("log_hz")
    if log_hz is None:
        return []
    intervals_s = np.diff(np.asarray(log.time_s, float))
    interval_s = float(np.median(intervals_s))
    factor = interval_s * log_hz
    if any(
        1.0 / MAX_RATE_FACTOR <= s * log_hz <= MAX_RATE_FACTOR
        for s in (interval_s, float(intervals_s.mean()))
    ):
        return []
    stated = (
        f"column time_s: the median interval of the rows is {interval_s:.4g} s, that of the rig's "
        f"sensors.log_hz = {log_hz:g} is {1.0 / log_hz:.4g} s"
    )
    return [Finding(f"{stated}: {_rate_mend(factor)}", refuses=True)]


def _rate_mend(factor: float) -> str:
    """What to change where the interval is `factor` times the expected one."""
    for size, unit in TIME_UNITS.items():
        if abs(np.log(factor / size)) <= np.log1p(TIME_TOLERANCE):
            return f'are the times in {unit}? Read them with --map "time_s:{unit}=time_s"'
    return "is time_s in another unit, or log_hz not the rate of this log?"
