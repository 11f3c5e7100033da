"""What a log contains: number and rate of its rows, missing rows, range and sign of each column."""

from dataclasses import dataclass

import numpy as np

from vgroove.gap.cleaning.long_logs import LIMITS as REDUCTION
from vgroove.log import COLUMN_UNITS, Log, current_is_unsigned
from vgroove.rig import Rig

# Rows are missing in an interval of more than this many median row intervals (chosen: two lost
# rows)
MISSING_AFTER_INTERVALS = 2.5
# Judged rows, and processor time of a diagnosis in s. Measured on robotino_m1_current (1.3 s),
# practice_001 and 009 (17 s) and a log of 5 million rows, of which 40,000 are judged (53 s). A log
# that is compared in its torque balance takes up to three times as long (robotino_m1_delay, 2,292
# rows: 18 s; EMPS, 24,841 rows: 60 s).
DIAGNOSIS_ROWS = (0.0, 240.0, 6_000.0, 40_000.0)
DIAGNOSIS_S = (1.0, 1.3, 17.0, 53.0)
LONGER = "up to three times as long in the torque balance"
# Processor time of the diagnosis of a hammering tool: of any log, and for each second of it;
# measured with one effect: 29 to 38 s for 1.7 to 2.2 s, 35 to 48 s for 2.6 and 2.7 s; 75 to 100 s
# with tolerances, 130 to 180 s for 2.8 s that no effect explains.
IMPACT_DIAGNOSIS_S, IMPACT_S_PER_S = 18.0, 9.0
IMPACT_LONGER = (
    "two to three times as long with tolerances or several effects, five times where none explains "
    "the gap"
)


@dataclass(frozen=True)
class ColumnFacts:
    """Range of a column in its unit, and its missing samples; sign: signed, never negative, never
    positive, or always 0.
    """

    unit: str
    low: float | None
    high: float | None
    missing: int
    sign: str


@dataclass(frozen=True)
class LogFacts:
    """What a log holds; interval_s is the median row interval; missing_intervals: number of
    intervals in which rows are missing, longest_missing_s: the longest of them, 0 without one.
    command_rows: interval, instant or unknown; diagnosis_s: estimated processor time of a
    diagnosis; diagnosis_longer: when it takes longer.
    """

    source: str
    rows: int
    duration_s: float
    interval_s: float
    rate_hz: float
    missing_intervals: int
    longest_missing_s: float
    columns: dict[str, ColumnFacts]
    driven_by: str | None
    unsigned_current: bool
    command_rows: str
    command_rows_reason: str
    diagnosis_s: float
    diagnosis_longer: str


def facts_of(log: Log, rig: Rig | None) -> LogFacts:
    """The facts of a log; the convention of its command's rows is not estimated."""
    time_s = np.asarray(log.time_s, float)
    intervals = np.diff(time_s)
    median = float(np.median(intervals))
    longest = float(intervals.max())
    duration_s = float(time_s[-1] - time_s[0])
    hammers = rig is not None and rig.mechanism["kind"] == "impact"
    return LogFacts(
        source=log.source,
        rows=len(time_s),
        duration_s=duration_s,
        interval_s=median,
        rate_hz=1.0 / median,
        missing_intervals=int(np.count_nonzero(intervals > MISSING_AFTER_INTERVALS * median)),
        longest_missing_s=longest if longest > MISSING_AFTER_INTERVALS * median else 0.0,
        columns={name: column_facts(name, values) for name, values in log.columns.items()},
        driven_by=None if rig is None else rig.input["kind"],
        unsigned_current=current_is_unsigned(log),
        command_rows="unknown",
        command_rows_reason="it is estimated with --rig, from a log that is not refused",
        diagnosis_s=impact_diagnosis_s(duration_s) if hammers else diagnosis_s(len(time_s)),
        diagnosis_longer=IMPACT_LONGER if hammers else LONGER,
    )


def diagnosis_s(rows: int) -> float:
    """Processor time in s of the diagnosis of so many rows."""
    return float(np.interp(min(rows, REDUCTION.max_rows), DIAGNOSIS_ROWS, DIAGNOSIS_S))


def impact_diagnosis_s(duration_s: float) -> float:
    """Processor time in s of the diagnosis of a hammering tool's log."""
    return IMPACT_DIAGNOSIS_S + IMPACT_S_PER_S * duration_s


def column_facts(name: str, values: np.ndarray) -> ColumnFacts:
    """Range and sign of a column (rows,)."""
    known = np.asarray(values, float)
    known = known[np.isfinite(known)]
    missing = len(values) - len(known)
    unit = COLUMN_UNITS.get(name, "")
    if not len(known):
        return ColumnFacts(unit, None, None, missing, "no value")
    low, high = float(known.min()), float(known.max())
    if low == high == 0.0:
        sign = "always 0"
    elif low >= 0.0:
        sign = "never negative"
    else:
        sign = "never positive" if high <= 0.0 else "signed"
    return ColumnFacts(unit, low, high, missing, sign)
