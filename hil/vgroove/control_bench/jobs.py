"""Many runs in parallel, in worker processes, since a process holds one instance of the firmware;
finished runs may be kept on disk.
"""

import json
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from vgroove.eeprom_image import AbsentError
from vgroove.output import write_text
from vgroove.progress import Tick

Figures = dict[str, Any]
MAX_WORKERS = 2
JOBS_PER_FILE = 50  # of the files with kept figures


@dataclass(frozen=True)
class Variant:
    """A way to drive the tool: without control, or by a method of a controller."""

    name: str
    mode: str = "duty"
    params: Mapping[str, float] = field(default_factory=dict)


PLAIN = Variant("without")


@dataclass(frozen=True)
class Job:
    """One cell under one variant; a worker process calls work(variant, **cell) -> figures."""

    work: Callable[..., Figures]
    variant: Variant
    cell: Mapping[str, Any]


def run_job(job: Job) -> Figures:
    """The cell and its figures; where the firmware lacks the controller, only the reason."""
    try:
        figures = job.work(job.variant, **job.cell)
    except AbsentError as error:
        figures = {"absent": str(error)}
    return {"variant": job.variant.name, **job.cell, **figures}


def run_jobs(
    jobs: Sequence[Job],
    tick: Tick,
    text: str,
    workers: int | None = None,
    keep: Path | None = None,
) -> list[Figures]:
    """Every job's figures in the order of the jobs; `tick(text)` is called once a job.

    `keep` is a folder with figures of earlier runs of the same software, named by `text`: they are
    read instead of computed again, and those of this run are added, JOBS_PER_FILE at a time.
    """
    if keep is None:
        return _run(jobs, tick, text, workers)
    keep.mkdir(parents=True, exist_ok=True)
    found: list[Figures] = []
    for first in range(0, len(jobs), JOBS_PER_FILE):
        path = keep / f"{text.replace(' ', '_')}_{first}.json"
        found += _kept(path, jobs[first : first + JOBS_PER_FILE], tick, text, workers)
    return found


def _kept(
    path: Path, jobs: Sequence[Job], tick: Tick, text: str, workers: int | None
) -> list[Figures]:
    """Figures of the file where they belong to these jobs; else they are computed and written."""
    asked = [{"variant": job.variant.name, **job.cell} for job in jobs]
    if path.is_file():
        rows = json.loads(path.read_text(encoding="utf-8"))
        if len(rows) == len(asked) and all(
            row | cell == row for row, cell in zip(rows, asked, strict=True)
        ):
            return [_ticked(row, tick, text) for row in rows]
    rows = _run(jobs, tick, text, workers)
    write_text(path, json.dumps(rows, allow_nan=False))
    return rows


def _run(jobs: Sequence[Job], tick: Tick, text: str, workers: int | None) -> list[Figures]:
    count = min(workers or os.cpu_count() or 1, MAX_WORKERS, max(1, len(jobs)))
    if count == 1:
        return [_ticked(run_job(job), tick, text) for job in jobs]
    with ProcessPoolExecutor(count, mp_context=get_context("spawn")) as pool:
        return [_ticked(figures, tick, text) for figures in pool.map(run_job, jobs, chunksize=4)]


def _ticked(figures: Figures, tick: Tick, text: str) -> Figures:
    tick(text)
    return figures


def present(rows: Sequence[Figures]) -> list[Figures]:
    """Rows of the controllers that the firmware has."""
    return [row for row in rows if "absent" not in row]


def absent_lines(rows: Sequence[Figures], part: str) -> list[str]:
    """One sentence for each controller that the firmware lacks."""
    reasons = {row["variant"]: row["absent"] for row in rows if "absent" in row}
    return [f"{part}, {variant}: absent ({reason})." for variant, reason in reasons.items()]
