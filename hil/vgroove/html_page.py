"""Pages of reports: tables, figures and cards as one HTML text that opens without a network."""

import csv
import html
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import numpy as np
import rich.table
import rich.text

if TYPE_CHECKING:
    import plotly.graph_objects as go

PAGE_WIDTH = 1000  # CSS pixels
WIDE_PANEL = 0.75  # share of the page's width from which a legend is one line at the right
LEAST_SHOWN = 1e-4  # smaller magnitudes are shown as "< 0.0001"
CSS = (
    "body{font:16px/1.5 system-ui,sans-serif;max-width:1000px;margin:24px auto;"
    "padding:0 20px;color:#222}\n"
    "h1{font-size:25px;margin-bottom:4px} h2{font-size:19px;margin:34px 0 4px} "
    "table{border-collapse:collapse;font-size:14px}\n"
    "td,th{padding:3px 10px;border-bottom:1px solid #ddd;text-align:left} "
    "td.n,th.n{text-align:right;font-variant-numeric:tabular-nums}\n"
    "p{margin:6px 0} .note{color:#555} .lead{font-size:19px} .warn{color:#8a5a00}\n"
    "code{font:14px/1.5 ui-monospace,monospace;background:#f3f4f6;padding:1px 5px;"
    "border-radius:3px;overflow-wrap:anywhere}\n"
    ".cards{display:grid;grid-template-columns:repeat(4,1fr);gap:12px;margin:16px 0} "
    ".card{border:1px solid #d5d8dc;border-top:4px solid #00798c;\n"
    "border-radius:4px;padding:8px 12px} "
    ".card b{display:block;font-size:19px;line-height:1.3;overflow-wrap:anywhere} "
    ".card i{font-style:normal;\n"
    "font-size:13px;letter-spacing:.04em;color:#555} "
    ".card span{font-size:14px;color:#333;display:block;margin-top:4px}\n"
    "@media(max-width:760px){.cards{grid-template-columns:repeat(2,1fr)}}"
)


@dataclass(frozen=True)
class Link:
    """A cell of a table that leads to another page: its text, and the file beside the page."""

    text: str
    file: str

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True)
class Table:
    """One table. The CSV file is named REPORT_NAME.csv with this `name`; a column's header states
    its unit; cells are texts, numbers or None.
    """

    name: str
    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[Any]]

    def as_csv(self) -> str:
        """CSV text: header and rows, numbers to six digits."""
        buffer = io.StringIO()
        writer = csv.writer(buffer, lineterminator="\n")
        writer.writerow(self.header)
        writer.writerows(
            [f"{c:.6g}" if isinstance(c, float) else ("" if c is None else c) for c in row]
            for row in self.rows
        )
        return buffer.getvalue()

    def as_rich(self) -> rich.table.Table:
        """The table for the terminal, its texts as they are."""
        title = rich.text.Text(self.title)
        table = rich.table.Table(title=title, title_justify="left", title_style="bold")
        for column, name in enumerate(self.header):
            table.add_column(
                rich.text.Text(name),
                justify="right" if self._is_number(column) else "left",
                overflow="fold",
            )
        for row in self.rows:
            table.add_row(*(rich.text.Text(shown(cell)) for cell in row))
        return table

    def as_html(self) -> str:
        """HTML for the page."""
        marks = [
            " class=n" if self._is_number(column) else "" for column in range(len(self.header))
        ]
        head = "".join(
            f"<th{m}>{html.escape(n)}</th>" for m, n in zip(marks, self.header, strict=True)
        )
        body = [
            "".join(f"<td{m}>{_cell_html(c)}</td>" for m, c in zip(marks, row, strict=True))
            for row in self.rows
        ]
        return f"<table><tr>{head}</tr>" + "".join(f"<tr>{row}</tr>" for row in body) + "</table>"

    def as_markdown(self) -> str:
        """Markdown for pages of documentation."""
        ruler = ["---:" if self._is_number(column) else "---" for column in range(len(self.header))]
        rows = [[shown(cell).replace("|", "\\|") for cell in row] for row in self.rows]
        return "\n".join(f"| {' | '.join(cells)} |" for cells in (self.header, ruler, *rows))

    def height(self) -> int:
        """Approximate height on the page in CSS pixels."""
        return 100 + 32 * len(self.rows)

    def _is_number(self, column: int) -> bool:
        return any(isinstance(row[column], int | float) for row in self.rows)


def table_from_dicts(
    name: str, title: str, columns: Sequence[tuple[str, str]], rows: Iterable[dict[str, Any]]
) -> Table:
    """A table of dicts: `columns` are pairs (header, key); a missing key is an empty cell."""
    cells = [[row.get(key) for _, key in columns] for row in rows]
    return Table(name, title, [header for header, _ in columns], cells)


def _cell_html(cell: Any) -> str:
    text = html.escape(shown(cell))
    return f"<a href='{quote(cell.file)}'>{text}</a>" if isinstance(cell, Link) else text


