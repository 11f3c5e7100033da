"""Forty cases of the blind set's half `tune`, made from tests/truth/fixed_cases.json, diagnosed and
scored. Every third guards every change (test_gap_fixed.py).

`python tests/python/fixed_cases.py` diagnoses all and prints the counts; of the cases that guard
every change alone with the argument `guard`.
"""

import json
import sys
import tempfile
import time
from pathlib import Path

from truth_helpers import TRUTH

import gap_bench  # isort: skip
from vgroove.gap import diagnose
from vgroove.gap_bench.scored import Scored
from vgroove.log import read_log
from vgroove.rig import read_rig

ROWS = json.loads((TRUTH / "fixed_cases.json").read_text(encoding="utf-8"))
# 13 cases: seven effects, a pair, two without an effect, three not in the catalogue
GUARD = ROWS[2::3]


def diagnosed(row: dict, folder: Path) -> Scored:
    """Make a case in a folder and diagnose it in this process; the verdict with its answer."""
    case = gap_bench.frozen_case(row)
    gap_bench.write_case(case, folder)
    begin = time.process_time()
    verdict = diagnose([read_log(folder / "log.csv")], read_rig(folder / "rig.toml")).as_dict()
    seconds = time.process_time() - begin
    return Scored(
        row["number"],
        folder.name,
        None,
        gap_bench.answer_of(case) | {"ties": row["ties"]},
        verdict,
        seconds,
        seconds,
        0.0,
    )


def case_lines(cases: list[Scored]) -> str:
    """A line for each case, shown when a test fails."""
    return "\n".join(
        f"{c.number} {c.kind} {'+'.join(c.answer['ids'])} {c.answer['times_visible']} -> "
        f"{c.outcome} {'+'.join(c.selected)} "
        f"{'right' if c.right else 'WRONG'} {c.cpu_seconds:.1f} s"
        for c in cases
    )


def counts(cases: list[Scored]) -> dict[str, int]:
    """The counts that test_gap_fixed.py limits."""
    return {
        "of": len(cases),
        "right": sum(c.right for c in cases),
        "sure_and_wrong": sum(c.sure_and_wrong for c in cases),
        "false_alarms": sum(c.kind == "none" and c.outcome != "none" for c in cases),
    }


def main(arguments: list[str]) -> int:
    rows = GUARD if arguments == ["guard"] else ROWS
    with tempfile.TemporaryDirectory() as folder:
        cases = [diagnosed(row, Path(folder) / f"case_{n}") for n, row in enumerate(rows)]
    sys.stdout.write(f"{case_lines(cases)}\n{counts(cases)}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
