"""Sentences, table and page of a comparison."""

from pathlib import Path

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from vgroove.html_page import Page, Picture, Table, style, thin
from vgroove.log.table import COLUMN_LABELS, COLUMN_UNITS
from vgroove.log_compare.compare import Comparison
from vgroove.log_compare.gaps import EQUAL, SignalGap
from vgroove.log_compare.limits import DISCRETE

PANEL_HEIGHT = 190  # CSS pixels
COLOURS = {"A": "#00798c", "B": "#d1495b", "gap": "#555"}
KINDS = {
    "quantisation": "by at most one step of its resolution (quantisation)",
    "timing": "by a value that the other log has one row earlier or later (timing)",
    "other": "by neither quantisation nor one row of timing",
}


def first_sentence(found: Comparison) -> str:
    """Where the logs first differ, and whether an input or an output of the board is first."""
    alike = "equal to the interpolated ones" if found.pairs.interpolated else "equal bit for bit"
    if found.first is None:
        return f"All {len(found.pairs.time_s)} common rows are {alike}."
    first, names = found.first, found.first.columns
    gap = next(g for g in found.signals if g.name == names[0])
    unit = COLUMN_UNITS.get(gap.name, "")
    sides = (f"{log} {_shown(v)}" for log, v in (("A", gap.first_a), ("B", gap.first_b)))
    values = f"{', '.join(sides)}{' ' + unit if unit else ''}"
    also = f"; in the same row also {', '.join(names[1:])}" if len(names) > 1 else ""
    return (
        f"The {found.equal_rows} rows before {first.time_s:.6g} s are {alike}. There "
        f"{names[0]} differs first ({values}), {KINDS[first.kind]}{also}."
    )


def _shown(value: float | None) -> str:
    return "missing" if value is None or np.isnan(value) else f"{value:.9g}"


def cause_sentence(found: Comparison) -> str:
    """What the first difference says about the board."""
    if found.cause == "input":
        return (
            "The board's inputs differ first, while its bridge command is equal. Outputs that "
            "differ in this or later rows are the answer to other inputs."
        )
    if found.cause == "output":
        return (
            "The board's outputs differ first, although its inputs in the log were equal until "
            "then: compare firmware, parameters and the commands sent to both boards."
        )
    return ""


def clock_sentence(found: Comparison) -> str:
    """Offset and drift of the clocks, where they explain a part of the gap."""
    time_map = found.time_map
    if not time_map.share:
        return "No time offset within the searched range explains 75 % of the gap."
    return (
        f"Log B is {1e3 * time_map.offset_s:.3f} ms later than log A, with a clock drift of "
        f"{1e6 * time_map.drift:.1f} ppm; this explains {100 * time_map.share:.1f} % of the gap of "
        "the continuous columns (normalised squares)."
    )


def row_sentence(found: Comparison) -> str:
    """Which rows were compared."""
    pairs = found.pairs
    if pairs.interpolated:
        return (
            f"{len(pairs.time_s)} rows of A with B interpolated at their times: the logs have "
            "other sampling instants, so equality bit for bit is not defined."
        )
    outside_a, outside_b = (
        total - len(pairs.time_s) - only
        for total, only in zip(found.rows, (pairs.only_a, pairs.only_b), strict=True)
    )
    return (
        f"{len(pairs.time_s)} rows of equal time; within the common range {pairs.only_a} rows are "
        f"in A only and {pairs.only_b} in B only; {outside_a} rows of A and {outside_b} of B lie "
        "outside it."
    )


def sentences(found: Comparison) -> list[str]:
    """The findings in their order."""
    lines = [*found.warnings, row_sentence(found), first_sentence(found), cause_sentence(found)]
    if found.first is not None:
        lines.append(clock_sentence(found))
    if found.only_in:
        only = ", ".join(f"{name} (in {log})" for name, log in found.only_in.items())
        lines.append(f"Columns of one log only: {only}.")
    return [line for line in lines if line]


def gap_table(found: Comparison) -> Table:
    """Gap of each column."""
    header = (
        "column",
        "unit",
        "rows that differ",
        "first in s",
        "largest gap",
        "rms gap",
        "resolution",
        "largest in steps",
        "rms after the time map",
        "explanation",
    )
    return Table("columns", "Gap of each column, B - A", header, [_row(g) for g in found.signals])


def _row(gap: SignalGap) -> list[object]:
    steps = gap.largest / gap.resolution if gap.resolution and gap.name not in DISCRETE else None
    explanation = gap.explanation
    if gap.explanation == "timing" and gap.worst_shift_s is not None:
        explanation = f"timing: changes at most {1e3 * gap.worst_shift_s:.3g} ms apart"
    if gap.missing:
        explanation += f"; {gap.missing} values in one log only"
    return [
        gap.name,
        COLUMN_UNITS.get(gap.name, "") or "1",
        gap.differing,
        gap.first_s,
        gap.largest,
        gap.rms,
        gap.resolution or None,
        steps,
        gap.rms_aligned,
        explanation,
    ]


def trace_picture(found: Comparison) -> Picture:
    """Both logs, a panel for each column that differs (all columns where none does)."""
    shown = [g for g in found.signals if g.explanation != EQUAL] or list(found.signals)
    figure = make_subplots(
        rows=len(shown), cols=1, shared_xaxes=True, vertical_spacing=0.3 / (len(shown) + 2)
    )
    for panel, gap in enumerate(shown, 1):
        _add_panel(figure, found, gap, panel)
    figure.update_xaxes(title_text="time in s", row=len(shown))
    note = "A, B and their gap B - A at the paired rows; the dotted line is the first difference."
    return Picture("Both logs and their gap", style(figure, 200 + PANEL_HEIGHT * len(shown)), note)


def _add_panel(figure: go.Figure, found: Comparison, gap: SignalGap, panel: int) -> None:
    a, b = found.pairs.a[gap.name], found.pairs.b[gap.name]
    time_s, *curves = thin(found.pairs.time_s, a, b, b - a)
    for name, values in zip(COLOURS, curves, strict=True):
        trace = go.Scatter(
            x=time_s,
            y=values,
            name=name,
            legendgroup=name,
            showlegend=panel == 1,
            line={"color": COLOURS[name], "width": 1, "dash": "dot" if name == "gap" else "solid"},
        )
        figure.add_trace(trace, row=panel, col=1)
    if found.first is not None:
        figure.add_vline(x=found.first.time_s, line_dash="dot", row=panel, col=1)
    unit = COLUMN_UNITS.get(gap.name, "")
    label = COLUMN_LABELS.get(gap.name, gap.name)
    figure.update_yaxes(title_text=f"{label}{f' in {unit}' if unit else ''}", row=panel, col=1)


def comparison_page(found: Comparison) -> Page:
    """The page of a comparison."""
    names = [Path(source).name for source in (found.a, found.b)]
    return Page(
        "log_compare",
        f"Comparison of {names[0]} (A) and {names[1]} (B)",
        sentences(found),
        [gap_table(found), trace_picture(found)],
    )
