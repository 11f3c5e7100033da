"""Pages of a batch of diagnoses: one for each verdict, and a summary that leads to them."""

import re
from collections.abc import Sequence
from pathlib import Path

from plotly.offline import get_plotlyjs

from vgroove.errors import VgrooveError
from vgroove.gap.cases import CaseResult, batch_table
from vgroove.html_page import Link, Page
from vgroove.result_files import SCRIPT_NAME

SUMMARY = "index.html"


def page_name(number: int, name: str) -> str:
    """File of the page of a case: its number, from 1, and its name without special characters."""
    return f"{number:03d}_{re.sub(r'[^A-Za-z0-9_-]+', '_', name)[:80]}.html"


def batch_pages(
    results: Sequence[CaseResult], limit: float | None, folder: Path
) -> list[tuple[Path, str]]:
    """Paths in `folder` and texts of the summary, of the pages of all verdicts, and of the script
    that the pages share.
    """
    table, texts = batch_table(results, limit), []
    for number, (one, row) in enumerate(zip(results, table.rows, strict=True), 1):
        if one.verdict is None:
            continue
        file = page_name(number, one.case.name)
        row[0] = Link(one.case.name, file)
        page = one.verdict.page([path.name for path in one.case.logs])
        texts.append((folder / file, page.as_html(script=SCRIPT_NAME)))
    summary = Page("batch", "Diagnoses", ["Each case leads to the page of its verdict."], [table])
    texts.append((folder / SUMMARY, summary.as_html(script=SCRIPT_NAME)))
    return [*texts, (folder / SCRIPT_NAME, get_plotlyjs())]


def prepare_folder(folder: Path | None) -> None:
    """Make the folder of the pages, before the work; VgrooveError where it cannot be made."""
    if folder is None:
        return
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise VgrooveError(
            f"{folder}: no folder can be made there: {error.strerror or error}."
        ) from error
