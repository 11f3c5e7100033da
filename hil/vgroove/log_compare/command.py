"""The command `vgroove log compare`."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer
from rich.console import Console

from vgroove.errors import VgrooveError
from vgroove.log import read_log
from vgroove.log_compare.compare import Comparison, compare_logs
from vgroove.log_compare.gaps import EQUAL, OTHER, PARTLY
from vgroove.log_compare.limits import LIMITS
from vgroove.log_compare.report import comparison_page, gap_table, sentences
from vgroove.output import json_text, write_all
from vgroove.terminal import print_results, print_warning, table_console

if TYPE_CHECKING:
    from vgroove.log import ColumnMap

DIFFERENT_CODE = 3  # exit code: the logs differ more than --require allows
MAX_SHIFT_S = 3600.0
REQUIREMENTS = ("equal", "explained")


def checked_options(require: str | None, max_shift_s: float) -> None:
    """VgrooveError for options that no comparison could use."""
    if require is not None and require not in REQUIREMENTS:
        raise VgrooveError(f"--require is equal or explained, not {require}")
    if not 0.0 <= max_shift_s <= MAX_SHIFT_S:
        raise VgrooveError(f"--max-shift must be from 0 to {MAX_SHIFT_S:g} s, not {max_shift_s:g}")


def meets(found: Comparison, require: str | None) -> bool:
    """Whether a comparison is as --require demands: both logs with the same columns and rows, all
    equal, or every gap explained by quantisation or timing.
    """
    kinds = {gap.explanation for gap in found.signals}
    if require == "equal":
        same_rows = set(found.rows) == {len(found.pairs.time_s)} and not found.pairs.interpolated
        return kinds <= {EQUAL} and same_rows and not found.only_in
    return require is None or not kinds & {OTHER, PARTLY}


def compare_files(
    paths: tuple[Path, Path],
    columns: "ColumnMap",
    outputs: tuple[Path | None, Path | None],
    require: str | None,
    max_shift_s: float,
) -> None:
    """Compare two log files; print the findings and write the JSON file and the page, if wanted.
    Ends with exit code 3 where the logs differ more than `require` allows.
    """
    checked_options(require, max_shift_s)
    json_path, html_path = outputs
    logs = [read_log(path, columns) for path in paths]
    for log in logs:
        for warning in log.warnings:
            print_warning(Console(stderr=True), warning)
    found = compare_logs(*logs, replace(LIMITS, max_shift_s=max_shift_s))
    print_results(table_console(json_path, html_path), sentences(found), [gap_table(found)])
    files = [(json_path, json_text(found.as_dict()))] if json_path else []
    if html_path:
        files.append((html_path, comparison_page(found).as_html()))
    write_all(files)
    if not meets(found, require):
        raise typer.Exit(DIFFERENT_CODE)
