"""What every study hands over, and how it is shown and written: tables on the terminal and as CSV, one JSON, one page, a picture of it."""

import csv
import html
import io
import json
import re
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import plotly.graph_objects as go
import rich.table
from plotly.offline import get_plotlyjs

from vgroove.errors import VgrooveError
from vgroove.output import check_outputs, write_text

PAGE_WIDTH = 1000
CSS = """body{font:16px/1.5 system-ui,sans-serif;max-width:1000px;margin:24px auto;padding:0 20px;color:#222}
h1{font-size:25px;margin-bottom:4px} h2{font-size:19px;margin:34px 0 4px} table{border-collapse:collapse;font-size:14px}
td,th{padding:3px 10px;border-bottom:1px solid #ddd;text-align:left} td.n,th.n{text-align:right;font-variant-numeric:tabular-nums}
p{margin:6px 0} .note{color:#555}"""
CHROMIUM = ("chromium", "chromium-browser", "google-chrome", "chrome")
CHROMIUM_LIMIT_S = 120
LEAST_SHOWN = 1e-4


@dataclass(frozen=True)
class Table:
    """One table: `name` ends its file's name; a column's header carries its unit; cells are texts, numbers or None."""

    name: str
    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[Any]]

    def as_csv(self) -> str:
        """Header and rows, numbers to six digits."""
        buffer = io.StringIO()
        writer = csv.writer(buffer, lineterminator="\n")
        writer.writerow(self.header)
        writer.writerows([f"{c:.6g}" if isinstance(c, float) else ("" if c is None else c) for c in row] for row in self.rows)
        return buffer.getvalue()

    def as_rich(self) -> rich.table.Table:
        """For the terminal."""
        table = rich.table.Table(title=self.title, title_justify="left", title_style="bold")
        for column, name in enumerate(self.header):
            table.add_column(name, justify="right" if self._is_number(column) else "left", overflow="fold")
        for row in self.rows:
            table.add_row(*(shown(cell) for cell in row))
        return table

    def as_html(self) -> str:
        """For the page."""
        marks = [" class=n" if self._is_number(column) else "" for column in range(len(self.header))]
        head = "".join(f"<th{m}>{html.escape(n)}</th>" for m, n in zip(marks, self.header, strict=True))
        body = ["".join(f"<td{m}>{html.escape(shown(c))}</td>" for m, c in zip(marks, row, strict=True)) for row in self.rows]
        return f"<table><tr>{head}</tr>" + "".join(f"<tr>{row}</tr>" for row in body) + "</table>"

    def _is_number(self, column: int) -> bool:
        return any(isinstance(row[column], int | float) for row in self.rows)


def shown(cell: Any) -> str:
    """A cell as people read it: four digits, a dash for nothing; what is smaller than anyone measures is said to be."""
    if cell is None:
        return "–"
    if isinstance(cell, float) and 0.0 < abs(cell) < LEAST_SHOWN:
        return f"< {LEAST_SHOWN:g}"
    if isinstance(cell, float):
        return f"{cell:.4g}" if abs(cell) < 1e4 else f"{cell:,.0f}"
    return str(cell)


@dataclass(frozen=True)
class Picture:
    """A plotly figure with its title and the sentence that says what is seen."""

    title: str
    figure: go.Figure
    note: str = ""


@dataclass(frozen=True)
class Study:
    """A finished study; `data` is its JSON, `lines` what it found in sentences."""

    name: str
    title: str
    lines: Sequence[str]
    tables: Sequence[Table]
    pictures: Sequence[Picture]
    data: dict[str, Any] = field(default_factory=dict)


def joined(title: str, parts: Sequence[Study]) -> Study:
    """Studies of one name as one."""
    return Study(
        parts[0].name,
        title,
        [line for p in parts for line in p.lines],
        [t for p in parts for t in p.tables],
        [f for p in parts for f in p.pictures],
        {key: value for p in parts for key, value in p.data.items()},
    )


def style(figure: go.Figure, height: int, **layout: Any) -> go.Figure:
    """The house's look: white, type that is read at half a page, legend above, the camera saves an SVG."""
    legend = {"orientation": "h", "y": 1.0 - 30.0 / height, "yref": "container", "yanchor": "top", "x": 0.0}
    figure.update_layout(
        template="plotly_white",
        width=PAGE_WIDTH,
        height=height,
        font={"size": 15},
        legend=legend,
        margin={"l": 80, "r": 20, "t": 115, "b": 60},
        **layout,
    )
    figure.update_xaxes(showline=True, linecolor="#888", ticks="outside", title_standoff=8)
    figure.update_yaxes(showline=True, linecolor="#888", ticks="outside", title_standoff=8)
    return figure


