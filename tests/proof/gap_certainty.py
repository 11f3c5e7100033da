"""Fits the coefficients of vgroove.gap.verdict.calibration to opened cases of the blind set's half
`tune`.

    gap_certainty.py            prints the coefficients, and their figures on cases to which they
                                were not fitted, from docs/results/gap_certainty.json
    gap_certainty.py --gather   first writes that file from the verdicts that
                                `vgroove gap bench [--removed]` has kept for this engine
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
# Weight of a verdict made without the true effect in the catalogue; below 1, since the catalogue
# has the effect of most real gaps
REMOVED_WEIGHT = 0.3
RIDGE = 0.3  # normal prior of variance 1 / RIDGE on the coefficients, since there are few cases
BINS = (0.0, 0.2, 0.5, 0.7, 0.9, 0.95, 1.0000001)
MAX_PROBABILITY = 0.99  # of a verdict


def gather() -> dict[str, Any]:
    """Every effect of the kept verdicts: the quantities from which its probability is computed
    (`signs`, docs/spec/gap.md, section 5) and whether it is true.
    """
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
    """One named effect of a verdict; `gone` is the effect that the catalogue lacked, if any."""
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
    """Regressors (n, k): a column of ones, then the `signs`; whether each name is true (n,);
    weights (n,).
    """
    x = np.array([[1.0, *r["signs"].values()] for r in rows])
    return (
        x,
        np.array([r["true"] for r in rows]),
        np.where([bool(r["without"]) for r in rows], REMOVED_WEIGHT, 1.0),
    )


def fitted(x: np.ndarray, true: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Coefficients (k,) of a logistic regression with RIDGE; the constant has no prior."""
    side = np.where(true, 1.0, -1.0)

    def loss(b: np.ndarray) -> float:
        return float(weight @ np.logaddexp(0.0, -side * (x @ b)) + 0.5 * RIDGE * b[1:] @ b[1:])

    return np.round(minimize(loss, np.zeros(x.shape[1]), method="BFGS").x, 2)


def held_out_probabilities(rows: list[dict[str, Any]]) -> np.ndarray:
    """Probability of each name (n,) by leave-one-out cross-validation over the cases."""
    x, true, weight = table(rows)
    case = np.array([r["number"] for r in rows])
    out = np.zeros(len(rows))
    for number in np.unique(case):
        others = case != number
        out[~others] = expit(x[~others] @ fitted(x[others], true[others], weight[others]))
    return np.minimum(out, MAX_PROBABILITY)


def figures(given: np.ndarray, true: np.ndarray) -> dict[str, Any]:
    """Brier score, log loss and reliability of probabilities (n,)."""
    kept = np.clip(given, 1.0 - MAX_PROBABILITY, MAX_PROBABILITY)
    bins = [(given >= low) & (given < high) for low, high in zip(BINS, BINS[1:], strict=False)]
    return {
        "names": len(given),
        "brier": float(np.mean((given - true) ** 2)),
        "log_loss": float(-np.mean(np.log(np.where(true, kept, 1.0 - kept)))),
        "reliability": [
            (low, int(true[b].sum()), int(b.sum())) for low, b in zip(BINS, bins, strict=False)
        ],
    }


def main() -> None:
    """Print the coefficients and the figures of given and of held-out probabilities."""
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
    for name, given in (
        ("given by the verdicts", np.array([r["said"] for r in rows])),
        ("held out", held_out_probabilities(rows)),
    ):
        f = figures(given[whole], true[whole])
        reliable = ", ".join(f"{low:g}: {hits}/{of}" for low, hits, of in f["reliability"] if of)
        sys.stdout.write(
            f"{name}: {f['names']} names, Brier {f['brier']:.3f}, log loss {f['log_loss']:.3f};"
            f" right from {reliable}\n"
        )


if __name__ == "__main__":
    main()
