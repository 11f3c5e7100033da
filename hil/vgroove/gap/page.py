"""The page of a diagnosis: where, which, how far and what next at first sight, then everything that
supports it.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from vgroove.gap.diagnose import Diagnosis
from vgroove.gap.next_run.menu import PROFILE_S, profile_named
from vgroove.gap.report import parameter_texts, spaced_name, verdict_sentence
from vgroove.page import Card, Note, Page, Part, Picture, Table, style, thin

MEASURED, NOMINAL, RETUNED, CORRECTED, FLOOR, SHADE = (
    "#30343b",
    "#d1495b",
    "#edae49",
    "#00798c",
    "#9aa0a6",
    "rgba(237,174,73,0.16)",
)
EFFECTS_SHOWN, FOLLOWS_SHOWN = 12, 8
SHARE_SHOWN = 0.05
Traces = dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]


def diagnosis_page(found: Diagnosis, names: Sequence[str]) -> Page:
    """The page of a diagnosis of logs with these names."""
    problem, verdict = found.problem, found.verdict
    units = {s.column: s.unit for s in problem.signals}
    nominal, corrected = problem.traces(problem.theta0), problem.traces(found.theta())
    traces = [
        trace_picture(
            name, nominal[j], corrected[j], units, problem.held_out_s[j], problem.restart_s, verdict
        )
        for j, name in enumerate(names)
    ]
    retuned = [
        [key, problem.rig.value(key), value] for key, value in verdict["retuned_parameters"].items()
    ]
    parts = [
        *gap_parts(verdict["gap"]),
        effect_table(verdict),
        *rival_parts(verdict),
        *next_parts(verdict),
        *where_parts(verdict["where"]),
        *left_parts(verdict["unexplained"], units),
        *traces,
    ]
    parts += (
        [Table("retuned", "Rig values within their tolerance", ["key", "rig", "retuned"], retuned)]
        if retuned
        else []
    )
    title = f"Gap of {problem.rig.name or 'the rig'}: {', '.join(names)}"
    return Page(
        "gap",
        title,
        [],
        parts,
        lead=verdict_sentence(verdict),
        cards=cards(verdict),
        warnings=verdict["warnings"],
    )


def percent(share: float | None) -> str:
    """A share in words."""
    return "–" if share is None else f"{100 * share:.0f} %"


def cards(verdict: dict[str, Any]) -> list[Card]:
    """Where, which, how far, what next."""
    return [where_card(verdict), which_card(verdict), far_card(verdict), next_card(verdict)]


def where_card(verdict: dict[str, Any]) -> Card:
    """The subsystem with the largest share, the others, and the regime."""
    ranked = sorted(verdict["where"]["share"].items(), key=lambda i: -i[1])
    if not ranked:
        return Card("WHERE", "nowhere", "what differs is noise, or within the rig's tolerances")
    others = [
        f"{spaced_name(name)} {percent(value)}"
        for name, value in ranked[1:]
        if value >= SHARE_SHOWN
    ]
    signals = verdict["gap"]["by_signal"]
    seen = max(signals, key=lambda name: signals[name]["before"] / signals[name]["floor"])
    regimes = [
        f"most of it at {r['regime']} ({percent(r['share'])})"
        for r in verdict["where"]["by_regime"][:1]
    ]
    return Card(
        "WHERE",
        f"{spaced_name(ranked[0][0])} {percent(ranked[0][1])}",
        "; ".join([*others, f"seen in {seen}", *regimes]),
    )


def which_card(verdict: dict[str, Any]) -> Card:
    """What is missing, or why nothing is named."""
    effects = {e["id"]: e for e in verdict["effects"]}
    if verdict["verdict"] == "none":
        return Card("WHICH", "no effect is missing", "")
    if verdict["verdict"] == "unlisted":
        left = verdict["unexplained"]
        gain = f"; a correction over that could gain {percent(left['could_gain'])}"
        looks = left["looks_like"] + gain if left["looks_like"] else "no pattern"
        return Card("WHICH", "none of the catalogue", f"what is left: {looks}")
    chosen = verdict["selected"]
    if verdict["verdict"] == "ambiguous":
        rivals = [r["id"] for r in verdict["indistinguishable"]]
        chances = ", ".join(
            f"{spaced_name(i)} {percent(effects[i]['probability'])}"
            for i in [*chosen, *rivals]
            if i in effects
        )
        return Card(
            "WHICH",
            f"{' and '.join(map(spaced_name, chosen))}, or {' or '.join(map(spaced_name, rivals))}",
            f"probabilities: {chances}",
        )
    support = [
        f"{percent(effects[i]['probability'])} sure: {', '.join(parameter_texts(effects[i]))}"
        for i in chosen
    ]
    return Card("WHICH", " and ".join(map(spaced_name, chosen)), "; ".join(support))


def far_card(verdict: dict[str, Any]) -> Card:
    """The gap before and after."""
    gap = verdict["gap"]
    closes = f"closes {percent(gap['closed'])}" if gap["closed"] is not None else "no gap to close"
    closes += " [{}, {}]".format(*map(percent, gap["closed_ci95"])) if gap["closed_ci95"] else ""
    alone = (
        f", retuning alone {percent(gap['closed_by_retuning'])}"
        if gap["closed_by_retuning"] is not None
        else ""
    )
    support = f"noise floor {gap['floor']:.2f} (RMS in sigma, held out); {closes}{alone}"
    return Card("HOW FAR", f"{gap['before']:.2f} → {gap['after']:.2f}", support)


def next_card(verdict: dict[str, Any]) -> Card:
    """The run to record next."""
    asked = verdict["next_experiment"]
    if asked is None:
        return Card("WHAT NEXT", "no further run", "--out-rig writes the rig with what was found")
    parts = asked.get("separation")
    support = (
        f"parts the rivals by {parts[0]['sigma']:.2g} sigma a sample" if parts else asked["why"]
    )
    return Card("WHAT NEXT", f"record: {asked['profile']}", support)


def gap_parts(gap: dict[str, Any]) -> list[Part]:
    """Gap of each signal in units of its floor, and in its own unit with the agreement ratings."""
    figure, names = go.Figure(), list(gap["by_signal"])
    for label, colour in (
        ("before", NOMINAL),
        ("retuned", RETUNED),
        ("after", CORRECTED),
        ("floor", FLOOR),
    ):
        values = [gap["by_signal"][n][label] / gap["by_signal"][n]["floor"] for n in names]
        text = [f"{v:.2f}" for v in values]
        figure.add_trace(
            go.Bar(
                x=names,
                y=values,
                name=label,
                marker_color=colour,
                text=text,
                textposition="outside",
            )
        )
    style(figure, 400, barmode="group", yaxis_title="gap / noise floor")
    keys = ("unit", "before", "retuned", "after", "floor", "iso18571_before", "iso18571_after")
    rows = [[name, *(one[key] for key in keys)] for name, one in gap["by_signal"].items()]
    header = [
        "signal",
        "unit",
        "before",
        "retuned",
        "after",
        "floor",
        "ISO/TS 18571 before",
        "after",
    ]
    note = "RMS of measured minus model on held-out blocks, over what noise alone gives"
    return [
        Picture("How far: the gap of each signal", figure, note),
        Table("signals", "The same in units", header, rows),
    ]


def effect_table(verdict: dict[str, Any]) -> Table:
    """The likeliest effects."""
    header = [
        "effect",
        "named",
        "subsystem",
        "probability",
        "closes alone",
        "lost without",
        "fitted [95 % interval]",
    ]
    rows = [
        [
            e["id"],
            "yes" if e["id"] in verdict["selected"] else "",
            spaced_name(e["subsystem"]),
            round(e["probability"], 2),
            percent(e["closes"]),
            percent(e["lost_without"]),
            "; ".join(parameter_texts(e)),
        ]
        for e in verdict["effects"][:EFFECTS_SHOWN]
    ]
    more = len(verdict["effects"]) - len(rows)
    rest = f" (the first {len(rows)}; {more} more are less likely)" if more > 0 else ""
    return Table("effects", f"Which: effects, ranked{rest}", header, rows)


def rival_parts(verdict: dict[str, Any]) -> list[Part]:
    """What these logs cannot tell apart."""
    chance = {e["id"]: round(e["probability"], 2) for e in verdict["effects"]}
    rows = [
        [r["id"], r["instead_of"], chance.get(r["id"]), percent(r["closes"])]
        for r in verdict["indistinguishable"]
    ]
    tied = verdict["verdict"] == "ambiguous"
    title = (
        "Rivals that predict the held-out data as well"
        if tied
        else "Equal by physics: no such log could tell them apart"
    )
    return (
        [Table("rivals", title, ["effect", "instead of", "probability", "closes alone"], rows)]
        if rows
        else []
    )


def next_parts(verdict: dict[str, Any]) -> list[Part]:
    """The proposed run: why, how it is performed, its command, and how far each run of the menu
    parts the rivals.
    """
    asked = verdict["next_experiment"]
    if asked is None:
        return []
    time_s, level = zip(*asked["points"], strict=True)
    shape, ends = (
        ("linear", []) if profile_named(asked["profile"]).straight else ("hv", [PROFILE_S])
    )
    course = go.Figure(
        go.Scatter(
            x=[*time_s, *ends],
            y=[*level, *level[-1:] * len(ends)],
            line={"shape": shape, "color": CORRECTED},
        )
    )
    plain(course, 260, xaxis_title="time in s", yaxis_title="command, share")
    command = "vgroove run --on PORT --next VERDICT.json -o next.csv    (PORT: the board's; VERDICT.json: from --json)"
    lines = [asked["why"] + ".", "Then diagnose all logs together."]
    opens = "of the largest command" + (
        ", the bridge open where it is 0 after the first press"
        if profile_named(asked["profile"]).coasts
        else ""
    )
    parts: list[Part] = [
        Note(f"What next: record the run '{asked['profile']}'", lines, command),
        Picture("Its command", course, opens),
    ]
    if asked.get("separation"):
        rows = [(s["profile"], s["sigma"]) for s in asked["separation"]]
        note = "difference of what they predict, in sigma a sample, less what other sizes of the effects could make of it"
        parts.append(
            Picture("How far each run would part the rivals", bars(rows, "sigma a sample"), note)
        )
    return parts


def where_parts(where: dict[str, Any]) -> list[Part]:
    """Shares of subsystems and regimes, and what the gap follows."""
    shares = sorted(
        ((spaced_name(k), 100 * v) for k, v in where["share"].items() if v > 0.0),
        key=lambda i: -i[1],
    )
    regimes = [(r["regime"], 100 * r["share"]) for r in where["by_regime"]]
    follows = [
        (f"{c['follows']} (in {c['signal']})", 100 * c["share"])
        for c in where["by_correlate"][:FOLLOWS_SHOWN]
    ]
    shown = (
        (
            "Where: subsystems",
            shares,
            "share of the squared gap, Shapley value of each subsystem's own flexible correction",
        ),
        (
            "Where: regimes",
            regimes,
            "share of the squared gap of the nominal model above the noise",
        ),
        (
            "What the gap follows",
            follows,
            "share of the squared gap, after retuning, that goes with each signal alone; they overlap",
        ),
    )
    return [
        Picture(title, bars(rows, "share in %"), note)
        for title, rows, note in shown
        if rows and shares
    ]


def bars(rows: Sequence[tuple[str, float]], axis: str) -> go.Figure:
    """Horizontal bars, the first row on top."""
    names, values = zip(*reversed(rows), strict=True)
    text = [f"{v:.3g}" for v in values]
    bar = go.Bar(
        x=values,
        y=names,
        orientation="h",
        marker_color=CORRECTED,
        text=text,
        textposition="outside",
        cliponaxis=False,
    )
    figure = go.Figure(bar)
    plain(figure, 106 + 34 * len(rows), xaxis_title=axis)
    return figure.update_layout(margin={"l": 260, "r": 60})


def plain(figure: go.Figure, height: int, **layout: Any) -> go.Figure:
    """The house's look for a figure without a legend."""
    return style(figure, height, **layout).update_layout(showlegend=False, margin={"t": 36})


