"""Runs the diagnosis on the cases, each in a process of its own that sees a log and a rig and
nothing else; kept, so that a run resumes.
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
AHEAD = 8  # cases are made in portions, so that verdicts come from the start
Job = tuple[int, str | None]


def verdict_path(blind: BlindSet, engine: str, name: str, without: str | None) -> Path:
    return (
        blind.folder
        / "verdicts"
        / engine
        / (f"{name}.json" if without is None else f"{name}.without.{without}.json")
    )


def run_cases(
    blind: BlindSet, jobs_wanted: Sequence[Job], jobs: int, tell: Callable[[int, str], None]
) -> list[dict[str, Any]]:
    """Verdicts with their cost for (number, effect to leave out or None); `tell` hears how many
    cases are made or judged.
    """
    engine, names = blind.engine(), blind.names(sorted({number for number, _ in jobs_wanted}))
    out = []
    with ThreadPoolExecutor(jobs) as pool:
        for start in range(0, len(jobs_wanted), AHEAD):
            part = jobs_wanted[start : start + AHEAD]
            missing = sorted(
                {
                    n
                    for n, without in part
                    if not verdict_path(blind, engine, names[n], without).exists()
                    and not blind.case(names[n]).exists()
                }
            )
            if missing:
                blind.make(missing, lambda number: tell(0, f"case {number} made"))
            for found in pool.map(
                lambda job: kept_verdict(blind, engine, job[0], names[job[0]], job[1]), part
            ):
                out.append(found)
                tell(1, f"case {found['number']}: {found['verdict']['verdict']}")
    return out


def kept_verdict(
    blind: BlindSet, engine: str, number: int, name: str, without: str | None
) -> dict[str, Any]:
    """The verdict of an earlier run of the same engine, or a fresh one."""
    path = verdict_path(blind, engine, name, without)
    if not path.exists():
        found = diagnose_apart(blind.case(name), without)
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(".part")
        part.write_text(json.dumps(found), encoding="utf-8")
        part.rename(path)
    return {"number": number, "name": name, "without": without} | json.loads(
        path.read_text(encoding="utf-8")
    )


def diagnose_apart(case: Path, without: str | None) -> dict[str, Any]:
    """`vgroove gap diagnose` as a user calls it, with wall and processor seconds and peak memory of
    its process.
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
        with open(Path(folder) / "said", "w", encoding="utf-8") as said:
            process = subprocess.Popen(command, cwd=folder, stdout=said, stderr=said)
            usage, status = waited(process)
        seconds = time.monotonic() - begin
        verdict = crash(Path(folder) / "said", status)
        with contextlib.suppress(OSError, ValueError):
            verdict = json.loads((Path(folder) / "verdict.json").read_text(encoding="utf-8"))
    return {
        "verdict": {key: verdict.get(key) for key in KEPT},
        "seconds": round(seconds, 2),
        "cpu_seconds": round(usage.ru_utime + usage.ru_stime, 2),
        "memory_mib": round(usage.ru_maxrss / 1024.0, 1),
    }


def waited(process: subprocess.Popen) -> tuple[Any, int]:
    """(resource usage, exit code) of a process that has ended; it is killed when the wait is
    interrupted.
    """
    try:
        _, status, usage = os.wait4(process.pid, 0)
    except BaseException:
        process.kill()
        raise
    process.returncode = os.waitstatus_to_exitcode(status)
    return usage, process.returncode


def crash(said: Path, status: int) -> dict[str, Any]:
    """A verdict that is none: what the process said last."""
    lines = said.read_text(encoding="utf-8", errors="replace").strip().splitlines()
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
