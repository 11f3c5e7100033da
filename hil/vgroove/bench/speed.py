"""`vgroove bench speed`: the plant against general-purpose solvers, all in one run on one machine.

Speeds are given in wall time; ratios are of processor time, which does not depend on the load of
the machine by other programs.
"""

import os
import platform
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

from rich.console import Console

from vgroove.bench import (
    batch_speed,
    drive_speed,
    impact_speed,
    lockstep_speed,
    memory,
    sensitivity,
)
from vgroove.bench.impact_speed import Figure
from vgroove.bench.impact_tool import ImpactTool
from vgroove.bench.lockstep_speed import LockstepFigure, own_lockstep, own_lockstep_in_python
from vgroove.bench.own import impact_heads
from vgroove.bench.solvers import (
    EULER,
    EULER_2_US,
    FAST,
    NUMBALSODA,
    NUMBALSODA_RESTARTED,
    Missing,
    Peer,
    load_peers,
)
from vgroove.errors import VgrooveError
from vgroove.progress import Tick, step_bar

SCHEMA = "vgroove.bench_speed/1"
REFERENCE, LOCKSTEP = "vgroove, reference", "vgroove, lock-step"
IN_PYTHON = "vgroove, lock-step in Python"
# Name in the table -> names of the figures alone and in lock-step
LOCKSTEP_PAIRS = {
    FAST: (FAST, LOCKSTEP),
    IN_PYTHON: (FAST, IN_PYTHON),
    NUMBALSODA: (NUMBALSODA, NUMBALSODA_RESTARTED),
}
MUJOCO = Missing("MuJoCo (step cost)", "pip install mujoco")


@dataclass(frozen=True)
class Requirement:
    """A figure and its limit; met is None where the figure needs a peer that is missing."""

    name: str
    value: float | None
    relation: str  # "<=" or ">="
    asked: float
    met: bool | None


@dataclass(frozen=True)
class Limits:
    """The project's requirements on the speed of the plant (the comparisons: docs/plant.md)."""

    impact_wall_s: float = 0.003  # for one simulated second
    over_numbalsoda: float = 12.0  # least ratio of the times
    over_euler: float = 5.0
    lockstep_extra: float = 0.15  # largest relative increase of the time
    rollouts_per_s: float = 1000.0
    growth: float = 1.25  # largest over smallest cost
    drive_real_time: float = 20_000.0  # least ratio of simulated time to wall time
    sensitivity_runs: float = 1.5  # cost of a sensitivity in runs
    log_copies: float = 2.0  # memory of a longer run over that of its log


LIMITS = Limits()


@dataclass(frozen=True)
class Effort:
    """Seconds of the drivetrain's run, seed of the drawn runs and tools, timed rounds."""

    seconds: int
    seed: int
    repeats: int


def bench_speed(
    seconds: int = 10, seed: int = 1, repeats: int = 5, console: Console | None = None
) -> dict[str, Any]:
    """All figures of one run, ready for JSON; a progress bar on a console that is a terminal.

    Raises VgrooveError without numba.
    """
    try:
        import numba  # noqa: F401
    except ImportError as error:
        raise VgrooveError(
            "The reference and most peers need numba, an optional extra: run `make bench`, or "
            "pip install numba."
        ) from error
    peers, missing = load_peers()
    with step_bar(runs_of(peers, repeats), "reference", console or Console()) as tick:
        return measure(peers, missing, Effort(seconds, seed, repeats), tick)


def runs_of(peers: list[Peer], repeats: int) -> int:
    """How often `measure` calls `tick`."""
    batch = 1 + 2 * repeats
    growth = repeats * (len(batch_speed.TIMES_MS) + len(batch_speed.SIZES))
    impact = impact_speed.runs_of(len(owns()), len(peers), repeats) + sensitivity.runs_of(peers)
    return impact + batch + growth + repeats * (2 + len(drive_speed.load_solvers()))


