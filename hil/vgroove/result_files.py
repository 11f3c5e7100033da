"""A finished report (of a study or a bench) and its files: tables as CSV, JSON, page, picture."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from plotly.offline import get_plotlyjs, get_plotlyjs_version

from vgroove.chromium import draw, find_chromium
from vgroove.errors import VgrooveError
from vgroove.html_page import Page, Picture, Table
from vgroove.output import check_outputs, json_text, write_all

SCRIPT_NAME = f"plotly-{get_plotlyjs_version()}.min.js"


@dataclass(frozen=True)
class Report:
    """Results of one study or bench; `lines` are its findings in sentences, `data` its JSON."""

    name: str
    title: str
    lines: Sequence[str]
    tables: Sequence[Table]
    pictures: Sequence[Picture]
    data: dict[str, Any] = field(default_factory=dict)

    def page(self) -> Page:
        """The page: sentences, pictures, then tables."""
        return Page(self.name, self.title, self.lines, [*self.pictures, *self.tables])


def join_reports(title: str, reports: Sequence[Report]) -> Report:
    """Reports one after the other as one report, under the first one's name."""
    return Report(
        reports[0].name,
        title,
        [line for report in reports for line in report.lines],
        [table for report in reports for table in report.tables],
        [picture for report in reports for picture in report.pictures],
        {key: value for report in reports for key, value in report.data.items()},
    )


@dataclass(frozen=True)
class ReportFiles:
    """Where the files of a report go; `chromium` is the browser that draws the PNG, if wanted."""

    folder: Path
    json_path: Path
    chromium: str | None

    def file(self, name: str) -> Path:
        """A file in the folder."""
        return self.folder / name


def prepare_files(name: str, folder: Path, json_path: Path | None, png: bool) -> ReportFiles:
    """Make the folder and check before the work that the files can be written.

    The JSON goes to `json_path`, or to NAME.json in the folder. Raises VgrooveError where a file
    cannot be written or `png` is wanted without Chromium.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise VgrooveError(f"{folder}: this folder cannot be made: {error.strerror}") from error
    chromium = find_chromium() if png else None
    files = ReportFiles(folder, json_path or folder / f"{name}.json", chromium)
    png_path = files.file(f"{name}.png") if png else None
    check_outputs([files.json_path, files.file(f"{name}.html"), png_path])
    return files


def write_report(report: Report, files: ReportFiles) -> list[Path]:
    """Write the files of the report, all or none, then the picture; returns the paths.

    The page loads plotly from a file beside it, which all pages of the folder share.
    """
    page, script = report.page(), files.file(SCRIPT_NAME)
    contents = [
        (files.json_path, json_text({"study": report.name, **report.data})),
        (files.file(f"{report.name}.html"), page.as_html(script=SCRIPT_NAME)),
        *((files.file(f"{report.name}_{t.name}.csv"), t.as_csv()) for t in report.tables),
    ]
    if not script.is_file():
        contents.append((script, get_plotlyjs()))
    write_all(contents)
    written = [path for path, _ in contents]
    if files.chromium:
        written.append(files.file(f"{report.name}.png"))
        draw(files.chromium, page.as_html(bar=False), written[-1], page.height())
    return written
