"""Pages of the house: tables, figures and cards as one HTML text that opens offline; what every
report is shown on.
"""

import csv
import html
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import plotly.graph_objects as go
import rich.table
from plotly.offline import get_plotlyjs

PAGE_WIDTH = 1000
LEAST_SHOWN = 1e-4
CSS = """body{font:16px/1.5 system-ui,sans-serif;max-width:1000px;margin:24px auto;padding:0 20px;color:#222}
h1{font-size:25px;margin-bottom:4px} h2{font-size:19px;margin:34px 0 4px} table{border-collapse:collapse;font-size:14px}
td,th{padding:3px 10px;border-bottom:1px solid #ddd;text-align:left} td.n,th.n{text-align:right;font-variant-numeric:tabular-nums}
p{margin:6px 0} .note{color:#555} .lead{font-size:19px} .warn{color:#8a5a00}
code{font:14px/1.5 ui-monospace,monospace;background:#f3f4f6;padding:1px 5px;border-radius:3px;overflow-wrap:anywhere}
.cards{display:grid;grid-template-columns:repeat(4,1fr);gap:12px;margin:16px 0} .card{border:1px solid #d5d8dc;border-top:4px solid #00798c;
border-radius:4px;padding:8px 12px} .card b{display:block;font-size:19px;line-height:1.3;overflow-wrap:anywhere} .card i{font-style:normal;
font-size:13px;letter-spacing:.04em;color:#555} .card span{font-size:14px;color:#333;display:block;margin-top:4px}
@media(max-width:760px){.cards{grid-template-columns:repeat(2,1fr)}}"""


@dataclass(frozen=True)
class Table:
    """One table: `name` ends its file's name; a column's header carries its unit; cells are texts,
    numbers or None.
    """

    name: str
    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[Any]]

    def as_csv(self) -> str:
        """Header and rows, numbers to six digits."""
        buffer = io.StringIO()
        writer = csv.writer(buffer, lineterminator="\n")
        writer.writerow(self.header)
        writer.writerows(
            [f"{c:.6g}" if isinstance(c, float) else ("" if c is None else c) for c in row]
            for row in self.rows
        )
        return buffer.getvalue()

    def as_rich(self) -> rich.table.Table:
        """For the terminal."""
        table = rich.table.Table(title=self.title, title_justify="left", title_style="bold")
        for column, name in enumerate(self.header):
            table.add_column(
                name, justify="right" if self._is_number(column) else "left", overflow="fold"
            )
        for row in self.rows:
            table.add_row(*(shown(cell) for cell in row))
        return table

    def as_html(self) -> str:
        """For the page."""
        marks = [
            " class=n" if self._is_number(column) else "" for column in range(len(self.header))
        ]
        head = "".join(
            f"<th{m}>{html.escape(n)}</th>" for m, n in zip(marks, self.header, strict=True)
        )
        body = [
            "".join(f"<td{m}>{html.escape(shown(c))}</td>" for m, c in zip(marks, row, strict=True))
            for row in self.rows
        ]
        return f"<table><tr>{head}</tr>" + "".join(f"<tr>{row}</tr>" for row in body) + "</table>"

    def as_markdown(self) -> str:
        """For pages of documentation."""
        ruler = ["---:" if self._is_number(column) else "---" for column in range(len(self.header))]
        rows = [[shown(cell).replace("|", "\\|") for cell in row] for row in self.rows]
        return "\n".join(f"| {' | '.join(cells)} |" for cells in (self.header, ruler, *rows))

    def height(self) -> int:
        """On the page, about, in CSS pixels."""
        return 100 + 32 * len(self.rows)

    def _is_number(self, column: int) -> bool:
        return any(isinstance(row[column], int | float) for row in self.rows)


def table_from_dicts(
    name: str, title: str, columns: Sequence[tuple[str, str]], rows: Iterable[dict[str, Any]]
) -> Table:
    """A table whose rows are dicts; `columns` are pairs (header, key), a missing key is no value."""
    cells = [[row.get(key) for _, key in columns] for row in rows]
    return Table(name, title, [header for header, _ in columns], cells)


