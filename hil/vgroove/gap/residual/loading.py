"""Loads logs and a rig as a measured problem: checks, one prepared run per log, and the arrays of
all their channels joined.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vgroove.errors import VgrooveError
from vgroove.gap.catalogue import LOADS_BEHIND
from vgroove.gap.cleaning.held_samples import remove_held_samples
from vgroove.gap.cleaning.long_logs import reduce_long_logs
from vgroove.gap.residual.agreement import MIN_CLIP_SIGMAS, clip_sigmas
from vgroove.gap.residual.angle_alignment import align_angles
from vgroove.gap.residual.angle_comparison import with_angle_comparison
from vgroove.gap.residual.blocks import FoldBlocks
from vgroove.gap.residual.channels import Channel
from vgroove.gap.residual.clean_log import clean_log, with_common_noise
from vgroove.gap.residual.impact.loading import load_impact_problem
from vgroove.gap.residual.measured_run import MeasuredRun, prepare_run
from vgroove.gap.residual.problem import Problem, SignalInfo
from vgroove.log import COLUMN_UNITS, as_log
from vgroove.rig import Rig

# Largest magnitude of a judged value, in the unit of its column (chosen): no measurement of a tool
# comes near it, and squared sums of such values keep their precision.
MAX_MAGNITUDE = 1e9


def load_problem(
    logs: Sequence[Any],
    rig: Rig,
    restart_s: float | None = None,
    threads: int = 2,
    joints: Sequence[Rig] = (),
) -> Problem:
    """Problem of one tool's logs (Log objects or paths) and a rig; long logs are reduced
    (cleaning/long_logs.py). restart_s: time between restarts of the model in s; without it
    CleanLog.restart_s. joints: for each log of a hammering tool the rig with its own joint.

    VgrooveError when the rig's input column is missing, nothing else is measured, the plant cannot
    follow the rig along a log, or the rig's mechanism or load is not simulated.
    """
    _check_simulated(rig)
    if not logs:
        raise VgrooveError("no log to judge")
    if restart_s is not None and restart_s <= 0.0:
        raise VgrooveError("restart_s must be above 0")
    logs = [read(log) for log in logs]
    for log in logs:
        _check_magnitudes(log)
    if rig.mechanism["kind"] == "impact":
        return with_clip(load_impact_problem(logs, rig, threads, joints), {})
    logs = remove_held_samples(reduce_long_logs(logs, rig), rig)
    cleaned = with_common_noise([clean_log(log, rig, restart_s) for log in logs])
    cleaned = with_angle_comparison(cleaned)
    runs = tuple(prepare_run(log) for log in cleaned)
    problem = join_runs(rig, runs, max(log.restart_s for log in cleaned), threads)
    _check_reach(problem)
    aligned = problem.with_angles(align_angles(problem, problem.theta0, problem.angles))
    return with_clip(aligned, {})


def with_clip(problem: Problem, stated: Mapping[str, float]) -> Problem:
    """The problem with the clip of each signal: as stated by column, else from the residuals of its
    rig.
    """
    size = np.sqrt(problem.squared_unclipped(problem.residuals(problem.theta0)[0]))
    clip = []
    for k, signal in enumerate(problem.signals):
        mine = size[problem.judged & (problem.signal == k)]
        clip.append(stated.get(signal.column, clip_sigmas(mine[np.isfinite(mine)])))
    return replace(problem, clip=np.array(clip))


def read(log: Any) -> Any:
    """A log, read from its file where it is a path."""
    return as_log(log)


def _check_magnitudes(log: Any) -> None:
    """VgrooveError for a value that no sensor gives, with which the fits would fail."""
    for name, values in log.columns.items():
        large = np.flatnonzero(np.abs(values) > MAX_MAGNITUDE)
        if len(large):
            value = f"{values[large[0]]:.4g} {COLUMN_UNITS.get(name, '')}"
            raise VgrooveError(
                f"{log.source}: column {name} is {value} at {log.time_s[large[0]]:.10g} s, "
                f"which no sensor measures: magnitudes up to {MAX_MAGNITUDE:g} are accepted"
            )


def _check_simulated(rig: Rig) -> None:
    mechanism, load = rig.mechanism["kind"], rig.load["kind"]
    if mechanism not in LOADS_BEHIND:
        raise VgrooveError(
            f"a log of a tool with mechanism {mechanism} cannot be judged, "
            f"only one with mechanism {' or '.join(LOADS_BEHIND)}"
        )
    loads = LOADS_BEHIND[mechanism]
    if load not in loads:
        raise VgrooveError(
            f"a log of a tool with mechanism {mechanism} and load {load} cannot be judged, "
            f"only with {', '.join(loads)}"
        )


def _check_reach(problem: Problem) -> None:
    """VgrooveError for a rig that the plant cannot simulate along its logs. (A parameter set of a
    fit that it cannot simulate has residuals of UNFINISHED_RESIDUAL.)
    """
    try:
        problem.simulate(problem.theta0, unfinished="raise")
    except RuntimeError as error:
        raise VgrooveError(f"the rig cannot be simulated along the log: {error}") from error


@dataclass(frozen=True)
class _Part:
    """One channel of one log: the log's index, its run and the channel."""

    log: int
    run: MeasuredRun
    channel: Channel


