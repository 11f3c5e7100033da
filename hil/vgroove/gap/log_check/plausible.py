"""Checks that need no simulation: values that no tool or logger reaches, a duty that is none,
columns without a value, and a row interval that the rig's log_hz contradicts.
"""

import numpy as np

from vgroove.gap.cleaning.missing_values import hold_last_value
from vgroove.gap.log_check.finding import Finding
from vgroove.gap.log_check.missing_marks import marked_findings
from vgroove.gap.log_check.wrapped_angle import wrapped_finding
from vgroove.gap.residual.impact.cycle_windows import RULES
from vgroove.gap.residual.inputs import COMMAND
from vgroove.log import COLUMN_UNITS, MEASURED, Log
from vgroove.rig import Rig
from vgroove.rig_keys import JUDGED_COLUMNS
from vgroove.units import TIME_UNITS

# Largest magnitude of a column: a factor of 10 above the largest machine that the ranges of a rig
# include (rig_keys.py: hundreds of kilowatts, 5 kV), for positions what a log of hours adds up to
LARGEST = {
    "duty": 1e5,  # in percent or as a compare value it is refused with its own sentence
    "voltage_v": 1e7,  # 5 kV in mV: the factor 1000 has its own sentence
    "supply_v": 1e7,
    "current_a": 1e7,
    "speed_rpm": 1e7,
    "position_rad": 1e9,
    "load_nm": 1e9,
}
MAX_OVER_RIG = 10.0  # times the rig's value that a load or a driving voltage reaches: as LARGEST
# Full values of a duty that timers and loggers count in
FULL_DUTIES = (100.0, 255.0, 1000.0, 1023.0, 4095.0, 10_000.0, 32_767.0, 65_535.0)
# The interval may differ from that of log_hz by less than this factor: the median one, or the mean
# one of a logger that writes its rows in batches.
MAX_RATE_FACTOR = 3.0
MIN_INTERVAL_S = 1e-6  # of a logger: log_hz is at most 1e6
LEAST_INTERVAL_S = MIN_INTERVAL_S * (1.0 - 1e-3)  # that is no less: rounding of the stamps
TIME_TOLERANCE = 0.5  # relative, of the factor of a unit of time
MIN_BLOWS = 8  # that a firmware counts in a tool that hammers; fewer may be steps of the current


def plausibility_findings(log: Log, rig: Rig | None = None) -> list[Finding]:
    """Findings on values that no tool reaches, and on columns that measure nothing."""
    found = [
        Finding(
            f"column {name}: reaches {top:.4g}, more than any tool (at most {LARGEST[name]:g}): "
            "the column is damaged or in another unit",
            refuses=True,
        )
        for name, top in _largest(log).items()
        if top > LARGEST[name]
    ]
    driven_by_duty = rig is None or rig.input["kind"] == "duty"
    return [
        *found,
        *(_duty_finding(log) if driven_by_duty and not found else ()),
        *(_voltage_finding(log, rig) if rig is not None and not found else ()),
        *(_load_finding(log, rig) if rig is not None and not found else ()),
        *wrapped_finding(log),
        *marked_findings(log, rig),
        *_empty_findings(log, rig),
        *(_blow_findings(log, rig) if rig is not None else ()),
    ]


def _duty_finding(log: Log) -> list[Finding]:
    """A finding on a duty beyond -1..1; the full value that the mend states is the first of
    FULL_DUTIES that it does not exceed.
    """
    top = _largest(log).get("duty", 0.0)
    if top <= COMMAND.max_duty:
        return []
    text = f"column duty: reaches {top:.4g}, and a duty lies within -1..1: "
    full = next((value for value in FULL_DUTIES if top <= value), None)
    if full == 100.0:
        text += 'is it in percent? Read it with --map "duty:%=duty"'
    elif full is not None:
        text += f'is it in counts of {full:g}? Read it with --map "duty:{1.0 / full:.7g}=duty"'
    else:
        text += "put the share that one of its counts is of the full duty into --map, as in "
        text += '--map "duty:1e-6=duty"'
    if np.nanmin(np.abs(log.columns["duty"])) > COMMAND.max_duty:
        text += (
            "; or, where it is never 0 because another value is no command, as 1500 us of a servo "
            'pulse, --map "duty:FACTOR from ZERO=duty", as "0.002 from 1500"'
        )
    return [Finding(text, refuses=True)]


def _voltage_finding(log: Log, rig: Rig) -> list[Finding]:
    """A finding on a driving voltage that the supply of the rig cannot give."""
    supply = rig.supply.get("voltage_v")
    if rig.input["kind"] != "voltage_v" or supply is None:
        return []
    return _beyond_rig(log, "voltage_v", supply, f"supply.voltage_v = {supply:g}")


