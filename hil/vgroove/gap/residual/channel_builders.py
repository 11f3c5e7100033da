"""Builds the judged channels of a log from its columns, each with the standard deviation of its
samples.
"""

from dataclasses import dataclass, replace

import numpy as np

from vgroove.errors import VgrooveError
from vgroove.gap.cleaning.missing_values import hold_last_value
from vgroove.gap.hall_edges.edge_periods import EdgePeriods
from vgroove.gap.residual.channels import Channel, ChannelInfo, ModelColumn, RowChannel, row_channel
from vgroove.gap.residual.clean_log import CleanLog
from vgroove.gap.residual.position_channels import position_channel
from vgroove.gap.residual.speed_channels import edge_speed_channel, filtered_speed_channel
from vgroove.rig import Rig
from vgroove.units import RAD_S_PER_RPM, RPM_PER_RAD_S

UNSIGNED_NOTE = (
    "the current never turns negative while the drive brakes or reverses: it is unsigned, compared "
    "by magnitude"
)


@dataclass(frozen=True)
class UnsignedCurrentTest:
    """When a current column shows magnitudes; chosen on the tuning half of the blind set
    (docs/gap_bench.md).
    """

    # the drive brakes where the expected current is negative and its magnitude exceeds all three:
    # A, sigmas of the current, share of the largest expected current
    min_braking_a: float = 1.0
    min_braking_sigmas: float = 8.0
    min_braking_share: float = 0.05
    min_rows: int = 20  # in which the drive brakes
    min_median_sigmas: float = 3.0  # an unsigned current has a larger median in the rows of braking
    # and over the whole log this quantile of it is above min_lowest_sigmas
    lowest_quantile: float = 0.001
    min_lowest_sigmas: float = -5.0


UNSIGNED = UnsignedCurrentTest()


def build_channels(log: CleanLog, edges: EdgePeriods | None) -> list[Channel]:
    """The judged channels of a log; VgrooveError where there are none."""
    built = [
        _current(log),
        _supply(log),
        _speed(log, edges),
        position_channel(log) if log.has_values("position_rad") else None,
    ]
    found = [channel for channel in built if channel is not None and len(channel.row)]
    for channel in found:
        log.warn_of_dead_sensor(channel.column, channel.measured)
    if not found:
        raise VgrooveError(
            f"{log.source}: nothing to judge: besides the input {log.kind} no column that the "
            "model predicts"
        )
    return found


def _current(log: CleanLog) -> RowChannel | None:
    if log.kind == "current_a" or "current_a" not in log.columns:
        return None
    values, sigma = log.columns["current_a"], log.noise["current_a"].sigma
    unsigned = current_is_unsigned(log.columns, log.rig, sigma)
    if unsigned:
        values = np.abs(values)
        if not any("unsigned" in known for known in log.warnings):
            log.warnings.append(UNSIGNED_NOTE)
    note = UNSIGNED_NOTE if unsigned else ""
    info = ChannelInfo("current_a", "A", magnitude=unsigned, note=note)
    return row_channel(info, log.time_s, values, sigma, ModelColumn("current_a"))


def current_is_unsigned(columns: dict[str, np.ndarray], rig: Rig, sigma: float) -> bool:
    """Whether a current column of standard deviation sigma (A) stays positive where the nominal
    voltage equation says that the drive brakes or reverses.
    """
    current, kind = columns["current_a"], rig.input["kind"]
    if kind == "current_a" or "speed_rpm" not in columns:
        return False
    expected = _expected_current(columns, rig)
    known = np.isfinite(current) & np.isfinite(expected)
    if "coast" in columns:
        known &= hold_last_value(columns["coast"]) == 0.0
    largest = np.max(np.abs(expected[known]), initial=0.0)
    limit = max(
        UNSIGNED.min_braking_a,
        UNSIGNED.min_braking_sigmas * sigma,
        UNSIGNED.min_braking_share * largest,
    )
    braking = known & (expected < -limit)
    if np.count_nonzero(braking) < UNSIGNED.min_rows:
        return False
    lowest = np.quantile(current[known], UNSIGNED.lowest_quantile)
    return bool(
        np.median(current[braking]) > UNSIGNED.min_median_sigmas * sigma
        and lowest > UNSIGNED.min_lowest_sigmas * sigma
    )


def _expected_current(columns: dict[str, np.ndarray], rig: Rig) -> np.ndarray:
    """Stationary current (rows,) in A of the nominal motor at the measured speed."""
    kind, motor = rig.input["kind"], rig.motor
    bus = rig.supply.get("voltage_v", 0.0)
    if "supply_v" in columns:
        bus = hold_last_value(columns["supply_v"])
    volt = hold_last_value(columns[kind]) * (bus if kind == "duty" else 1.0)
    speed = columns["speed_rpm"] * RAD_S_PER_RPM
    return (volt - motor["torque_constant_nm_per_a"] * speed) / motor["resistance_ohm"]


def _supply(log: CleanLog) -> RowChannel | None:
    """The bus voltage, where it does not drive the model."""
    if log.kind != "duty" or log.rig.bus_is_measured or "supply_v" not in log.columns:
        return None
    return row_channel(
        ChannelInfo("supply_v", "V"),
        log.time_s,
        log.columns["supply_v"],
        log.noise["supply_v"].sigma,
        ModelColumn("supply_v"),
    )


def _speed(log: CleanLog, edges: EdgePeriods | None) -> Channel | None:
    if edges is not None:
        return edge_speed_channel(log, edges)
    if log.pulses_per_rev and "speed_rpm" in log.columns:
        return filtered_speed_channel(log)
    if not log.has_values("speed_rpm"):
        return None
    return row_channel(
        ChannelInfo("speed_rpm", "rpm"),
        log.time_s,
        log.columns["speed_rpm"],
        log.noise["speed_rpm"].sigma,
        ModelColumn("speed_measured_rad_s", RPM_PER_RAD_S),
    )


def widen_by_input(
    channels: list[Channel],
    time_s: np.ndarray,
    input_sigma: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> list[Channel]:
    """Channels whose standard deviations contain those (rows,) of speed in rad/s, current in A and
    angle in rad that come from the input's errors.
    """
    speed, current, angle = input_sigma
    by_unit = {"A": current, "rpm": speed * RPM_PER_RAD_S, "rad/s": speed, "rad": angle}
    return [
        replace(c, sigma=np.hypot(c.sigma, np.interp(c.time_s, time_s, by_unit[c.unit])))
        if c.unit in by_unit
        else c
        for c in channels
    ]
