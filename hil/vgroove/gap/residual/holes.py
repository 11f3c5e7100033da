"""Holes: missing-data intervals of the command (docs/rig.md). The samples from each up to the next
restart are left out, because the state from which the model continues after it is unknown.
"""

from dataclasses import dataclass

import numpy as np

from vgroove.gap.cleaning.logging_interval import median_interval_s, pauses_of
from vgroove.gap.cleaning.missing_values import MIN_KNOWN_SHARE
from vgroove.gap.residual.channels import Channel
from vgroove.gap.residual.clean_log import CleanLog
from vgroove.gap.residual.restarts import Restarts, StateObserver, find_restarts


@dataclass(frozen=True)
class HoleRules:
    """When missing samples of the command count as a hole; chosen on the tuning half of the blind
    set (docs/gap_bench.md).
    """

    # a hole that is no pause of the logger (cleaning/logging_interval.py) counts if the command
    # changes in it by more than this share of its span: the row in which it stepped is unknown
    min_step_share: float = 0.1
    # share of a log's rows that may be left out after such steps; above it these holes are ignored
    max_step_rows_share: float = 0.1


@dataclass(frozen=True)
class MotionStartRules:
    """When a log begins in motion: its first speed is observed within max_start_s, and the slowest
    of its first speeds is above a share of the fastest and above the noise. Chosen on the tuning
    half of the blind set.
    """

    speeds: int = 4  # observations that are tested
    max_start_s: float = 0.02
    min_speed_share: float = 0.5
    min_speed_sigmas: float = 10.0
    # without a restart within this time from the first row the whole log is judged
    max_first_restart_s: float = 0.15


HOLES, IN_MOTION = HoleRules(), MotionStartRules()
BEFORE_LOG = -1  # row before a hole that begins before the log

Hole = tuple[int, int]  # the rows before and after a hole


def find_restarts_and_holes(
    log: CleanLog, observer: StateObserver, moving: bool
) -> tuple[Restarts, list[Hole]]:
    """Restarts of a log, some soon after each hole of its command, and the holes; moving: the log
    begins in motion. The thinned rows between two stretches of a reduced log are a hole.
    """
    thinned = log.thinned
    command, slew_per_s = log.columns[log.kind], log.rig.input.get("slew_per_s", 0.0)
    begin = [0] * moving
    holes = _holes(log.time_s, command, log.interval_s)
    steps = _steps_in_holes(log.time_s, command, slew_per_s)
    steps = [hole for hole in steps if not _is_thinned(hole, thinned)]
    resume = begin + [row for _, row in holes + steps]
    restarts = find_restarts(observer, log.time_s, log.restart_s, resume, thinned)
    if _share_left_out(steps, restarts.rows, len(log.time_s)) <= HOLES.max_step_rows_share:
        holes += steps
    else:  # a command that steps in every hole: little would be left
        resume = begin + [row for _, row in holes]
        restarts = find_restarts(observer, log.time_s, log.restart_s, resume, thinned)
    return restarts, holes + (_unknown_start(restarts, log.time_s) if moving else [])


def _holes(time_s: np.ndarray, command: np.ndarray, interval_s: float) -> list[Hole]:
    """Intervals in which the command is unknown: missing rows or missing samples, and the pauses of
    a logger that writes bursts of rows in which the command changes, at an unknown time.
    """
    known = np.flatnonzero(np.isfinite(command))
    known_s = time_s[known]
    short = pauses_of(known_s, median_interval_s(known_s))
    changed = short[_is_step(known_s, command[known], 0.0)[short]]
    holes = np.union1d(pauses_of(known_s, interval_s), changed)
    return [(int(known[k]), int(known[k + 1])) for k in holes]


def _is_step(time_s: np.ndarray, command: np.ndarray, slew_per_s: float) -> np.ndarray:
    """Whether the command (n,) changes faster than its slew rate between neighbouring rows
    (n - 1,), by more than min_step_share of its span.
    """
    limit = slew_per_s * np.diff(time_s) + HOLES.min_step_share * np.ptp(command)
    return np.abs(np.diff(command)) > limit


def _steps_in_holes(time_s: np.ndarray, command: np.ndarray, slew_per_s: float) -> list[Hole]:
    """Missing samples in which the command stepped at an unknown row; empty for a command that is
    sampled less often than the rows.
    """
    known = np.flatnonzero(np.isfinite(command))
    if len(known) < MIN_KNOWN_SHARE * len(command):
        return []
    stepped = (np.diff(known) > 1) & _is_step(time_s[known], command[known], slew_per_s)
    return [(int(known[k]), int(known[k + 1])) for k in np.flatnonzero(stepped)]


def _share_left_out(holes: list[Hole], starts: np.ndarray, rows: int) -> float:
    """Share of a log's rows from each hole up to the next restart."""
    ends = np.append(starts, rows)
    return sum(int(ends[np.searchsorted(ends, after)]) - before for before, after in holes) / rows


def begins_in_motion(observer: StateObserver, time_s: np.ndarray) -> bool:
    """Whether a log begins in motion."""
    speed = observer.speed
    if speed is None or len(speed.value) < IN_MOTION.speeds:
        return False
    if speed.start_s[0] > time_s[0] + IN_MOTION.max_start_s:
        return False
    first = np.abs(speed.value[: IN_MOTION.speeds])
    return bool(
        first.min() > IN_MOTION.min_speed_share * first.max()
        and first.min() > IN_MOTION.min_speed_sigmas * speed.sigma[0]
    )


def _unknown_start(restarts: Restarts, time_s: np.ndarray) -> list[Hole]:
    """A hole at the beginning of a log that begins in motion, so that it is judged from its first
    restart on: the state at its first row is known only roughly.
    """
    latest = time_s[0] + IN_MOTION.max_first_restart_s
    early = restarts.rows[(restarts.rows > 0) & (time_s[restarts.rows] < latest)]
    return [(BEFORE_LOG, 1)] if len(early) and restarts.measured[0, 1] != 0.0 else []


def _is_thinned(hole: Hole, thinned: np.ndarray) -> bool:
    """Whether thinned rows of a reduced log (rows,) lie in a hole."""
    return bool(thinned[hole[0] + 1 : hole[1]].any())


def count_inner(holes: list[Hole], thinned: np.ndarray) -> int:
    """Holes that lie within the log and are not thinned rows (rows,) of a reduced one."""
    return sum(hole[0] > BEFORE_LOG and not _is_thinned(hole, thinned) for hole in holes)


def select_known(channel: Channel, starts: np.ndarray, holes: list[Hole]) -> Channel:
    """The channel without samples that a restart (rows starts) cuts in two, and without those from
    each hole up to the next restart.
    """
    return _outside_holes(_uncut(channel, starts), starts, holes)


def _uncut(channel: Channel, starts: np.ndarray) -> Channel:
    window = np.searchsorted(starts, channel.row, side="right")
    first_window = np.searchsorted(starts, channel.first_row(), side="right")
    return channel.select((window == first_window) & (channel.first_row() >= 0))


def _outside_holes(channel: Channel, starts: np.ndarray, holes: list[Hole]) -> Channel:
    keep = np.ones(len(channel.row), dtype=bool)
    for before, after in holes:
        later = starts[starts >= after]
        until = int(later[0]) if later.size else np.iinfo(int).max
        keep &= (channel.row <= before) | (channel.first_row() >= until)
    return channel.select(keep)