def join_runs(rig: Rig, runs: tuple[MeasuredRun, ...], restart_s: float, threads: int) -> Problem:
    """Concatenate the channels of all logs, log by log and channel by channel, as Problem.models
    does.
    """
    parts = [_Part(j, run, channel) for j, run in enumerate(runs) for channel in run.channels]
    columns = list(dict.fromkeys(part.channel.column for part in parts))
    regimes = tuple(dict.fromkeys(name for run in runs for name in run.regimes))
    block = [part.run.blocks.of(part.channel.time_s) for part in parts]

    def joined(value: Callable[[Channel], np.ndarray]) -> np.ndarray:
        return np.concatenate([value(part.channel) for part in parts])

    sizes = [len(part.channel.row) for part in parts]
    return Problem(
        rig=rig,
        runs=runs,
        theta0=rig.parameters(),
        restart_s=restart_s,
        threads=threads,
        signals=tuple(_signal_info(column, parts) for column in columns),
        regimes=regimes,
        signal=np.repeat([columns.index(part.channel.column) for part in parts], sizes),
        log=np.repeat([part.log for part in parts], sizes),
        row=joined(lambda c: c.row),
        time_s=joined(lambda c: c.time_s),
        measured=joined(lambda c: c.measured),
        sigma=joined(lambda c: c.sigma),
        censored=joined(lambda c: c.censored),
        block=np.concatenate(block),
        regime=np.concatenate([_regime_of(part, regimes) for part in parts]),
        fold=_per_block(parts, block, FoldBlocks.fold_of),
        judged=_per_block(parts, block, FoldBlocks.judged),
        warnings=tuple(warning for run in runs for warning in run.warnings),
        clip=np.full(len(columns), MIN_CLIP_SIGMAS),
    )


def _regime_of(part: _Part, regimes: tuple[str, ...]) -> np.ndarray:
    number = np.array([regimes.index(name) for name in part.run.regimes])
    return number[part.run.regime[part.channel.row]]


def _per_block(
    parts: list[_Part],
    block: list[np.ndarray],
    value: Callable[[FoldBlocks, np.ndarray], np.ndarray],
) -> np.ndarray:
    """A property of each residual's block."""
    return np.concatenate(
        [value(part.run.blocks, numbers) for part, numbers in zip(parts, block, strict=True)]
    )


def _signal_info(column: str, parts: list[_Part]) -> SignalInfo:
    channels = [part.channel for part in parts if part.channel.column == column]
    return SignalInfo(
        column,
        channels[0].unit,
        float(np.median(np.concatenate([c.sigma for c in channels]))),
        any(c.edges for c in channels),
        any(c.magnitude for c in channels),
        "; ".join(dict.fromkeys(c.note for c in channels if c.note)),
        all(c.noise_is_known for c in channels),
    )