def trace_picture(
    name: str,
    nominal: Traces,
    corrected: Traces,
    units: dict[str, str],
    held_out: Sequence[Sequence[float]],
    restart_s: float,
    verdict: dict[str, Any],
) -> Picture:
    """Per signal: measured, nominal, corrected above; residuals of both below; held-out blocks
    shaded.
    """
    after = "corrected" if verdict["selected"] else "retuned"
    rows = 2 * len(nominal)
    labels = [text for n in nominal for text in (f"{n} in {units[n]}", f"{n}: measured - model")]
    figure = make_subplots(
        rows=rows, cols=1, shared_xaxes=True, vertical_spacing=0.25 / rows, subplot_titles=labels
    )
    for i, signal in enumerate(nominal):
        t, y, model, fixed = thin(nominal[signal][0], *nominal[signal][1:], corrected[signal][2])
        curves = (
            (1, "measured", y, MEASURED),
            (1, "nominal", model, NOMINAL),
            (1, after, fixed, CORRECTED),
            (2, "nominal", y - model, NOMINAL),
            (2, after, y - fixed, CORRECTED),
        )
        for row, label, values, colour in curves:
            figure.add_trace(
                line(t, values, label, colour, i == 0 and row == 1), row=2 * i + row, col=1
            )
    for start, end in held_out:
        figure.add_vrect(x0=start, x1=end, fillcolor=SHADE, line_width=0, layer="below")
    style(figure, 130 + 190 * rows)
    figure.update_xaxes(title_text="time in s", row=rows, col=1)
    note = (
        f"models restarted every {restart_s:g} s; shaded: held-out blocks, which the figures above are from, each predicted by a fit "
        "that did not see it; the curves are those of the final fit"
    )
    return Picture(f"{name}: measured, nominal and {after} model", figure, note)


