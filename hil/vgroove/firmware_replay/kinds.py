"""Which kind of firmware gap a log shows, if any: another parameter, a state that changes at
another tick, a late actuation, or another build.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vgroove import _replay, telemetry
from vgroove.eeprom_image import parameter
from vgroove.firmware_replay.assumed_firmware import AssumedFirmware
from vgroove.firmware_replay.closed_loop import ClosedLoop
from vgroove.firmware_replay.delay import LIMITS, actuation_delay_ms
from vgroove.firmware_replay.rows import COMPARE, COMPARE_TOP, STATE, TRIGGER, replay_rows
from vgroove.firmware_replay.search import FoundParameter, ParameterSearch, Parting, replay
from vgroove.log import Log

NONE, FIRMWARE = "none", "firmware"
PARAMETER, STATE_TICK, LATE, BUILD = "parameter", "state", "late", "build"
SHIFT_ROWS = 12  # largest shift of the trigger that is tried


@dataclass(frozen=True)
class FirmwareResult:
    """Verdict on the firmware of a log: `kind` is empty without a gap; `first` is the first tick
    that the assumed firmware does not give (time_s, signal, logged, expected), and `details` holds
    what a kind has besides. closed_loop: with the simulated tool, where there is a rig.
    """

    log: str
    kind: str
    first: dict[str, Any] | None = None
    details: dict[str, Any] = field(default_factory=dict)
    closed_loop: ClosedLoop | None = None

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        verdict = FIRMWARE if self.kind else NONE
        base = {"log": self.log, "verdict": verdict, "kind": self.kind or None}
        loop = {"closed_loop": self.closed_loop.as_dict()} if self.closed_loop else {}
        return {**base, "first": self.first, **self.details, **loop}

    def summary(self) -> list[str]:
        """Sentences for the terminal."""
        loop = [self.closed_loop.sentence()] if self.closed_loop else []
        return [f"{self.log}: {text}" for text in (*self._sentences(), *loop)]

    def _sentences(self) -> list[str]:
        if not self.kind:
            return ["the firmware gives every duty of the log from its measured inputs."]
        at = f"first at {self.first['time_s']:.6g} s in {self.first['signal']}"
        details = self.details
        if self.kind == LATE:
            return [
                "the firmware gives every duty of the log, and the bridge acts "
                f"{1e3 * details['delay_s']:.2g} ms late ({at})."
            ]
        if self.kind == STATE_TICK:
            rows = details["trigger_rows"]
            return [f"the state follows the trigger {rows} ms later than it should ({at})."]
        if self.kind == PARAMETER:
            found = details["parameter"]
            return [
                f"the board has {found['name']} = {found['value']:.6g} {found['unit']}, not "
                f"{found['assumed']:.6g} ({at})."
            ]
        return [
            f"no single parameter and no shift of the trigger gives the log: another build ({at})."
        ]


def judge_firmware(log: Log, assumed: AssumedFirmware) -> FirmwareResult:
    """Replay a log with the assumed firmware, and search for the kind of gap where they part.
    VgrooveError for a log that cannot be replayed.
    """
    rows = replay_rows(log)
    base = replay(assumed, rows)
    if base.row >= len(rows):
        return _of_late(log, rows)
    shifted = _shift_of(assumed, rows)
    if shifted is not None:
        return _of_shift(log, rows, shifted)
    first = _first_of(log, rows, base)
    found = ParameterSearch(assumed, rows, base).found()
    if found is not None:
        return FirmwareResult(
            log.source, PARAMETER, first, {"parameter": _entry_of(assumed, found)}
        )
    return FirmwareResult(log.source, BUILD, first)


def _value(signal: str, count: int) -> float | None:
    """A duty or a state; None for an open bridge."""
    if signal == "state":
        return count
    return None if count == _replay.COAST else count / COMPARE_TOP


def _first(log: Log, row: int, signal: str, values: tuple[Any, Any]) -> dict[str, Any]:
    time_s = float(log.time_s[row])
    return {"time_s": time_s, "signal": signal, "logged": values[0], "expected": values[1]}


def _first_of(log: Log, rows: np.ndarray, base: Parting) -> dict[str, Any]:
    column = STATE if base.signal == "state" else COMPARE
    logged = _value(base.signal, int(rows[base.row, column]))
    return _first(log, base.row, base.signal, (logged, _value(base.signal, base.expected)))


def _of_late(log: Log, rows: np.ndarray) -> FirmwareResult:
    delay_ms = actuation_delay_ms(log)
    details = {"delay_s": None if delay_ms is None else round(1e-3 * max(delay_ms, 0.0), 6)}
    if delay_ms is None or delay_ms < LIMITS.late_ms:
        return FirmwareResult(log.source, "", None, details)
    row = int(np.argmax((rows[:, COMPARE] != _replay.COAST) & (rows[:, COMPARE] != 0)))
    first = _first(log, row, "current_a", (float(log["current_a"][row]), None))
    return FirmwareResult(log.source, LATE, first, details)


def _shifted(rows: np.ndarray, count: int) -> np.ndarray:
    """Rows whose trigger comes `count` rows later."""
    result = rows.copy()
    result[count:, TRIGGER] = rows[:-count, TRIGGER]
    return result


def _shift_of(assumed: AssumedFirmware, rows: np.ndarray) -> int | None:
    """The least shift of the trigger with which all rows agree; the board cannot see a trigger
    before it is pulled.
    """
    for count in range(1, SHIFT_ROWS + 1):
        if replay(assumed, _shifted(rows, count)).row >= len(rows):
            return count
    return None


def _of_shift(log: Log, rows: np.ndarray, count: int) -> FirmwareResult:
    seen = _shifted(rows, count)[:, TRIGGER]
    apart = (seen != rows[:, TRIGGER]) & (seen != _replay.UNKNOWN)
    apart &= rows[:, TRIGGER] != _replay.UNKNOWN
    row = int(np.argmax(apart))
    values = (float(rows[row, TRIGGER]) / COMPARE_TOP, float(seen[row]) / COMPARE_TOP)
    first = _first(log, row, "trigger", values)
    return FirmwareResult(log.source, STATE_TICK, first, {"trigger_rows": count})


def _entry_of(assumed: AssumedFirmware, found: FoundParameter) -> dict[str, Any]:
    entry: telemetry.Parameter = parameter(found.name)
    scale = 2**entry.q
    return {
        "name": entry.name,
        "unit": entry.unit,
        "value": found.raw / scale,
        "range": [found.low / scale, found.high / scale],
        "assumed": assumed.raw(entry.name) / scale,
    }
