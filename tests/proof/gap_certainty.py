"""Fits the coefficients of vgroove/gap/verdict/calibration.py to opened cases of the blind set's
tuning half.

gap_certainty.py           prints the coefficients, and their scores on cases left out of the fit,
                           from docs/results/gap_certainty.json
gap_certainty.py --gather  writes that file from the verdicts that `vgroove gap bench [--removed]`
                           made with the current engine
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit

ROOT = Path(__file__).resolve().parents[2]
ROWS = ROOT / "docs" / "results" / "gap_certainty.json"
# weight of a name given where the catalogue lacked the truth: most real gaps have one in it
OF_REMOVED = 0.3
RIDGE = 0.3  # few cases: coefficients are drawn to 0 as by a normal prior of variance 1 / RIDGE
BINS = (0.0, 0.2, 0.5, 0.7, 0.9, 0.95, 1.0000001)
SURE = 0.99  # most that a verdict says


def gather() -> dict[str, Any]:
    """Every effect of the best sets of the verdicts, with its evidence and whether it is true."""
    from vgroove.gap_bench.cases import BlindSet

    blind, rows = BlindSet(ROOT, "tune"), []
    numbers = {name: number for number, name in blind.names([]).items()}
    files = sorted((blind.folder / "verdicts" / blind.engine()).glob("*.json"))
    answers = blind.answers(sorted({numbers[f.name.split(".")[0]] for f in files}))
    for file in files:
        name, *gone = file.stem.split(".without.")
        rows += [
            row(numbers[name], gone, answers[name], effect)
            for effect in json.loads(file.read_text())["verdict"]["effects"]
            if effect.get("signs")
        ]
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    ).stdout.strip()
    return {
        "commits": [commit],
        "rows": sorted(rows, key=lambda r: (r["number"], r["without"], r["id"])),
    }


def row(
    number: int, gone: list[str], answer: dict[str, Any], effect: dict[str, Any]
) -> dict[str, Any]:
    true = not gone and any(effect["id"] in ids for ids in answer["accept"])
    return {
        "number": number,
        "without": gone[0] if gone else "",
        "id": effect["id"],
        "true": true,
        "said": effect["probability"],
        "signs": effect["signs"],
    }


def table(rows: list[dict[str, Any]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """1 and the signs (n, k), whether the name is true (n,), weights (n,)."""
    x = np.array([[1.0, *r["signs"].values()] for r in rows])
    return (
        x,
        np.array([r["true"] for r in rows]),
        np.where([bool(r["without"]) for r in rows], OF_REMOVED, 1.0),
    )


def fitted(x: np.ndarray, true: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Coefficients (k,) of the logistic law; the constant has no prior."""
    side = np.where(true, 1.0, -1.0)

    def loss(b: np.ndarray) -> float:
        return float(weight @ np.logaddexp(0.0, -side * (x @ b)) + 0.5 * RIDGE * b[1:] @ b[1:])

    return np.round(minimize(loss, np.zeros(x.shape[1]), method="BFGS").x, 2)


def foreseen(rows: list[dict[str, Any]]) -> np.ndarray:
    """Probability of each name (n,) by a fit to the other cases."""
    x, true, weight = table(rows)
    case = np.array([r["number"] for r in rows])
    out = np.zeros(len(rows))
    for number in np.unique(case):
        others = case != number
        out[~others] = expit(x[~others] @ fitted(x[others], true[others], weight[others]))
    return np.minimum(out, SURE)


def figures(said: np.ndarray, true: np.ndarray) -> dict[str, Any]:
    """Brier score, log loss and reliability of probabilities (n,)."""
    kept = np.clip(said, 1.0 - SURE, SURE)
    bins = [(said >= low) & (said < high) for low, high in zip(BINS, BINS[1:], strict=False)]
    return {
        "names": len(said),
        "brier": float(np.mean((said - true) ** 2)),
        "log_loss": float(-np.mean(np.log(np.where(true, kept, 1.0 - kept)))),
        "reliability": [
            (low, int(true[b].sum()), int(b.sum())) for low, b in zip(BINS, bins, strict=False)
        ],
    }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--gather", action="store_true")
    if parser.parse_args().gather:
        ROWS.write_text(json.dumps(gather(), indent=1) + "\n")
    rows = json.loads(ROWS.read_text())["rows"]
    x, true, weight = table(rows)
    sys.stdout.write(f"COEFFICIENTS = {tuple(float(b) for b in fitted(x, true, weight))}\n")
    whole = weight == 1.0
    for name, said in (
        ("as said in the verdicts", np.array([r["said"] for r in rows])),
        ("foreseen", foreseen(rows)),
    ):
        f = figures(said[whole], true[whole])
        reliable = ", ".join(f"{low:g}: {hits}/{of}" for low, hits, of in f["reliability"] if of)
        sys.stdout.write(
            f"{name}: {f['names']} names, Brier {f['brier']:.3f}, log loss {f['log_loss']:.3f};"
            f" right from {reliable}\n"
        )


if __name__ == "__main__":
    main()