def line(t: np.ndarray, y: np.ndarray, name: str, colour: str, legend: bool) -> go.Scatter:
    """One curve."""
    return go.Scatter(
        x=t,
        y=y,
        name=name,
        mode="lines",
        line={"color": colour, "width": 1.2},
        legendgroup=name,
        showlegend=legend,
    )


def left_parts(left: dict[str, Any], units: dict[str, str]) -> list[Part]:
    """What remains, what it follows and what a correction over that would gain."""
    if not left["significant"] or left["best_correlate"] is None:
        said = (
            "is more than noise, and follows none of the measured signals"
            if left["significant"]
            else "is noise"
        )
        return [Note("What is left", [f"What the named effects and retuning leave {said}."])]
    gain = f"a smooth correction over it would take {percent(left['could_gain'])} of the squared gap that is left above the noise"
    note = f"{left['signal']}: {left['looks_like']}; {gain} (on blocks it was not drawn through)"
    title = f"What is left follows {left['best_correlate']}"
    if not left["correction"]:
        return [Note(title, [note])]
    x, y = zip(*left["correction"], strict=True)
    figure = go.Figure(go.Scatter(x=x, y=y, mode="lines+markers", line={"color": CORRECTED}))
    correction = f"correction of {left['signal']} in {units.get(left['signal'], '')}"
    return [
        Picture(
            title,
            plain(figure, 340, xaxis_title=left["best_correlate"], yaxis_title=correction),
            note,
        )
    ]