def _load_finding(log: Log, rig: Rig) -> list[Finding]:
    """A finding on a load torque beyond what the tool can give."""
    if rig.load["kind"] != "torque" or rig.stall_current_a is None:
        return []
    stall = rig.motor["torque_constant_nm_per_a"] * rig.gearbox["ratio"] * rig.stall_current_a
    return _beyond_rig(log, "load_nm", stall, f"stall torque at the output ({stall:.3g} Nm)")


def _beyond_rig(log: Log, column: str, size: float, said: str) -> list[Finding]:
    """A finding on a column that is far beyond the size of its quantity in the rig."""
    top, most, unit = _largest(log).get(column, 0.0), MAX_OVER_RIG * size, COLUMN_UNITS[column]
    if top <= most:
        return []
    text = f"column {column}: reaches {top:.4g}, {top / size:.3g} times the rig's {said}: "
    if top <= 1e3 * most:
        text += f'is it in m{unit}? Read it with --map "{column}:m{unit}={column}"'
    else:
        text += "is it in another unit, or the rig that of another tool?"
    return [Finding(text, refuses=True)]


def _empty_findings(log: Log, rig: Rig | None) -> list[Finding]:
    """Findings on columns that hold no value. The log is refused if such a column would be compared
    with the simulation of the rig.
    """
    empty = [n for n in MEASURED if n in log.columns and not np.isfinite(log.columns[n]).any()]
    text = (
        "column {}: holds no value, so that it compares no sample with the simulation: check its "
        "name and its logger, or leave the column out"
    )
    given = rig is not None
    compared = [name for name in JUDGED_COLUMNS if given and name != rig.input["kind"]]
    return [Finding(text.format(name), refuses=name in compared) for name in empty]


def _blow_findings(log: Log, rig: Rig) -> list[Finding]:
    """A finding on a log in which the firmware counted blows as often as a tool hammers, for a rig
    without a mechanism.
    """
    if rig.mechanism["kind"] != "none" or "blow_count" not in log.columns:
        return []
    count = float(np.maximum(np.diff(hold_last_value(log.columns["blow_count"])), 0.0).sum())
    command = hold_last_value(log.columns.get(rig.input["kind"], np.zeros(len(log))))
    driven_s = float(np.sum(np.diff(log.time_s)[command[1:] != 0.0]))
    if count < max(MIN_BLOWS, RULES.least_hz * driven_s):
        return []
    text = f'column blow_count: {count:.0f} blows: the tool hammers, but mechanism.kind is "none"'
    return [Finding(f"{text}: is the rig that of another tool?", refuses=True)]


def _largest(log: Log) -> dict[str, float]:
    """Largest magnitude of each column with a limit that holds a value."""
    return {
        name: float(np.nanmax(np.abs(log.columns[name])))
        for name in LARGEST
        if name in log.columns and np.isfinite(log.columns[name]).any()
    }


def rate_finding(log: Log, rig: Rig) -> list[Finding]:
    """A finding where both the median and the mean row interval are far from that of the rig's
    log_hz; without it, where the rows are faster than those of any logger.
    """
    log_hz = rig.sensors.get("log_hz")
    intervals_s = np.diff(np.asarray(log.time_s, float))
    interval_s = float(np.median(intervals_s))
    if log_hz is None:
        return _too_fast(interval_s) if interval_s < LEAST_INTERVAL_S else []
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


def _too_fast(interval_s: float) -> list[Finding]:
    """The finding on a row interval that is shorter than that of any logger."""
    named = [
        f'in {unit} (--map "time_s:{unit}=time_s")'
        for size, unit in TIME_UNITS.items()
        if size < 1.0 and interval_s / size >= LEAST_INTERVAL_S
    ]
    text = (
        f"column time_s: the median interval of the rows is {interval_s:.4g} s, less than that of "
        f"any logger ({MIN_INTERVAL_S:g} s): are the times {' or '.join(named)}?"
        if named
        else f"column time_s: the median interval of the rows is {interval_s:.4g} s: no times"
    )
    return [Finding(text, refuses=True)]


def _rate_mend(factor: float) -> str:
    """What to change where the interval is `factor` times the expected one."""
    for size, unit in TIME_UNITS.items():
        if abs(np.log(factor / size)) <= np.log1p(TIME_TOLERANCE):
            return f'are the times in {unit}? Read them with --map "time_s:{unit}=time_s"'
    return "is time_s in another unit, or log_hz not the rate of this log?"
