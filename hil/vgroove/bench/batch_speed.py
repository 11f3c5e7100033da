"""Batches of different tools on all cores, and the cost of impact mode over the simulated time and
over the size of the batch.
"""

import dataclasses
import os
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vgroove.bench.impact_speed import ROWS, reference_head, row_times
from vgroove.bench.impact_tool import SLIPPING, ImpactTool, rest
from vgroove.bench.own import impact_heads
from vgroove.bench.solvers import FAST, NUMBALSODA
from vgroove.bench.timing import medians
from vgroove.progress import Tick

Floats = npt.NDArray[np.float64]

OWN_BATCH, PEER_BATCH = 512, 32
CHECKED = 4  # tools of a batch whose error is computed
TIMES_MS = (500, 1000, 2000, 4000)
SIZES = (64, 128, 256, 512)
SPREAD = {  # largest relative deviation of a drawn tool's values
    "supply_v": 0.03,
    "preload_n": 0.03,
    "rate_n_m": 0.03,
    "hammer_inertia": 0.03,
    "torque_constant": 0.02,
    "run_nm": 0.2,
}


@dataclass(frozen=True)
class BatchFigure:
    """Throughput of a batch of runs of one second, in runs a second: by wall time, and on an idle
    machine (by processor time).

    head_error: the largest relative error of the head's angle among the first CHECKED tools.
    """

    name: str
    rollouts: int
    threads: int
    per_second: float
    per_second_idle: float
    head_error: float


@dataclass(frozen=True)
class Cost:
    """Processor seconds of one simulated second (`of` = time) or of one run (`of` = batch) at one
    size (s, runs).
    """

    of: str
    size: float
    seconds_each: float


def different_tools(count: int, seed: int) -> list[ImpactTool]:
    """Tools whose values of SPREAD are drawn around the reference tool."""
    rng, base = np.random.default_rng(seed), SLIPPING["slip_60"]
    factors = {name: 1.0 + width * rng.uniform(-1.0, 1.0, count) for name, width in SPREAD.items()}
    return [
        dataclasses.replace(
            base, **{name: getattr(base, name) * factor[i] for name, factor in factors.items()}
        )
        for i in range(count)
    ]


def largest_error(heads: Floats, references: Floats) -> float:
    """Largest relative error of the first heads (n,) against their references."""
    return float(np.max(np.abs(heads[: references.size] / references - 1.0)))


def measure_batch(
    seed: int, repeats: int, peer_rtol: float | None, tick: Tick
) -> list[BatchFigure]:
    """The plant's fast mode, and numbalsoda's LSODA in a parallel loop (with a tolerance
    `peer_rtol`), on the same tools.
    """
    threads = os.cpu_count() or 1
    tools = different_tools(OWN_BATCH, seed)
    references = np.array([reference_head(tool) for tool in tools[:CHECKED]])
    tick("batch: reference")
    works = {FAST: impact_heads(tools, ROWS, "fast", threads)}
    counts = {FAST: OWN_BATCH, NUMBALSODA: PEER_BATCH}
    if peer_rtol is not None:
        works[NUMBALSODA] = _numbalsoda_batch(tools[:PEER_BATCH], peer_rtol)
    seconds = medians(works, repeats, lambda name: tick(f"batch: {name}"))
    return [
        BatchFigure(
            name,
            counts[name],
            threads,
            counts[name] / seconds[name].wall,
            counts[name] * threads / seconds[name].cpu,
            largest_error(work(), references),
        )
        for name, work in works.items()
    ]


def _numbalsoda_batch(tools: list[ImpactTool], rtol: float) -> Callable[[], Floats]:
    from vgroove.bench.impact_peers import Numbalsoda

    batch, times = Numbalsoda().batch, row_times(ROWS)
    sets = np.stack([tool.vector() for tool in tools])

    def run() -> Floats:
        ends = batch(times, rest(), sets, rtol)
        return ends[:, 5] - ends[:, 7]

    return run


def measure_growth(seed: int, repeats: int, tick: Tick) -> list[Cost]:
    """Cost of a simulated second over the length of a run, and of a run over the size of a
    batch.
    """
    tools, threads = different_tools(max(SIZES), seed), os.cpu_count() or 1
    works = {("time", float(ms)): impact_heads(tools[:1], ms, "fast") for ms in TIMES_MS}
    works |= {
        ("batch", float(size)): impact_heads(tools[:size], ROWS, "fast", threads) for size in SIZES
    }
    names = {f"{of} {size:g}": (of, size) for of, size in works}
    seconds = medians(
        {name: works[key] for name, key in names.items()},
        repeats,
        lambda name: tick(f"growth: {name}"),
    )
    each = {name: size / 1000.0 if of == "time" else size for name, (of, size) in names.items()}
    return [
        Cost(of, size / 1000.0 if of == "time" else size, seconds[name].cpu / each[name])
        for name, (of, size) in names.items()
    ]


def growth(costs: list[Cost], of: str) -> float:
    """Largest over smallest cost of a unit (`of` as in Cost); 1 where the cost is linear."""
    each = [cost.seconds_each for cost in costs if cost.of == of]
    return max(each) / min(each)