def own_prepare(mode: str) -> impact_speed.Prepare:
    """The plant's impact mode as the comparison runs it."""

    def prepare(tool: ImpactTool) -> Callable[[], float]:
        run = impact_heads([tool], impact_speed.ROWS, mode)
        return lambda: float(run()[0])

    return prepare


def owns() -> dict[str, impact_speed.Prepare]:
    """The modes in which the plant is timed, by name."""
    return {
        FAST: own_prepare("fast"),
        LOCKSTEP: own_lockstep,
        IN_PYTHON: own_lockstep_in_python,
        REFERENCE: own_prepare("reference"),
    }


def measure(
    peers: list[Peer], missing: list[Missing], effort: Effort, tick: Tick
) -> dict[str, Any]:
    """Measure impact mode, lock-step, batch, growth, drivetrain and memory, one after the other."""
    seed, repeats = effort.seed, effort.repeats
    impact = impact_speed.measure(owns(), peers, repeats, tick)
    tolerances = sensitivity.measure_tolerances(own_prepare("fast"), peers, impact, repeats, tick)
    rtol = next((f.tolerance for f in impact if f.name == NUMBALSODA and f.case == "slip_60"), None)
    batch = batch_speed.measure_batch(seed, repeats, rtol, tick)
    costs = batch_speed.measure_growth(seed, repeats, tick)
    drive, sensitivity_runs = drive_speed.measure_drive(effort.seconds, seed, repeats, tick)
    memories = memory.measure_memory()
    lockstep, step_s = lockstep_speed.pairs(impact, LOCKSTEP_PAIRS), mujoco_step_s()
    requirements = [
        *impact_requirements(impact, lockstep),
        tolerance_requirement(tolerances),
        *batch_requirements(batch, costs),
        *drive_requirements(drive, sensitivity_runs),
        *memory_requirements(memories),
    ]
    return {
        "schema": SCHEMA,
        "cpu": cpu_name(),
        "cores": os.cpu_count(),
        "busy": busy_share(impact),
        "seed": seed,
        "repeats": repeats,
        "drive_seconds": effort.seconds,
        "asked": [asdict(r) for r in requirements],
        "impact": [
            asdict(f) | {"ratio": f.cpu_seconds / own_cpu_seconds(impact, f.case)} for f in impact
        ],
        "tolerances": [asdict(f) for f in tolerances],
        "lockstep": [asdict(f) for f in lockstep],
        "batch": [asdict(f) for f in batch],
        "growth": [asdict(c) for c in costs],
        "memory": [asdict(m) for m in memories],
        "drive": [asdict(f) | {"ratio": f.cpu_seconds / drive[0].cpu_seconds} for f in drive],
        "drive_sensitivity_runs": sensitivity_runs,
        "mujoco_step_s": step_s,
        "missing": [asdict(m) for m in missing + ([MUJOCO] if step_s is None else [])],
    }


def cpu_name() -> str:
    """Name of the processor by /proc/cpuinfo, else of the architecture."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as text:
            return next(
                (line.split(":", 1)[1].strip() for line in text if line.startswith("model name")),
                platform.machine(),
            )
    except OSError:
        return platform.machine()


def mujoco_step_s() -> float | None:
    """Seconds of a step of MuJoCo; None where it is missing."""
    try:
        from vgroove.bench.mujoco_step import seconds_per_step
    except ImportError:
        return None
    return seconds_per_step()


def busy_share(figures: list[Figure]) -> float:
    """Share of the wall time of single-threaded solvers that the machine spent on other
    programs.
    """
    return 1.0 - sum(f.cpu_seconds for f in figures) / sum(f.seconds for f in figures)


def own_cpu_seconds(figures: list[Figure], case: str) -> float:
    """Processor seconds of the plant's fast mode on a joint."""
    return next(f.cpu_seconds for f in figures if f.name == FAST and f.case == case)


