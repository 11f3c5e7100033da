"""Loads logs of an impact tool and its rig as a measured problem of cycle statistics."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from vgroove import _core
from vgroove.errors import VgrooveError
from vgroove.gap.catalogue.statistics import PERIOD, RUN_UP, SHAPE
from vgroove.gap.residual.agreement import MIN_CLIP_SIGMAS
from vgroove.gap.residual.clean_log import clean_log, with_common_noise
from vgroove.gap.residual.impact.cycle_statistics import StatisticPart
from vgroove.gap.residual.impact.impact_run import PLACES, ImpactRun, prepare_impact_run
from vgroove.gap.residual.impact.problem import OF_LOG, ImpactProblem, OwnValue
from vgroove.gap.residual.impact.roll_outs import MODE, PARAMETERS
from vgroove.gap.residual.impact.start_angle import START
from vgroove.gap.residual.impact.unknowns import with_nuisances
from vgroove.gap.residual.problem import SignalInfo
from vgroove.rig import Rig

KINDS = {PERIOD: "period", SHAPE: "shape of the cycle", RUN_UP: "run-up"}
OTHER_KIND = "level"


def load_impact_problem(
    logs: Sequence[Any], rig: Rig, threads: int, joints: Sequence[Rig] = ()
) -> ImpactProblem:
    """Problem of one impact tool's logs and rig, clips not yet set. joints: for each log the rig
    with its own joint (none: all have the rig's). VgrooveError for a log that cannot be judged, or
    a rig that cannot be simulated along it.
    """
    tools = list(joints) or [rig] * len(logs)
    runs, starts, nominal = [], [], []
    cleaned = with_common_noise([clean_log(*pair) for pair in zip(logs, tools, strict=True)])
    for log, tool in zip(cleaned, tools, strict=True):
        run = prepare_impact_run(log)
        nominal.append(_nominal(run, tool.parameters()))
        run, angles = with_nuisances(run, tool)
        runs.append(run)
        starts.append(angles)
    own = own_values(rig, tools, starts, bool(joints))
    problem = _joined(rig, tuple(runs), threads)
    values = [v for log_values in own for _, v in log_values]
    return replace(
        problem,
        theta0=np.concatenate([rig.parameters(), values]),
        own=tuple(tuple(one for one, _ in log_values) for log_values in own),
        starts=tuple(each[1:] for each in starts),
        load_kinds=frozenset(tool.load["kind"] for tool in tools),
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
    units = {p.signal: p.unit for run in runs for p in run.parts}
    kinds = (KINDS[PERIOD], KINDS[SHAPE], OTHER_KIND)
    regimes = (KINDS[RUN_UP], *(f"{kind}, {place}" for kind in kinds for place in PLACES))
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
        run.parts[k].signal for run in runs for k in np.unique(run.part[run.judged])
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
    """Arrays of Problem for the residuals of log j: its judged statistics."""
    kept, parts = run.judged, run.parts
    part, row = run.part[kept], run.row[kept]
    time_s = np.asarray(run.log.time_s, float)[row]
    block = run.blocks.of(time_s)
    windows = np.arange(run.windows.count) * len(PLACES) // run.windows.count
    place = run.of_places(windows, np.zeros(len(run.run_up.first), int))[kept]
    return {
        "signal": np.array([names.index(parts[k].signal) for k in part]),
        "log": np.full(len(row), j),
        "row": row,
        "time_s": time_s,
        "measured": run.measured[kept],
        "sigma": run.sigma[kept],
        "block": block,
        "regime": np.array(
            [regimes.index(_regime(parts[k], PLACES[n])) for k, n in zip(part, place, strict=True)]
        ),
        "fold": run.blocks.fold_of(block),
        "judged": run.blocks.judged(block),
    }


def _regime(part: StatisticPart, place: str) -> str:
    """Kind of a statistic, and the place along the run where it has one."""
    kind = KINDS.get(part.kind, OTHER_KIND)
    return kind if part.kind == RUN_UP else f"{kind}, {place}"
