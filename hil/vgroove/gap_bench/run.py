"""Runs the diagnosis on cases, each in a process of its own with nothing but a log and a rig; kept
verdicts let an interrupted run resume.
"""

import contextlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from vgroove.gap_bench.cases import BlindSet

KEPT = (
    "verdict",
    "selected",
    "gap",
    "where",
    "effects",
    "indistinguishable",
    "unexplained",
    "warnings",
)
BATCH = 8  # cases that are made before they are diagnosed
Job = tuple[int, str | None]  # number of a case, effect to leave out of the catalogue


def verdict_path(blind: BlindSet, engine: str, name: str, without: str | None) -> Path:
    """File of a kept verdict."""
    return (
        blind.folder
        / "verdicts"
        / engine
        / (f"{name}.json" if without is None else f"{name}.without.{without}.json")
    )


def run_cases(
    blind: BlindSet, jobs: Sequence[Job], processes: int, bar: Callable[[str, int], None]
) -> list[dict[str, Any]]:
    """Verdicts of the jobs with their cost, `processes` at a time; `bar` is called with a text and
    the number of jobs that are finished with it (0 or 1).
    """
    if not jobs:
        return []
    engine, names = blind.engine(), blind.names(sorted({number for number, _ in jobs}))

    def lacks_case(job: Job) -> bool:
        path = verdict_path(blind, engine, names[job[0]], job[1])
        return not path.exists() and not blind.case(names[job[0]]).exists()

    out = []
    with ThreadPoolExecutor(processes) as pool:
        for start in range(0, len(jobs), BATCH):
            batch = jobs[start : start + BATCH]
            missing = sorted({job[0] for job in batch if lacks_case(job)})
            if missing:
                blind.make(missing, lambda number: bar(f"case {number} made", 0))
            for found in pool.map(
                lambda job: kept_verdict(blind, engine, job[0], names[job[0]], job[1]), batch
            ):
                out.append(found)
                bar(f"case {found['number']}: {found['verdict']['verdict']}", 1)
    return out


def kept_verdict(
    blind: BlindSet, engine: str, number: int, name: str, without: str | None
) -> dict[str, Any]:
    """The verdict of an earlier run with the same engine; without one the case is diagnosed."""
    path = verdict_path(blind, engine, name, without)
    if not path.exists():
        found = diagnose_in_own_process(blind.case(name), without)
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(".part")
        part.write_text(json.dumps(found), encoding="utf-8")
        part.rename(path)
    return {"number": number, "name": name, "without": without} | json.loads(
        path.read_text(encoding="utf-8")
    )


def diagnose_in_own_process(case: Path, without: str | None) -> dict[str, Any]:
    """Verdict of `vgroove gap diagnose` in a process of its own, with the wall and processor
    seconds and the peak memory of that process.
    """
    with tempfile.TemporaryDirectory() as folder:
        for name in ("log.csv", "rig.toml"):
            shutil.copy(case / name, folder)
        command = [
            sys.executable,
            "-m",
            "vgroove.cli",
            "gap",
            "diagnose",
            "log.csv",
            "--rig",
            "rig.toml",
            "--json",
            "verdict.json",
            *(["--without", without] if without else []),
        ]
        begin = time.monotonic()
        output = Path(folder) / "output"
        with output.open("w", encoding="utf-8") as file:
            process = subprocess.Popen(command, cwd=folder, stdout=file, stderr=file)
            usage, status = wait_with_usage(process)
        seconds = time.monotonic() - begin
        verdict = failed_verdict(output, status)
        with contextlib.suppress(OSError, ValueError):
            verdict = json.loads((Path(folder) / "verdict.json").read_text(encoding="utf-8"))
    return {
        "verdict": {key: verdict.get(key) for key in KEPT},
        "seconds": round(seconds, 2),
        "cpu_seconds": round(usage.ru_utime + usage.ru_stime, 2),
        "memory_mib": round(usage.ru_maxrss / 1024.0, 1),
    }


def wait_with_usage(process: subprocess.Popen) -> tuple[Any, int]:
    """(resource usage, exit code) of a process after its end; an interrupt kills the process."""
    try:
        _, status, usage = os.wait4(process.pid, 0)
    except BaseException:
        process.kill()
        raise
    process.returncode = os.waitstatus_to_exitcode(status)
    return usage, process.returncode


def failed_verdict(output: Path, status: int) -> dict[str, Any]:
    """The verdict of a process that wrote none: its exit code and the last line of its output."""
    lines = output.read_text(encoding="utf-8", errors="replace").strip().splitlines()
    return {
        "verdict": "failed",
        "selected": [],
        "gap": {},
        "where": {},
        "effects": [],
        "indistinguishable": [],
        "unexplained": {},
        "warnings": [f"exit code {status}: {lines[-1] if lines else ''}"],
    }