def worst_ratio(figures: list[Figure], name: str) -> float | None:
    """A peer's time over the plant's, on the joint where it is smallest."""
    ratios = [f.cpu_seconds / own_cpu_seconds(figures, f.case) for f in figures if f.name == name]
    return min(ratios, default=None)


def at_most(name: str, value: float, limit: float) -> Requirement:
    """A figure that must not exceed its limit."""
    return Requirement(name, value, "<=", limit, bool(value <= limit))


def at_least(name: str, value: float | None, limit: float) -> Requirement:
    """A figure that must reach its limit; None without its peer."""
    return Requirement(name, value, ">=", limit, None if value is None else bool(value >= limit))


def impact_requirements(figures: list[Figure], lockstep: list[LockstepFigure]) -> list[Requirement]:
    """Speed and accuracy of impact mode, alone and in lock-step."""
    own = [f for f in figures if f.name == FAST]
    extra = [f.extra for f in lockstep if f.name == FAST]
    ratios = {name: worst_ratio(figures, name) for name in (NUMBALSODA, EULER_2_US, EULER)}
    wall_s, error = max(f.seconds for f in own), max(f.head_error for f in own)
    over_lsoda, over_euler = LIMITS.over_numbalsoda, LIMITS.over_euler
    return [
        at_most("impact: wall s per simulated s", wall_s, LIMITS.impact_wall_s),
        at_most("impact: error of the head's angle", error, impact_speed.ACCURACY),
        at_least("impact: times as fast as numbalsoda", ratios[NUMBALSODA], over_lsoda),
        at_least("impact: times as fast as Euler at 2 us", ratios[EULER_2_US], over_euler),
        at_least("impact: times as fast as Euler at equal accuracy", ratios[EULER], over_euler),
        at_most("impact: share that lock-step costs more", max(extra), LIMITS.lockstep_extra),
    ]


def tolerance_requirement(found: list[sensitivity.ToleranceFigure]) -> Requirement:
    """Speed of impact mode against numbalsoda at the peer's cheapest passing tolerance."""
    return at_least(
        "impact: times as fast as numbalsoda, cheapest tolerance",
        sensitivity.least_ratio(found, NUMBALSODA),
        LIMITS.over_numbalsoda,
    )


def batch_requirements(
    batch: list[batch_speed.BatchFigure], costs: list[batch_speed.Cost]
) -> list[Requirement]:
    """Throughput and accuracy of a batch, and the growth of the cost."""
    own, by_time = batch[0], batch_speed.growth(costs, "time")
    by_batch = batch_speed.growth(costs, "batch")
    return [
        at_least("batch: one-second roll-outs per second", own.per_second, LIMITS.rollouts_per_s),
        at_most("batch: error of the head's angle", own.head_error, impact_speed.ACCURACY),
        at_most("growth with time: largest over smallest cost", by_time, LIMITS.growth),
        at_most("growth with batch: largest over smallest cost", by_batch, LIMITS.growth),
    ]


def drive_requirements(
    drive: list[drive_speed.DriveFigure], sensitivity_runs: float
) -> list[Requirement]:
    """Speed and accuracy of the drivetrain, and the cost of a sensitivity."""
    own, runs = drive[0], LIMITS.sensitivity_runs
    return [
        at_least("drivetrain: times real time", own.times_real_time, LIMITS.drive_real_time),
        at_most("drivetrain: error of the speed", own.speed_error, drive_speed.ACCURACY),
        at_most("drivetrain: runs that a sensitivity costs", sensitivity_runs, runs),
    ]


def memory_requirements(found: list[memory.Memory]) -> list[Requirement]:
    """Memory of a longer run: at most LIMITS.log_copies copies of its columns."""
    name = "{}: memory of a longer run over its log's"
    return [
        at_most(name.format(of), memory.growth_over_log(found, of), LIMITS.log_copies)
        for of in memory.RUNS
    ]
