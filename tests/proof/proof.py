"""`make proof`: measurements that take too long for every change, written to docs/results.

An interrupted proof resumes: finished items are kept under build/proof until the commit changes.
"""

import argparse
import json
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

from diagnosed_tools import diagnosed_tools
from gap_growth import gap_growth
from plausibility import FAULTY_RUNS, RUNS, plausibility
from real_time import hil, serial_readers, streams
from rich.console import Console
from rich.progress import track
from soak import HOURS, soak

from vgroove.control_bench.control import PARTS, Choice

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "docs" / "results"
DEMO_SEEDS = range(1, 21)
# Part of the control bench -> factor of its number of draws
CONTROL_DRAWS = {
    "blows": 1,
    "blows_drawn": 4,
    "sync": 1,
    "sync_drawn": 2,
    "screwing": 3,
    "screwing_drawn": 10,
    "vibration": 1,
    "vibration_drawn": 6,
    "torque": 20,
    "torque_drawn": 1,
    "torque_adapted": 1,
    "drill": 10,
}
MAX_CONTROL_ROWS = 250  # longer lists of single runs are not committed


def commit() -> str:
    """Short hash of HEAD, with a plus sign when tracked files differ from it."""
    head = subprocess.run(
        ["git", "-C", ROOT, "rev-parse", "--short=10", "HEAD"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.strip()
    dirty = (
        subprocess.run(
            ["git", "-C", ROOT, "diff", "--quiet", "HEAD", "--", ":!docs"], check=False
        ).returncode
        != 0
    )
    return head + ("+" if dirty else "")


def kept(folder: Path, name: str, work: Callable[[], dict]) -> dict:
    """The result of an item: read from the file of an interrupted proof of the same commit where
    there is one, else computed by `work` and written to that file.
    """
    path = folder / f"{name}.json"
    if not path.exists():
        result = work()
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(result), encoding="utf-8")
    return json.loads(path.read_text(encoding="utf-8"))


def demo(tool: str, seed: int, folder: Path) -> dict:
    """The result of the demo of a tool with a seed."""
    out = folder / f"demo_{tool}_{seed}"
    command = [sys.executable, ROOT / "tests/demo/demo.py", "--seed", str(seed), "--tool", tool]
    done = subprocess.run([*command, "--out", out], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"demo {seed} ended with {done.returncode}: {done.stdout}{done.stderr}")
    return json.loads((out / "demo.json").read_text(encoding="utf-8"))


def demo_seeds(tool: str, folder: Path, jobs: int) -> dict:
    """The demo of a tool with every seed: number of right verdicts, and each verdict."""

    def of_seed(seed: int) -> dict:
        return kept(folder, f"demo_{tool}_{seed}", lambda: demo(tool, seed, folder))

    with ThreadPoolExecutor(jobs) as pool:
        work = pool.map(of_seed, DEMO_SEEDS)
        runs = list(track(work, "demo", total=len(DEMO_SEEDS)))
    rows = [
        {
            "seed": r["seed"],
            "right": r["right"],
            "verdict": r["verdict"],
            "selected": r["selected"],
            "truth": r["truth"].get("ids", []),
            "label": r["truth"]["label"],
            "before": round(r["gap"]["before"], 3),
            "after": round(r["gap"]["after"], 3),
        }
        for r in runs
    ]
    return {"right": sum(r["right"] for r in runs), "of": len(rows), "runs": rows}


def gap_bench(half: str, folder: Path, jobs: int) -> dict:
    """A half of the blind set by the command line, the single cases also without their effect in
    the catalogue; the bench keeps its verdicts itself.
    """
    out = folder / f"gap_bench_{half}.json"
    out.parent.mkdir(parents=True, exist_ok=True)
    command = [
        sys.executable,
        "-m",
        "vgroove.cli",
        "gap",
        "bench",
        "--set",
        half,
        "--removed",
        "--jobs",
        str(jobs),
        "--json",
        out,
    ]
    page = ["--page", ROOT / "docs/gap_bench.md"] if half == "report" else []
    subprocess.run([*command, *page], check=True, cwd=ROOT)
    return json.loads(out.read_text(encoding="utf-8"))


def measured_machines(folder: Path, _jobs: int) -> dict:
    """Verdicts on the measured machines, by the command line."""
    out = folder / "measured_machines.json"
    out.parent.mkdir(parents=True, exist_ok=True)
    script = ROOT / "tests/proof/measured_machines.py"
    subprocess.run([sys.executable, script, "--json", out], check=True, cwd=ROOT)
    return json.loads(out.read_text(encoding="utf-8"))


def control(part: str, folder: Path, jobs: int) -> dict:
    """All cells of a part of the controllers' bench; finished cells are kept in the folder."""
    choice = Choice(draws=CONTROL_DRAWS[part], workers=jobs, keep=folder / f"control_{part}")
    found = without_runs(PARTS[part](choice).data[part])
    goals = found.get("goals", [])
    missed = [
        f"{goal['variant']}, {goal['set']}: {goal['goal']}" for goal in goals if not goal["met"]
    ]
    return {
        "goals_met": sum(goal["met"] for goal in goals),
        "goals_asked": len(goals),
        "missed": missed,
    } | found


def gap_bench_measured(half: str, folder: Path, jobs: int) -> dict:
    """The cases with disturbances of a half of the blind set."""
    out = folder / f"gap_bench_measured_{half}.json"
    out.parent.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "vgroove.cli", "gap", "bench", "--set", half]
    more = ["--regime", "measured", "--jobs", str(jobs), "--json", out]
    subprocess.run([*command, *more], check=True, cwd=ROOT)
    return json.loads(out.read_text(encoding="utf-8"))


