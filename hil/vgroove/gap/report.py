"""Puts a diagnosis into words and on one self-contained page: verdict, shares, ranked effects, traces, residuals, gaps."""

import html
from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
from plotly.offline import get_plotlyjs
from plotly.subplots import make_subplots

MEASURED, NOMINAL, CORRECTED, SHADE = "#30343b", "#d1495b", "#00798c", "rgba(237,174,73,0.16)"
POINTS = 4000
CSS = """body{font:15px/1.5 system-ui,sans-serif;max-width:1180px;margin:24px auto;padding:0 20px;color:#222}
h1{font-size:24px;margin-bottom:4px} h2{font-size:18px;margin-top:32px} table{border-collapse:collapse;font-size:14px}
td,th{padding:4px 12px;border-bottom:1px solid #ddd;text-align:left} td.n{text-align:right;font-variant-numeric:tabular-nums}
.lead{font-size:18px} .muted{color:#666}"""


def sentence(verdict: dict) -> str:
    """The verdict in one sentence."""
    gap, names = verdict["gap"], " and ".join(n.replace("_", " ") for n in verdict["selected"])
    figures = f"gap {gap['before']:.2f} before, {gap['retuned']:.2f} retuned, {gap['after']:.2f} after (noise floor {gap['floor']:.2f})"
    if verdict["verdict"] == "none":
        return f"No gap beyond the noise and the stated tolerances: {figures}."
    if verdict["verdict"] == "unlisted":
        left = verdict["unexplained"]["best_correlate"]
        follows = f"; what remains follows {left}" if left else ""
        return f"A real gap that no effect of the catalogue closes: {figures}{follows}."
    if verdict["verdict"] == "ambiguous":
        others = ", ".join(r["id"].replace("_", " ") for r in verdict["indistinguishable"])
        return f"Most likely {names}, but {others} would predict these logs as well: {figures}."
    return f"The missing effect is {names}: {figures}."


def summary(verdict: dict) -> list[str]:
    """Lines for a terminal."""
    lines = [sentence(verdict)]
    shares = {k: v for k, v in verdict["where"]["share"].items() if v >= 0.005}
    if shares:
        lines.append("where: " + ", ".join(f"{k} {100 * v:.0f} %" for k, v in sorted(shares.items(), key=lambda i: -i[1])))
    for effect in [e for e in verdict["effects"] if e["id"] in verdict["selected"]]:
        lines.append(f"{effect['id']}: probability {effect['probability']:.2f}, " + ", ".join(parameter_words(effect)))
    for other in verdict["indistinguishable"]:
        lines.append(f"not to be told from {other['instead_of']}: {other['id']}")
    if verdict["next_experiment"]:
        lines.append(f"next run: {verdict['next_experiment']['profile']} ({verdict['next_experiment']['why']})")
    return lines


def parameter_words(effect: dict) -> list[str]:
    """Each parameter with its interval and unit."""
    out = []
    for name, p in effect["parameters"].items():
        ci = f" [{p['ci95'][0]:.4g}, {p['ci95'][1]:.4g}]" if p["ci95"] else ""
        out.append(f"{name} {p['value']:.4g}{ci} {p['unit']}")
    return out


