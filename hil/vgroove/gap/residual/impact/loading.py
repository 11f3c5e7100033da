"""Loads logs of an impact tool and its rig as a measured problem of cycle statistics."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from vgroove import _core
from vgroove.errors import VgrooveError
from vgroove.gap.catalogue.statistics import PERIOD, SHAPE
from vgroove.gap.residual.agreement import MIN_CLIP_SIGMAS
from vgroove.gap.residual.impact.cycle_statistics import StatisticPart
from vgroove.gap.residual.impact.impact_run import PLACES, ImpactRun, prepare_impact_run
from vgroove.gap.residual.impact.problem import OF_LOG, ImpactProblem, OwnValue
from vgroove.gap.residual.impact.roll_outs import (
    MODE,
    PARAMETERS,
    START,
    choose_starts,
    from_starts,
    simulate_statistics,
    start_angles,
)
from vgroove.gap.residual.problem import SignalInfo
from vgroove.rig import Rig

KINDS = {PERIOD: "period", SHAPE: "shape of the cycle"}
OTHER_KIND = "level"
# scatter over the start angles, in standard deviations of a log's statistic, above which the
# statistic is not judged
MAX_START_SHARE = 5.0
# Relative standard deviation of a slip torque along the joint, which no log states: wood and
# lubricated threads vary by a few per cent from place to place (an estimate)
SLIP_TORQUE, ROUGHNESS = "effects.thread_friction.relative", 0.03


def load_impact_problem(
    logs: Sequence[Any], rig: Rig, threads: int, joints: Sequence[Rig] = ()
) -> ImpactProblem:
    """Problem of one impact tool's logs and rig, clips not yet set. joints: for each log the rig
    with its own joint (none: all have the rig's). VgrooveError for a log that cannot be judged, or
    a rig that cannot be simulated along it.
    """
    tools = list(joints) or [rig] * len(logs)
    runs, starts, nominal = [], [], []
    for log, tool in zip(logs, tools, strict=True):
        run, theta = prepare_impact_run(log, tool), tool.parameters()
        nominal.append(_nominal(run, theta))
        stated = "hammer_start_rad" in rig.mechanism
        tried = theta[[PARAMETERS.index(START)]] if stated else start_angles(theta)
        neutral = without_effects(theta)
        plain = simulate_statistics(run, from_starts(neutral, tried))
        runs.append(with_roughness(with_start_scatter(run, plain), neutral))
        found = plain
        if not np.array_equal(neutral, theta):
            found = simulate_statistics(runs[-1], from_starts(theta, tried))
        starts.append(choose_starts(runs[-1], tried, found))
    own = own_values(rig, tools, starts, bool(joints))
    problem = _joined(rig, tuple(runs), threads)
    values = [v for log_values in own for _, v in log_values]
    return replace(
        problem,
        theta0=np.concatenate([rig.parameters(), values]),
        own=tuple(tuple(one for one, _ in log_values) for log_values in own),
        starts=tuple(each[1:] for each in starts),
        head_rad=max(float(np.ptp(rows["head_rad"])) for rows in nominal),
        joint_nm=max(float(np.max(rows["anvil_torque_nm"])) for rows in nominal),
    )


def own_values(
    rig: Rig, tools: Sequence[Rig], starts: Sequence[np.ndarray], own_joints: bool
) -> list[list[tuple[OwnValue, float]]]:
    """Values that each log has for itself: the start angle of the hammer that follows it best, and
    the numbers of its own joint.
    """
    column, found = len(PARAMETERS), []
    for j, (tool, angles) in enumerate(zip(tools, starts, strict=True)):
        mine = {START: float(angles[0])}
        if own_joints:
            theta = tool.parameters()
            mine |= {n: theta[k] for k, n in enumerate(PARAMETERS) if n.startswith("load.")}
        values = []
        for name, value in mine.items():
            sigma = rig.tolerance.get(name, 0.0)
            own = OwnValue(column, PARAMETERS.index(name), f"{name}{OF_LOG}{j + 1}", sigma)
            values.append((own, value))
            column += 1
        found.append(values)
    return found


def _nominal(run: ImpactRun, theta: np.ndarray) -> dict[str, np.ndarray]:
    """The rig's simulation along a log; VgrooveError for one that the plant refuses."""
    try:
        return _core.simulate_impact(run.drive, theta[None], mode=MODE)
    except (RuntimeError, ValueError) as error:
        source = run.log.source
        raise VgrooveError(f"the rig cannot be simulated along {source}: {error}") from error


def _joined(rig: Rig, runs: tuple[ImpactRun, ...], threads: int) -> ImpactProblem:
    """The arrays of all logs, statistic by statistic and window by window."""
    names = judged_signals(runs)
    units = {p.signal: p.unit for run in runs for p in run.reader.parts}
    kinds = (*KINDS.values(), OTHER_KIND)
    regimes = tuple(f"{kind}, {place}" for kind in kinds for place in PLACES)
    tables = [_residual_table(j, run, names, regimes) for j, run in enumerate(runs)]
    arrays = {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}
    sigma, signal = arrays["sigma"], arrays["signal"]
    return ImpactProblem(
        rig=rig,
        runs=runs,
        theta0=rig.parameters(),
        restart_s=float(max(r.windows.rows * r.windows.row_s for r in runs)),
        threads=threads,
        signals=tuple(
            SignalInfo(n, units[n], float(np.median(sigma[signal == k])), False, False, "")
            for k, n in enumerate(names)
        ),
        regimes=regimes,
        censored=np.zeros(len(signal), bool),
        warnings=tuple(warning for run in runs for warning in run.warnings),
        clip=np.full(len(names), MIN_CLIP_SIGMAS),
        **arrays,
    )


def judged_signals(runs: Sequence[ImpactRun]) -> list[str]:
    """Signals of which any statistic is judged; VgrooveError where there is none. An irregular
    motion, whose cycles are longer than a window, has levels alone.
    """
    found = dict.fromkeys(
        part.signal
        for run in runs
        for k, part in enumerate(run.reader.parts)
        if np.isfinite(run.sigma[:, k]).any()
    )
    if not found:
        sources = ", ".join(str(run.log.source) for run in runs)
        raise VgrooveError(
            f"{sources}: nothing to judge: all statistics depend on the start angle of the hammer; "
            "record a longer run"
        )
    return list(found)


def _residual_table(
    j: int, run: ImpactRun, names: Sequence[str], regimes: Sequence[str]
) -> dict[str, np.ndarray]:
    """Arrays of Problem for the residuals of log j, in the order of ImpactRun.flat."""
    windows, parts = run.windows, run.reader.parts
    row = np.tile(windows.centre[:, None], len(parts))
    time_s = np.asarray(run.log.time_s, float)[row]
    block = run.blocks.of(time_s.ravel()).reshape(row.shape)
    place = np.arange(windows.count) * len(PLACES) // windows.count
    place_of = {name: k for k, name in enumerate(names)}
    table = {
        "signal": np.tile([place_of.get(p.signal, -1) for p in parts], (windows.count, 1)),
        "log": np.full(row.shape, j),
        "row": row,
        "time_s": time_s,
        "measured": run.measured,
        "sigma": run.sigma,
        "block": block,
        "regime": np.array([[regimes.index(_regime(p, PLACES[k])) for p in parts] for k in place]),
        "fold": run.blocks.fold_of(block),
        "judged": run.blocks.judged(block.ravel()).reshape(row.shape),
    }
    return {name: run.flat(values) for name, values in table.items()}


def _regime(part: StatisticPart, place: str) -> str:
    """Kind of a statistic, and the place along the run."""
    return f"{KINDS.get(part.kind, OTHER_KIND)}, {place}"


def with_start_scatter(run: ImpactRun, statistics: np.ndarray) -> ImpactRun:
    """The run whose standard deviations contain the scatter of statistics (M, W, K) over the start
    angles; of windows without a cycle, whose phase is not known either, their whole range. What
    shows little but the start angle is not judged.
    """
    scatter = np.nan_to_num(statistics.std(axis=0))
    scatter = np.where(
        run.windows.periodic[:, None], scatter, np.nan_to_num(np.ptp(statistics, axis=0))
    )
    sigma = np.hypot(run.sigma, scatter)
    return replace(run, sigma=np.where(scatter > MAX_START_SHARE * run.sigma, np.inf, sigma))


def with_roughness(run: ImpactRun, theta: np.ndarray) -> ImpactRun:
    """The run whose standard deviations contain the roughness of the joint: the response of the
    statistics to a slip torque that is larger throughout, times ROUGHNESS.
    """
    both = np.stack([theta, theta])
    both[1, PARAMETERS.index(SLIP_TORQUE)] = ROUGHNESS
    plain, more = simulate_statistics(run, both)
    return replace(run, sigma=np.hypot(run.sigma, np.nan_to_num(more - plain)))


def without_effects(theta: np.ndarray) -> np.ndarray:
    """Parameters (P,) with the effects of a rig off, so that standard deviations are those of the
    rig's own model, whatever effects `--out-rig` has added to it.
    """
    neutral, plain = np.array(_core.parameter_defaults(), dtype=float), theta.copy()
    effects = [k for k, name in enumerate(PARAMETERS) if name.startswith("effects.")]
    plain[effects] = neutral[effects]
    return plain
