"""`vgroove bench speed`: the plant against the solvers that a user would pick instead, all in one
run on one machine.

What a user waits is wall time; ratios are of processor time, which other programs on the machine
cannot tilt.
"""

import os
import platform
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

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
    NUMBALSODA,
    NUMBALSODA_RESTARTED,
    Missing,
    Peer,
    load_peers,
)
from vgroove.errors import VgrooveError

SCHEMA = "vgroove.bench_speed/1"
FAST, REFERENCE, LOCKSTEP = "vgroove, fast", "vgroove, reference", "vgroove, lock-step"
IN_PYTHON = "vgroove, lock-step in Python"
LOCKSTEP_PAIRS = {
    "vgroove, fast": (FAST, LOCKSTEP),
    IN_PYTHON: (FAST, IN_PYTHON),
    "numbalsoda LSODA": (NUMBALSODA, NUMBALSODA_RESTARTED),
}
MUJOCO = Missing("MuJoCo (step cost)", "pip install mujoco")
Done = Callable[[str], None]


@dataclass(frozen=True)
class Asked:
    """One figure against what was asked of it; met is None where the figure needs a peer that is
    missing.
    """

    name: str
    value: float | None
    relation: str  # "<=" or ">="
    asked: float
    met: bool | None


def bench_speed(
    seconds: int = 10, seed: int = 1, repeats: int = 5, console: Console | None = None
) -> dict[str, Any]:
    """All figures of one run, JSON-ready; a progress bar on a console that is a terminal."""
    try:
        import numba  # noqa: F401
    except ImportError as error:
        raise VgrooveError(
            "The reference and most peers need numba, an optional extra: run `make bench`, or pip install numba."
        ) from error
    peers, missing = load_peers()
    columns = (
        TextColumn("{task.description:48}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    console = console or Console()
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as progress:
        task = progress.add_task("reference", total=runs_of(peers, repeats))
        return measure(
            peers,
            missing,
            (seconds, seed, repeats),
            lambda name: progress.update(task, advance=1, description=name),
        )


def runs_of(peers: list[Peer], repeats: int) -> int:
    """How often `measure` tells its progress."""
    batch = 1 + 2 * repeats
    growth = repeats * (len(batch_speed.TIMES_MS) + len(batch_speed.SIZES))
    impact = impact_speed.runs_of(len(owns()), len(peers), repeats) + sensitivity.runs_of(peers)
    return impact + batch + growth + repeats * (2 + len(drive_speed.load_solvers()))


def own_prepare(mode: str) -> impact_speed.Prepare:
    """The plant's impact mode as the comparison asks for it."""

    def prepare(tool: ImpactTool) -> Callable[[], float]:
        run = impact_heads([tool], impact_speed.ROWS, mode)
        return lambda: float(run()[0])

    return prepare


def owns() -> dict[str, impact_speed.Prepare]:
    return {
        FAST: own_prepare("fast"),
        LOCKSTEP: own_lockstep,
        IN_PYTHON: own_lockstep_in_python,
        REFERENCE: own_prepare("reference"),
    }


def measure(
    peers: list[Peer], missing: list[Missing], run: tuple[int, int, int], done: Done
) -> dict[str, Any]:
    """Impact, lock-step, batch, growth and drivetrain in turn; run = drivetrain seconds, seed,
    repeats.
    """
    seconds, seed, repeats = run
    impact = impact_speed.measure(owns(), peers, repeats, done)
    tolerances = sensitivity.measure_sensitivity(own_prepare("fast"), peers, impact, repeats, done)
    rtol = next((f.tolerance for f in impact if f.name == NUMBALSODA and f.case == "slip_60"), None)
    batch = batch_speed.measure_batch(seed, repeats, rtol, done)
    costs = batch_speed.measure_growth(seed, repeats, done)
    drive, sensitivity_runs = drive_speed.measure_drive(seconds, seed, repeats, done)
    memories = memory.measure_memory()
    lockstep, step_s = lockstep_speed.pairs(impact, LOCKSTEP_PAIRS), mujoco_step_s()
    asked = [
        *asked_of_impact(impact, lockstep),
        *asked_of_tolerances(tolerances),
        *asked_of_batch(batch, costs),
        *asked_of_drive(drive, sensitivity_runs),
        *asked_of_memory(memories),
    ]
    return {
        "schema": SCHEMA,
        "cpu": cpu_name(),
        "cores": os.cpu_count(),
        "busy": busy_share(impact),
        "seed": seed,
        "repeats": repeats,
        "drive_seconds": seconds,
        "asked": [asdict(a) for a in asked],
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
    """The processor's name where Linux tells it."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as text:
            return next(
                (line.split(":", 1)[1].strip() for line in text if line.startswith("model name")),
                platform.machine(),
            )
    except OSError:
        return platform.machine()


def mujoco_step_s() -> float | None:
    """None where MuJoCo is missing."""
    try:
        from vgroove.bench.mujoco_step import seconds_per_step
    except ImportError:
        return None
    return seconds_per_step()


def busy_share(figures: list[Figure]) -> float:
    """Share of the time that the machine spent on other programs while single-threaded solvers ran."""
    return 1.0 - sum(f.cpu_seconds for f in figures) / sum(f.seconds for f in figures)


def own_cpu_seconds(figures: list[Figure], case: str) -> float:
    return next(f.cpu_seconds for f in figures if f.name == FAST and f.case == case)


def worst_ratio(figures: list[Figure], name: str) -> float | None:
    """A peer's time over ours, on the joint where it is smallest."""
    ratios = [f.cpu_seconds / own_cpu_seconds(figures, f.case) for f in figures if f.name == name]
    return min(ratios, default=None)


def judged(name: str, value: float | None, relation: str, asked: float) -> Asked:
    met = None if value is None else bool(value <= asked if relation == "<=" else value >= asked)
    return Asked(name, value, relation, asked, met)


def asked_of_impact(figures: list[Figure], lockstep: list[LockstepFigure]) -> list[Asked]:
    own = [f for f in figures if f.name == FAST]
    extra = [f.extra for f in lockstep if f.name == FAST]
    return [
        judged("impact: wall s per simulated s", max(f.seconds for f in own), "<=", 0.003),
        judged(
            "impact: error of the head's angle",
            max(f.head_error for f in own),
            "<=",
            impact_speed.ACCURACY,
        ),
        judged("impact: times as fast as numbalsoda", worst_ratio(figures, NUMBALSODA), ">=", 12.0),
        judged(
            "impact: times as fast as Euler at 2 us", worst_ratio(figures, EULER_2_US), ">=", 5.0
        ),
        judged("impact: the same, Euler at equal accuracy", worst_ratio(figures, EULER), ">=", 5.0),
        judged("impact: share that lock-step costs more", max(extra), "<=", 0.15),
    ]


def asked_of_tolerances(found: list[sensitivity.Sensitivity]) -> list[Asked]:
    return [
        judged(
            "impact: the same, at its cheapest tolerance that passes",
            sensitivity.least_ratio(found, NUMBALSODA),
            ">=",
            12.0,
        )
    ]


def asked_of_batch(
    batch: list[batch_speed.BatchFigure], costs: list[batch_speed.Cost]
) -> list[Asked]:
    return [
        judged("batch: one-second roll-outs per second", batch[0].per_second, ">=", 1000.0),
        judged(
            "batch: error of the head's angle", batch[0].head_error, "<=", impact_speed.ACCURACY
        ),
        judged(
            "growth with time: dearest over cheapest", batch_speed.growth(costs, "time"), "<=", 1.25
        ),
        judged(
            "growth with batch: dearest over cheapest",
            batch_speed.growth(costs, "batch"),
            "<=",
            1.25,
        ),
    ]


def asked_of_drive(drive: list[drive_speed.DriveFigure], sensitivity: float) -> list[Asked]:
    return [
        judged("drivetrain: times real time", drive[0].times_real_time, ">=", 20_000.0),
        judged("drivetrain: error of the speed", drive[0].speed_error, "<=", drive_speed.ACCURACY),
        judged("drivetrain: runs that a sensitivity costs", sensitivity, "<=", 1.5),
    ]


def asked_of_memory(found: list[memory.Memory]) -> list[Asked]:
    """Bounded by the log: every byte more that a longer run takes belongs to a copy of its columns."""
    name = "{}: memory of a longer run over its log's"
    return [
        judged(name.format(of), memory.growth_over_log(found, of), "<=", 2.0) for of in memory.RUNS
    ]