def thin(time: np.ndarray, *columns: np.ndarray, points: int = 3000) -> list[np.ndarray]:
    """`time` and columns (n,) with at most about `points` samples each; of every stretch the extremes of each column stay."""
    count = len(time)
    if count <= points:
        return [time, *columns]
    edges = np.linspace(0, count, max(2, points // (2 * max(1, len(columns)))) + 1).astype(int)
    keep = {0, count - 1}
    for low, high in zip(edges[:-1], edges[1:], strict=True):
        for column in columns:
            keep |= {low + int(np.argmin(column[low:high])), low + int(np.argmax(column[low:high]))}
    at = np.array(sorted(keep))
    return [time[at], *(column[at] for column in columns)]


def page(study: Study, bar: bool | str = "hover") -> str:
    """The study as one HTML text that opens offline; `bar`: when the buttons above a figure show."""
    body = [f"<h1>{html.escape(study.title)}</h1>"]
    body += [f"<p>{html.escape(line)}</p>" for line in study.lines]
    for n, picture in enumerate(study.pictures):
        body.append(f"<h2>{html.escape(picture.title)}</h2><p class=note>{html.escape(picture.note)}</p>")
        image = {"format": "svg", "filename": f"{study.name}_{n + 1}"}
        config = {"displaylogo": False, "displayModeBar": bar, "toImageButtonOptions": image}
        body.append(picture.figure.to_html(full_html=False, include_plotlyjs=False, div_id=f"figure{n + 1}", config=config))
    for table in study.tables:
        body.append(f"<h2>{html.escape(table.title)}</h2>{table.as_html()}")
    return (
        f"<!doctype html><html lang=en><head><meta charset=utf-8><title>{html.escape(study.title)}</title><style>{CSS}</style>"
        f"<link rel=icon href='data:,'><script>{get_plotlyjs()}</script></head><body>{''.join(body)}</body></html>\n"
    )


def page_height(study: Study) -> int:
    """About the height of the page in CSS pixels."""
    pictures = sum(p.figure.layout.height + 110 for p in study.pictures)
    return 180 + 34 * len(study.lines) + pictures + sum(100 + 32 * len(t.rows) for t in study.tables)


def find_chromium() -> str:
    """The browser that draws the picture; VgrooveError when there is none."""
    found = next((path for path in map(shutil.which, CHROMIUM) if path), None)
    if found is None:
        raise VgrooveError(f"--png needs Chromium to draw the page, and none of {', '.join(CHROMIUM)} is installed")
    return found


def draw(chromium: str, text: str, png_path: Path, height: int) -> None:
    """Picture of a page (its HTML text), twice the page's resolution."""
    part, source = (png_path.with_name(f".{png_path.name}.part.{ending}") for ending in ("png", "html"))
    write_text(source, text)
    command = [
        chromium,
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--hide-scrollbars",
        "--force-device-scale-factor=2",
        f"--window-size={PAGE_WIDTH + 60},{height}",
        "--virtual-time-budget=8000",
        f"--screenshot={part}",
        source.resolve().as_uri(),
    ]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=CHROMIUM_LIMIT_S, check=False)
        if done.returncode != 0 or not part.is_file():
            raise VgrooveError(f"{png_path}: {chromium} drew no picture (exit code {done.returncode})")
        part.replace(png_path)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise VgrooveError(f"{png_path}: {chromium} drew no picture: {error}") from error
    finally:
        part.unlink(missing_ok=True)
        source.unlink(missing_ok=True)


def svg_of(chromium: str, figure: go.Figure) -> str:
    """A figure as the SVG that plotly's camera saves."""
    size = f"{{format:'svg',width:{figure.layout.width},height:{figure.layout.height}}}"
    script = f"Plotly.newPlot('figure',{figure.to_json()}).then(g=>Plotly.toImage(g,{size})).then(u=>{{document.body.textContent=u}})"
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "figure.html"
        scripts = f"<script>{get_plotlyjs()}</script><script>{script}</script>"
        source.write_text(f"<!doctype html><meta charset=utf-8><div id=figure></div>{scripts}", encoding="utf-8")
        command = [chromium, "--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=20000", "--dump-dom", source.as_uri()]
        try:
            dom = subprocess.run(command, capture_output=True, text=True, timeout=CHROMIUM_LIMIT_S, check=True).stdout
        except (OSError, subprocess.SubprocessError) as error:
            raise VgrooveError(f"{chromium} drew no figure: {error}") from error
    found = re.search(r"data:image/svg\+xml,([^<\s]+)", dom)
    if found is None:
        raise VgrooveError(f"{chromium} drew no figure: its page holds none")
    return unquote(html.unescape(found[1])) + "\n"


@dataclass(frozen=True)
class Places:
    """Where a study's files go; prepared, and tried, before the work."""

    folder: Path
    json_path: Path
    chromium: str | None

    def file(self, name: str) -> Path:
        """A file in the folder."""
        return self.folder / name


def prepare(name: str, folder: Path, json_path: Path | None, png: bool) -> Places:
    """Make the folder and see that the files can be written; VgrooveError otherwise."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise VgrooveError(f"{folder}: this folder cannot be made: {error.strerror}") from error
    places = Places(folder, json_path or folder / f"{name}.json", find_chromium() if png else None)
    check_outputs([places.json_path, places.file(f"{name}.html"), places.file(f"{name}.png") if png else None])
    return places


def write(study: Study, places: Places) -> list[Path]:
    """Every file of the study; a file is whole or not there."""
    written = [places.json_path, places.file(f"{study.name}.html")]
    write_text(written[0], json.dumps({"study": study.name, **study.data}, indent=1, allow_nan=False) + "\n")
    write_text(written[1], page(study))
    for table in study.tables:
        written.append(places.file(f"{study.name}_{table.name}.csv"))
        write_text(written[-1], table.as_csv())
    if places.chromium:
        written.append(places.file(f"{study.name}.png"))
        draw(places.chromium, page(study, bar=False), written[-1], page_height(study))
    return written
