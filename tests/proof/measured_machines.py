"""Diagnoses the measured machines of tests/data by the command line and compares each verdict with
the accepted one: `measured_machines.py [NAME ...] [--json FILE]`; `--page` only writes the page.

Writes docs/results/measured_machines.json and the marked parts of docs/measured_machines.md, and
prints the table. With names only these machines are diagnosed; the entries of the others stay.
"""

import argparse
import json
import re
import sys
import tempfile
import textwrap
import time
from pathlib import Path
from typing import Any

from command_verdict import command_verdict
from proof import RESULTS, ROOT, commit
from results_page import table

sys.path.insert(0, str(ROOT / "tests" / "python"))

from real_machines import Machine, Wanted, faults, machines, reference_figures  # noqa: E402

PAGE = ROOT / "docs" / "measured_machines.md"
RESULT = RESULTS / "measured_machines.json"
COMMAND = "python tests/proof/measured_machines.py"
TIMEOUT_S = 1800.0  # of one diagnosis; the slowest takes minutes
GAPS = ("before", "retuned", "after")
ALTERED = RESULTS / "altered_machines.json"  # of altered_machines.py
# marked part of the page: name, argument, content
MARKED = re.compile(r"<!--part (\w+) ?(\w*)-->\n.*?<!--end of part-->", re.DOTALL)


def diagnose(machine: Machine, folder: Path) -> dict[str, Any]:
    """Verdict of the command line on one machine (command_verdict)."""
    return command_verdict(machine.logs, machine.rig, folder / f"{machine.name}.json", TIMEOUT_S)


def entry(machine: Machine, verdict: dict[str, Any], seconds: float) -> dict[str, Any]:
    """What is kept of a verdict; a key that the verdict lacks is null."""
    gap = verdict.get("gap", {})
    by_id = {effect["id"]: effect for effect in verdict.get("effects", [])}
    kept = ("probability", "parameters", "evidence")
    figures = (*GAPS, "refit", "floor", "closed", "closed_by_retuning", "closed_beyond_retuning")
    wrong = faults(machine.answer, verdict)
    return {
        "name": machine.name,
        "machine": machine.answer.machine,
        "commit": commit(),
        "verdict": verdict.get("verdict"),
        "selected": [
            {"id": name} | {key: by_id.get(name, {}).get(key) for key in kept}
            for name in verdict.get("selected", [])
        ],
        "indistinguishable": verdict.get("indistinguishable", []),
        "gap": {key: gap.get(key) for key in figures},
        "by_signal": {
            signal: {key: row.get(key) for key in ("unit", *GAPS, "floor", "clip", "rms")}
            for signal, row in gap.get("by_signal", {}).items()
        },
        "unexplained": verdict.get("unexplained"),
        "seconds": round(seconds, 1),
        "right": not wrong,
        "faults": wrong,
    }


def measure(names: list[str], path: Path) -> dict[str, Any]:
    """Result over the machines, written to the JSON file after each of them; those that are not
    named keep the entry that the file has.
    """
    old = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    entries = {row["name"]: row for row in old.get("machines", [])}
    result: dict[str, Any] = {}
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        for machine in machines():
            if names and machine.name not in names:
                continue
            start = time.perf_counter()
            verdict = diagnose(machine, Path(folder))
            entries[machine.name] = entry(machine, verdict, time.perf_counter() - start)
            result = summary(entries)
            path.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
            sys.stderr.write(" | ".join(verdict_row(entries[machine.name])) + "\n")
    return result


