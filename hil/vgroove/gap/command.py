"""The command `vgroove gap diagnose`: reads, shows progress, writes what was asked for, whole or
not at all.
"""

import json
from collections.abc import Sequence
from pathlib import Path

import tomli_w
from rich.console import Console

from vgroove.gap.diagnose import Diagnosis, diagnose
from vgroove.gap.page import diagnosis_page
from vgroove.gap.report import summary_lines
from vgroove.log import read_log
from vgroove.output import check_outputs, write_text
from vgroove.rig import read_rig


def diagnose_files(
    logs: Sequence[Path],
    rig_path: Path,
    json_path: Path | None,
    html_path: Path | None,
    out_rig: Path | None,
    seed: int,
    without: Sequence[str],
) -> None:
    """Diagnose log files; the verdict in words goes to stdout, progress and warnings to stderr."""
    check_outputs((json_path, html_path, out_rig), (*logs, rig_path))
    notes = Console(stderr=True)
    rig, tables = read_rig(rig_path), [read_log(path) for path in logs]
    with notes.status("reading") as status:
        found = diagnose(tables, rig, seed, without, lambda text: status.update(text))
        texts = outputs(found, logs, json_path, html_path, out_rig)
    for warning in found.verdict["warnings"]:
        notes.print(
            f"vgroove: {warning}", style="yellow", highlight=False, markup=False, soft_wrap=True
        )
    for path, text in texts:
        write_text(path, text)
    for line in summary_lines(found.verdict):
        Console().print(line, highlight=False, markup=False, soft_wrap=True)


def outputs(
    found: Diagnosis,
    logs: Sequence[Path],
    json_path: Path | None,
    html_path: Path | None,
    out_rig: Path | None,
) -> list[tuple[Path, str]]:
    """Texts of the files that were asked for; all are made before any is written."""
    texts = []
    if json_path:
        texts.append((json_path, json.dumps(found.verdict, indent=1, allow_nan=False) + "\n"))
    if html_path:
        texts.append((html_path, diagnosis_page(found, [path.name for path in logs]).as_html()))
    if out_rig:
        texts.append((out_rig, tomli_w.dumps(found.corrected_rig().as_dict())))
    return texts
