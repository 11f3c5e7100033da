"""Waveforms as a small SVG that prints: a grid of panels, a column a drive, a row a quantity; no browser and no library is needed."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from vgroove.study.report import thin

WIDTH, LEFT, RIGHT, TOP, BOTTOM = 940, 62, 14, 62, 46
PANEL_HEIGHT, GAP_X, GAP_Y, COLUMN_HEAD = 132, 18, 30, 22
POINTS = 560  # of a curve, at most about: two a pixel
INK, FAINT, GRID = "#222", "#666", "#e3e3e3"
FONT = "font-family='Helvetica,Arial,sans-serif'"


@dataclass(frozen=True)
class Curve:
    """A quantity over time in a column; NaN leaves a gap."""

    time: np.ndarray
    value: np.ndarray
    colour: str


@dataclass(frozen=True)
class Mark:
    """Something happened: a tick at the panel's upper edge, or a line through the panel."""

    time: float
    colour: str = FAINT
    words: str = ""
    through: bool = False


@dataclass(frozen=True)
class Line:
    """A level across a panel, and what it is called."""

    value: float
    words: str
    below: bool = False  # stand the words


@dataclass(frozen=True)
class Cell:
    """One panel."""

    curves: Sequence[Curve]
    marks: Sequence[Mark] = ()
    lines: Sequence[Line] = ()


@dataclass(frozen=True)
class Chart:
    """cells[row][column]; rows share the scale of the quantity, columns that of the time."""

    title: str
    columns: Sequence[str]
    rows: Sequence[str]
    cells: Sequence[Sequence[Cell]]
    time_words: str


@dataclass(frozen=True)
class Scale:
    """Values least..greatest onto pixels from..to."""

    least: float
    greatest: float
    from_px: float
    to_px: float

    def px(self, value: np.ndarray | float) -> np.ndarray | float:
        """Pixels of values."""
        return self.from_px + (value - self.least) / (self.greatest - self.least) * (self.to_px - self.from_px)

    def ticks(self, about: int) -> list[float]:
        """Round numbers within the range."""
        rough = (self.greatest - self.least) / about
        size = 10.0 ** math.floor(math.log10(rough))
        step = next(size * m for m in (1, 2, 5, 10) if size * m >= rough)
        first = math.ceil(self.least / step - 1e-9)
        return [n * step for n in range(first, math.floor(self.greatest / step + 1e-9) + 1)]


def words_of(number: float) -> str:
    """A tick's number as it is read."""
    return f"{number:,.6g}".replace("-", "−")


def range_of(cells: Iterable[Cell]) -> tuple[float, float]:
    """Least and greatest of a row with some air; 0 where it is near."""
    cells = list(cells)
    values = [float(v) for c in cells for curve in c.curves for v in (np.nanmin(curve.value), np.nanmax(curve.value))]
    values += [line.value for c in cells for line in c.lines]
    least, greatest = min(values), max(values)
    span = max(greatest - least, 1e-6 * max(abs(greatest), 1.0))
    least = 0.0 if 0.0 <= least < 0.4 * span else least - 0.06 * span
    return least, greatest + 0.08 * span


def text(x: float, y: float, words: str, *, size: int = 13, anchor: str = "middle", colour: str = INK, bold: bool = False) -> str:
    """Words at a place."""
    weight = " font-weight='600'" if bold else ""
    return f"<text x='{x:.1f}' y='{y:.1f}' font-size='{size}' text-anchor='{anchor}' fill='{colour}'{weight}>{escape(words)}</text>"


def line(x1: float, y1: float, x2: float, y2: float, colour: str, more: str = "") -> str:
    """A straight line."""
    return f"<line x1='{x1:.1f}' y1='{y1:.1f}' x2='{x2:.1f}' y2='{y2:.1f}' stroke='{colour}'{more}/>"


