"""Checks that need no simulation: values that no tool or logger reaches, a duty that is none, a
position that wraps, marks of missing samples, columns without a value, and a row interval that the
rig's log_hz contradicts.
"""

from dataclasses import dataclass

import numpy as np

from vgroove.gap.log_check.finding import Finding
from vgroove.gap.residual.inputs import COMMAND
from vgroove.log import MEASURED, Log
from vgroove.log.units_of_columns import unit_factor
from vgroove.rig import Rig

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
MAX_OVER_STALL = 10.0  # times the stall torque at the output that load_nm reaches: as for LARGEST
MAX_OVER_SUPPLY = 10.0  # times supply.voltage_v that a driving voltage reaches: as for LARGEST
# Full values of a duty that timers and loggers count in
FULL_DUTIES = (100.0, 255.0, 1000.0, 1023.0, 4095.0, 10_000.0, 32_767.0, 65_535.0)
COMPARED = ("current_a", "supply_v", "speed_rpm", "position_rad")


@dataclass(frozen=True)
class MarkRules:
    """When a value marks missing samples (values chosen; no log of tests/data comes near)."""

    beyond: float = 5.0  # times the largest magnitude of the other rows
    min_rows: int = 3  # that hold exactly this value
    alone: float = 0.8  # share of them whose neighbours do not hold it


MARK = MarkRules()


@dataclass(frozen=True)
class WrapRules:
    """When a position is an angle within one turn (values chosen; no log of tests/data and no case
    of the blind set comes near).
    """

    jump: float = 0.6  # of its range, between two rows
    calm: float = 0.2  # of its range, that the rows before and after a jump may change by
    min_jumps: int = 3  # without regard to the motion; one that opposes the motion is enough
    motion_rows: int = 5  # before and after a jump, whose change is the motion
    max_gap: float = 3.0  # median intervals of a jump; a longer one may hide a motion
    min_range_rad: float = 3.0  # a smaller range is one of a shaft at rest
    min_rows: int = 20


WRAP = WrapRules()
# The interval may differ from that of log_hz by less than this factor: the median one, or the mean
# one of a logger that writes its rows in batches.
MAX_RATE_FACTOR = 3.0
# times as seconds: the factor that the stamps are too large by, within this relative tolerance
TIME_UNITS = {1e3: "ms", 1e6: "us", 1e9: "ns", 1 / 60: "min", 1 / 3600: "h", 1 / 86_400: "d"}
MIN_INTERVAL_S = 1e-6  # of a logger: log_hz is at most 1e6
TIME_TOLERANCE = 0.5


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
        *_wrapped_finding(log),
        *_marked_findings(log),
        *_empty_findings(log, rig),
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
    return [Finding(text, refuses=True)]


def _voltage_finding(log: Log, rig: Rig) -> list[Finding]:
    """A finding on a driving voltage that the supply of the rig cannot give."""
    supply, top = rig.supply.get("voltage_v"), _largest(log).get("voltage_v", 0.0)
    if rig.input["kind"] != "voltage_v" or supply is None or top <= MAX_OVER_SUPPLY * supply:
        return []
    text = (
        f"column voltage_v: reaches {top:.4g}, {top / supply:.3g} times the rig's "
        f"supply.voltage_v = {supply:g}: "
    )
    if top <= 1e3 * MAX_OVER_SUPPLY * supply:
        text += 'is it in mV? Read it with --map "voltage_v:mV=voltage_v"'
    else:
        text += "is it in another unit, or the supply that of another tool?"
    return [Finding(text, refuses=True)]


def _load_finding(log: Log, rig: Rig) -> list[Finding]:
    """A finding on a load torque beyond what the tool can give."""
    top, stall = _largest(log).get("load_nm", 0.0), _stall_torque_nm(log, rig)
    if rig.load["kind"] != "torque" or stall is None or top <= MAX_OVER_STALL * stall:
        return []
    text = (
        f"column load_nm: reaches {top:.4g}, {top / stall:.3g} times the rig's stall torque at "
        f"the output ({stall:.3g} Nm): "
    )
    if top <= 1e3 * MAX_OVER_STALL * stall:
        text += 'is it in mNm? Read it with --map "load_nm:mNm=load_nm"'
    else:
        text += "is it in another unit?"
    return [Finding(text, refuses=True)]


