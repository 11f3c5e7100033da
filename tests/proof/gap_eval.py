"""Diagnoses folders of labelled cases and counts right verdicts:
`gap_eval.py DIR [DIR ...] [--jobs N] [--json FILE]`; a label is read after its verdict.
"""

import argparse
import json
import os
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

# as on the command line: the plant has its own threads
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from vgroove.gap import diagnose  # noqa: E402
from vgroove.rig import read_rig  # noqa: E402

# A gap below this after retuning: the stated tolerances explain the effect, and `none` is right
# (docs/spec/gap.md, section 5)
HIDDEN = 1.05
SURE = 0.9  # probability from which a first name counts as confident


def diagnose_case(folder: Path) -> dict[str, Any]:
    """Verdict and label of one case; an exception is a wrong verdict with its message."""
    start, busy = time.perf_counter(), time.process_time()
    try:
        verdict = diagnose([folder / "log.csv"], read_rig(folder / "rig.toml")).as_dict()
    except Exception as error:  # the other cases are counted
        verdict = {
            "verdict": f"crash: {error}",
            "selected": [],
            "indistinguishable": [],
            "effects": [],
            "gap": dict.fromkeys(("before", "retuned", "after"), float("nan")) | {"closed": None},
        }
    seconds, busy = time.perf_counter() - start, time.process_time() - busy
    label = json.loads((folder / "label.json").read_text())
    return {
        "case": str(folder),
        "label": label,
        "verdict": verdict,
        "seconds": seconds,
        "cpu_seconds": busy,
    } | score(label, verdict)


def score(label: dict[str, Any], verdict: dict[str, Any]) -> dict[str, Any]:
    """right: verdict and names as labelled; first: the first name is true; tie: ambiguous with the
    true effects among the rivals; hidden: the verdict is none, and retuning alone brings the gap
    below HIDDEN.
    """
    wanted, named, kind = label.get("accept", []), verdict["selected"], verdict["verdict"]
    if label["label"] != "effect":
        return {
            "right": kind == label["label"],
            "first": kind == label["label"],
            "tie": False,
            "hidden": False,
        }
    rivals = {r["id"] for r in verdict["indistinguishable"]} | set(named)
    right = (
        kind == "effect"
        and len(named) == len(wanted)
        and all(any(i in ids for i in named) for ids in wanted)
    )
    return {
        "right": right,
        "first": bool(named) and any(named[0] in ids for ids in wanted),
        "tie": kind == "ambiguous" and all(any(i in ids for i in rivals) for ids in wanted),
        "hidden": kind == "none" and verdict["gap"]["retuned"] < HIDDEN <= verdict["gap"]["before"],
    }


def row(result: dict[str, Any]) -> str:
    """One line on a case."""
    label, verdict, gap = result["label"], result["verdict"], result["verdict"]["gap"]
    truth = "+".join(label["ids"]) or label.get("what", "none")
    mark = next((m for m in ("right", "tie", "hidden") if result[m]), "WRONG")
    rivals = ",".join(r["id"] for r in verdict["indistinguishable"])
    top = verdict["effects"][0]["probability"] if verdict["effects"] else 0.0
    sizes = "/".join(f"{v:.1f}" for v in label.get("times_visible", {}).values())
    return (
        f"{mark:6s} {Path(result['case']).name} {label.get('profile', ''):11s} {truth} x{sizes} -> "
        f"{verdict['verdict']} {'+'.join(verdict['selected'])} [{rivals}] p {top:.2f} "
        f"gap {gap['before']:.2f}/{gap['retuned']:.2f}/{gap['after']:.2f} "
        f"{result['seconds']:.1f} s (cpu {result['cpu_seconds']:.1f})"
    )


def kind_of(label: dict[str, Any]) -> str:
    """none, unlisted, single, pair or triple."""
    return (
        label["label"]
        if label["label"] != "effect"
        else ("single", "pair", "triple")[min(len(label["ids"]), 3) - 1]
    )


def totals(results: list[dict[str, Any]]) -> list[str]:
    """Rates by kind of case, confident wrong names, times, wrong verdicts, closed shares."""
    lines = []
    for kind in ("none", "unlisted", "single", "pair", "triple"):
        mine = [r for r in results if kind_of(r["label"]) == kind]
        counts = {k: sum(r[k] for r in mine) for k in ("right", "tie", "hidden", "first")}
        if mine:
            lines.append(f"{kind:9s} {len(mine):4d} cases: {counts}")
    wrong = [
        r
        for r in results
        if not r["first"]
        and r["verdict"]["selected"]
        and r["verdict"]["effects"][0]["probability"] >= SURE
    ]
    lines.append(f"confident (>= {SURE:g}) wrong first name: {len(wrong)} of {len(results)}")
    for what in ("seconds", "cpu_seconds"):
        times = sorted(r[what] for r in results)
        high = times[int(0.9 * (len(times) - 1))]
        lines.append(
            f"{what}: median {times[len(times) // 2]:.1f}, 90th percentile {high:.1f}, "
            f"maximum {times[-1]:.1f}"
        )
    return lines + confusion(results) + closing(results)


def confusion(results: list[dict[str, Any]]) -> list[str]:
    """Wrong verdicts as truth -> verdict."""
    wrong = [r for r in results if not (r["right"] or r["tie"] or r["hidden"])]
    names = Counter(
        (
            "+".join(r["label"]["ids"]) or r["label"]["label"],
            f"{r['verdict']['verdict']} {'+'.join(r['verdict']['selected'])}",
        )
        for r in wrong
    )
    return [f"  {count} x {truth} -> {answer}" for (truth, answer), count in names.most_common()]


def closing(results: list[dict[str, Any]]) -> list[str]:
    """Share of the gap that right verdicts close."""
    closed = sorted(
        r["verdict"]["gap"]["closed"]
        for r in results
        if r["right"] and r["verdict"]["gap"]["closed"] is not None
    )
    return (
        [f"closed (right answers): median {closed[len(closed) // 2]:.3f}, least {closed[0]:.3f}"]
        if closed
        else []
    )


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args(arguments)
    cases, results = (
        sorted(p.parent for folder in args.folders for p in folder.rglob("label.json")),
        [],
    )
    with ProcessPoolExecutor(args.jobs) as pool:
        for result in pool.map(diagnose_case, cases):
            results.append(result)
            sys.stdout.write(row(result) + "\n")
            sys.stdout.flush()
    sys.stdout.write("\n".join(totals(results)) + "\n")
    if args.json:
        args.json.write_text(json.dumps(results, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
