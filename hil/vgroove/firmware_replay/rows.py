"""Rows of a log as the replay needs them: the integers that the board has sent."""

import numpy as np

from vgroove import _replay
from vgroove.errors import VgrooveError
from vgroove.log import Log

COLUMNS = ("duty", "current_a", "speed_rpm", "supply_v", "trigger", "state")
COMPARE, TRIGGER, STATE = 0, 4, 5  # columns of the rows
COMPARE_TOP = 255
ROW_S, ROW_TOLERANCE_S = 1e-3, 1e-4  # tick of the board; 1e-4: clock of 2 % and rounded times
INTEGER_TOLERANCE = 0.02  # of a count: rounding of a text file
# Columns of the rows after the first: log column, counts per unit
SCALES = {"current_a": 512.0, "speed_rpm": 2.0, "supply_v": 1000.0}


def replay_rows(log: Log) -> np.ndarray:
    """Rows (n, 6) int32 for vgroove._replay.replay; VgrooveError for a log that is not the
    telemetry of a board, a row per tick from its start on.
    """
    log.require(*COLUMNS)
    _check_times(log)
    compare = _counts(log, "duty", COMPARE_TOP)
    if "coast" in log:
        compare[log["coast"] > 0.5] = _replay.COAST
    measured = [_counts(log, name, scale) for name, scale in SCALES.items()]
    states = [_held(log, "trigger", COMPARE_TOP), _held(log, "state", 1.0)]
    return np.ascontiguousarray(np.stack([compare, *measured, *states], axis=1), np.int32)


def _check_times(log: Log) -> None:
    steps = np.diff(log.time_s)
    wrong = np.abs(steps - ROW_S) > ROW_TOLERANCE_S
    if wrong.any():
        at = int(np.argmax(wrong))
        raise VgrooveError(
            f"{log.source}: the replay of the firmware needs a row per tick of 1 ms; after "
            f"{log.time_s[at]:.6g} s the next row follows after {1e3 * steps[at]:.4g} ms."
        )
    if not 0.0 <= log.time_s[0] <= 1.5 * ROW_S:
        raise VgrooveError(
            f"{log.source}: the replay of the firmware needs the rows from the start of the board "
            f"on; the first is at {log.time_s[0]:.6g} s."
        )


def _counts(log: Log, name: str, scale: float) -> np.ndarray:
    values = log[name] * scale
    if not np.isfinite(values).all():
        at = log.time_s[int(np.argmin(np.isfinite(values)))]
        raise VgrooveError(
            f"{log.source}: the replay of the firmware needs {name} in every row; it is missing at "
            f"{at:.6g} s."
        )
    counts = np.rint(values)
    apart = np.abs(values - counts) > INTEGER_TOLERANCE
    if apart.any():
        at = int(np.argmax(apart))
        raise VgrooveError(
            f"{log.source}: {name} is {log[name][at]:.6g} at {log.time_s[at]:.6g} s, which is no "
            f"multiple of 1/{scale:g} as a board sends it: the replay needs unfiltered telemetry."
        )
    return counts


def _held(log: Log, name: str, scale: float) -> np.ndarray:
    values = np.rint(log[name] * scale)
    return np.where(np.isfinite(values), values, _replay.UNKNOWN)
