"""The page of each kind of verdict in a real Chromium: everything is drawn, the console is empty,
nothing is loaded from elsewhere.
"""

from pathlib import Path

import numpy as np
import plotly.graph_objects as go
import pytest

from browser import seen
from made_log import MadeLog, drive_log, rig
from vgroove.gap import Verdict, diagnose
from vgroove.gap.page import cards
from vgroove.page import Note, Page, Table

ABROAD = "http://vgroove.invalid/other.js"
SHORT = [(0.2, 0.4), (0.8, 0.9), (1.4, 0.5)]


def hummed() -> MadeLog:
    """A log whose current oscillates at 37 Hz, which no effect explains."""
    made = drive_log(rig(), seconds=2.0, levels=SHORT)
    made.columns["current_a"] = made.columns["current_a"] + 0.8 * np.sin(
        2.0 * np.pi * 37.0 * made.time_s
    )
    return made


LOGS = {
    "none": lambda: drive_log(rig(), seconds=2.0, levels=SHORT),
    "effect": lambda: drive_log(rig(effects={"coulomb_friction": {"torque_nm": 0.003}})),
    "ambiguous": lambda: drive_log(
        rig(effects={"viscous_friction": {"nm_s_per_rad": 6e-7}}), seconds=2.0, levels=[(0.2, 0.5)]
    ),
    "unlisted": hummed,
}
CARDS = {
    "none": ("nowhere", "no effect is missing", "no further run"),
    "effect": ("motor mechanical", "coulomb friction", "no further run"),
    "ambiguous": ("motor mechanical", " or ", "record: "),
    "unlisted": ("unexplained", "none of the catalogue", "record: "),
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
        "What the gap follows",
        "measured, nominal and corrected model",
        "What is left",
    ),
    "ambiguous": (
        "Rivals that predict the held-out data as well",
        "What next: record the run",
        "How far each run would separate the rivals",
        "vgroove run --on PORT --next VERDICT.json -o next.csv",
    ),
    "unlisted": (
        "What is left follows time at",
        "a smooth correction over it would take",
        "What next: record the run",
    ),
}


@pytest.fixture(scope="module")
def found() -> dict[str, Verdict]:
    """A diagnosis of each kind."""
    return {kind: diagnose([make()], rig()) for kind, make in LOGS.items()}


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
            f"<script src={ABROAD}></script><script>console.error('broken')</script></body>",
        )
    )
    shown = seen(page)
    assert any("broken" in line for line in shown.console) and shown.loaded == [ABROAD]
    assert (
        "x &lt; y" in shown.dom
        and "vgroove &lt;run&gt;" in shown.dom
        and "a &lt;b&gt;" in shown.dom
    )
