"""The table of samples that every log is, and the rules that it must keep
(docs/spec/gap.md, section 1).
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vgroove import telemetry
from vgroove.errors import VgrooveError
from vgroove.log.clock import time_mend

INPUTS = ("duty", "voltage_v", "current_a")
MEASURED = (
    "voltage_v",
    "supply_v",
    "current_a",
    "speed_rpm",
    "position_rad",
    "anvil_torque_nm",
    "anvil_angle_rad",
    "hammer_mm",
)
# Columns that no board sends: unit and quantity. Those of the board come from its signal list.
TEST_BENCH_COLUMNS = {
    "voltage_v": ("V", "voltage at the motor"),
    "position_rad": ("rad", "motor angle"),
    "load_nm": ("Nm", "load torque"),
    "anvil_torque_nm": ("Nm", "anvil torque"),
    "anvil_angle_rad": ("rad", "anvil angle"),
    "hammer_mm": ("mm", "hammer displacement"),
}
COLUMN_UNITS = telemetry.COLUMN_UNITS | {
    name: unit for name, (unit, _) in TEST_BENCH_COLUMNS.items()
}
COLUMN_LABELS = telemetry.COLUMN_LABELS | {
    name: text for name, (_, text) in TEST_BENCH_COLUMNS.items()
}
MIN_USABLE_SAMPLES = 50  # docs/spec/gap.md, section 1
STANDSTILL_SHARE = 0.01  # of the largest speed, which the noise of a speed at rest stays below
MAX_DUTY = 1.0 + 1e-6  # a larger magnitude is reported; 1e-6 is the rounding of a text file


@dataclass(frozen=True)
class UnsignedCurrent:
    """What marks a current column as a magnitude without sign (values chosen, not fitted)."""

    min_current_a: float = 1.0  # noise and offset hide the sign of a smaller current
    min_rows: int = 20  # least number of rows with braking or reverse drive for a decision
    negative_share: float = 0.02  # of the largest magnitude: a signed current goes below minus this
    # a current that stays above this share of the largest magnitude, and whose means in drive and
    # in braking or reverse drive differ by more than this share of its range, has an offset
    least_share: float = 0.8
    most_apart: float = 0.5


UNSIGNED = UnsignedCurrent()


@dataclass
class Log:
    """Samples over time: `time_s` (n,) strictly increasing, `columns` (n,) by name with NaN where a
    sample is missing.

    `source` names the origin for messages, `meta` holds what a recording states about the board
    (boot, parameters, counters), `read_from` the names in the file of the columns that have another
    name there, `scales` what one of the numbers in the file is in the log's unit, and the number
    that stands for 0, of the columns for which these are not 1 and 0.
    """

    time_s: np.ndarray
    columns: dict[str, np.ndarray]
    source: str
    warnings: list[str] = field(default_factory=list)
    meta: dict[str, Any] = field(default_factory=dict)
    read_from: dict[str, str] = field(default_factory=dict)
    scales: dict[str, tuple[float, float]] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.time_s)

    def __getitem__(self, name: str) -> np.ndarray:
        return self.time_s if name == "time_s" else self.columns[name]

    def __contains__(self, name: object) -> bool:
        return name == "time_s" or name in self.columns

    def require(self, *names: str) -> None:
        """VgrooveError naming the file and the first of `names` that is missing."""
        for name in names:
            if name not in self:
                raise VgrooveError(f"{self.source}: the column {name} is missing.")


def check_columns(source: str, found: Iterable[str], others: Iterable[str] = ()) -> None:
    """VgrooveError unless the log columns `found` include the time, an input and another measured
    signal; `others` are the further names of the file, of which the message lists the nearest.
    """
    from vgroove.log.nearest import hint

    found = set(found)
    if "time_s" not in found:
        missing = hint(("time_s",), others, found)
        raise VgrooveError(f"{source}: the required column time_s is missing.{missing}")
    if not found & set(INPUTS):
        raise VgrooveError(
            f"{source}: a required column is missing: one input of {', '.join(INPUTS)}."
            f"{hint(INPUTS, others, found)}"
        )
    if not any(found & (set(MEASURED) - {given}) for given in found & set(INPUTS)):
        raise VgrooveError(
            f"{source}: a required column is missing: a measured signal besides the input, "
            f"such as speed_rpm.{hint(('speed_rpm', 'current_a', *MEASURED), others, found)}"
        )


def checked(log: Log, lines: np.ndarray | None = None) -> Log:
    """The log, with warnings added, if it keeps the rules; VgrooveError otherwise.

    Time increases, nothing is infinite, enough samples are usable. `lines` (n,) are the line
    numbers of the rows in a text file, for the messages.
    """

    def place(row: int) -> str:
        return f"sample {row + 1}" if lines is None else f"line {lines[row]}"

    missing = ~np.isfinite(log.time_s)
    if missing.any():
        where = place(int(np.argmax(missing)))
        raise VgrooveError(f"{log.source}: {where}, column time_s: the time is missing.")
    not_later = np.diff(log.time_s) <= 0
    if not_later.any():
        at = int(np.argmax(not_later)) + 1
        values = f"{log.time_s[at]:.10g} s after {log.time_s[at - 1]:.10g} s"
        raise VgrooveError(
            f"{log.source}: {place(at)}, column time_s: time does not increase ({values}): "
            f"{time_mend(log.time_s)}."
        )
    for name, values in log.columns.items():
        if np.isinf(values).any():
            where = place(int(np.argmax(np.isinf(values))))
            raise VgrooveError(f"{log.source}: {where}, column {name}: an infinite value.")
    usable = _usable_samples(log)
    if usable < MIN_USABLE_SAMPLES:
        raise VgrooveError(
            f"{log.source}: {usable} usable samples, at least {MIN_USABLE_SAMPLES} are needed."
        )
    log.warnings += _warnings(log)
    return log


def _usable_samples(log: Log) -> int:
    """Number of samples with an input and another measured signal."""
    usable = np.zeros(len(log), bool)
    for given in (name for name in INPUTS if name in log):
        others = [np.isfinite(log[name]) for name in MEASURED if name in log and name != given]
        if others:
            usable |= np.isfinite(log[given]) & np.any(others, axis=0)
    return int(usable.sum())


def _warnings(log: Log) -> list[str]:
    """Doubtful properties of a log that is accepted."""
    found = []
    if "duty" in log and np.nanmax(np.abs(log["duty"]), initial=0.0) > MAX_DUTY:
        found.append(
            f"{log.source}: column duty: the greatest magnitude is "
            f"{np.nanmax(np.abs(log['duty'])):.4g}, not within -1..1."
        )
    if offset := standstill_offset(log):
        found.append(
            f"{log.source}: column current_a: has a constant value of about {offset:.4g} at "
            "standstill, more than all changes: subtract it from the column, as --map "
            f'"{log.read_from.get("current_a", "current_a")}:UNIT from ZERO=current_a" does.'
        )
    elif current_is_unsigned(log):
        found.append(
            f"{log.source}: column current_a: never negative while the drive brakes or reverses, "
            "so it is unsigned."
        )
    return found


def current_is_unsigned(log: Log) -> bool:
    """Whether the current is never negative although it should be for a while: in reverse drive, or
    while the bridge brakes forward rotation.
    """
    if not all(name in log for name in ("duty", "current_a", "speed_rpm")):
        return False
    if standstill_offset(log):
        return False
    duty, current, speed = log["duty"], log["current_a"], log["speed_rpm"]
    closed = log["coast"] == 0 if "coast" in log else np.ones(len(log), bool)
    brakes = closed & (duty <= 0) & (speed > 0)
    reverses = closed & (duty < 0) & (speed <= 0)
    rows = (brakes | reverses) & (np.abs(current) > UNSIGNED.min_current_a)
    if rows.sum() < UNSIGNED.min_rows:
        return False
    least, largest = np.nanmin(current), np.nanmax(np.abs(current))
    if least <= -UNSIGNED.negative_share * largest:
        return False
    driven = closed & (duty > 0) & np.isfinite(current)
    if least < UNSIGNED.least_share * largest or not driven.any():
        return True
    apart = float(np.nanmean(current[driven]) - np.nanmean(current[rows]))
    return abs(apart) <= UNSIGNED.most_apart * float(largest - least)


def standstill_offset(log: Log) -> float:
    """The current, A, at rest without a command, where it is larger than any deviation from it: the
    middle of a converter's range. 0 otherwise.
    """
    if not all(name in log for name in ("duty", "current_a", "speed_rpm")):
        return 0.0
    slow = STANDSTILL_SHARE * np.nanmax(np.abs(log["speed_rpm"]), initial=0.0)
    rests = (log["duty"] == 0.0) & (np.abs(log["speed_rpm"]) <= slow)
    rests &= np.isfinite(log["current_a"])
    if np.count_nonzero(rests) < UNSIGNED.min_rows:
        return 0.0
    offset = float(np.median(log["current_a"][rests]))
    return offset if abs(offset) > np.nanmax(np.abs(log["current_a"] - offset)) else 0.0