def shown(cell: Any) -> str:
    """A cell as people read it: four digits, a dash for nothing; what is smaller than anyone
    measures is said to be.
    """
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

    def height(self) -> int:
        """On the page, about, in CSS pixels."""
        return self.figure.layout.height + 110


@dataclass(frozen=True)
class Note:
    """A heading with sentences under it; `code` is set as the user types it."""

    title: str
    lines: Sequence[str]
    code: str = ""

    def as_html(self) -> str:
        """For the page."""
        lines = "".join(f"<p>{html.escape(line)}</p>" for line in self.lines)
        return lines + (f"<p><code>{html.escape(self.code)}</code></p>" if self.code else "")

    def height(self) -> int:
        """On the page, about, in CSS pixels."""
        return 100 + 34 * len(self.lines)


@dataclass(frozen=True)
class Card:
    """What a page says at first sight: a question, its answer in a few words, and what supports it."""

    question: str
    answer: str
    support: str = ""

    def as_html(self) -> str:
        """For the page."""
        parts = (html.escape(part) for part in (self.question, self.answer, self.support))
        return "<div class=card><i>{}</i><b>{}</b><span>{}</span></div>".format(*parts)


Part = Table | Picture | Note


@dataclass(frozen=True)
class Page:
    """A page from top to bottom; `lead` is its finding in a sentence, `name` that of the pictures
    saved from it.
    """

    name: str
    title: str
    lines: Sequence[str]
    parts: Sequence[Part]
    lead: str = ""
    cards: Sequence[Card] = ()
    warnings: Sequence[str] = ()

    def as_html(self, bar: bool | str = "hover") -> str:
        """One text that opens offline; `bar`: when the buttons above a figure show."""
        body = [f"<h1>{html.escape(self.title)}</h1>"]
        body += [f"<p class=lead>{html.escape(self.lead)}</p>"] if self.lead else []
        body += (
            [f"<div class=cards>{''.join(card.as_html() for card in self.cards)}</div>"]
            if self.cards
            else []
        )
        body += [f"<p>{html.escape(line)}</p>" for line in self.lines]
        body += [f"<p class=warn>{html.escape(line)}</p>" for line in self.warnings]
        figures = 0
        for part in self.parts:
            figures += isinstance(part, Picture)
            body.append(f"<h2>{html.escape(part.title)}</h2>")
            body.append(
                self._drawn(part, figures, bar) if isinstance(part, Picture) else part.as_html()
            )
        return (
            f"<!doctype html><html lang=en><head><meta charset=utf-8><title>{html.escape(self.title)}</title><style>{CSS}</style>"
            f"<link rel=icon href='data:,'><script>{get_plotlyjs()}</script></head><body>{''.join(body)}</body></html>\n"
        )

    def _drawn(self, picture: Picture, number: int, bar: bool | str) -> str:
        image = {"format": "svg", "filename": f"{self.name}_{number}"}
        config = {"displaylogo": False, "displayModeBar": bar, "toImageButtonOptions": image}
        figure = picture.figure.to_html(
            full_html=False, include_plotlyjs=False, div_id=f"figure{number}", config=config
        )
        return f"<p class=note>{html.escape(picture.note)}</p>{figure}"

    def height(self) -> int:
        """About its height in CSS pixels."""
        return (
            180
            + 34 * len(self.lines)
            + 200 * bool(self.cards)
            + sum(part.height() for part in self.parts)
        )


def style(figure: go.Figure, height: int, **layout: Any) -> go.Figure:
    """The house's look: white, type that is read at half a page, legend above, the camera saves an
    SVG.
    """
    legend = {
        "orientation": "h",
        "y": 1.0 - 30.0 / height,
        "yref": "container",
        "yanchor": "top",
        "x": 0.0,
    }
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
    """`time` and columns (n,) with at most about `points` samples each; of every stretch the
    extremes of each column stay.
    """
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
