"""Diagnose a folder of labelled cases and count: `gap_eval.py DIR [DIR ...] [--jobs N] [--json FILE]`; a label is opened only after its verdict."""

import argparse
import json
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any


def judge(folder: Path) -> dict[str, Any]:
    """Verdict of one case beside its label."""
    from vgroove.gap.diagnose import diagnose
    from vgroove.rig import read_rig

    start = time.perf_counter()
    verdict = diagnose([folder / "log.csv"], read_rig(folder / "rig.toml")).verdict
    seconds = time.perf_counter() - start
    label = json.loads((folder / "label.json").read_text())
    return {"case": str(folder), "label": label, "verdict": verdict, "seconds": seconds} | score(label, verdict)


def score(label: dict[str, Any], verdict: dict[str, Any]) -> dict[str, Any]:
    """right: verdict and names as the label has them; first: the first name is one of the label's; tie: ambiguous and the truth among the rivals."""
    wanted, named = label.get("accept", []), verdict["selected"]
    rivals = {r["id"] for r in verdict["indistinguishable"]} | set(named)
    kind = verdict["verdict"]
    if label["label"] != "effect":
        return {"right": kind == label["label"], "first": kind == label["label"], "tie": False}
    matched = all(any(i in ids for i in named) for ids in wanted)
    return {"right": kind == "effect" and matched and len(named) == len(wanted), "first": bool(named) and any(named[0] in ids for ids in wanted),
            "tie": kind == "ambiguous" and all(any(i in ids for i in rivals) for ids in wanted)}


def row(result: dict[str, Any]) -> str:
    """One line about a case."""
    label, verdict = result["label"], result["verdict"]
    gap = verdict["gap"]
    truth = "+".join(label["ids"]) or label.get("what", "none")
    mark = "ok " if result["right"] else "tie" if result["tie"] else "BAD"
    rivals = ",".join(r["id"] for r in verdict["indistinguishable"])
    top = verdict["effects"][0]["probability"] if verdict["effects"] else 0.0
    return (f"{mark} {Path(result['case']).name} {label.get('profile', ''):12s} {truth:40s} {str(list(label.get('times_visible', {}).values())):14s}"
            f" -> {verdict['verdict']:9s} {'+'.join(verdict['selected']):40s} [{rivals}] p {top:.2f} {gap['before']:.2f}/{gap['retuned']:.2f}/"
            f"{gap['after']:.2f} {result['seconds']:.1f} s")


def totals(results: list[dict[str, Any]]) -> list[str]:
    """Rates by kind of case, confident wrong names, false alarms, times."""
    lines = []
    for kind in ("none", "unlisted", "single", "pair", "triple"):
        mine = [r for r in results if kind_of(r["label"]) == kind]
        if mine:
            good, ties, first = (sum(r[k] for r in mine) for k in ("right", "tie", "first"))
            lines.append(f"{kind:9s} {len(mine):4d} cases: right {good}, right or tie {good + ties}, first name right {first}")
    wrong = [r for r in results if not r["first"] and r["verdict"]["selected"] and r["verdict"]["effects"][0]["probability"] >= 0.9]
    lines.append(f"confident (>= 0.9) wrong first name: {len(wrong)} of {len(results)}")
    seconds = sorted(r["seconds"] for r in results)
    lines.append(f"seconds: median {seconds[len(seconds) // 2]:.1f}, worst tenth {seconds[int(0.9 * (len(seconds) - 1))]:.1f}, most {seconds[-1]:.1f}")
    return lines + confusion(results) + coverage(results)


def kind_of(label: dict[str, Any]) -> str:
    """none, unlisted, single, pair or triple."""
    return label["label"] if label["label"] != "effect" else ("single", "pair", "triple")[min(len(label["ids"]), 3) - 1]


def confusion(results: list[dict[str, Any]]) -> list[str]:
    """Wrong answers as truth -> answer."""
    pairs = Counter((("+".join(r["label"]["ids"]) or r["label"]["label"]), r["verdict"]["verdict"] + " " + "+".join(r["verdict"]["selected"]))
                    for r in results if not r["right"])
    return [f"  {count} x {truth} -> {answer}" for (truth, answer), count in pairs.most_common()]


def coverage(results: list[dict[str, Any]]) -> list[str]:
    """Share of gap closed where the answer is right."""
    closed = sorted(r["verdict"]["gap"]["closed"] for r in results if r["right"] and r["verdict"]["gap"]["closed"] is not None)
    return [f"closed (right answers): median {closed[len(closed) // 2]:.3f}, least {closed[0]:.3f}"] if closed else []


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args(arguments)
    cases = sorted(p.parent for folder in args.folders for p in folder.rglob("label.json"))
    results = []
    with ProcessPoolExecutor(args.jobs) as pool:
        for result in pool.map(judge, cases):
            results.append(result)
            sys.stdout.write(row(result) + "\n")
            sys.stdout.flush()
    sys.stdout.write("\n".join(totals(results)) + "\n")
    if args.json:
        args.json.write_text(json.dumps(results, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
