"""The columns that drive the model: command, measured bus, load torque, open bridge."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vgroove import _core
from vgroove.errors import VgrooveError
from vgroove.gap.cleaning.denoised_command import DenoisedCommand, denoise_command
from vgroove.gap.cleaning.long_logs import BUS_A, SQUARE_A2
from vgroove.gap.cleaning.missing_values import (
    hold_last_value,
    interpolate_missing,
    interpolate_to_known_levels,
)
from vgroove.gap.cleaning.sensor_noise import resolution_of
from vgroove.gap.residual.clean_log import CleanLog
from vgroove.gap.residual.input_uncertainty import MeasuredInput, full_volt


@dataclass(frozen=True)
class CommandLimits:
    """When a column cannot be the command of a log; chosen on the tuning half of the blind set
    (docs/gap_bench.md).
    """

    max_duty: float = 1.01  # a compare value of 256 of 255 is rounding, anything above is no duty
    # speed in rpm that a shaft may gain without a command (noise, a turn by hand), besides doubling
    max_unaided_rpm: float = 100.0
    unaided_factor: float = 2.0


COMMAND = CommandLimits()
# a change of a measured voltage by fewer standard deviations of its noise is no step
STEP_SIGMAS = 4.0


@dataclass(frozen=True)
class DrivingColumns:
    """Columns that drive the plant: time_s (rows,) from 0, the command (rows,) of a kind, and the
    further arguments of _core.LogInput.
    """

    time_s: np.ndarray
    kind: str
    command: np.ndarray
    more: dict[str, Any]

    def plant(self, command: np.ndarray | None = None) -> _core.LogInput:
        """The plant's input, by default with the log's own command."""
        values = self.command if command is None else command
        return _core.LogInput(self.time_s, self.kind, values, **self.more)

    def first_rows(self, count: int) -> "DrivingColumns":
        """The columns up to a row."""
        more = {n: v[:count] if isinstance(v, np.ndarray) else v for n, v in self.more.items()}
        return replace(self, time_s=self.time_s[:count], command=self.command[:count], more=more)


@dataclass(frozen=True)
class DrivingInput:
    """The input of a log's simulation, and the measured columns that it is made from."""

    columns: DrivingColumns
    measured: MeasuredInput


def read_input(log: CleanLog) -> DrivingInput:
    """The input of a log's simulation, whose commands act in the interval before their row; a rig
    whose commands hold after their row shifts them by one row. VgrooveError for a command that is
    missing or cannot have driven the tool.
    """
    rig, time_s = log.rig, log.time_s
    command = before_rows(log, interpolate_to_known_levels(time_s, _command(log)))
    more: dict[str, Any] = {}
    if rig.bus_is_measured and log.kind == "duty":
        more["supply_v"] = _bus(log)
    load = _load_kind(log)
    if load == "torque":
        more["load_nm"] = interpolate_missing(time_s, log.columns["load_nm"])
    if log.thinned.any():
        more |= {"skipped_a2": log.columns[SQUARE_A2], "skipped_bus_a": log.columns[BUS_A]}
    if "coast" in log.columns:
        more["coast"] = _open_bridge(log)
    denoised, step_slack = None, resolution_of(log.columns[log.kind])
    if log.kind == "voltage_v":
        denoised = denoise_command(command)
        noise = np.hypot(denoised.noise_v, np.max(denoised.fast_v))
        command, step_slack = denoised.values, step_slack + STEP_SIGMAS * noise
    elif "supply_v" in more:
        denoised = DenoisedCommand(more["supply_v"], log.noise["supply_v"].sigma)
    if "slew_per_s" in rig.input:  # changes within the slack follow the ramp: noise is no step
        more |= {"slew_per_s": rig.input["slew_per_s"], "slew_slack": step_slack}
    # time since the first row: stamps far from 0 would lose digits in the plant's steps
    columns = DrivingColumns(time_s - time_s[0], log.kind, command, more | {"load_kind": load})
    measured = MeasuredInput(
        time_s,
        command,
        load_nm=more.get("load_nm"),
        current_a=log.columns.get("current_a"),
        denoised=denoised,
        bridge_closed=_bridge_closed(log, more.get("coast")),
        full_volt=full_volt(rig, log.columns),
    )
    return DrivingInput(columns, measured)


def before_rows(log: CleanLog, values: np.ndarray) -> np.ndarray:
    """Values of the bridge (rows,) in the intervals before their rows: shifted by one row where the
    rig's commands hold after them.
    """
    if not log.rig.command_holds_after:
        return values
    return np.concatenate([values[:1], values[:-1]])


