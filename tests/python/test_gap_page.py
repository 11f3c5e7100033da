"""The page of each kind of verdict in a real Chromium: everything is drawn, the console is empty,
nothing is loaded from elsewhere.
"""

import time
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
import pytest

from browser import seen
from made_log import MadeLog, drive_log, rig
from vgroove.gap import DiagnosisOptions, Gap, SignalGap, Verdict, diagnose
from vgroove.gap.catalogue import CATALOGUE
from vgroove.gap.figures import SHADE, LogTraces, trace_picture
from vgroove.gap.page import cards, closed_notes, differing_signals, shares_of_signals
from vgroove.gap.report import summary_lines, verdict_sentence
from vgroove.html_page import Note, Page, Table

OTHER_SITE = "http://vgroove.invalid/other.js"
SHORT = [(0.2, 0.4), (0.8, 0.9), (1.4, 0.5)]


def oscillating(made: MadeLog, amplitude_a: float) -> MadeLog:
    """The log with a current that oscillates at 37 Hz, which no effect explains."""
    wave = np.sin(2.0 * np.pi * 37.0 * made.time_s)
    made.columns["current_a"] = made.columns["current_a"] + amplitude_a * wave
    return made


LOGS = {
    "none": lambda: drive_log(rig(), seconds=2.0, levels=SHORT),
    "effect": lambda: drive_log(
        rig(effects={"coulomb_friction": {"torque_nm": 0.003}}), seconds=2.0, levels=SHORT
    ),
    "ambiguous": lambda: drive_log(
        rig(effects={"viscous_friction": {"nm_s_per_rad": 6e-7}}), seconds=2.0, levels=[(0.2, 0.5)]
    ),
    "unlisted": lambda: oscillating(drive_log(rig(), seconds=2.0, levels=SHORT), 0.8),
    "partial": lambda: oscillating(
        drive_log(rig(effects={"coulomb_friction": {"torque_nm": 0.0003}}), seconds=3.0), 3.0
    ),
}
CARDS = {
    "none": ("no gap", "no effect is missing", "no further run"),
    "effect": ("motor mechanical", "coulomb friction", "no further run"),
    "ambiguous": ("motor mechanical", " or ", "record: "),
    "unlisted": ("unexplained", "none of the catalogue", "record: "),
    "partial": ("motor mechanical", "coulomb friction", "WHAT NEXT"),
}
SECTIONS = {
    "none": (
        "How far: the gap of each signal",
        "Which: effects, ranked",
        "measured, nominal and retuned model",
        "is noise",
    ),
    "effect": (
        "Where: subsystems",
        "Where: regimes",
        "Quantity that correlates with the gap",
        "measured, nominal and corrected model",
        "Remainder",
    ),
    "ambiguous": (
        "Rivals that predict the held-out data as well",
        "What next: record the run",
        "How far each run would separate the rivals",
        "vgroove run --on PORT --next VERDICT.json -o next.csv",
    ),
    "unlisted": (
        "Remainder correlates with time at",
        "a smooth correction over it would take",
        "What next: record the run",
    ),
    "partial": (
        "Part of the gap is coulomb friction; a remainder stays that is not explained",
        "Remainder correlates with time at",
        "Why a signal closes more or less than all together",
        "clip in sigma",
    ),
}


# Effects that are fitted: a part of the catalogue gives a page of each kind in a fifth of the time.
FITTED = (
    "coulomb_friction",
    "viscous_friction",
    "stribeck_friction",
    "quadratic_drag",
    "asymmetric_friction",
    "added_inertia",
    "winding_resistance",
    "torque_constant",
    "brush_drop",
    "dead_time",
    "current_offset",
    "speed_gain",
)


@pytest.fixture(scope="module")
def found() -> dict[str, Verdict]:
    """A diagnosis of each kind."""
    options = DiagnosisOptions(without=tuple(e.id for e in CATALOGUE if e.id not in FITTED))
    return {kind: diagnose([make()], rig(), options) for kind, make in LOGS.items()}


@pytest.mark.parametrize("kind", LOGS)
def test_a_browser_draws_the_page_of_each_verdict(
    kind: str, found: dict[str, Verdict], tmp_path: Path
) -> None:
    assert found[kind].verdict == kind
    page = tmp_path / f"{kind}.html"
    page.write_text(found[kind].page(["<run> & 1.csv"]).as_html(), encoding="utf-8")
    shown = seen(page)
    assert shown.console == [] and shown.loaded == []
    assert shown.dom.count('class="main-svg"') >= 4 and "&lt;run&gt; &amp; 1.csv" in shown.dom
    missing = [
        words
        for words in (*CARDS[kind], *SECTIONS[kind], "WHERE", "WHICH", "HOW FAR", "WHAT NEXT")
        if words not in shown.dom
    ]
    assert missing == []


