"""What `vgroove record` shows on a terminal while it records: the newest value of each signal with
its range over the last seconds, the counters, and on request the curves of the fast signals.
"""

from dataclasses import dataclass, field

import numpy as np
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from vgroove.recorder import Recording
from vgroove.telemetry import COLUMN_LABELS, COLUMN_UNITS, COLUMNS

SHOWN_S = 10.0  # of board time, in table and curves
PLOTTED = ("current_a", "speed_rpm", "duty", "supply_v")
CURVE_LINES, MIN_CURVE_CELLS = 4, 16
SCALE_CELLS = 14  # of the numbers beside a curve
# A character of Unicode's Braille block has 2 x 4 dots; the bit of each, by row and column.
BRAILLE = 0x2800
DOT_BITS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])


def _column_bins(time_s: np.ndarray, dots: int) -> np.ndarray:
    """The column of dots (n,) of each time; the newest sample is in the last one."""
    before_s = time_s[-1] - time_s
    return np.clip(dots - 1 - (before_s * dots / SHOWN_S).astype(int), 0, dots - 1)


def curve_lines(
    time_s: np.ndarray, values: np.ndarray, cells: int, lines: int, span: tuple[float, float]
) -> list[str]:
    """The last SHOWN_S seconds of a curve (n,) as lines of Braille characters: in each column of
    dots the range of its samples, joined to that of the column before. `span`: values of the
    lowest and the highest dot.
    """
    height, width = 4 * lines, 2 * cells
    dots = np.zeros((height, width), bool)
    known = np.isfinite(values)
    if known.any():
        low, high = span
        rows = np.rint((values[known] - low) / max(high - low, 1e-12) * (height - 1)).astype(int)
        bins, last = _column_bins(time_s[known], width), None
        for column in np.unique(bins):
            inside = rows[bins == column]
            ends = [inside.min(), inside.max()]
            if last is not None:
                ends = [min(ends[0], last), max(ends[1], last)]
            dots[ends[0] : ends[1] + 1, column] = True
            last = inside[-1]
    cells_of = dots[::-1].reshape(lines, 4, cells, 2)
    codes = BRAILLE + np.einsum("lrcd,rd->lc", cells_of, DOT_BITS)
    return ["".join(map(chr, row)) for row in codes]


def _number(value: float) -> str:
    return "-" if np.isnan(value) else f"{value:.6g}"


@dataclass
class LiveView:
    """Keeps the rows of the last seconds of a recording and draws them; `plot`: with curves."""

    plot: bool = False
    rows: dict[str, np.ndarray] = field(default_factory=dict)

    def add(self, rows: dict[str, np.ndarray]) -> None:
        """Add final rows, (n,) by column name with `time_s`; older ones than SHOWN_S drop out."""
        if not len(rows["time_s"]):
            return
        joined = {name: np.append(self.rows.get(name, []), rows[name]) for name in rows}
        recent = joined["time_s"] > joined["time_s"][-1] - SHOWN_S
        self.rows = {name: values[recent] for name, values in joined.items()}

    def draw(self, recording: Recording, width: int) -> RenderableType:
        """Counters, table and curves in so many columns of characters."""
        parts: list[RenderableType] = [counters_line(recording)]
        if self.rows:
            if self.plot:
                parts += self._curves(width)  # above the table, which a low terminal cuts off
            parts.append(self._table())
        return Group(*parts)

    def _table(self) -> Table:
        table = Table(box=None, padding=(0, 2), header_style="dim")
        for header in ("signal", "now", f"least in {SHOWN_S:g} s", "greatest", "unit"):
            table.add_column(header, justify="left" if header in ("signal", "unit") else "right")
        for name in COLUMNS:
            values = self.rows[name]
            known = values[np.isfinite(values)]
            ends = (known.min(), known.max()) if len(known) else (np.nan, np.nan)
            numbers = (_number(float(value)) for value in (values[-1], *ends))
            table.add_row(COLUMN_LABELS[name], *numbers, COLUMN_UNITS[name])
        return table

    def _curves(self, width: int) -> list[RenderableType]:
        cells = max(MIN_CURVE_CELLS, width - SCALE_CELLS)
        parts: list[RenderableType] = []
        for name in PLOTTED:
            values = self.rows[name]
            known = values[np.isfinite(values)]
            low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
            lines = curve_lines(self.rows["time_s"], values, cells, CURVE_LINES, (low, high))
            scale = [_number(high), *[""] * (CURVE_LINES - 2), _number(low)]
            text = f"{COLUMN_LABELS[name]} in {COLUMN_UNITS[name]}, last {SHOWN_S:g} s"
            parts.append(Text(text, style="dim"))
            curve = (f"{n:>{SCALE_CELLS - 2}} {line}" for n, line in zip(scale, lines, strict=True))
            parts.append(Text("\n".join(curve), no_wrap=True))
        return parts


def counters_line(recording: Recording) -> Table:
    """One line: file, board time, rows, losses."""
    counters = recording.session.counters
    table = Table.grid(padding=(0, 2))
    colour = "red" if counters.lost + counters.corrupt else "green"
    losses = f"{counters.lost} lost, {counters.corrupt} corrupt, {counters.skipped_bytes} B skipped"
    table.add_row(
        f"[bold]{escape(recording.output.name)}[/]",
        f"{recording.recorded_s:8.1f} s",
        f"{counters.fast} samples",
        f"[{colour}]{losses}[/]",
    )
    return table