def summary(entries: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """The result over all machines that have an entry, in the order of the machines."""
    rows = [entries[machine.name] for machine in machines() if machine.name in entries]
    head = {"commit": commit(), "command": COMMAND}
    return head | {"right": sum(row["right"] for row in rows), "of": len(rows), "machines": rows}


def number(value: float | None, form: str = ".3g") -> str:
    """A figure, empty where there is none."""
    return "" if value is None else f"{value:{form}}"


def effect_cell(effect: dict[str, Any]) -> str:
    """An effect of the verdict with its parameters and their 95 % intervals."""
    sizes = [
        f"{name} {number(p.get('value'))} [{number(low)}, {number(high)}]"
        for name, p in (effect["parameters"] or {}).items()
        for low, high in [p.get("ci95") or (None, None)]
    ]
    return f"`{effect['id']}`" + (" " + ", ".join(sizes) if sizes else "")


def signal_cell(name: str, row: dict[str, Any]) -> str:
    """Error of a signal before, retuned and after, in its unit, and in per cent of the signal's
    RMS where the verdict states that.
    """
    text = f"{name}: " + " / ".join(number(row[key]) for key in GAPS) + f" {row['unit'] or ''}"
    if row["rms"]:
        shares = (row[key] and 100.0 * row[key] / row["rms"] for key in GAPS)
        text += " (" + " / ".join(number(share, ".0f") for share in shares) + " %)"
    return text


def verdict_row(row: dict[str, Any]) -> tuple[str, ...]:
    """Cells of one machine in the table of verdicts."""
    rivals = ", ".join(f"`{rival['id']}`" for rival in row["indistinguishable"])
    return (
        f"`{row['name']}`",
        f"`{row['verdict']}`",
        "<br>".join(effect_cell(effect) for effect in row["selected"]),
        rivals,
        " / ".join(number(row["gap"][key]) for key in GAPS),
        number(row["gap"]["closed"], ".2f"),
        "<br>".join(signal_cell(name, signal) for name, signal in row["by_signal"].items()),
        number(row["seconds"], ".0f"),
        "yes" if row["right"] else "no: " + "; ".join(row["faults"]),
    )


def verdicts(result: dict[str, Any]) -> list[str]:
    """The table of verdicts, below a sentence on their number and commits."""
    commits = sorted({row["commit"] for row in result["machines"]})
    head = ("machine", "verdict", "named, size, 95 % interval", "indistinguishable")
    head += ("gap before / retuned / after", "closed", "signals before / retuned / after")
    return [
        f"`{result['command']}`: {result['right']} of {result['of']} verdicts are right, commit "
        f"{', '.join(commits)}.",
        "",
        *table((*head, "seconds", "right"), map(verdict_row, result["machines"])),
    ]


def wanted_cell(wanted: Wanted) -> str:
    """An effect of an accepted diagnosis with its ranges and rivals."""
    text = " or ".join(f"`{name}`" for name in wanted.ids) + (" first" if wanted.first else "")
    ranges = (f"{name} {low:g}..{high:g}" for name, (low, high) in wanted.ranges.items())
    text += "".join(", " + part for part in ranges)
    rivals = ", ".join(f"`{name}`" for name in wanted.rivals)
    return text + (f"; rivals {rivals}" if rivals else "")


def answers() -> list[str]:
    """The table of accepted diagnoses."""
    rows = (
        (
            f"`{machine.name}`",
            machine.answer.machine,
            ", ".join(f"`{verdict}`" for verdict in machine.answer.verdicts),
            "<br>".join(wanted_cell(wanted) for wanted in machine.answer.effects),
            ", ".join(f"`{name}`" for name in machine.answer.allowed),
            number(machine.answer.closed_min),
        )
        for machine in machines()
    )
    head = ("folder", "machine", "verdict", "named", "allowed besides", "closes at least")
    return table(head, rows)


def reference(name: str) -> list[str]:
    """The figures of a reference fit."""
    rows = (
        (label, f"{v} {unit}".strip()) for label, (v, unit, _) in reference_figures(name).items()
    )
    return table(("figure", "value"), rows)


def altered(result: dict[str, Any]) -> list[str]:
    """The diagnoses of logs with a known difference, one row each."""
    head = (
        f"`{result['command']}`, commit {result['commit']}: {result['first']} of {result['of']} "
        f"cases have the right first name, {result['complete']} exactly the right ones; a wrong "
        f"name of a probability of 0.9 or more: {result['sure_and_wrong']}."
    )
    rows = [
        (
            f"`{case['machine']}`",
            f"{case['change']} ({number(case['size'])})" if case["size"] else case["change"],
            f"`{case['verdict']}`",
            ", ".join(f"`{name}` {number(p, '.2f')}" for name, p in case["selected"].items()),
            ", ".join(f"`{name}`" for name in case["indistinguishable"]),
            f"{number(case['gap']['before'])} / {number(case['gap']['after'])}",
            number(case["seconds"], ".0f"),
            "yes" if case["complete"] else "no",
        )
        for case in result["cases"]
    ]
    names = ("machine", "difference (size)", "verdict", "named, probability")
    more = ("indistinguishable", "gap before / after", "seconds", "right")
    return [*textwrap.wrap(head, 100), "", *table((*names, *more), rows)]


def page(text: str) -> str:
    """The text of the page with its marked parts written again."""
    result = json.loads(RESULT.read_text(encoding="utf-8"))
    parts = {"verdicts": lambda _: verdicts(result), "answers": lambda _: answers()}
    parts |= {
        "reference": reference,
        "altered": lambda _: altered(json.loads(ALTERED.read_text(encoding="utf-8"))),
    }

    def part(match: re.Match[str]) -> str:
        lines = parts[match[1]](match[2])
        return "\n".join([match[0].split("\n")[0], *lines, "<!--end of part-->"])

    return MARKED.sub(part, text)


def main(arguments: list[str]) -> int:
    """Diagnose, write the JSON file and, where it is that of the page, the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="folders under tests/data; all when none is named")
    parser.add_argument("--json", type=Path, default=RESULT)
    parser.add_argument("--page", action="store_true", help="write the page, diagnose nothing")
    args = parser.parse_args(arguments)
    unknown = set(args.names) - {machine.name for machine in machines()}
    if unknown:
        parser.error(f"no measured machine: {', '.join(sorted(unknown))}")
    if not args.page:
        sys.stdout.write("\n".join(verdicts(measure(args.names, args.json))) + "\n")
    if args.json == RESULT:
        PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