def _open_bridge(log: CleanLog) -> np.ndarray:
    """State of the bridge in the interval that ends at each row (rows,): 1 open, 0 closed.

    In a rig whose commands hold after their row, the value of a row in the column `coast` holds
    after the row as well, or in the interval that ends there (docs/spec/gap.md, section 1).
    """
    coast = hold_last_value(log.columns["coast"])
    if log.kind == "current_a" or not log.rig.command_holds_after or not _coast_is_late(log):
        return before_rows(log, coast)
    log.warn(
        f"coast changes a row later than {log.kind} becomes 0 or ends to be 0: taken as the "
        "bridge's state in the interval that the row closes"
    )
    return coast


def _coast_is_late(log: CleanLog) -> bool:
    """Whether the bridge opens and closes more often one row after a change of the command to and
    from 0 than in the row of that change. Changes beside missing samples and thinned rows count as
    neither.
    """
    coast, command = log.columns["coast"], log.columns[log.kind]
    known = np.isfinite(coast) & np.isfinite(command) & ~log.thinned
    bridge, zero = np.diff(coast != 0.0), np.diff(command == 0.0)  # changes, from row 1 on
    bridge, known = bridge[1:], known[2:] & known[1:-1] & known[:-2]
    late, same = (np.count_nonzero(bridge & known & zero[k : k + len(bridge)]) for k in (0, 1))
    return late > same


def driving_values(columns: Mapping[str, np.ndarray], kind: str, source: str) -> np.ndarray:
    """The column (rows,) of a log's columns that drives the model; VgrooveError, which names the
    source, where it is missing or holds no value.
    """
    if kind not in columns:
        raise VgrooveError(
            f"{source}: the column {kind} is missing, which drives the model according to the rig"
        )
    if not np.isfinite(columns[kind]).any():
        raise VgrooveError(
            f"{source}: the column {kind}, which drives the model according to the rig, holds no "
            "value"
        )
    return columns[kind]


def _command(log: CleanLog) -> np.ndarray:
    """The column that drives the model; VgrooveError for one that cannot have driven the tool."""
    kind = log.kind
    command = driving_values(log.columns, kind, log.source)
    top = np.nanmax(np.abs(command))
    if kind == "duty" and top > COMMAND.max_duty:
        raise VgrooveError(
            f"{log.source}: the column duty reaches {top:.4g}: a duty lies within -1..1 "
            "(is it in percent?)"
        )
    unloaded = log.rig.load["kind"] == "none"
    if unloaded and not np.nan_to_num(command).any() and "speed_rpm" in log.columns:
        _refuse_unaided_start(log)
    return command


def _refuse_unaided_start(log: CleanLog) -> None:
    """VgrooveError for a command that is always 0 although the shaft speeds up: the tool had
    another command. (A log that begins in motion may run down without one.)
    """
    speed = log.columns["speed_rpm"]
    speed = np.abs(speed[np.isfinite(speed)])
    if len(speed) == 0:
        return
    begin, fast = float(np.median(speed[: len(speed) // 50 + 1])), float(np.percentile(speed, 95))
    if fast > COMMAND.unaided_factor * begin + COMMAND.max_unaided_rpm:
        raise VgrooveError(
            f"{log.source}: the column {log.kind} is 0 throughout while the shaft speeds up from "
            f"{begin:.4g} to {fast:.4g} rpm: it is not the command of this log"
        )


def _bus(log: CleanLog) -> np.ndarray:
    """The measured bus voltage (rows,) in V."""
    if "supply_v" not in log.columns:
        raise VgrooveError(
            f"{log.source}: the column supply_v is missing, which drives the model according to "
            "the rig (input.bus)"
        )
    return interpolate_missing(log.time_s, log.columns["supply_v"])


def _load_kind(log: CleanLog) -> str:
    """The rig's load; none, with a warning, for a load torque that the log does not hold."""
    load = log.rig.load["kind"]
    if load != "torque" or "load_nm" in log.columns:
        return load
    log.warn("the rig has a load torque but the log no column load_nm: taken as no load")
    return "none"


def _bridge_closed(log: CleanLog, is_open: np.ndarray | None) -> np.ndarray:
    """Whether a voltage drives the motor at each row (rows,), so that its back-EMF brakes it.
    is_open: as _open_bridge(); None: never open.
    """
    if log.kind == "current_a":
        return np.zeros(len(log.time_s), dtype=bool)
    return np.ones(len(log.time_s), dtype=bool) if is_open is None else is_open == 0.0
