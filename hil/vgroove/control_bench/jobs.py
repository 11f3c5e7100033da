"""Many runs side by side: each in a process of its own, since the firmware is one instance a
process; what is done may be kept on disk.
"""

import json
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from vgroove.control_bench.runs import AbsentError
from vgroove.output import write_text

Figures = dict[str, Any]
Tick = Callable[[str], None]
WORKERS_MOST = 2
KEPT_JOBS = 50  # a file


@dataclass(frozen=True)
class Variant:
    """A way of driving the tool: without control, or a controller's method."""

    name: str
    mode: str = "duty"
    params: Mapping[str, float] = field(default_factory=dict)


PLAIN = Variant("without")


@dataclass(frozen=True)
class Job:
    """One cell under one variant: work(variant, **cell) -> figures, in a worker."""

    work: Callable[..., Figures]
    variant: Variant
    cell: Mapping[str, Any]


def do(job: Job) -> Figures:
    """The cell and its figures; a controller that is not there gives only the reason."""
    try:
        figures = job.work(job.variant, **job.cell)
    except AbsentError as error:
        figures = {"absent": str(error)}
    return {"variant": job.variant.name, **job.cell, **figures}


def run_jobs(
    jobs: Sequence[Job],
    tick: Tick,
    words: str,
    workers: int | None = None,
    keep: Path | None = None,
) -> list[Figures]:
    """Every job's figures in the order of the jobs; ticks once a job. `keep`: a folder with figures
    of earlier runs of the same software, which are taken from it; those of this run are added,
    KEPT_JOBS at a time.
    """
    if keep is None:
        return _run(jobs, tick, words, workers)
    keep.mkdir(parents=True, exist_ok=True)
    found: list[Figures] = []
    for first in range(0, len(jobs), KEPT_JOBS):
        path = keep / f"{words.replace(' ', '_')}_{first}.json"
        found += _kept(path, jobs[first : first + KEPT_JOBS], tick, words, workers)
    return found


def _kept(
    path: Path, jobs: Sequence[Job], tick: Tick, words: str, workers: int | None
) -> list[Figures]:
    """Figures of the file when they are of these jobs; else they are made and written."""
    asked = [{"variant": job.variant.name, **job.cell} for job in jobs]
    if path.is_file():
        rows = json.loads(path.read_text(encoding="utf-8"))
        if len(rows) == len(asked) and all(
            row | cell == row for row, cell in zip(rows, asked, strict=True)
        ):
            return [_ticked(row, tick, words) for row in rows]
    rows = _run(jobs, tick, words, workers)
    write_text(path, json.dumps(rows, allow_nan=False))
    return rows


def _run(jobs: Sequence[Job], tick: Tick, words: str, workers: int | None) -> list[Figures]:
    count = min(workers or os.cpu_count() or 1, WORKERS_MOST, max(1, len(jobs)))
    if count == 1:
        return [_ticked(do(job), tick, words) for job in jobs]
    with ProcessPoolExecutor(count, mp_context=get_context("spawn")) as pool:
        return [_ticked(figures, tick, words) for figures in pool.map(do, jobs, chunksize=4)]


def _ticked(figures: Figures, tick: Tick, words: str) -> Figures:
    tick(words)
    return figures


def present(rows: Sequence[Figures]) -> list[Figures]:
    """Those of controllers that are there."""
    return [row for row in rows if "absent" not in row]


def absent_lines(rows: Sequence[Figures], what: str) -> list[str]:
    """One sentence for each controller that is not there."""
    reasons = {row["variant"]: row["absent"] for row in rows if "absent" in row}
    return [f"{what}, {variant}: absent ({reason})." for variant, reason in reasons.items()]
