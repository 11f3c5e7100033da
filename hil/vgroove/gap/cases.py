"""Cases of a batch of diagnoses: read from folders and TOML files, diagnosed one after the other,
and their results as JSON, JUnit XML and table.
"""

import difflib
import re
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from vgroove.errors import VgrooveError
from vgroove.gap import DiagnosisOptions, Verdict, diagnose
from vgroove.gap.report import verdict_sentence
from vgroove.html_page import Table
from vgroove.log import READERS, column_map
from vgroove.rig import read_rig, read_toml

SCHEMA = "vgroove.gap_batch/1"
RIG_NAME = "rig.toml"
# Characters that XML 1.0 (W3C, section 2.2) does not allow; a file name may hold them.
NOT_IN_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
NOT_RUN = "not diagnosed: the batch was interrupted"
# Keys of a case: type, and whether it must be given.
KEYS: dict[str, tuple[type | tuple[type, ...], bool]] = {
    "name": (str, True),
    "logs": (list, True),
    "rig": (str, True),
    "seed": (int, False),
    "without": (list, False),
    "from_s": ((int, float), False),
    "to_s": ((int, float), False),
    "as_is": (bool, False),
    "map": (list, False),
}


@dataclass(frozen=True)
class Case:
    """Logs of one tool, and its rig."""

    name: str
    logs: Sequence[Path]
    rig: Path
    options: DiagnosisOptions = DiagnosisOptions()


@dataclass(frozen=True)
class CaseResult:
    """A verdict, or the error that prevented it, and the wall time in s."""

    case: Case
    seconds: float
    verdict: Verdict | None
    error: str = ""

    def exceeds(self, limit: float | None) -> bool:
        """Whether the gap that the corrected model leaves is above a limit (None: no limit)."""
        return self.verdict is not None and limit is not None and self.verdict.gap.after > limit

    def as_dict(self) -> dict[str, Any]:
        """The result as JSON."""
        return {
            "name": self.case.name,
            "logs": [str(path) for path in self.case.logs],
            "rig": str(self.case.rig),
            "seconds": round(self.seconds, 3),
            "error": self.error or None,
            "verdict": self.verdict and self.verdict.as_dict(),
        }


def read_cases(paths: Iterable[Path]) -> list[Case]:
    """The cases of folders and TOML files, in their order; VgrooveError where one gives none, or
    where two cases have the same name.
    """
    cases = []
    for path in paths:
        cases += _folder_cases(path) if path.is_dir() else _file_cases(path)
    names = [case.name for case in cases]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise VgrooveError(f"two cases have the name {twice}: each needs its own")
    return cases


def _folder_cases(folder: Path) -> list[Case]:
    """The case of a folder with a rig.toml and logs, or those of its folders."""
    places = [folder] if (folder / RIG_NAME).is_file() else sorted(folder.iterdir())
    cases = []
    for place in (place for place in places if (place / RIG_NAME).is_file()):
        names = (file for file in sorted(place.iterdir()) if not file.name.startswith("."))
        logs = [file for file in names if file.name.lower().endswith(tuple(READERS))]
        if not logs:
            raise VgrooveError(f"{place}: has a {RIG_NAME} and no log ({', '.join(READERS)})")
        cases.append(Case(place.resolve().name, logs, place / RIG_NAME))
    if not cases:
        raise VgrooveError(f"{folder}: neither it nor a folder in it has a {RIG_NAME} with logs")
    return cases


def _file_cases(path: Path) -> list[Case]:
    """The tables [[case]] of a TOML file; its paths are relative to the file."""
    tables = read_toml(path)
    entries = tables.pop("case", None)
    if tables or not isinstance(entries, list) or not entries:
        raise VgrooveError(f"{path}: a batch is a list of tables [[case]], and nothing else")
    return [_case(entry, f"{path}: case {n}", path.parent) for n, entry in enumerate(entries, 1)]


def _case(entry: Any, source: str, folder: Path) -> Case:
    _check_entry(entry, source)
    try:
        options = DiagnosisOptions(
            entry.get("seed", 0),
            tuple(entry.get("without", ())),
            from_s=entry.get("from_s"),
            to_s=entry.get("to_s"),
            as_is=entry.get("as_is", False),
            columns=column_map(entry.get("map", ()), None),
        )
    except VgrooveError as error:
        raise VgrooveError(f"{source}: {error}") from None
    logs = [folder / name for name in entry["logs"]]
    return Case(entry["name"], logs, folder / entry["rig"], options)