def _stall_torque_nm(log: Log, rig: Rig) -> float | None:
    """Torque at the output, Nm, at the largest current that the command of the log or the supply
    drives through the winding; None where it is not known.
    """
    kind, top = rig.input["kind"], _largest(log)
    current = top.get("current_a") if kind == "current_a" else None
    volts = top.get("voltage_v") if kind == "voltage_v" else rig.supply.get("voltage_v")
    if kind != "current_a" and volts is not None:
        current = volts / rig.motor["resistance_ohm"]
    per_a = rig.motor["torque_constant_nm_per_a"] * rig.gearbox["ratio"]
    return per_a * current if current else None


def _wrapped_finding(log: Log) -> list[Finding]:
    """A finding on a position that jumps back by its whole range: an angle within one turn."""
    values = np.asarray(log.columns.get("position_rad", ()), float)
    known = np.isfinite(values)
    values, time_s = values[known], np.asarray(log.time_s, float)[: len(known)][known]
    reach = float(np.ptp(values)) if len(values) else 0.0
    if len(values) < WRAP.min_rows or reach < WRAP.min_range_rad:
        return []
    jumps = _calm_jumps(values, reach)
    count = np.count_nonzero(jumps)
    if count < WRAP.min_jumps and not (jumps & _opposes_motion(values, time_s)).any():
        return []
    times = "once" if count == 1 else f"{count} times"
    text = (
        f"column position_rad: jumps {times} by about its whole range of "
        f"{reach:.4g}: it is an angle within one turn; add up the turns (numpy.unwrap, its period "
        "is one turn in the unit of the column), or leave the column out"
    )
    return [Finding(text, refuses=True)]


def _calm_jumps(values: np.ndarray, reach: float) -> np.ndarray:
    """Whether each step (rows - 1,) is a jump by the range, between small steps."""
    steps = np.abs(np.diff(values)) / reach
    beside = np.maximum(np.append(steps[1:], np.inf), np.append(np.inf, steps[:-1]))
    return (steps > WRAP.jump) & (beside < WRAP.calm)


def _opposes_motion(values: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """Whether each step (rows - 1,) is against the motion before it and after it, and spans no
    gap.
    """
    steps, intervals = np.diff(values), np.diff(time_s)
    row, last = np.arange(len(steps)), len(values) - 1
    before = values[row] - values[np.maximum(row - WRAP.motion_rows, 0)]
    after = values[np.minimum(row + 1 + WRAP.motion_rows, last)] - values[row + 1]
    against = (before * steps < 0.0) & (after * steps < 0.0)
    return against & (intervals <= WRAP.max_gap * np.median(intervals))


def _marked_findings(log: Log) -> list[Finding]:
    """Findings on columns in which one value, far beyond all others, stands in single rows: the
    mark of a missing sample, such as 65535.
    """
    found = []
    for name in (name for name in COMPARED if name in log.columns):
        values = np.asarray(log.columns[name], float)
        size = np.abs(np.nan_to_num(values))
        top = size.max(initial=0.0)
        marked, others = size == top, size[size < top].max(initial=0.0)
        beside = np.append(marked[1:], False) | np.append(False, marked[:-1])
        count, alone = np.count_nonzero(marked), np.count_nonzero(marked & ~beside)
        if others == 0.0 or top <= MARK.beyond * others or count < MARK.min_rows:
            continue
        if alone >= MARK.alone * count:
            text = (
                f"column {name}: reads exactly {values[marked][0]:.6g} in {count} rows and "
                f"{others:.4g} at most in the others: if it marks missing samples, write them as "
                "empty cells or NaN"
            )
            found.append(Finding(text, refuses=True))
    return found


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
    compared = [name for name in COMPARED if given and name != rig.input["kind"]]
    return [Finding(text.format(name), refuses=name in compared) for name in empty]


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
        return _too_fast(interval_s) if interval_s < MIN_INTERVAL_S else []
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
    """The finding on rows that follow each other faster than those of any logger."""
    units = [unit for size, unit in TIME_UNITS.items() if size < 1.0]
    units = [u for u in units if unit_factor(u, "time_s") * interval_s >= MIN_INTERVAL_S]
    named = [f'in {unit} (--map "time_s:{unit}=time_s")' for unit in units]
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
