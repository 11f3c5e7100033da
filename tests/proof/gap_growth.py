"""Growth of the cost of a diagnosis with the length of the log and with the number of effects:
`gap_growth.py [--json FILE]`, about two minutes.

The logs are runs of the plant with one effect, of several lengths. The catalogues consist of the
true effect and every n-th other one, with the mean over the n possible first ones, since effects
differ in cost. Growth is the exponent of the processor time between the smallest and the largest
size; 1 is linear.
"""

import argparse
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

# as the command line does: the plant has threads of its own
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np  # noqa: E402
from rich.console import Console  # noqa: E402

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "python"))

from made_log import drive_log, rig  # noqa: E402
from vgroove.gap import DiagnosisOptions, diagnose  # noqa: E402
from vgroove.gap.catalogue import CATALOGUE  # noqa: E402
from vgroove.html_page import Table  # noqa: E402

EFFECT = {"viscous_friction": {"nm_s_per_rad": 2.5e-6}}
SECONDS = (3.0, 6.0, 12.0, 24.0)  # lengths of the logs
EVERY = (4, 2, 1)  # catalogues of every fourth, every second and every effect
PATTERN = [(0.3, 0.35), (1.0, 0.8), (1.8, 0.5), (2.4, 1.0)]  # (time in s, duty), repeated
PERIOD_S = 3.0  # of the pattern


def cost(seconds: float, every: int = 1, begin: int = 0) -> dict[str, Any]:
    """One diagnosis: processor and wall seconds, runs of the log, named effects."""
    levels = [
        (start + PERIOD_S * n, level)
        for n in range(int(seconds / PERIOD_S))
        for start, level in PATTERN
    ]
    log = drive_log(rig().with_effects(EFFECT), seconds=seconds, levels=levels)
    kept = {next(iter(EFFECT)), *(e.id for e in CATALOGUE[begin::every])}
    wall, busy = time.perf_counter(), time.process_time()
    found = diagnose(
        [log], rig(), DiagnosisOptions(without=[e.id for e in CATALOGUE if e.id not in kept])
    )
    wall, busy = time.perf_counter() - wall, time.process_time() - busy
    return {
        "log_s": seconds,
        "effects": len(found.effects),
        "cpu_s": busy,
        "wall_s": wall,
        "runs": found.evidence.search.engine.calls,
        "named": found.selected,
    }


def mean_cost(seconds: float, every: int) -> dict[str, Any]:
    """The mean cost over the catalogues of every n-th effect."""
    parts = [cost(seconds, every, begin) for begin in range(every)]
    means = {
        key: float(np.mean([part[key] for part in parts]))
        for key in ("log_s", "effects", "cpu_s", "wall_s", "runs")
    }
    return means | {"named": sorted({name for part in parts for name in part["named"]})}


def growth(rows: list[dict[str, Any]], size: str, key: str) -> float:
    """Exponent of the cost `key` over `size`, between the smallest and the largest."""
    first, last = rows[0], rows[-1]
    return float(np.log(last[key] / first[key]) / np.log(last[size] / first[size]))


def gap_growth() -> dict[str, Any]:
    """Costs over lengths and over catalogues, and their exponents."""
    lengths, catalogues = (
        [cost(seconds) for seconds in SECONDS],
        [mean_cost(6.0, every) for every in EVERY],
    )
    return {
        "lengths": lengths,
        "catalogues": catalogues,
        "with_length": growth(lengths, "log_s", "cpu_s"),
        "with_effects": growth(catalogues, "effects", "cpu_s"),
    }


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args(arguments)
    found = gap_growth()
    header = ["log, s", "effects", "processor, s", "wall, s", "runs of the log", "named"]
    for key, size in (("lengths", "with_length"), ("catalogues", "with_effects")):
        rows = [
            [r["log_s"], r["effects"], r["cpu_s"], r["wall_s"], r["runs"], ", ".join(r["named"])]
            for r in found[key]
        ]
        Console().print(
            Table(
                key, f"Cost {size.replace('_', ' ')}: exponent {found[size]:.2f}", header, rows
            ).as_rich()
        )
    if args.json:
        args.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
