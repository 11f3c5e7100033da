"""Prepares one log for judgement: what drives the model, which channels are judged with which
sigma, where the model restarts, regimes.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vgroove import _core
from vgroove.errors import VgrooveError
from vgroove.gap.cleaning import sensor_noise
from vgroove.gap.cleaning.clock import correct_time_stamps
from vgroove.gap.cleaning.dead_samples import remove_dead_samples
from vgroove.gap.cleaning.denoised_command import DenoisedCommand, denoise_command
from vgroove.gap.cleaning.lost_rows import insert_lost_rows
from vgroove.gap.cleaning.missing_values import (
    MIN_KNOWN_SHARE,
    hold_last_value,
    interpolate_missing,
    interpolate_to_known_levels,
)
from vgroove.gap.hall_edges.edge_periods import MIN_COUNTING_PULSES, EdgePeriods, near_reversal
from vgroove.gap.hall_edges.jitter import sigma_with_missed_rpm
from vgroove.gap.hall_edges.missed_edge_rows import read_edges_with_missed
from vgroove.gap.hall_edges.missed_edges import estimate_missed_edges
from vgroove.gap.hall_edges.scale import edge_scale
from vgroove.gap.hall_edges.stamp_check import stamp_contradictions
from vgroove.gap.residual import blocks
from vgroove.gap.residual.blocks import Blocks
from vgroove.gap.residual.breakaway import widen_after_breakaway
from vgroove.gap.residual.channels import (
    ENCODER,
    RAD_S_TO_RPM,
    Channel,
    ForceChannel,
    InterpolationPoints,
    RowChannel,
    span_channel,
)
from vgroove.gap.residual.input_uncertainty import drive_sigma
from vgroove.gap.residual.regimes import regimes_of
from vgroove.gap.residual.restarts import Restarts, StateObserver, find_restarts
from vgroove.gap.residual.state_observer import make_state_observer, rough_speed
from vgroove.rig import Rig
from vgroove.units import RAD_S_PER_RPM

DEFAULT_TIMEOUT_S = 0.25
# more breaks than this, and than this share of the periods: the column holds no edge periods
FEW_CHAINS, FILTERED_SHARE = 20, 0.2
LONGEST_PITCH_S = 0.02  # a filtered speed at longer periods says little about when
FORCE_ROWS = 2  # rows between the instants of a second difference, at least
# longest distance of an angle's instants, taken while it bends less than DROWNED times its noise
LONGEST_SPAN_S, DROWNED = 0.05, 4.0
DUTY_LIMIT = 1.01  # a compare value of 256 of 255 is rounding; beyond that the column is no duty
UNAIDED_RPM = 100.0  # by which a shaft may speed up without a command: noise, a hand
# a log whose first speed begins so early begins in motion; its first good state comes at most so
# late
START_S, LATEST_START_S = 0.02, 0.15
# a nominal model that is further from the count by the first edge knows nothing of the start
FIRST_TURN_RAD = 2.0 * np.pi
STEPPED = 0.1  # of a command's span: a change in a hole whose row would matter
MOST_BEHIND = 0.1  # of a log's rows, that may be left out behind such steps
# a command unknown for longer than both (seconds, usual intervals) leaves the motion after it open
HOLE_S, HOLE_ROWS = 0.02, 8


@dataclass(frozen=True)
class MeasuredRun:
    """One log prepared for judgement: the model's input, restarts, channels, blocks, and a regime
    per row.
    """

    log: Any
    drive: _core.LogInput
    restarts: Restarts
    channels: tuple[Channel, ...]
    blocks: Blocks
    regime: np.ndarray
    regimes: list[str]
    warnings: list[str]
    lost_s: np.ndarray  # instants at which edges may have been passed that no row shows
    pitch_rad: float  # between two edges; 0 without edges
    # (rows,): whether a voltage drives the motor, so that its back-EMF brakes it
    bridge_closed: np.ndarray
    edge_scale: float = 1.0  # of the edge speeds against the stamps, as the edges themselves tell
    # the angle is counted along edges from a rest that lies anywhere before the first of them
    from_rest: bool = False

    @property
    def starts(self) -> np.ndarray:
        """Rows (S,) at whose end the model starts anew."""
        return self.restarts.rows


def prepare_run(log: Any, rig: Rig, restart_s: float) -> MeasuredRun:
    """Run of a log (time_s, columns) under a rig; VgrooveError when the input is missing or nothing
    is left to judge.
    """
    log = remove_dead_samples(log, rig)
    log = insert_lost_rows(correct_time_stamps(log, stamp_contradictions(log, rig)), rig)
    time_s = np.asarray(log.time_s, dtype=float)
    columns = {name: np.asarray(values, dtype=float) for name, values in log.columns.items()}
    source, warnings = str(getattr(log, "source", "log")), list(getattr(log, "warnings", []))
    drive, command, driven = _drive(time_s, columns, rig, source, warnings)
    edges, motion = _edges(time_s, columns, rig, source, warnings), nominal_motion(drive, rig)
    edges = _with_expected(edges, time_s, motion)
    channels = _channels(time_s, columns, rig, edges, warnings)
    if not channels:
        raise VgrooveError(
            f"{source}: nothing to judge: besides the input {rig.input['kind']} no column that the model predicts"
        )
    sight = make_state_observer(time_s, columns, rig, edges, channels)
    load = (
        interpolate_missing(time_s, columns["load_nm"])
        if rig.load["kind"] == "torque" and "load_nm" in columns
        else None
    )
    closed = _bridge_closed(columns, rig, len(time_s))
    left_open = drive_sigma(
        rig, time_s, command, load, columns.get("current_a"), driven, closed, restart_s
    )
    channels = _widened(channels, time_s, left_open)
    holes = _holes(time_s, columns[rig.input["kind"]])
    steps = _steps_in_holes(time_s, columns[rig.input["kind"]], rig.input.get("slew_per_s", 0.0))
    moving = _in_motion(sight, time_s)
    from_rest = (
        edges is not None
        and "position_rad" not in columns
        and not moving
        and rig.load["kind"] != "pendulum"
    )
    if from_rest:
        sight = counted_from_rest(sight, edges, time_s, motion)
    restarts = find_restarts(
        sight, time_s, restart_s, [0] * moving + [row for _, row in holes + steps]
    )
    if _share_behind(steps, restarts.rows, len(time_s)) <= MOST_BEHIND:
        holes += steps
    else:  # a command that moves all the time steps in every hole: a guess leaves more than nothing
        restarts = find_restarts(sight, time_s, restart_s, [0] * moving + [row for _, row in holes])
    holes += _rough_start(restarts, time_s) if moving else []
    channels = tuple(
        _clear_of_holes(_clear_of_restarts(channel, restarts.rows), restarts.rows, holes)
        for channel in channels
    )
    gaps = sum(before >= 0 for before, _ in holes)
    if gaps:
        warnings.append(
            f"{source}: {gaps} holes in the command; what follows each is left out up to the next restart"
        )
    if not any(len(channel.row) for channel in channels):
        raise VgrooveError(
            f"{source}: nothing to judge: no sample is left between the holes of the log"
        )
    channels = tuple(channel for channel in channels if len(channel.row))
    channels = widen_after_breakaway(
        channels, sight.speed, rig, time_s[restarts.rows], time_s[0], moving
    )
    speed = rough_speed(time_s, sight)
    regime, regimes = regimes_of(time_s, speed, command)
    pitch = 2.0 * np.pi / rig.sensors["hall_pulses_per_rev"] if edges is not None else 0.0
    scale = edges.scale if edges is not None else 1.0
    return MeasuredRun(
        log,
        drive,
        restarts,
        channels,
        blocks.cut(time_s, blocks.stroke_s(time_s, speed)),
        regime,
        regimes,
        warnings,
        chain_starts(edges, rig.sensors.get("hall_pulses_per_rev", 0)),
        pitch,
        closed,
        scale,
        from_rest,
    )


def _command(columns: dict[str, np.ndarray], rig: Rig, source: str) -> np.ndarray:
    """The column that drives the model; VgrooveError for one that cannot have driven the tool."""
    kind = rig.input["kind"]
    if kind not in columns:
        raise VgrooveError(
            f"{source}: the column {kind} is missing, which drives the model according to the rig"
        )
    command = columns[kind]
    if not np.isfinite(command).any():
        raise VgrooveError(
            f"{source}: the column {kind}, which drives the model according to the rig, holds no value"
        )
    if kind == "duty" and np.nanmax(np.abs(command)) > DUTY_LIMIT:
        top = np.nanmax(np.abs(command))
        raise VgrooveError(
            f"{source}: the column duty reaches {top:.4g}: a duty lies within -1..1 (is it in percent?)"
        )
    if rig.load["kind"] == "none" and not np.nan_to_num(command).any() and "speed_rpm" in columns:
        _refuse_unaided_start(columns["speed_rpm"], kind, source)
    return command


def _drive(
    time_s: np.ndarray, columns: dict[str, np.ndarray], rig: Rig, source: str, warnings: list[str]
) -> tuple[_core.LogInput, np.ndarray, DenoisedCommand | None]:
    kind, command, more = rig.input["kind"], _command(columns, rig, source), {}
    if rig.bus_is_measured and kind == "duty":
        if "supply_v" not in columns:
            raise VgrooveError(
                f"{source}: the column supply_v is missing, which drives the model according to the rig (input.bus)"
            )
        more["supply_v"] = interpolate_missing(time_s, columns["supply_v"])
    load = rig.load["kind"]
    if load == "torque" and "load_nm" not in columns:
        warnings.append(
            f"{source}: the rig has a load torque but the log no column load_nm: taken as no load"
        )
        load = "none"
    if load == "torque":
        more["load_nm"] = interpolate_missing(time_s, columns["load_nm"])
    if "coast" in columns:
        more["coast"] = hold_last_value(columns["coast"])
    driving, driven, slack = (
        interpolate_to_known_levels(time_s, command),
        None,
        sensor_noise.resolution_of(command),
    )
    if kind == "voltage_v":
        driven = denoise_command(driving)
        driving, slack = (
            driven.values,
            slack + 4.0 * np.hypot(driven.noise_v, np.max(driven.fast_v)),
        )
    elif "supply_v" in more:
        driven = DenoisedCommand(
            more["supply_v"], sensor_noise.column_sigma(rig, "supply_v", columns["supply_v"])
        )
    if "slew_per_s" in rig.input:  # noise must not make steps of a ramp
        more |= {"slew_per_s": rig.input["slew_per_s"], "slew_slack": slack}
    # the plant steps in time since the first row: stamps far from 0 would cost it digits
    since = time_s - time_s[0]
    return _core.LogInput(since, kind, driving, load_kind=load, **more), driving, driven


def _bridge_closed(columns: dict[str, np.ndarray], rig: Rig, rows: int) -> np.ndarray:
    if rig.input["kind"] == "current_a":
        return np.zeros(rows, dtype=bool)
    return (
        hold_last_value(columns["coast"]) == 0.0
        if "coast" in columns
        else np.ones(rows, dtype=bool)
    )


def _refuse_unaided_start(speed_rpm: np.ndarray, kind: str, source: str) -> None:
    """A command of 0 throughout drives nothing: a log that begins fast may run down with it, one
    that speeds up has another command.
    """
    speed = np.abs(speed_rpm[np.isfinite(speed_rpm)])
    if len(speed) == 0:
        return
    begin, fast = float(np.median(speed[: len(speed) // 50 + 1])), float(np.percentile(speed, 95))
    if fast > 2.0 * begin + UNAIDED_RPM:
        raise VgrooveError(
            f"{source}: the column {kind} is 0 throughout while the shaft speeds up from {begin:.4g} to {fast:.4g} rpm: "
            "it is not the command of this log"
        )


def _edges(
    time_s: np.ndarray, columns: dict[str, np.ndarray], rig: Rig, source: str, warnings: list[str]
) -> EdgePeriods | None:
    pulses = rig.sensors.get("hall_pulses_per_rev", 0)
    if pulses == 0 or "speed_rpm" not in columns:
        return None
    found = _read_edges(
        time_s,
        columns["speed_rpm"],
        pulses,
        rig.sensors.get("speed_lsb_rpm", 0.0),
        source,
        warnings,
    )
    whole = found.chain[~found.timeout]
    if len(np.unique(whole)) <= max(FEW_CHAINS, FILTERED_SHARE * len(whole)):
        return found
    warnings.append(
        f"{source}: the speeds are no edge periods that follow one another (filtered?): compared over a pitch before each row"
    )
    return None


def _read_edges(
    time_s: np.ndarray,
    speed_rpm: np.ndarray,
    pulses: int,
    lsb_rpm: float,
    source: str,
    warnings: list[str],
) -> EdgePeriods:
    """Edge periods of a speed column whose scale against the time stamps need not be 1; speeds stay
    as they were logged.
    """
    scale = edge_scale(time_s, speed_rpm, pulses, lsb_rpm)
    found = read_edges_with_missed(time_s, speed_rpm / scale, pulses, lsb_rpm)
    if scale == 1.0:
        return found
    warnings.append(
        f"{source}: the edge periods behind speed_rpm follow one another on these time stamps only if the speeds are read "
        f"{100.0 * (scale - 1.0):+.3g} % off: the sensor's gain, or a clock"
    )
    return replace(found, speed_rpm=found.speed_rpm * scale, scale=scale)


def nominal_motion(drive: _core.LogInput, rig: Rig) -> dict[str, np.ndarray]:
    """What the nominal model does when it runs through from the first row, at rest."""
    return _core.simulate_log(
        drive,
        rig.parameters()[None],
        np.zeros(1, dtype=int),
        np.zeros((1, 3)),
        threads=1,
        unfinished="nan",
    )


def _with_expected(
    edges: EdgePeriods | None, time_s: np.ndarray, motion: dict[str, np.ndarray]
) -> EdgePeriods | None:
    """The edge periods with the speed that the nominal model has over each."""
    if edges is None:
        return None
    start, end = (
        InterpolationPoints.of(time_s, instants_s).angle(motion)[0]
        for instants_s in (edges.start_s, edges.end_s)
    )
    expected = (end - start) / (edges.end_s - edges.start_s) * RAD_S_TO_RPM
    return replace(edges, expected_rpm=expected) if np.isfinite(expected).all() else edges


def counted_from_rest(
    sight: StateObserver, edges: EdgePeriods, time_s: np.ndarray, motion: dict[str, np.ndarray]
) -> StateObserver:
    """The angle counted along the edges, from where the nominal model has come to by the first one:
    how far the shaft stood from it, and what edges a quick start hides, no row tells. A cogging
    would else start in another phase than it goes on in.
    """
    if edges.timeout.all():
        return sight
    first_s = edges.end_s[~edges.timeout][0]
    shift = float(
        InterpolationPoints.of(time_s, np.array([first_s])).angle(motion)[0, 0]
    ) - sight.angle_at(first_s)
    if not abs(shift) < FIRST_TURN_RAD:
        return sight
    return replace(sight, angle_at=lambda t: sight.angle_at(t) + (shift if t >= first_s else 0.0))


def chain_starts(edges: EdgePeriods | None, pulses: int) -> np.ndarray:
    """Instants at which a chain of edges begins that is not the first: how many edges came before
    it no row tells. A sensor that counts edges tears its chain without losing the count: there so
    many offsets would fit any ripple.
    """
    if edges is None or pulses >= MIN_COUNTING_PULSES:
        return np.zeros(0)
    whole = np.flatnonzero(~edges.timeout)
    return edges.end_s[whole[1:]][np.diff(edges.chain[whole]) != 0]


def _filtered_speed(time_s: np.ndarray, speed_rpm: np.ndarray, rig: Rig) -> Channel:
    """A speed made from edges and filtered: each row shows about the pitch that ended half a pitch
    ago, give or take that half.
    """
    pulses, timeout = (
        rig.sensors["hall_pulses_per_rev"],
        rig.sensors.get("hall_timeout_s", DEFAULT_TIMEOUT_S),
    )
    period = 60.0 / pulses / np.maximum(np.abs(interpolate_missing(time_s, speed_rpm)), 1e-6)
    start, end = time_s - 1.5 * period, time_s - 0.5 * period
    usual = (
        np.isfinite(speed_rpm)
        & (period < min(0.25 * timeout, LONGEST_PITCH_S))
        & (start > time_s[0])
    )
    middle = np.where(usual, start + end, -np.inf)
    # in order of time
    keep = np.flatnonzero(
        usual & (middle > np.maximum.accumulate(np.concatenate([[-np.inf], middle[:-1]])))
    )
    rate = np.abs(np.gradient(smooth_rows(interpolate_missing(time_s, speed_rpm)), time_s))
    sigma = np.hypot(
        sensor_noise.column_sigma(rig, "speed_rpm", speed_rpm), rate * period / np.sqrt(12.0)
    )
    return span_channel(
        "speed_rpm",
        "rpm",
        time_s,
        (start[keep], end[keep]),
        keep,
        speed_rpm[keep],
        sigma[keep],
        np.zeros(len(keep), dtype=bool),
        RAD_S_TO_RPM,
        False,
        "filtered edge speed, compared over a pitch before each row",
    )


def smooth_rows(values: np.ndarray, width: int = 5) -> np.ndarray:
    """Moving mean over an odd number of rows."""
    return np.convolve(
        np.pad(values, width // 2, mode="edge"), np.full(width, 1.0 / width), mode="valid"
    )


def _channels(
    time_s: np.ndarray,
    columns: dict[str, np.ndarray],
    rig: Rig,
    edges: EdgePeriods | None,
    warnings: list[str],
) -> list[Channel]:
    kind, found = rig.input["kind"], []
    if kind != "current_a" and "current_a" in columns:
        found.append(_current(time_s, columns, rig, warnings))
    if kind == "duty" and not rig.bus_is_measured and "supply_v" in columns:
        sigma = sensor_noise.column_sigma(rig, "supply_v", columns["supply_v"])
        found.append(_rows(time_s, columns["supply_v"], "supply_v", "V", sigma, "supply_v"))
    if edges is not None:
        found.append(_edge_speed(time_s, columns["speed_rpm"], rig, edges))
    elif rig.sensors.get("hall_pulses_per_rev", 0) and "speed_rpm" in columns:
        found.append(_filtered_speed(time_s, columns["speed_rpm"], rig))
    elif "speed_rpm" in columns and np.isfinite(columns["speed_rpm"]).any():
        sigma = sensor_noise.column_sigma(rig, "speed_rpm", columns["speed_rpm"])
        found.append(
            _rows(
                time_s,
                columns["speed_rpm"],
                "speed_rpm",
                "rpm",
                sigma,
                "speed_measured_rad_s",
                RAD_S_TO_RPM,
            )
        )
    if "position_rad" in columns and np.isfinite(columns["position_rad"]).any():
        found.append(_position(time_s, columns["position_rad"], rig))
    for channel in found:
        if (
            len(channel.row)
            and np.ptp(channel.measured) == 0.0
            and np.ptp(hold_last_value(columns[kind])) > 0.0
        ):
            warnings.append(
                f"the column {channel.column} reads {channel.measured[0]:.4g} throughout: is its sensor connected?"
            )
    return [channel for channel in found if len(channel.row)]


def _rows(
    time_s: np.ndarray,
    values: np.ndarray,
    column: str,
    unit: str,
    sigma: float,
    key: str,
    factor: float = 1.0,
    magnitude: bool = False,
    note: str = "",
) -> RowChannel:
    row = np.flatnonzero(np.isfinite(values))
    return RowChannel(
        column,
        unit,
        row,
        time_s[row],
        values[row],
        np.full(len(row), sigma),
        np.zeros(len(row), dtype=bool),
        magnitude=magnitude,
        note=note,
        key=key,
        factor=factor,
    )


def _current(
    time_s: np.ndarray, columns: dict[str, np.ndarray], rig: Rig, warnings: list[str]
) -> RowChannel:
    values = columns["current_a"]
    sigma = sensor_noise.column_sigma(rig, "current_a", values)
    unsigned = current_is_unsigned(columns, rig, sigma)
    note = (
        "the current never turns negative while the drive brakes or reverses: it is unsigned, compared by magnitude"
        if unsigned
        else ""
    )
    if unsigned:
        warnings += [] if any("unsigned" in known for known in warnings) else [note]
        values = np.abs(values)
    return _rows(
        time_s, values, "current_a", "A", sigma, "current_a", magnitude=unsigned, note=note
    )


def current_is_unsigned(columns: dict[str, np.ndarray], rig: Rig, sigma: float) -> bool:
    """Whether a current column stays positive where the nominal voltage equation says that the
    drive brakes or reverses.
    """
    current, kind = columns["current_a"], rig.input["kind"]
    if kind == "current_a" or "speed_rpm" not in columns:
        return False
    bus = (
        hold_last_value(columns["supply_v"])
        if "supply_v" in columns
        else rig.supply.get("voltage_v", 0.0)
    )
    volt = hold_last_value(columns[kind]) * (bus if kind == "duty" else 1.0)
    speed = columns["speed_rpm"] * RAD_S_PER_RPM
    expected = (volt - rig.motor["torque_constant_nm_per_a"] * speed) / rig.motor["resistance_ohm"]
    known = np.isfinite(current) & np.isfinite(expected)
    if "coast" in columns:
        known &= hold_last_value(columns["coast"]) == 0.0
    braking = known & (
        expected < -max(1.0, 8.0 * sigma, 0.05 * np.max(np.abs(expected[known]), initial=0.0))
    )
    if np.count_nonzero(braking) < 20:
        return False
    return bool(
        np.median(current[braking]) > 3.0 * sigma
        and np.quantile(current[known], 0.001) > -5.0 * sigma
    )


def _edge_speed(time_s: np.ndarray, speed_rpm: np.ndarray, rig: Rig, edges: EdgePeriods) -> Channel:
    """Speeds over their edge periods, and the rows that wait for an edge: at most one pitch over
    the time without one.
    """
    pulses = rig.sensors["hall_pulses_per_rev"]
    missed = estimate_missed_edges(edges)
    sigma = sigma_with_missed_rpm(rig, edges, missed)
    keep = ~edges.timeout & ~near_reversal(edges)
    wait_start, wait_row = _waits(
        time_s, speed_rpm, edges, rig.sensors.get("hall_timeout_s", DEFAULT_TIMEOUT_S)
    )
    start = np.concatenate([edges.start_s[keep], wait_start])
    end = np.concatenate([edges.end_s[keep], time_s[wait_row]])
    row = np.concatenate([edges.row[keep], wait_row])
    limit = 60.0 / pulses / np.maximum(end - start, 1e-9)
    waiting = np.arange(len(row)) >= np.count_nonzero(keep)
    measured = np.where(
        waiting, limit, np.concatenate([edges.speed_rpm[keep], np.zeros(len(wait_row))])
    )
    least = max(
        rig.sensors.get("speed_lsb_rpm", 0.0) / np.sqrt(12.0), sensor_noise.MIN_SIGMA["speed_rpm"]
    )
    wait_sigma = np.full(len(wait_row), float(np.median(sigma)) if len(sigma) else least)
    order = np.lexsort((waiting, row))
    later = np.searchsorted(edges.row[keep], wait_row)
    missed = np.concatenate([missed[keep], np.concatenate([missed[keep], [0]])[later]])
    channel = span_channel(
        "speed_rpm",
        "rpm",
        time_s,
        (start[order], end[order]),
        row[order],
        measured[order],
        np.concatenate([sigma[keep], wait_sigma])[order],
        waiting[order],
        RAD_S_TO_RPM,
        True,
        "compared over the measured edge periods",
    )
    return replace(channel, missed=missed[order].astype(float))


def _waits(
    time_s: np.ndarray, speed_rpm: np.ndarray, edges: EdgePeriods, timeout_s: float
) -> tuple[np.ndarray, np.ndarray]:
    """Rows without an edge since the time `start`: rows that fall, and rows that read 0 (from the
    last edge, at most the time-out ago).
    """
    whole = ~edges.timeout
    last_end, first_start = edges.end_s[whole], edges.start_s[whole]
    row = np.flatnonzero(speed_rpm == 0.0)
    now = time_s[row]
    place = np.searchsorted(edges.row[whole], row)
    since = np.concatenate([[-np.inf], last_end])[place]
    coming = np.concatenate([first_start, [np.inf]])[place]
    since = np.where((coming < now) & (coming > since), coming, np.maximum(since, now - timeout_s))
    since = np.maximum(since, time_s[0])
    real = now - since > 1e-6
    start, rows = (
        np.concatenate([edges.start_s[edges.timeout], since[real]]),
        np.concatenate([edges.row[edges.timeout], row[real]]),
    )
    order = np.argsort(rows, kind="stable")
    return start[order], rows[order]


def _position(time_s: np.ndarray, position: np.ndarray, rig: Rig) -> Channel:
    """An encoder: mean speeds over spans of rows; where the input is a current or force, the
    acceleration, so that force is compared with force.
    """
    sigma = sensor_noise.position_sigma(rig, time_s, position)
    known = np.flatnonzero(np.isfinite(position))
    if rig.input["kind"] == "current_a":
        return _force(time_s, position, known, sigma, rig)
    rows = _span_rows(time_s[known], position[known], sigma, 1)
    first, last = known[:-rows:rows], known[rows::rows]
    close = last - first <= 5 * rows
    first, last = first[close], last[close]
    length = time_s[last] - time_s[first]
    speed, spread = (position[last] - position[first]) / length, np.sqrt(2.0) * sigma / length
    channel = span_channel(
        "position_rad",
        "rad/s",
        time_s,
        (time_s[first], time_s[last]),
        last,
        speed,
        spread,
        np.zeros(len(last), dtype=bool),
        1.0,
        False,
        "compared through its derivative",
    )
    return replace(channel, sensor=ENCODER)


def _force(
    time_s: np.ndarray, position: np.ndarray, known: np.ndarray, sigma: float, rig: Rig
) -> ForceChannel:
    rows = _span_rows(time_s[known], position[known], sigma, FORCE_ROWS)
    first, middle, last = known[: -2 * rows : rows], known[rows:-rows:rows], known[2 * rows :: rows]
    count = min(len(first), len(middle), len(last))
    first, middle, last = first[:count], middle[:count], last[:count]
    length = 0.5 * (time_s[last] - time_s[first])
    even = np.abs((time_s[middle] - time_s[first]) / length - 1.0) < 1e-3
    first, middle, last, length = first[even], middle[even], last[even], length[even]
    force = (
        rig.motor["torque_constant_nm_per_a"]
        * rig.sensors.get("current_noise_a", 0.0)
        / rig.shaft_inertia_kg_m2
    )
    spread = np.hypot(np.sqrt(6.0) * sigma / length**2, force * np.sqrt(2.0 / 3.0 / rows))
    measured = (position[last] - 2.0 * position[middle] + position[first]) / length**2
    return ForceChannel(
        "position_rad",
        "rad/s^2",
        last,
        time_s[middle],
        measured,
        spread,
        np.zeros(len(last), dtype=bool),
        note="compared through its second derivative: force with force",
        places=tuple(
            InterpolationPoints.of(time_s, time_s[rows]) for rows in (first, middle, last)
        ),
        length_s=length,
    )


def _span_rows(time_s: np.ndarray, position: np.ndarray, sigma: float, least: int) -> int:
    """Rows between the instants of a difference, at least so many: more where noise would drown the
    acceleration, up to LONGEST_SPAN_S.
    """
    rows, step = least, float(np.median(np.diff(time_s))) if len(time_s) > 1 else 0.0
    while 2 * rows * step <= LONGEST_SPAN_S and 6 * rows < len(position):
        if sensor_noise.divided_differences(time_s, position, 2, rows).std() > DROWNED * sigma:
            break
        rows *= 2
    return rows


def _widened(
    channels: list[Channel], time_s: np.ndarray, drive: tuple[np.ndarray, np.ndarray]
) -> list[Channel]:
    """Channels with the part of sigma that comes in through the driving columns."""
    speed, current = drive
    more = {"A": current, "rpm": speed * RAD_S_TO_RPM, "rad/s": speed}
    return [
        replace(c, sigma=np.hypot(c.sigma, np.interp(c.time_s, time_s, more[c.unit])))
        if c.unit in more
        else c
        for c in channels
    ]


def _holes(time_s: np.ndarray, command: np.ndarray) -> list[tuple[int, int]]:
    """Rows (before, after) on both sides of each stretch in which the command is not known: missing
    rows or missing samples.
    """
    known = np.flatnonzero(np.isfinite(command))
    length = np.diff(time_s[known])
    limit = max(HOLE_S, HOLE_ROWS * float(np.median(np.diff(time_s))))
    return [(int(known[k]), int(known[k + 1])) for k in np.flatnonzero(length > limit)]


def _steps_in_holes(
    time_s: np.ndarray, command: np.ndarray, slew_per_s: float
) -> list[tuple[int, int]]:
    """Rows (before, after) on both sides of each missing sample in which the command stepped, in
    which row none tells; none of a command that comes less often than the rows.
    """
    known = np.flatnonzero(np.isfinite(command))
    if len(known) < MIN_KNOWN_SHARE * len(command):
        return []
    length, change = np.diff(time_s[known]), np.abs(np.diff(command[known]))
    stepped = (np.diff(known) > 1) & (
        change > slew_per_s * length + STEPPED * np.ptp(command[known])
    )
    return [(int(known[k]), int(known[k + 1])) for k in np.flatnonzero(stepped)]


def _share_behind(holes: list[tuple[int, int]], starts: np.ndarray, rows: int) -> float:
    """Share of a log's rows from each hole up to the next restart."""
    ends = np.append(starts, rows)
    return sum(int(ends[np.searchsorted(ends, after)]) - before for before, after in holes) / rows


