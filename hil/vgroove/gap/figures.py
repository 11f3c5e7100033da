"""The figures of a diagnosis page: gap of each signal, shares, traces, correction of the rest."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from vgroove.gap.next_run.menu import PROFILE_S, profile_named
from vgroove.gap.verdict.schema import Gap, NextExperiment, Unexplained
from vgroove.html_page import Picture, style, thin

MEASURED, NOMINAL, RETUNED, CORRECTED = "#30343b", "#d1495b", "#edae49", "#00798c"
FLOOR, SHADE = "#9aa0a6", "rgba(237,174,73,0.16)"
# column -> (time_s, measured, model), each (n,)
Traces = dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class LogTraces:
    """Traces of one log in the signals' units, of the nominal and the corrected model. name: of the
    log; after: name of the corrected model in the figure; held_out_s: judged stretches [from, to].
    """

    name: str
    after: str
    units: dict[str, str]
    nominal: Traces
    corrected: Traces
    held_out_s: Sequence[Sequence[float]]
    restart_s: float


def plain_style(figure: go.Figure, height: int, **layout: Any) -> go.Figure:
    """The style of a page's figure without a legend."""
    return style(figure, height, **layout).update_layout(showlegend=False, margin={"t": 36})


def gap_picture(gap: Gap) -> Picture:
    """Gap of each signal in units of its floor: before, retuned, after."""
    signals = gap.with_samples
    figure, names = go.Figure(), list(signals)
    bars = (("before", NOMINAL), ("retuned", RETUNED), ("after", CORRECTED), ("floor", FLOOR))
    for label, colour in bars:
        values = [getattr(one, label) / one.floor for one in signals.values()]
        figure.add_trace(
            go.Bar(
                x=names,
                y=values,
                name=label,
                marker_color=colour,
                text=[f"{v:.2f}" for v in values],
                textposition="outside",
            )
        )
    style(figure, 400, barmode="group", yaxis_title="gap / noise floor")
    note = (
        "RMS of measured minus model on held-out blocks, over what noise alone gives. Retuned: the"
        " rig's values refitted within their tolerances; after: with the named effects too."
    )
    return Picture("How far: the gap of each signal", figure, note)


def bars_figure(rows: Sequence[tuple[str, float]], axis: str) -> go.Figure:
    """Horizontal bars of (name, value), the first row on top."""
    names, values = zip(*reversed(rows), strict=True)
    bar = go.Bar(
        x=values,
        y=names,
        orientation="h",
        marker_color=CORRECTED,
        text=[f"{v:.3g}" for v in values],
        textposition="outside",
        cliponaxis=False,
    )
    figure = plain_style(go.Figure(bar), 106 + 34 * len(rows), xaxis_title=axis)
    return figure.update_layout(margin={"l": 260, "r": 60})


def command_picture(proposed: NextExperiment) -> Picture:
    """The command of a proposed run over time."""
    profile = profile_named(proposed.profile)
    time_s, level = zip(*proposed.points, strict=True)
    shape, ends = ("linear", []) if profile.linear else ("hv", [PROFILE_S])
    curve = go.Scatter(
        x=[*time_s, *ends],
        y=[*level, *level[-1:] * len(ends)],
        line={"shape": shape, "color": CORRECTED},
    )
    figure = plain_style(
        go.Figure(curve), 260, xaxis_title="time in s", yaxis_title="command, share"
    )
    note = "of the largest command"
    if profile.opens_bridge:
        note += ", the bridge open where it is 0 after the first press"
    return Picture("Command of the proposed run", figure, note)


def remainder_figure(left: Unexplained, unit: str) -> go.Figure:
    """The smooth correction of a signal over the covariate that the remainder depends on."""
    x, y = zip(*left.correction, strict=True)
    curve = go.Scatter(x=x, y=y, mode="lines+markers", line={"color": CORRECTED})
    axis = f"correction of {left.signal} in {unit}"
    return plain_style(go.Figure(curve), 340, xaxis_title=left.best_correlate, yaxis_title=axis)


def trace_picture(log: LogTraces) -> Picture:
    """Per signal of a log: measured, nominal and corrected curves above, residuals of both models
    below; held-out blocks shaded.
    """
    rows = 2 * len(log.nominal)
    titles = [t for n in log.nominal for t in (f"{n} in {log.units[n]}", f"{n}: measured - model")]
    figure = make_subplots(
        rows=rows, cols=1, shared_xaxes=True, vertical_spacing=0.25 / rows, subplot_titles=titles
    )
    for i, signal in enumerate(log.nominal):
        for row, curve in signal_curves(log, signal, legend=i == 0):
            figure.add_trace(curve, row=2 * i + row, col=1)
    figure.update_layout(shapes=shaded_blocks(log.held_out_s, figure))
    style(figure, 130 + 190 * rows)
    figure.update_xaxes(title_text="time in s", row=rows, col=1)
    note = (
        f"The model restarts from measured states, every {log.restart_s:g} s or earlier. Shaded:"
        " held-out blocks, from which the figures above are computed, each predicted by a fit"
        " without it. The curves are those of the final fit."
    )
    title = f"{log.name}: measured, nominal and {log.after} model"
    return Picture(title, figure, note)


def shaded_blocks(blocks: Sequence[Sequence[float]], figure: go.Figure) -> list[dict[str, Any]]:
    """Shapes that shade blocks [from, to] over the height of each subplot that holds a curve.

    They are set at once: each call of plotly's add_vrect checks all shapes that are there.
    """
    axes = dict.fromkeys((curve.xaxis, curve.yaxis) for curve in figure.data)
    look = {"type": "rect", "fillcolor": SHADE, "line": {"width": 0}, "layer": "below"}
    return [
        look | {"xref": x, "yref": f"{y} domain", "x0": start, "x1": end, "y0": 0, "y1": 1}
        for start, end in blocks
        for x, y in axes
    ]


def signal_curves(log: LogTraces, signal: str, legend: bool) -> list[tuple[int, go.Scatter]]:
    """Curves of one signal, with the row (1: signals, 2: residuals) that each belongs in."""
    nominal, corrected = log.nominal[signal], log.corrected[signal]
    t, y, model, fixed = thin(nominal[0], *nominal[1:], corrected[2])
    curves = (
        (1, "measured", y, MEASURED),
        (1, "nominal", model, NOMINAL),
        (1, log.after, fixed, CORRECTED),
        (2, "nominal", y - model, NOMINAL),
        (2, log.after, y - fixed, CORRECTED),
    )
    return [
        (
            row,
            go.Scatter(
                x=t,
                y=values,
                name=name,
                mode="lines",
                line={"color": colour, "width": 1.2},
                legendgroup=name,
                showlegend=legend and row == 1,
            ),
        )
        for row, name, values, colour in curves
    ]
