"""Processor time and memory of a diagnosis of a log of 5 million rows:
`gap_long_log.py [--rows N] [--json FILE]`, some two minutes.

The log is a run of the plant of 12 s with one effect, then a constant duty, with a group of steps
every PERIOD_S; it is written as CSV and diagnosed by the command line in a process of its own.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "python"))

from made_log import drive_log, rig  # noqa: E402
from vgroove.log import csv_header, csv_rows  # noqa: E402

EFFECT = {"viscous_friction": {"nm_s_per_rad": 2.5e-6}}
ROWS = 5_000_000
SECONDS, PERIOD_S = 300.0, 100.0  # of the run that is repeated, and between its groups of steps
STEPS = [(0.3, 0.35), (1.0, 0.8), (1.8, 0.5), (2.4, 1.0), (4.0, 0.6)]


def write_long_log(path: Path, rows: int) -> None:
    """A run of SECONDS, whose part after PERIOD_S is repeated up to a number of rows."""
    levels = [
        (start + PERIOD_S * n, level)
        for n in range(int(SECONDS / PERIOD_S))
        for start, level in STEPS
    ]
    log = drive_log(rig().with_effects(EFFECT), seconds=SECONDS, levels=levels)
    first = int(PERIOD_S * 1000.0)
    with path.open("wb") as file:
        file.write(csv_header(log.columns))
        begin, part = 0, slice(0, len(log.time_s) - 1)
        while begin < rows:
            columns = [values[part][: rows - begin] for values in log.columns.values()]
            time_s = (begin + np.arange(len(columns[0]))) * 1e-3
            file.write(csv_rows(time_s, columns))
            begin, part = begin + len(time_s), slice(first, len(log.time_s) - 1)


def measure(rows: int) -> dict[str, Any]:
    """Size of the log, processor seconds and largest memory of its diagnosis, and the verdict."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_long_log(folder / "log.csv", rows)
        (folder / "rig.toml").write_text(tomli_w.dumps(rig().as_dict()), encoding="utf-8")
        command = ["gap", "diagnose", "log.csv", "--rig", "rig.toml", "--json", "verdict.json"]
        subprocess.run(
            [sys.executable, "-c", "from vgroove.cli import main; main()", *command],
            cwd=folder,
            check=True,
            stdout=subprocess.DEVNULL,
            env=os.environ,
        )
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        verdict = json.loads((folder / "verdict.json").read_text(encoding="utf-8"))
        size = (folder / "log.csv").stat().st_size
    return {
        "rows": rows,
        "file_mb": size / 1e6,
        "cpu_s": used.ru_utime + used.ru_stime,
        "memory_mib": used.ru_maxrss / 1024.0,
        "verdict": verdict["verdict"],
        "selected": verdict["selected"],
        "held_out_s": verdict["gap"]["held_out_s"],
    }


def main() -> None:
    """Print the figures, and write them as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=ROWS)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    found = json.dumps(measure(given.rows), indent=1)
    sys.stdout.write(found + "\n")
    if given.json:
        given.json.write_text(found + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