def test_the_cards_hold_the_verdicts_figures(found: dict[str, Verdict]) -> None:
    verdict = found["effect"]
    where, which, far, following = cards(verdict)
    torque = verdict.effects[0].parameters["torque_nm"]
    assert (
        f"torque_nm {torque.value:.4g} [{torque.ci95[0]:.4g}, {torque.ci95[1]:.4g}] N m"
        in which.support
    )
    assert (
        far.answer == f"{verdict.gap.before:.2f} → {verdict.gap.after:.2f}"
        and "--out-rig" in following.support
    )
    assert where.answer.endswith(" %") and "seen in" in where.support
    tied = found["ambiguous"]
    probability = {e.id: e.probability for e in tied.effects}
    for rival in tied.indistinguishable:
        assert (
            f"{rival.id.replace('_', ' ')} {100 * probability[rival.id]:.0f} %"
            in cards(tied)[1].support
        )


def test_the_sentence_of_each_verdict_names_what_it_names(found: dict[str, Verdict]) -> None:
    sentence = {kind: verdict_sentence(verdict) for kind, verdict in found.items()}
    assert sentence["partial"].startswith("Part of the gap is coulomb friction; a remainder stays")
    assert sentence["effect"].startswith("The missing effect is coulomb friction: ")
    assert sentence["none"].startswith("No gap beyond the noise")
    assert sentence["unlisted"].startswith("A real gap that no effect of the catalogue closes")
    assert sentence["ambiguous"].startswith("Most likely ")
    for kind, verdict in found.items():
        assert f"{verdict.gap.before:.2f} before" in sentence[kind]
        assert summary_lines(verdict)[0] == sentence[kind]


def test_an_unlisted_gap_below_the_floor_is_called_no_real_gap(found: dict[str, Verdict]) -> None:
    small = replace(found["unlisted"], gap=replace(found["unlisted"].gap, retuned=0.92))
    assert verdict_sentence(small).startswith("A pattern below the noise floor that no effect")


def test_a_verdict_whose_rival_is_a_part_of_it_says_so(found: dict[str, Verdict]) -> None:
    alone = replace(found["ambiguous"], indistinguishable=[])
    assert "but a part of them would predict" in verdict_sentence(alone)
    assert cards(alone)[1].answer.endswith(", or a part of them")


def test_the_evidence_of_a_named_effect_is_in_the_json(found: dict[str, Verdict]) -> None:
    """Of the other effects there is none."""
    for kind, verdict in found.items():
        stated = {e["id"]: e for e in verdict.as_dict()["effects"]}
        assert {i for i, e in stated.items() if "evidence" in e} == set(verdict.selected), kind
    partial = found["partial"].as_dict()
    (effect,) = (e for e in partial["effects"] if e["id"] == "coulomb_friction")
    assert set(effect["evidence"]) == {"comparison", "before", "after", "floor"}
    assert effect["evidence"]["comparison"] == "forward simulation"
    assert effect["evidence"]["after"] < effect["evidence"]["before"]
    assert effect["probability"] <= 0.85 and partial["unexplained"]["significant"]


def signal(before: float, after: float, closed: float | None) -> SignalGap:
    return SignalGap("A", before, before, after, 1.0, None, None, 10.0, closed, 9.0, 0.1, 0.1)


def gap_of(closed: float | None, **signals: SignalGap) -> Gap:
    whole = {f.name: None for f in fields(Gap)}
    return Gap(**whole | {"closed": closed, "by_signal": signals})


def test_a_signal_that_closes_another_share_than_the_pooled_gap_is_explained() -> None:
    """From a difference of a tenth on."""
    current, speed, supply = signal(3.0, 2.9, 0.05), signal(4.0, 1.7, 0.76), signal(1.0, 1.0, None)
    gap = gap_of(0.7, current_a=current, speed_rpm=speed, supply_v=supply)
    shares = {"current_a": 0.17, "speed_rpm": 0.8, "supply_v": 0.03}
    (line,) = differing_signals(gap, shares)
    assert line.startswith("current_a: closes 5 % of its own error, the pooled gap 70 %: ")
    assert "the samples of this signal are 17 % of the sum before" in line
    (note,) = closed_notes(gap, shares)
    assert note.title == "Why a signal closes more or less than all together"


