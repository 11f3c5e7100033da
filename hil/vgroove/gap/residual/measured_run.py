"""Prepares one log for the fit: the model's input, the channels with their standard deviations,
the restarts of the model, blocks and regimes.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from vgroove import _core
from vgroove.errors import VgrooveError
from vgroove.gap.cleaning.sensor_noise import SensorNoise
from vgroove.gap.hall_edges.edge_periods import EdgePeriods
from vgroove.gap.residual.blocks import FoldBlocks, cut_blocks, mean_stroke_s
from vgroove.gap.residual.breakaway import SpeedRecord, widen_after_breakaway
from vgroove.gap.residual.channel_builders import build_channels, widen_by_input
from vgroove.gap.residual.channels import Channel
from vgroove.gap.residual.clean_log import CleanLog
from vgroove.gap.residual.edge_reading import (
    add_expected_speed,
    align_count_to_rest,
    chain_starts,
    nominal_motion,
    read_edge_periods,
)
from vgroove.gap.residual.holes import (
    Hole,
    begins_in_motion,
    count_inner,
    find_restarts_and_holes,
    select_known,
)
from vgroove.gap.residual.immutable import freeze_arrays
from vgroove.gap.residual.input_uncertainty import input_sigma
from vgroove.gap.residual.inputs import DrivingColumns, read_input
from vgroove.gap.residual.regimes import regimes_of
from vgroove.gap.residual.restart_errors import share_restart_errors, widen_by_start_speeds
from vgroove.gap.residual.restarts import Restarts
from vgroove.gap.residual.state_observer import make_state_observer, rough_speed
from vgroove.units import TURN_RAD


@dataclass(frozen=True)
class MeasuredRun:
    """One log prepared for the fit; immutable."""

    log: Any  # the cleaned log
    driving: DrivingColumns
    drive: _core.LogInput  # the plant's input, made of them
    restarts: Restarts
    channels: tuple[Channel, ...]
    blocks: FoldBlocks
    regime: np.ndarray  # (rows,) index of the regime of motion
    regimes: tuple[str, ...]
    warnings: tuple[str, ...]
    lost_s: np.ndarray  # (k,) instants in s at which edges may have passed that no row shows
    pitch_rad: float  # motor angle between two edges; 0 without edges
    bridge_closed: np.ndarray  # (rows,) whether a voltage drives the motor and brakes it
    noise: Mapping[str, SensorNoise]  # of each measured column
    edge_scale: float = 1.0  # of the edge speeds against the time stamps, from the edges alone
    # whether the log begins with a rest at an unknown angle, and edges alone count the angle then
    from_rest: bool = False

    def __post_init__(self) -> None:
        freeze_arrays(self)


def prepare_run(clean: CleanLog) -> MeasuredRun:
    """Run of a cleaned log under its rig; VgrooveError when the input is missing or nothing is left
    to judge.
    """
    rig = clean.rig
    time_s, drive = clean.time_s, read_input(clean)
    plant = drive.columns.plant()
    edges, motion = read_edge_periods(clean), nominal_motion(plant, rig)
    if edges is not None:
        edges = add_expected_speed(edges, time_s, motion)
    channels = build_channels(clean, edges)
    observer = make_state_observer(clean, edges, channels)
    channels = widen_by_input(channels, time_s, input_sigma(rig, drive.measured, clean.restart_s))
    moving = begins_in_motion(observer, time_s)
    from_rest = not moving and _counts_from_unknown_rest(clean, edges)
    if from_rest:
        observer = align_count_to_rest(observer, edges, time_s, motion)
    restarts, holes = find_restarts_and_holes(clean, observer, moving)
    known = _known_channels(clean, channels, restarts, holes)
    known = widen_by_start_speeds(known, plant, rig, restarts)
    known = share_restart_errors(known, plant, rig, restarts)
    record = SpeedRecord(observer.speed, time_s[0], moving)
    speed = rough_speed(time_s, observer)
    regime, regimes = regimes_of(time_s, speed, drive.measured.command)
    return MeasuredRun(
        clean.log,
        drive.columns,
        plant,
        restarts,
        widen_after_breakaway(known, record, rig, time_s[restarts.rows]),
        _blocks(clean, speed),
        regime,
        regimes,
        tuple(clean.warnings),
        chain_starts(edges, clean.pulses_per_rev),
        TURN_RAD / clean.pulses_per_rev if edges is not None else 0.0,
        drive.measured.bridge_closed,
        clean.noise,
        edges.scale if edges is not None else 1.0,
        from_rest,
    )


def _blocks(log: CleanLog, speed: np.ndarray) -> FoldBlocks:
    """Blocks of a log whose shaft has the speed (rows,). The stretches of a reduced log are in both
    directions where the log is: it needs no thirds.
    """
    thinned = log.thinned
    if not thinned.any():
        return cut_blocks(log.time_s, mean_stroke_s(log.time_s, speed))
    return cut_blocks(log.time_s, np.inf).limited_to(log.time_s[~thinned])


def _counts_from_unknown_rest(log: CleanLog, edges: EdgePeriods | None) -> bool:
    """Whether edges alone measure the angle, and that of a rest is unknown: there is no encoder,
    and no pendulum, which hangs at a known angle.
    """
    without_encoder = "position_rad" not in log.columns
    return edges is not None and without_encoder and log.rig.load["kind"] != "pendulum"


def _known_channels(
    log: CleanLog, channels: list[Channel], restarts: Restarts, holes: list[Hole]
) -> tuple[Channel, ...]:
    """The channels without samples between a hole and the next restart, and without those that a
    restart cuts in two; VgrooveError when none is left.
    """
    known = [select_known(channel, restarts.rows, holes) for channel in channels]
    gaps = count_inner(holes, log.thinned)
    if gaps:
        log.warn(
            f"{gaps} holes in the command; the samples from each to the next restart are left out"
        )
    known = [channel for channel in known if len(channel.row)]
    if not known:
        raise VgrooveError(
            f"{log.source}: nothing to judge: no sample is left between the holes of the log"
        )
    return tuple(known)
