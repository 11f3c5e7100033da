"""The command `vgroove gap diagnose`: reads logs and rig, shows progress, and writes the requested
files, all or none.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import tomli_w
from rich.console import Console

from vgroove.gap import DiagnosisOptions, Verdict, diagnose
from vgroove.output import check_outputs, write_text
from vgroove.rig import read_rig
from vgroove.terminal import print_line, print_warning


@dataclass(frozen=True)
class OutputPaths:
    """Files that a diagnosis writes; None: not wanted."""

    json: Path | None = None
    html: Path | None = None
    rig: Path | None = None


def diagnose_files(
    logs: Sequence[Path], rig_path: Path, outputs: OutputPaths, options: DiagnosisOptions
) -> None:
    """Diagnose log files; the verdict goes to stdout, progress and warnings to stderr."""
    check_outputs((outputs.json, outputs.html, outputs.rig), (*logs, rig_path))
    notes = Console(stderr=True)
    rig = read_rig(rig_path)
    with notes.status("reading the logs") as status:
        verdict = diagnose(logs, rig, replace(options, progress=status.update))
        texts = output_texts(verdict, [path.name for path in logs], outputs)
    for warning in verdict.warnings:
        print_warning(notes, warning)
    for path, text in texts:
        write_text(path, text)
    for line in verdict.summary():
        print_line(Console(), line)


def output_texts(
    verdict: Verdict, names: Sequence[str], outputs: OutputPaths
) -> list[tuple[Path, str]]:
    """Paths and texts of the requested files; all texts are made before any file is written."""
    texts = []
    if outputs.json:
        content = json.dumps(verdict.as_dict(), indent=1, allow_nan=False)
        texts.append((outputs.json, content + "\n"))
    if outputs.html:
        texts.append((outputs.html, verdict.page(names).as_html()))
    if outputs.rig:
        texts.append((outputs.rig, tomli_w.dumps(verdict.corrected_rig().as_dict())))
    return texts