def path(curve: Curve, x: Scale, y: Scale) -> str:
    """A curve, thinned so that the extremes of every stretch stay, in steps of a tenth of a pixel."""
    time, value = thin(curve.time, curve.value, points=POINTS)
    parts, last = [], None
    for px, py in zip(x.px(time), y.px(value), strict=True):
        if math.isnan(py):
            last = None
            continue
        at = round(10 * px), round(10 * py)
        if last is None:
            parts.append(f"M{at[0] / 10:g},{at[1] / 10:g}")
        elif at != last:
            parts.append(f"l{(at[0] - last[0]) / 10:g},{(at[1] - last[1]) / 10:g}")
        last = at
    return f"<path d='{''.join(parts)}' fill='none' stroke='{curve.colour}' stroke-width='1.3' stroke-linejoin='round'/>"


def axes(x: Scale, y: Scale, first_column: bool, last_row: bool) -> list[str]:
    """Grid, frame, and numbers where they are read."""
    size = f"width='{x.to_px - x.from_px:.1f}' height='{y.from_px - y.to_px:.1f}'"
    parts = []
    for value in y.ticks(4):
        at = float(y.px(value))
        parts.append(line(x.from_px, at, x.to_px, at, GRID))
        if first_column:
            parts.append(text(x.from_px - 7, at + 4.5, words_of(value), anchor="end", colour=FAINT))
    for value in x.ticks(max(3, int((x.to_px - x.from_px) / 50))):
        at = float(x.px(value))
        parts.append(line(at, y.from_px, at, y.to_px, GRID))
        if last_row:
            parts.append(text(at, y.from_px + 17, words_of(value), colour=FAINT))
    return [*parts, f"<rect x='{x.from_px:.1f}' y='{y.to_px:.1f}' {size} fill='none' stroke='#999'/>"]


def panel(cell: Cell, x: Scale, y: Scale) -> list[str]:
    """Levels, curves and marks."""
    parts = []
    for level in cell.lines:
        at = float(y.px(level.value))
        parts.append(line(x.from_px, at, x.to_px, at, FAINT, " stroke-dasharray='5 4'"))
        parts.append(text(x.from_px + 5, at + (13 if level.below else -4), level.words, size=12, anchor="start", colour=FAINT))
    parts += [path(curve, x, y) for curve in cell.curves]
    for mark in cell.marks:
        at = float(x.px(mark.time))
        if mark.through:
            parts.append(line(at, y.from_px, at, y.to_px, mark.colour, " stroke-dasharray='5 4'"))
        else:
            parts.append(line(at, y.to_px, at, y.to_px + 8, mark.colour, " stroke-width='1.6'"))
        if mark.words:
            parts.append(text(at + 5, y.to_px + 14, mark.words, size=12, anchor="start", colour=FAINT))
    return parts


def drawn(chart: Chart) -> str:
    """The chart as SVG."""
    count = len(chart.columns)
    wide = (WIDTH - LEFT - RIGHT - GAP_X * (count - 1)) / count
    height = TOP + len(chart.rows) * (PANEL_HEIGHT + GAP_Y) + BOTTOM - GAP_Y
    parts = [
        f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {WIDTH} {height}' width='{WIDTH}' height='{height}' {FONT}>",
        f"<title>{escape(chart.title)}</title><rect width='100%' height='100%' fill='#fff'/>",
    ]
    for c, heading in enumerate(chart.columns):
        from_px = LEFT + c * (wide + GAP_X)
        parts.append(text(from_px + wide / 2, COLUMN_HEAD, heading, size=15, bold=True))
        times = [curve.time for row in chart.cells for curve in row[c].curves]
        x = Scale(float(min(t[0] for t in times)), float(max(t[-1] for t in times)), from_px, from_px + wide)
        for r, words in enumerate(chart.rows):
            top = TOP + r * (PANEL_HEIGHT + GAP_Y)
            y = Scale(*range_of(chart.cells[r]), top + PANEL_HEIGHT, top)
            if c == 0:
                parts.append(text(LEFT, top - 7, words, anchor="start"))
            parts += axes(x, y, c == 0, r == len(chart.rows) - 1)
            parts += panel(chart.cells[r][c], x, y)
        parts.append(text(from_px + wide / 2, height - 8, chart.time_words))
    return "\n".join([*parts, "</svg>\n"])