@pytest.mark.parametrize("kind", ["effect", "partial", "unlisted"])
def test_the_share_of_a_signal_is_that_of_its_samples_in_the_squared_gap(
    kind: str, found: dict[str, Verdict]
) -> None:
    """Counted one sample after the other; the signals differ in samples, sigmas and clips."""
    verdict = found[kind]
    problem = verdict.evidence.problem
    residual = problem.residuals(problem.theta0)[0]
    sums, count = dict.fromkeys(verdict.gap.by_signal, 0.0), 0
    for row in np.flatnonzero(problem.judged):
        name = problem.signals[problem.signal[row]].column
        if not (problem.censored[row] and residual[row] == 0.0):
            sums[name] += min(abs(residual[row]), verdict.gap.by_signal[name].clip) ** 2
            count += 1
    assert sum(sums.values()) == pytest.approx(count * verdict.gap.before**2, rel=1e-6)
    shares = shares_of_signals(verdict)
    assert shares == pytest.approx({n: s / sum(sums.values()) for n, s in sums.items()}, rel=1e-6)
    for name, share in shares.items():
        lines = [line for line in differing_signals(verdict.gap, shares) if line.startswith(name)]
        assert all(f" {100 * share:.0f} % of the sum" in line for line in lines)


@pytest.mark.parametrize("pooled", [None, 0.05, 0.149])
def test_signals_that_close_as_much_as_the_pooled_gap_need_no_note(pooled: float | None) -> None:
    gap = gap_of(pooled, current_a=signal(3.0, 2.9, 0.05))
    assert differing_signals(gap, {}) == [] and closed_notes(gap, {}) == []


def traces(blocks: int) -> LogTraces:
    """Traces of three signals with so many held-out blocks."""
    time_s = np.arange(2000.0)
    curves = {name: (time_s, time_s, 0.0 * time_s) for name in ("current_a", "speed_rpm", "supply")}
    held_out_s = [[4.0 * k + 2.0, 4.0 * k + 3.0] for k in range(blocks)]
    return LogTraces("log", "corrected", dict.fromkeys(curves, "1"), curves, curves, held_out_s, 1)


def test_held_out_blocks_are_shaded_in_each_panel_as_plotly_shades_them() -> None:
    expected = trace_picture(traces(0)).figure
    for start, end in traces(3).held_out_s:
        expected.add_vrect(x0=start, x1=end, fillcolor=SHADE, line_width=0, layer="below")
    drawn = trace_picture(traces(3)).figure
    assert len(drawn.layout.shapes) == 18 and drawn.layout == expected.layout


def test_the_time_of_the_traces_does_not_grow_with_the_square_of_the_held_out_blocks() -> None:
    trace_picture(traces(1))  # loads what plotly loads once
    begin_s = time.process_time()
    trace_picture(traces(60))
    assert time.process_time() - begin_s < 5.0  # 0.3 s; a call of add_vrect for each: 60 s


def test_figures_are_plotly_objects_by_title(found: dict[str, Verdict]) -> None:
    figures = found["effect"].figures()
    assert {"Where: subsystems", "How far: the gap of each signal"} <= set(figures)
    assert all(isinstance(figure, go.Figure) for figure in figures.values())


def test_a_notebook_shows_the_page_in_a_frame(found: dict[str, Verdict]) -> None:
    shown = found["none"]._repr_html_()
    assert shown.startswith('<iframe srcdoc="&lt;!doctype html&gt;') and "<script" not in shown


def test_the_check_sees_errors_and_loads_of_a_page(tmp_path: Path) -> None:
    page = tmp_path / "bad.html"
    text = Page(
        "bad",
        "Bad",
        ["a <b>"],
        [Table("t", "T", ["n"], [[1.0]]), Note("N", ["x < y"], "vgroove <run>")],
    ).as_html()
    page.write_text(
        text.replace(
            "</body>",
            f"<script src={OTHER_SITE}></script><script>console.error('broken')</script></body>",
        )
    )
    shown = seen(page)
    assert any("broken" in line for line in shown.console) and shown.loaded == [OTHER_SITE]
    assert (
        "x &lt; y" in shown.dom
        and "vgroove &lt;run&gt;" in shown.dom
        and "a &lt;b&gt;" in shown.dom
    )