def shown(cell: Any) -> str:
    """Text of a cell: numbers to four digits, "< 0.0001" for magnitudes below LEAST_SHOWN, a dash
    for None.
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
    """A plotly figure with its title and a sentence that explains it."""

    title: str
    figure: "go.Figure"
    note: str = ""

    def height(self) -> int:
        """Approximate height on the page in CSS pixels."""
        return self.figure.layout.height + 110


@dataclass(frozen=True)
class Note:
    """A heading with sentences below it, and optionally a command that the user can type."""

    title: str
    lines: Sequence[str]
    code: str = ""

    def as_html(self) -> str:
        """HTML for the page."""
        lines = "".join(f"<p>{html.escape(line)}</p>" for line in self.lines)
        return lines + (f"<p><code>{html.escape(self.code)}</code></p>" if self.code else "")

    def height(self) -> int:
        """Approximate height on the page in CSS pixels."""
        return 100 + 34 * len(self.lines)


@dataclass(frozen=True)
class Card:
    """A box at the top of a page: a question, its answer in a few words, and its evidence."""

    question: str
    answer: str
    support: str = ""

    def as_html(self) -> str:
        """HTML for the page."""
        parts = (html.escape(part) for part in (self.question, self.answer, self.support))
        return "<div class=card><i>{}</i><b>{}</b><span>{}</span></div>".format(*parts)


Part = Table | Picture | Note


@dataclass(frozen=True)
class Page:
    """Content of a page in its order. `lead` is the main finding in one sentence; pictures that a
    reader saves from the page are named after `name`.
    """

    name: str
    title: str
    lines: Sequence[str]
    parts: Sequence[Part]
    lead: str = ""
    cards: Sequence[Card] = ()
    warnings: Sequence[str] = ()

    def as_html(self, bar: bool | str = "hover", script: str | None = None) -> str:
        """The page as one HTML text; `bar`: when plotly's buttons above a figure are visible (its
        option displayModeBar: True, False or "hover"); `script`: the file with plotly beside the
        page, without it plotly is within the page (5 MB).
        """
        from plotly.offline import get_plotlyjs

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
                self._figure_html(part, figures, bar)
                if isinstance(part, Picture)
                else part.as_html()
            )
        head = f"<meta charset=utf-8><title>{html.escape(self.title)}</title><style>{CSS}</style>"
        plotly = f" src='{script}'>" if script else f">{get_plotlyjs()}"
        loaded = f"<link rel=icon href='data:,'><script{plotly}</script>"
        return (
            f"<!doctype html><html lang=en><head>{head}{loaded}</head>"
            f"<body>{''.join(body)}</body></html>\n"
        )

    def _figure_html(self, picture: Picture, number: int, bar: bool | str) -> str:
        image = {"format": "svg", "filename": f"{self.name}_{number}"}
        config = {"displaylogo": False, "displayModeBar": bar, "toImageButtonOptions": image}
        figure = picture.figure.to_html(
            full_html=False, include_plotlyjs=False, div_id=f"figure{number}", config=config
        )
        return f"<p class=note>{html.escape(picture.note)}</p>{figure}"

    def height(self) -> int:
        """Approximate height of the page in CSS pixels."""
        return (
            180
            + 34 * len(self.lines)
            + 200 * bool(self.cards)
            + sum(part.height() for part in self.parts)
        )


def style(figure: "go.Figure", height: int, **layout: Any) -> "go.Figure":
    """Give a figure the common style of all reports and return it: white, page width, legend above,
    a font that is legible when the page is shown at half its width.
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


def legend_per_panel(figure: "go.Figure") -> "go.Figure":
    """Give each panel of a styled figure a legend of its own curves, above the panel, and return
    the figure. For figures whose panels show different curves.
    """
    panels = dict.fromkeys((t.xaxis or "x", t.yaxis or "y") for t in figure.data)
    for number, (x, y) in enumerate(panels, 1):
        legend = "legend" if number == 1 else f"legend{number}"
        figure.update_traces(legend=legend, selector={"xaxis": x, "yaxis": y})
        left, right = figure.layout["xaxis" + x[1:]].domain
        is_wide = right - left > WIDE_PANEL
        place = {
            "orientation": "h" if is_wide else "v",
            "x": right if is_wide else left,
            "xanchor": "right" if is_wide else "left",
            "y": figure.layout["yaxis" + y[1:]].domain[1],
            "yref": "paper",
            "yanchor": "bottom",
            "bgcolor": "rgba(0,0,0,0)",  # the axis of the panel above stays visible
        }
        figure.update_layout({legend: place})
    # plotly leaves out the legend of a single curve unless it is asked for
    figure.update_traces(showlegend=True, selector=lambda trace: trace.showlegend is None)
    return figure


def _extremes(values: np.ndarray) -> set[int]:
    """Indices of the minimum and the maximum of values (n,), and of the first NaN."""
    missing = np.isnan(values)
    found = {int(np.argmax(missing))} if missing.any() else set()
    if missing.all():
        return found
    return found | {int(np.nanargmin(values)), int(np.nanargmax(values))}


def thin(time: np.ndarray, *columns: np.ndarray, points: int = 3000) -> list[np.ndarray]:
    """Reduce `time` and columns (n,) to about `points` samples for a plot (min-max decimation): of
    every interval the samples at which a column has its minimum and maximum are kept, and of a
    column with missing samples (NaN) one of these.
    """
    count = len(time)
    if count <= points:
        return [time, *columns]
    edges = np.linspace(0, count, max(2, points // (2 * max(1, len(columns)))) + 1).astype(int)
    keep = {0, count - 1}
    for low, high in zip(edges[:-1], edges[1:], strict=True):
        for column in columns:
            keep |= {low + k for k in _extremes(column[low:high])}
    at = np.array(sorted(keep))
    return [time[at], *(column[at] for column in columns)]