def without_runs(part: dict) -> dict:
    """A part without its lists of single runs, which are longer than those of cells."""
    return {
        key: value
        for key, value in part.items()
        if not (isinstance(value, list) and len(value) > MAX_CONTROL_ROWS)
    }


PROOFS = {
    "demo_seeds": partial(demo_seeds, "drive"),
    "demo_seeds_impact": partial(demo_seeds, "impact"),
    "gap_bench": partial(gap_bench, "report"),
    "gap_bench_tune": partial(gap_bench, "tune"),
    "measured_machines": measured_machines,
}
PROOFS |= {"gap_growth": lambda _folder, _jobs: gap_growth()}
PROOFS |= {"soak": lambda folder, jobs: soak(HOURS, folder, jobs, kept)}
PROOFS |= {"diagnosed_tools": lambda folder, jobs: diagnosed_tools(folder, jobs, kept)}
PROOFS |= {"plausibility": lambda _folder, jobs: plausibility(RUNS, FAULTY_RUNS, jobs)}
PROOFS |= {
    "serial_readers": lambda _folder, _jobs: serial_readers(),
    "streams": lambda folder, _jobs: streams(folder, kept),
    "hil": lambda folder, _jobs: hil(folder, kept),
}
PROOFS |= {f"control_{part}": partial(control, part) for part in CONTROL_DRAWS}
PROOFS |= {
    "gap_bench_measured": partial(gap_bench_measured, "report"),
    "gap_bench_measured_tune": partial(gap_bench_measured, "tune"),
}
GROUPS = {"control": [f"control_{part}" for part in CONTROL_DRAWS]}


def main(arguments: list[str]) -> int:
    """Run the named proofs (all when none is named) and write docs/results/NAME.json."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", choices=[*PROOFS, *GROUPS, []], default=[])
    parser.add_argument("--jobs", type=int, default=2)
    args = parser.parse_args(arguments)
    at = commit()
    RESULTS.mkdir(parents=True, exist_ok=True)
    for name in [name for asked in args.names or PROOFS for name in GROUPS.get(asked, [asked])]:
        result = {"commit": at, "command": f"python tests/proof/proof.py {name}"} | PROOFS[name](
            ROOT / "build" / "proof" / at, args.jobs
        )
        (RESULTS / f"{name}.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
        Console().print(f"{name}: written to docs/results/{name}.json")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