def thin(*columns: np.ndarray) -> list[np.ndarray]:
    """Every k-th sample, so that a plot holds at most POINTS of them."""
    step = max(1, -(-len(columns[0]) // POINTS))
    return [c[::step] for c in columns]


def trace_figure(nominal: dict, corrected: dict, units: dict[str, str], held_out: Sequence[Sequence[float]]) -> go.Figure:
    """Per signal: measured, nominal, corrected above; residuals of both below; held-out blocks shaded."""
    names = list(nominal)
    labels = [text for n in names for text in (n, f"{n}: measured - model")]
    figure = make_subplots(rows=2 * len(names), cols=1, shared_xaxes=True, vertical_spacing=0.03, subplot_titles=labels)
    for i, name in enumerate(names):
        t, y, model = thin(*nominal[name])
        _, _, fixed = thin(*corrected[name])
        first, row = i == 0, 2 * i + 1
        for label, values, colour in (("measured", y, MEASURED), ("nominal", model, NOMINAL), ("corrected", fixed, CORRECTED)):
            figure.add_trace(line(t, values, label, colour, first), row=row, col=1)
        figure.add_trace(line(t, y - model, "nominal", NOMINAL, False), row=row + 1, col=1)
        figure.add_trace(line(t, y - fixed, "corrected", CORRECTED, False), row=row + 1, col=1)
        figure.update_yaxes(title_text=units[name], row=row, col=1)
        figure.update_yaxes(title_text=units[name], row=row + 1, col=1)
    for start, end in held_out:
        figure.add_vrect(x0=start, x1=end, fillcolor=SHADE, line_width=0, layer="below")
    figure.update_xaxes(title_text="time in s", row=2 * len(names), col=1)
    figure.update_layout(height=230 * 2 * len(names), template="plotly_white", legend={"orientation": "h", "y": 1.04})
    return figure


def line(t: np.ndarray, y: np.ndarray, name: str, colour: str, legend: bool) -> go.Scattergl:
    """One curve."""
    return go.Scatter(x=t, y=y, name=name, mode="lines", line={"color": colour, "width": 1.1}, legendgroup=name, showlegend=legend)


def gap_figure(gap: dict) -> go.Figure:
    """Gap of each signal over its floor: before, retuned, after."""
    names, figure = list(gap["by_signal"]), go.Figure()
    for label, colour in (("before", NOMINAL), ("retuned", "#edae49"), ("after", CORRECTED), ("floor", "#9aa0a6")):
        values = [gap["by_signal"][n][label] / gap["by_signal"][n]["floor"] for n in names]
        words = [f"{gap['by_signal'][n][label]:.4g} {gap['by_signal'][n]['unit']}" for n in names]
        figure.add_trace(go.Bar(x=names, y=values, name=label, marker_color=colour, text=words, textposition="outside"))
    figure.update_layout(barmode="group", height=380, margin={"t": 30}, template="plotly_white",
                         yaxis_title="gap / noise floor (RMS, held out)")
    return figure


def share_figure(shares: dict[str, float]) -> go.Figure:
    """Subsystem shares."""
    ranked = sorted(((k, v) for k, v in shares.items() if v > 0.0), key=lambda i: i[1])
    figure = go.Figure(go.Bar(x=[100 * v for _, v in ranked], y=[k for k, _ in ranked], orientation="h", marker_color=CORRECTED))
    figure.update_layout(height=110 + 36 * len(ranked), template="plotly_white", xaxis_title="share of the squared gap in %",
                         margin={"l": 160, "t": 20, "b": 50}, yaxis={"dtick": 1})
    return figure


def effect_table(verdict: dict) -> str:
    """Ranked effects as an HTML table."""
    rows = []
    for e in verdict["effects"][:15]:
        mark = "<b>" if e["id"] in verdict["selected"] else "<span>"
        closes = "–" if e["closes"] is None else f"{100 * e['closes']:.0f} %"
        words = html.escape("; ".join(parameter_words(e)))
        rows.append(f"<tr><td>{mark}{e['id']}{mark.replace('<', '</')}</td><td>{e['subsystem']}</td><td class=n>{e['probability']:.2f}</td>"
                    f"<td class=n>{closes}</td><td class=n>{100 * (e['lost_without'] or 0):.0f} %</td><td>{words}</td></tr>")
    head = "<tr><th>effect</th><th>subsystem</th><th>probability</th><th>closes alone</th><th>lost without</th><th>fitted [95 %]</th></tr>"
    return f"<table>{head}{''.join(rows)}</table>"


def page(verdict: dict, figures: Sequence[tuple[str, go.Figure]], source: str, notes: Sequence[str]) -> str:
    """The whole report as one HTML text that opens offline."""
    body = [f"<h1>{html.escape(source)}</h1><p class=lead>{html.escape(sentence(verdict))}</p>"]
    body += [f"<p class=muted>{html.escape(text)}</p>" for text in [*summary(verdict)[1:], *notes]]
    body.append(f"<h2>Effects, ranked</h2>{effect_table(verdict)}")
    for i, (title, figure) in enumerate(figures):
        body.append(f"<h2>{html.escape(title)}</h2>")
        body.append(figure.to_html(full_html=False, include_plotlyjs=False, div_id=f"figure{i}", config={"displaylogo": False}))
    return (f"<!doctype html><html lang=en><head><meta charset=utf-8><title>{html.escape(source)}</title><style>{CSS}</style>"
            f"<link rel=icon href='data:,'><script>{get_plotlyjs()}</script></head><body>{''.join(body)}</body></html>\n")
