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

from vgroove.errors import VgrooveError
from vgroove.firmware_replay.command import (
    firmware_results,
    firmware_section,
    with_closed_loops,
)
from vgroove.firmware_replay.kinds import FirmwareResult
from vgroove.firmware_replay.page import firmware_table
from vgroove.gap import DiagnosisOptions, Verdict, diagnose
from vgroove.gap.batch_command import ABOVE_CODE
from vgroove.gap.cases import Case, CaseResult, above_text, junit_text
from vgroove.gap.stage_shares import StageShare
from vgroove.output import check_outputs, json_text, write_all
from vgroove.progress import share_bar
from vgroove.reference.rigs import with_load
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


@dataclass(frozen=True)
class InputPaths:
    """Files that a diagnosis reads: logs, rig, joints (one for each log; empty: all have the joint
    of the rig), and firmware, the mode and parameters that the board is assumed to have (None: the
    firmware is not replayed).
    """

    logs: Sequence[Path]
    rig: Path
    joints: Sequence[Path] = ()
    firmware: Path | None = None

    def paths(self) -> tuple[Path, ...]:
        """All of the files."""
        firmware = [self.firmware] if self.firmware else []
        return (*self.logs, self.rig, *self.joints, *firmware)


def diagnose_files(inputs: InputPaths, outputs: OutputPaths, options: DiagnosisOptions) -> None:
    """Diagnose log files; the verdict goes to stdout, progress and warnings to stderr. typer.Exit
    with ABOVE_CODE where the gap is above the limit.
    """
    check_outputs(outputs.paths(), inputs.paths())
    notes, begin = Console(stderr=True), time.monotonic()
    logs, rig = inputs.logs, read_rig(inputs.rig)
    options = replace(options, joints=read_joints(inputs.joints, rig, len(logs)))
    replayed = _replayed(inputs, options)
    verdict = _diagnosed(logs, rig, options, notes)
    if inputs.firmware is not None:
        tools = _tools_of_logs(rig, verdict.corrected_rig(), options.joints, len(logs))
        try:
            replayed = with_closed_loops(replayed, logs, inputs.firmware, options.columns, tools)
        except VgrooveError as error:  # the verdict is written all the same
            print_warning(notes, f"no closed loop: {error}")
    name = ", ".join(path.name for path in logs)
    result = CaseResult(Case(name, logs, inputs.rig), time.monotonic() - begin, verdict)
    texts = output_texts(verdict, [path.name for path in logs], outputs, replayed)
    if outputs.junit:
        texts.append((outputs.junit, junit_text([result], outputs.fail_above)))
    for warning in verdict.warnings:
        print_warning(notes, warning)
    write_all(texts)
    for line in (*verdict.summary(), *(line for one in replayed for line in one.summary())):
        print_line(result_console(*outputs.paths()), line)
    if result.exceeds(outputs.fail_above):
        print_warning(notes, above_text(result, outputs.fail_above))
        raise typer.Exit(ABOVE_CODE)


def _replayed(inputs: InputPaths, options: DiagnosisOptions) -> list[FirmwareResult]:
    if inputs.firmware is None:
        return []
    return firmware_results(inputs.logs, inputs.firmware, options.columns)


def _tools_of_logs(
    rig: Rig, corrected: Rig, joints: Sequence[Rig], logs: int
) -> list[tuple[Rig, Rig]]:
    """The rig and the corrected one of each log, on its own joint where it has one."""
    return [(tool, with_load(corrected, tool.load)) for tool in joints] or [(rig, corrected)] * logs


def _diagnosed(
    logs: Sequence[Path], rig: Rig, options: DiagnosisOptions, notes: Console
) -> Verdict:
    share = StageShare()
    with share_bar("reading the logs", notes) as bar:
        show = replace(options, progress=lambda stage: bar.move_to(share.at(stage), stage))
        return diagnose(logs, rig, show)


def output_texts(
    verdict: Verdict, names: Sequence[str], outputs: OutputPaths, replayed: list[FirmwareResult]
) -> list[tuple[Path, str]]:
    """Paths and texts of the requested files; all texts are made before any file is written. The
    JSON file and the page hold the results of the firmware's replay, if any, besides the verdict.
    """
    texts = []
    if outputs.json:
        section = {"firmware": firmware_section(replayed)} if replayed else {}
        texts.append((outputs.json, json_text(verdict.as_dict() | section)))
    if outputs.html:
        page = verdict.page(names)
        firmware = [firmware_table(replayed)] if replayed else []
        texts.append((outputs.html, replace(page, parts=[*firmware, *page.parts]).as_html()))
    if outputs.rig:
        texts.append((outputs.rig, tomli_w.dumps(verdict.corrected_rig().as_dict())))
    return texts
