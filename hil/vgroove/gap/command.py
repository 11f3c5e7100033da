"""The command `vgroove gap diagnose`: reads logs and rig, shows progress, and writes the requested
files, all or none.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import tomli_w
import typer
from rich.console import Console

from vgroove.gap import DiagnosisOptions, Verdict, diagnose
from vgroove.gap.batch_command import ABOVE_CODE
from vgroove.gap.cases import Case, CaseResult, above_text, junit_text
from vgroove.gap.stage_shares import StageShare
from vgroove.output import check_outputs, json_text, write_all
from vgroove.progress import share_bar
from vgroove.rig import Rig, read_joints, read_rig
from vgroove.terminal import print_line, print_warning, result_console


@dataclass(frozen=True)
class OutputPaths:
    """Files that a diagnosis writes (None: not wanted), and the gap above which it fails."""

    json: Path | None = None
    html: Path | None = None
    rig: Path | None = None
    junit: Path | None = None
    fail_above: float | None = None

    def paths(self) -> tuple[Path | None, ...]:
        """All of the files."""
        return (self.json, self.html, self.rig, self.junit)


def diagnose_files(
    logs: Sequence[Path],
    rig_path: Path,
    outputs: OutputPaths,
    options: DiagnosisOptions,
    joints: Sequence[Path] = (),
) -> None:
    """Diagnose log files; the verdict goes to stdout, progress and warnings to stderr. joints:
    files with the joint of each log. typer.Exit with ABOVE_CODE where the gap is above the limit.
    """
    check_outputs(outputs.paths(), (*logs, rig_path, *joints))
    notes, begin = Console(stderr=True), time.monotonic()
    rig = read_rig(rig_path)
    options = replace(options, joints=read_joints(joints, rig, len(logs)))
    verdict = _diagnosed(logs, rig, options, notes)
    name = ", ".join(path.name for path in logs)
    result = CaseResult(Case(name, logs, rig_path), time.monotonic() - begin, verdict)
    texts = output_texts(verdict, [path.name for path in logs], outputs)
    if outputs.junit:
        texts.append((outputs.junit, junit_text([result], outputs.fail_above)))
    for warning in verdict.warnings:
        print_warning(notes, warning)
    write_all(texts)
    for line in verdict.summary():
        print_line(result_console(*outputs.paths()), line)
    if result.exceeds(outputs.fail_above):
        print_warning(notes, above_text(result, outputs.fail_above))
        raise typer.Exit(ABOVE_CODE)


def _diagnosed(
    logs: Sequence[Path], rig: Rig, options: DiagnosisOptions, notes: Console
) -> Verdict:
    share = StageShare()
    with share_bar("reading the logs", notes) as bar:
        show = replace(options, progress=lambda stage: bar.move_to(share.at(stage), stage))
        return diagnose(logs, rig, show)


def output_texts(
    verdict: Verdict, names: Sequence[str], outputs: OutputPaths
) -> list[tuple[Path, str]]:
    """Paths and texts of the requested files; all texts are made before any file is written."""
    texts = []
    if outputs.json:
        texts.append((outputs.json, json_text(verdict.as_dict())))
    if outputs.html:
        texts.append((outputs.html, verdict.page(names).as_html()))
    if outputs.rig:
        texts.append((outputs.rig, tomli_w.dumps(verdict.corrected_rig().as_dict())))
    return texts