def _in_motion(sight: StateObserver, time_s: np.ndarray) -> bool:
    """Whether a log begins in motion: its first speeds are there at once, and none is near rest."""
    seen = sight.speed
    if seen is None or len(seen.value) < 4 or seen.start_s[0] > time_s[0] + START_S:
        return False
    first = np.abs(seen.value[:4])
    return bool(first.min() > 0.5 * first.max() and first.min() > 10.0 * seen.sigma[0])


def _rough_start(restarts: Restarts, time_s: np.ndarray) -> list[tuple[int, int]]:
    """A log that begins in motion is judged from its first good state on, as after a hole: what
    came before is not known.
    """
    early = restarts.rows[
        (restarts.rows > 0) & (time_s[restarts.rows] < time_s[0] + LATEST_START_S)
    ]
    return [(-1, 1)] if len(early) and restarts.measured[0, 1] != 0.0 else []


def _clear_of_holes(channel: Channel, starts: np.ndarray, holes: list[tuple[int, int]]) -> Channel:
    """Drop values from each hole up to the next restart: the motion that the model goes on with
    there is a guess.
    """
    keep = np.ones(len(channel.row), dtype=bool)
    for before, after in holes:
        later = starts[starts >= after]
        until = int(later[0]) if later.size else np.iinfo(int).max
        keep &= (channel.row <= before) | (channel.first_row() >= until)
    return channel.kept(keep)


def _clear_of_restarts(channel: Channel, starts: np.ndarray) -> Channel:
    """Drop values that a restart of the model cuts in two."""
    whole = np.searchsorted(starts, channel.row, side="right") == np.searchsorted(
        starts, channel.first_row(), side="right"
    )
    return channel.kept(whole & (channel.first_row() >= 0))
