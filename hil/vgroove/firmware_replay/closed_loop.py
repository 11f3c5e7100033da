"""The assumed firmware in closed loop with the simulated tool: which signal of a log leaves the
simulation first, that of the rig and that of the corrected one.

What is not measured (start angle of the hammer, position of the Hall sensor, noise) differs from
run to run of the simulation; a log within the spread of the runs has no gap.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vgroove.control_bench.draw import START_RAD
from vgroove.control_bench.runs import RunPlan, run_plan
from vgroove.firmware_replay.assumed_firmware import AssumedFirmware
from vgroove.firmware_replay.rows import ROW_S
from vgroove.gap.cleaning.missing_values import hold_last_value
from vgroove.lockstep import ADC_COUNTS, TRAVEL_AT_REST, TRAVEL_SPAN, Profile
from vgroove.log import Log
from vgroove.rig import Rig

RUNS = 16  # of a rig
# States, and the columns of the message that reports each
STATE_MESSAGE, CONTROL_MESSAGE = (
    ("trigger", "state", "mode"),
    ("control_state", "stop_reason", "blow_count"),
)
MESSAGES = {
    "state": STATE_MESSAGE,
    "control_state": CONTROL_MESSAGE,
    "stop_reason": CONTROL_MESSAGE,
}
# Measured signals, and the least width of their spread: a few steps of the board's resolution
WIDTHS = {"duty": 4 / 255, "current_a": 1.0, "speed_rpm": 60.0, "supply_v": 0.15}
STATE_WIDTH = 2  # rows; the least width of the spread of a change of state
TRIGGER_ROWS = (2, 1, 3, 0, 4)  # by which a row may report the trigger late, likeliest first
DUTY_ROWS = 2  # rows by which the duty follows the trigger
ROWS_APART = 10  # rows in a row in which a measured signal must be apart

COLUMNS = dict.fromkeys((*STATE_MESSAGE, *CONTROL_MESSAGE))
Rows = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Departure:
    """The first row that lies outside the simulation: its index, the signal, the log's value, the
    least and largest value of the runs, and the row's time in the log.
    """

    row: int
    signal: str
    logged: float
    least: float
    most: float
    time_s: float = np.nan

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "time_s": self.time_s,
            "signal": self.signal,
            "logged": self.logged,
            "expected": [self.least, self.most],
        }


@dataclass(frozen=True)
class ClosedLoop:
    """Where a log leaves the simulation of the rig, and that of the corrected rig (None where it
    does not, or where nothing is corrected).
    """

    nominal: Departure | None
    corrected: Departure | None
    is_corrected: bool

    def as_dict(self) -> dict[str, Any]:
        """For JSON; `corrected` is absent where nothing is corrected."""
        found = {"nominal": self.nominal and self.nominal.as_dict()}
        if self.is_corrected:
            found["corrected"] = self.corrected and self.corrected.as_dict()
        return found

    def sentence(self) -> str:
        """In words."""
        text = f"in closed loop the log {_words(self.nominal, 'the simulation of the rig')}"
        if self.is_corrected:
            text += f", and {_words(self.corrected, 'that of the corrected rig')}"
        return text + "."


def _words(found: Departure | None, what: str) -> str:
    if found is None:
        return f"stays within {what}"
    return (
        f"leaves {what} at {found.time_s:.4g} s ({found.signal} {found.logged:.5g}, simulated "
        f"{found.least:.5g} to {found.most:.5g})"
    )


def closed_loop(log: Log, rig: Rig, corrected: Rig, assumed: AssumedFirmware) -> ClosedLoop | None:
    """The closed loop of a log with the assumed firmware; None for a rig that no duty drives, or
    that does not state its supply. corrected: the rig with the effects that a diagnosis has named,
    and retuned values.
    """
    if rig.input["kind"] != "duty" or not rig.supply.get("voltage_v"):
        return None
    is_corrected = bool((corrected.parameters() != rig.parameters()).any())
    nominal = first_departure(log, rig, assumed)
    found = first_departure(log, corrected, assumed) if is_corrected else None
    return ClosedLoop(nominal, found, is_corrected)


def first_departure(log: Log, rig: Rig, assumed: AssumedFirmware) -> Departure | None:
    """Where a log of rows from the board's start on leaves the closed loop of the assumed firmware
    and a rig first; None where it does not. Measured signals count while the bridge drives and the
    trigger is known. VgrooveError for a rig that cannot be simulated.
    """
    runs = simulated_runs(log, rig, assumed)
    length = min(len(log.time_s), *(len(run["duty"]) for run in runs))
    logged, *runs = (
        {name: hold_last_value(rows[name][:length]) for name in (*COLUMNS, *WIDTHS) if name in rows}
        for rows in (log.columns, *runs)
    )
    states = [state_departure(name, logged, runs, length) for name in MESSAGES if name in logged]
    judged = trigger_share(log)[1][:length] & (logged["duty"] != 0.0)
    measured = [measured_departure(name, logged, runs, judged) for name in WIDTHS if name in logged]
    found = [f for f in (*states, *measured) if f is not None]
    if not found:
        return None
    first = min(found, key=lambda f: f.row)
    return replace(first, time_s=float(log.time_s[first.row]))


def simulated_runs(log: Log, rig: Rig, assumed: AssumedFirmware) -> list[Rows]:
    """Telemetry of RUNS simulated runs of the assumed firmware with the tool of a rig. The trigger
    is that of the log, moved to an earlier time: by the likeliest number of rows, by one row less,
    and by one row more.
    """
    if "hall_pulses_per_rev" not in rig.sensors:
        rig = rig.with_values({"sensors.hall_pulses_per_rev": assumed.raw("hall_pulses")})
    likeliest = likeliest_rows(log, rig, assumed)
    profiles = [trigger_profile(log, assumed, max(likeliest + k, 0)) for k in (-1, 0, 1)]
    starts = np.linspace(*START_RAD, RUNS, endpoint=False)
    return [
        simulated(log, on_start(rig, float(start)), assumed, profiles[n % len(profiles)], n + 1)
        for n, start in enumerate(starts)
    ]


def on_start(rig: Rig, start_rad: float) -> Rig:
    """The rig with a start angle of its hammer, if it has one."""
    if rig.mechanism["kind"] != "impact":
        return rig
    return rig.with_values({"mechanism.hammer_start_rad": start_rad})


def simulated(log: Log, rig: Rig, assumed: AssumedFirmware, profile: Profile, seed: int) -> Rows:
    """Telemetry of one run as long as a log."""
    seconds = (len(log.time_s) + 2) * ROW_S
    return run_plan(
        rig, RunPlan(profile, assumed.mode, assumed.params, seconds, seed=seed)
    ).telemetry


def likeliest_rows(log: Log, rig: Rig, assumed: AssumedFirmware) -> int:
    """Rows by which the log reports the trigger late: with these the simulated duty is that of the
    log in most rows (before the first blow it follows from the trigger alone).
    """

    def equal_rows(rows: int) -> int:
        duty = simulated(log, rig, assumed, trigger_profile(log, assumed, rows), 1)["duty"]
        length = min(len(duty), len(log.time_s))
        apart = np.abs(duty[:length] - log["duty"][:length])
        return int(np.count_nonzero(apart < WIDTHS["duty"]))

    return max(TRIGGER_ROWS, key=equal_rows)


def trigger_profile(log: Log, assumed: AssumedFirmware, rows: int) -> Profile:
    """The travel of the trigger, the direction switch and the load that a log shows; trigger and
    switch are `rows` before the rows that report them. Rows are ticks of the board's clock.
    """
    share, _ = trigger_share(log)
    low, high = assumed.raw("trigger_low_count"), assumed.raw("trigger_high_count")
    counts = low + share * (high - low)
    travel = np.where(share > 0.0, (counts / (ADC_COUNTS - 1) - TRAVEL_AT_REST) / TRAVEL_SPAN, 0.0)
    ends_s = ROW_S * np.arange(1, len(log.time_s) + 1)
    time_s = np.maximum(ends_s - rows * ROW_S, 0.0)
    load_nm = hold_last_value(log["load_nm"]) if "load_nm" in log else np.zeros(len(ends_s))
    return Profile(
        travel=steps_of(time_s, travel),
        reverse=steps_of(time_s, reversed_rows(log)),
        load_nm=steps_of(ends_s - ROW_S, load_nm),
    )


def trigger_share(log: Log) -> tuple[np.ndarray, np.ndarray]:
    """Trigger (n,), 0..1, and whether it is known (n,). A board sends it with each change of its
    state and once a second. Between two messages it rises along the straight line to the next
    value, or with the duty where that is larger; it is not known while the duty falls with it.
    """
    sent = np.nan_to_num(hold_last_value(log["trigger"]))
    duty = np.abs(np.nan_to_num(log["duty"]))
    duty = np.append(duty[DUTY_ROWS:], duty[-DUTY_ROWS:])
    begins = [0, *(np.flatnonzero(np.diff(sent)) + 1), len(sent)]
    share, is_known = sent.copy(), np.ones(len(sent), bool)
    for first, last in zip(begins[:-1], begins[1:], strict=True):
        following = sent[min(last, len(sent) - 1)]
        if following > sent[first] > 0.0:
            line = np.linspace(sent[first], following, last - first, endpoint=False)
            driven = np.maximum.accumulate(duty[first:last])
            share[first:last] = np.minimum(np.maximum(line, driven), following)
        elif following < sent[first]:
            fall = first + fall_begin(duty[first:last])
            share[fall:last] = np.clip(duty[fall:last], following, sent[first])
            is_known[fall:last] = False
    return share, is_known


def fall_begin(duty: np.ndarray) -> int:
    """First row of the fall with which a duty (n,) ends; n where it does not fall."""
    rises = np.flatnonzero(np.diff(duty) > 0.0)
    top = int(rises[-1]) + 1 if len(rises) else 0
    return int(np.flatnonzero(duty == duty[top])[-1]) + 1


def reversed_rows(log: Log) -> np.ndarray:
    """Whether the direction switch is reversed in each row (n,), 1 or 0: the sign of the next duty
    that is not 0, or of the last one.
    """
    driven = np.flatnonzero(log["duty"] != 0.0)
    if not len(driven):
        return np.zeros(len(log.time_s))
    following = np.searchsorted(driven, np.arange(len(log.time_s)))
    sign = log["duty"][driven[np.minimum(following, len(driven) - 1)]]
    return (sign < 0.0).astype(float)


def steps_of(time_s: np.ndarray, values: np.ndarray) -> list[tuple[float, float]]:
    """Points of a profile that holds each value (n,) from its time (n,) on."""
    points = [(0.0, float(values[0]))]
    for k in np.flatnonzero(np.diff(values)) + 1:
        points += [(float(time_s[k]), points[-1][1]), (float(time_s[k]), float(values[k]))]
    return points


def measured_departure(
    name: str, logged: Rows, runs: Sequence[Rows], judged: np.ndarray
) -> Departure | None:
    """Where a measured signal lies outside the spread of the runs by more than the spread's width,
    for ROWS_APART of the judged rows (n,). Of rows of equal length.
    """
    values, simulated = logged[name], np.stack([run[name] for run in runs])
    least, most = simulated.min(axis=0), simulated.max(axis=0)
    width = np.maximum(most - least, WIDTHS[name])
    apart = ((values < least - width) | (values > most + width)) & judged
    in_a_row = np.convolve(apart, np.ones(ROWS_APART), "valid") >= ROWS_APART
    if not in_a_row.any():
        return None
    row = int(np.argmax(in_a_row))
    return Departure(row, name, float(values[row]), float(least[row]), float(most[row]))


def state_departure(name: str, logged: Rows, runs: Sequence[Rows], length: int) -> Departure | None:
    """Where a state changes otherwise than in any of the runs, or earlier or later than in all of
    them by more than the width of their spread, or stays where it changes in all. Of rows of equal
    length.
    """

    def departure(row: int) -> Departure:
        expected = [float(run[name][row]) for run in runs]
        return Departure(row, name, float(logged[name][row]), min(expected), max(expected))

    in_log, in_runs = changes(name, logged), [changes(name, run) for run in runs]
    for k in range(max(len(in_log), *(len(changed) for changed in in_runs))):
        simulated = [changed[k] for changed in in_runs if len(changed) > k]
        if k >= len(in_log):
            last = spread(simulated)[1]
            in_all = len(simulated) == len(runs)
            return departure(last) if in_all and last < length else None
        alike = [change for change in simulated if change.value == in_log[k].value]
        if not alike or in_log[k].last < spread(alike)[0]:
            return departure(in_log[k].last)
        if in_log[k].first > spread(alike)[1]:
            return departure(spread(alike)[1])
    return None


@dataclass(frozen=True)
class Change:
    """A change of a state to a value in one of the rows first to last: those since the message
    before the one that reports it.
    """

    first: int
    last: int
    value: float


def changes(name: str, rows: Rows) -> list[Change]:
    """The changes of a state, in their order. What the board does before its first message is
    unknown.
    """
    changed = [np.diff(rows[n]) != 0.0 for n in MESSAGES[name] if n in rows]
    messages = np.flatnonzero(np.any(changed, axis=0)) + 1
    values = rows[name]
    found = []
    for before, row in zip([0, *messages], messages, strict=False):
        if values[row] != values[row - 1] and np.isfinite(values[row - 1]):
            found.append(Change(int(before) + 1, int(row), float(values[row])))
    return found


def spread(alike: Sequence[Change]) -> tuple[int, int]:
    """First and last row in which a change is within the spread of the runs' changes."""
    first, last = min(c.first for c in alike), max(c.last for c in alike)
    width = max(last - min(c.last for c in alike), STATE_WIDTH)
    return first - width, last + width