def _check_entry(entry: Any, source: str) -> None:
    """VgrooveError unless an entry is a table with the keys of a case and values of their types."""
    if not isinstance(entry, dict):
        raise VgrooveError(f"{source}: is no table; a case begins with the line [[case]]")
    for key in entry:
        if key not in KEYS:
            near = difflib.get_close_matches(key, KEYS, 1)
            hint = f"; the nearest known one is {near[0]}" if near else ""
            raise VgrooveError(f"{source}: the key {key} is unknown{hint}")
    for key, (kind, needed) in KEYS.items():
        if key in entry and not _is_of_type(entry[key], kind):
            raise VgrooveError(f"{source}: the key {key} has a value of the wrong type")
        if needed and not entry.get(key):
            raise VgrooveError(f"{source}: the key {key} is missing")
    texts = [one for key in ("logs", "without", "map") for one in entry.get(key, ())]
    if not all(isinstance(one, str) and one for one in texts):
        raise VgrooveError(
            f"{source}: logs, without and map are lists of texts, none of them empty"
        )


def _is_of_type(value: Any, kind: type | tuple[type, ...]) -> bool:
    """Whether a value has a type that KEYS states; a bool, an int in Python, is no number here."""
    return isinstance(value, kind) and (kind is bool or not isinstance(value, bool))


def diagnose_cases(
    cases: Sequence[Case], progress: Callable[[int, str], None] = lambda *_: None
) -> list[CaseResult]:
    """Diagnose the cases one after the other. An error ends only its case; after Ctrl-C the cases
    that are left have the error NOT_RUN. `progress` gets the number of a case and its stage.
    """
    results: list[CaseResult] = []
    try:
        for number, case in enumerate(cases):
            results.append(_diagnosed(case, lambda stage, n=number: progress(n, stage)))
    except KeyboardInterrupt:
        left = cases[len(results) :]
        results += [CaseResult(case, 0.0, None, NOT_RUN) for case in left]
    return results


def _diagnosed(case: Case, progress: Callable[[str], None]) -> CaseResult:
    begin, verdict, error = time.monotonic(), None, ""
    try:
        rig = read_rig(case.rig)
        progress("reading the logs")
        verdict = diagnose(list(case.logs), rig, replace(case.options, progress=progress))
    except VgrooveError as unusable:
        error = str(unusable)
    except Exception as failure:  # a fault of the program in one case must not lose the others
        error = f"the diagnosis failed: {type(failure).__name__}: {failure}"
    return CaseResult(case, time.monotonic() - begin, verdict, error)


def batch_json(results: Sequence[CaseResult], limit: float | None) -> dict[str, Any]:
    """All results, and how many failed."""
    return {
        "schema": SCHEMA,
        "cases": [one.as_dict() for one in results],
        "errors": sum(one.verdict is None for one in results),
        "fail_above": limit,
        "above": [one.case.name for one in results if one.exceeds(limit)],
    }


def batch_table(results: Sequence[CaseResult], limit: float | None) -> Table:
    """One row for each case."""
    rows = []
    for one in results:
        if one.verdict is None:
            rows.append([one.case.name, "error", one.error, None, None, one.seconds])
            continue
        gap, found = one.verdict.gap, ", ".join(one.verdict.selected)
        mark = f" (above {limit:g})" if one.exceeds(limit) else ""
        rows.append([one.case.name, one.verdict.verdict + mark, found, gap.before, gap.after])
        rows[-1].append(one.seconds)
    header = ["case", "verdict", "effects, or why none", "gap before", "gap after", "time in s"]
    return Table("batch", f"{len(results)} cases", header, rows)


def junit_text(results: Sequence[CaseResult], limit: float | None) -> str:
    """The results as JUnit XML: a test case each, which fails where the gap is above the limit and
    has an error where there is no verdict.
    """
    counts = {
        "tests": len(results),
        "failures": sum(one.exceeds(limit) for one in results),
        "errors": sum(one.verdict is None for one in results),
    }
    numbers = {name: str(count) for name, count in counts.items()}
    numbers["time"] = f"{sum(one.seconds for one in results):.3f}"
    root = ElementTree.Element("testsuites", numbers)
    suite = ElementTree.SubElement(root, "testsuite", {"name": "vgroove.gap", **numbers})
    for one in results:
        _add_test(suite, one, limit)
    ElementTree.indent(root)
    text = ElementTree.tostring(root, "unicode", xml_declaration=True)
    return NOT_IN_XML.sub("?", text) + "\n"


def _add_test(suite: ElementTree.Element, one: CaseResult, limit: float | None) -> None:
    names = {"classname": "vgroove.gap", "name": one.case.name, "time": f"{one.seconds:.3f}"}
    test = ElementTree.SubElement(suite, "testcase", names)
    if one.verdict is None:
        ElementTree.SubElement(test, "error", {"message": one.error})
        return
    if one.exceeds(limit):
        ElementTree.SubElement(test, "failure", {"message": above_text(one, limit)})
    ElementTree.SubElement(test, "system-out").text = verdict_sentence(one.verdict)


def above_text(one: CaseResult, limit: float) -> str:
    """The sentence on a gap above the limit."""
    return (
        f"{one.case.name}: the gap after correction is {one.verdict.gap.after:.3f}, above {limit:g}"
    )
