"""The page of a verdict: four cards on top (WHERE: the subsystem; WHICH: the effect; HOW FAR: the
gap; WHAT NEXT: the run to record), then figures and tables.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from vgroove.gap.corrected_rig import corrected_parameters
from vgroove.gap.figures import (
    LogTraces,
    bars_figure,
    command_picture,
    gap_picture,
    remainder_figure,
    trace_picture,
)
from vgroove.gap.report import parameter_texts, rivals_in_words, spaced_name, verdict_sentence
from vgroove.gap.result import Verdict
from vgroove.gap.verdict.schema import Gap, NextExperiment, Unexplained, Where
from vgroove.html_page import Card, Note, Page, Part, Picture, Table

EFFECTS_SHOWN, CORRELATES_SHOWN = 12, 8  # rows of the page; the JSON has all
MIN_SHARE_SHOWN = 0.05  # smallest share of a further subsystem that the card WHERE lists
TINY = 1e-12  # smallest sum of squares: a gap of 0 has no shares
MAX_CLOSED_DIFFERENCE = 0.1  # of closed shares, above which the page explains it
CLOSED_ALONE = "share closed by this effect alone"  # header of a column
RUN_COMMAND = (
    "vgroove run --on PORT --next VERDICT.json -o next.csv"
    "    (PORT: the board's; VERDICT.json: from --json)"
)


def verdict_page(verdict: Verdict, names: Sequence[str]) -> Page:
    """The page of a verdict on logs with these names."""
    problem = verdict.evidence.problem
    units = {s.column: s.unit for s in problem.signals}
    parts = [
        *gap_parts(verdict.gap, shares_of_signals(verdict)),
        effects_table(verdict),
        *rival_parts(verdict),
        *next_parts(verdict.next_experiment),
        *where_parts(verdict.where),
        *remainder_parts(verdict.unexplained, units),
        *trace_parts(verdict, names, units),
        *retuned_parts(verdict),
    ]
    return Page(
        "gap",
        f"Gap of {problem.rig.name or 'the rig'}: {', '.join(names)}",
        [],
        parts,
        lead=verdict_sentence(verdict),
        cards=cards(verdict),
        warnings=verdict.warnings,
    )


def percent(share: float | None) -> str:
    """A share in per cent; a dash for none."""
    return "–" if share is None else f"{100 * share:.0f} %"


def cards(verdict: Verdict) -> list[Card]:
    """The cards WHERE, WHICH, HOW FAR and WHAT NEXT."""
    return [where_card(verdict), which_card(verdict), far_card(verdict), next_card(verdict)]


def where_card(verdict: Verdict) -> Card:
    """The subsystem with the largest share, the others, and the regime."""
    ranked = sorted(verdict.where.share.items(), key=lambda item: -item[1])
    if not ranked:
        return Card("WHERE", "no gap", "what differs is noise, or within the rig's tolerances")
    others = [
        f"{spaced_name(name)} {percent(value)}"
        for name, value in ranked[1:]
        if value >= MIN_SHARE_SHOWN
    ]
    signals = verdict.gap.with_samples
    seen = max(signals, key=lambda name: signals[name].before / signals[name].floor)
    regimes = [
        f"most of it at {r.regime} ({percent(r.share)})" for r in verdict.where.by_regime[:1]
    ]
    return Card(
        "WHERE",
        f"{spaced_name(ranked[0][0])} {percent(ranked[0][1])}",
        "; ".join([*others, f"seen in {seen}", *regimes]),
    )


def which_card(verdict: Verdict) -> Card:
    """The missing effect, or why none is named."""
    if verdict.verdict == "none":
        return Card("WHICH", "no effect is missing", "")
    if verdict.verdict == "unlisted":
        left = verdict.unexplained
        gain = f"; a smooth correction for that would close {percent(left.could_gain)} of it"
        looks = left.looks_like + gain if left.looks_like else "no pattern"
        return Card("WHICH", "none of the catalogue", f"what remains: {looks}")
    if verdict.verdict == "ambiguous":
        return ambiguous_card(verdict)
    chosen = [verdict.effect(i) for i in verdict.selected]
    support = [
        f"probability {percent(e.probability)}: {', '.join(parameter_texts(e))}" for e in chosen
    ]
    return Card("WHICH", " and ".join(spaced_name(e.id) for e in chosen), "; ".join(support))


def ambiguous_card(verdict: Verdict) -> Card:
    """The likeliest effects, their rivals, and all probabilities."""
    chance = {e.id: e.probability for e in verdict.effects}
    rivals = [r.id for r in verdict.indistinguishable]
    chances = [
        f"{spaced_name(i)} {percent(chance[i])}"
        for i in [*verdict.selected, *rivals]
        if i in chance
    ]
    named = " and ".join(map(spaced_name, verdict.selected))
    return Card(
        "WHICH",
        f"{named}, or {' or '.join(rivals_in_words(verdict))}",
        f"probabilities: {', '.join(chances)}",
    )


def far_card(verdict: Verdict) -> Card:
    """The gap before and after."""
    gap = verdict.gap
    closes = f"closes {percent(gap.closed)}" if gap.closed is not None else "no gap to close"
    if gap.closed_ci95:
        closes += " [{}, {}]".format(*map(percent, gap.closed_ci95))
    alone = ""
    if gap.closed_by_retuning is not None:
        alone = f", retuning alone {percent(gap.closed_by_retuning)}"
    support = f"noise floor {gap.floor:.2f} (RMS in sigma, held out); {closes}{alone}"
    return Card("HOW FAR", f"{gap.before:.2f} → {gap.after:.2f}", support)


def next_card(verdict: Verdict) -> Card:
    """The run to record next."""
    proposed = verdict.next_experiment
    if proposed is None:
        return Card("WHAT NEXT", "no further run", "--out-rig writes the corrected rig")
    support = proposed.why
    if proposed.separation:
        support = f"separates the rivals by {proposed.separation[0].sigma:.2g} sigma a sample"
    return Card("WHAT NEXT", f"record: {proposed.profile}", support)


def shares_of_signals(verdict: Verdict) -> dict[str, float]:
    """Share of each signal in the squared gap of the input rig, that is, in the sum of the clipped
    squared residuals of all judged samples.
    """
    search, problem = verdict.evidence.search, verdict.evidence.search.simulated
    squares = np.nan_to_num(problem.squared(search.gap_residual(search.nominal)))
    sums = {
        signal.column: float(squares[problem.judged & (problem.signal == k)].sum())
        for k, signal in enumerate(problem.signals)
    }
    total = max(sum(sums.values()), TINY)
    return {column: one / total for column, one in sums.items()}


def gap_parts(gap: Gap, shares: Mapping[str, float]) -> list[Part]:
    """Gap of each signal in units of its floor, and in its own unit with the ISO ratings. shares:
    of the signals in the squared gap.
    """
    header = ["signal", "unit", "before", "retuned", "after", "floor"]
    header += ["before, share of RMS", "after, share of RMS", "closed"]
    header += ["ISO/TS 18571 before", "ISO/TS 18571 after", "clip in sigma"]
    rows = [
        [n, s.unit, s.before, s.retuned, s.after, s.floor]
        + [percent(s.before_share), percent(s.after_share), percent(s.closed)]
        + [s.iso18571_before, s.iso18571_after, s.clip]
        for n, s in gap.by_signal.items()
    ]
    table = Table("signals", "Gap of each signal in its own unit", header, rows)
    return [gap_picture(gap), table, *closed_notes(gap, shares)]


def closed_notes(gap: Gap, shares: Mapping[str, float]) -> list[Note]:
    """The sentences of differing_signals() under a heading, where there are any."""
    lines = differing_signals(gap, shares)
    return [Note("Why a signal closes more or less than all together", lines)] if lines else []


def differing_signals(gap: Gap, shares: Mapping[str, float]) -> list[str]:
    """A sentence for each signal whose own closed share differs from that of the pooled gap."""
    pooled = gap.closed
    return [
        f"{name}: closes {percent(s.closed)} of its own error, the pooled gap {percent(pooled)}: "
        "the pooled gap adds the squares of all samples in sigmas of their sensors, each residual "
        f"clipped, and the samples of this signal are {percent(shares[name])} of the sum before."
        for name, s in gap.by_signal.items()
        if s.closed is not None
        and pooled is not None
        and abs(s.closed - pooled) > MAX_CLOSED_DIFFERENCE
    ]


def effects_table(verdict: Verdict) -> Table:
    """The likeliest effects."""
    header = ["effect", "named", "subsystem", "probability", CLOSED_ALONE]
    header += ["share lost without it", "fitted [95 % interval]"]
    rows = [
        [
            e.id,
            "yes" if e.id in verdict.selected else "",
            spaced_name(e.subsystem),
            round(e.probability, 2),
            percent(e.closes),
            percent(e.lost_without),
            "; ".join(parameter_texts(e)),
        ]
        for e in verdict.effects[:EFFECTS_SHOWN]
    ]
    more = len(verdict.effects) - len(rows)
    rest = f" (the first {len(rows)}; {more} more are less likely)" if more > 0 else ""
    return Table("effects", f"Which: effects, ranked{rest}", header, rows)


def rival_parts(verdict: Verdict) -> list[Part]:
    """The effects that these logs do not distinguish from the named ones."""
    chance = {e.id: round(e.probability, 2) for e in verdict.effects}
    rows = [
        [r.id, r.instead_of, chance.get(r.id), percent(r.closes)] for r in verdict.indistinguishable
    ]
    if not rows:
        return []
    tied = verdict.verdict == "ambiguous"
    title = (
        "Rivals that predict the held-out data as well"
        if tied
        else "Identical by physics: no log of this kind distinguishes them"
    )
    return [Table("rivals", title, ["effect", "instead of", "probability", CLOSED_ALONE], rows)]


def next_parts(proposed: NextExperiment | None) -> list[Part]:
    """The proposed run: why, the command line that performs it, its command over time, and how far
    each run of the menu separates the rivals.
    """
    if proposed is None:
        return []
    lines = [proposed.why + ".", "Then diagnose all logs together."]
    title = f"What next: record the run '{proposed.profile}'"
    parts: list[Part] = [Note(title, lines, RUN_COMMAND), command_picture(proposed)]
    if proposed.separation:
        rows = [(s.profile, s.sigma) for s in proposed.separation]
        note = (
            "RMS difference of the rivals' predictions, in sigma a sample, less the part that other"
            " parameter values of the effects explain"
        )
        figure = bars_figure(rows, "sigma a sample")
        parts.append(Picture("How far each run would separate the rivals", figure, note))
    return parts


def where_parts(where: Where) -> list[Part]:
    """Shares of subsystems and regimes, and the quantities that the gap depends on; empty where
    there is no gap.
    """
    shares = [(spaced_name(k), 100 * v) for k, v in where.share.items() if v > 0.0]
    if not shares:
        return []
    shown = (
        (
            "Where: subsystems",
            sorted(shares, key=lambda item: -item[1]),
            "share of the squared gap: Shapley value of a flexible correction of each subsystem",
        ),
        (
            "Where: regimes",
            [(r.regime, 100 * r.share) for r in where.by_regime],
            "share of the squared gap of the nominal model above the noise",
        ),
        (
            "Quantity that correlates with the gap",
            [
                (f"{c.follows} (in {c.signal})", 100 * c.share)
                for c in where.by_correlate[:CORRELATES_SHOWN]
            ],
            "share of the squared gap, after retuning, that each quantity alone explains; the"
            " shares overlap",
        ),
    )
    return [Picture(title, bars_figure(r, "share in %"), note) for title, r, note in shown if r]


def remainder_parts(left: Unexplained, units: dict[str, str]) -> list[Part]:
    """The remainder, the quantity that it depends on, and how much a smooth correction over that
    quantity would close.
    """
    if not left.significant or left.best_correlate is None:
        what = "is noise"
        if left.significant:
            what = "is more than noise, and correlates with none of the measured signals"
        return [Note("Remainder", [f"What the named effects and retuning leave {what}."])]
    note = (
        f"{left.signal}: {left.looks_like}; a smooth correction over it would take"
        f" {percent(left.could_gain)} of the squared gap that is left above the noise (on blocks"
        " that it was not fitted to)"
    )
    title = f"Remainder correlates with {left.best_correlate}"
    if not left.correction:
        return [Note(title, [note])]
    return [Picture(title, remainder_figure(left, units.get(left.signal, "")), note)]


def trace_parts(verdict: Verdict, names: Sequence[str], units: dict[str, str]) -> list[Part]:
    """Measured, nominal and corrected traces of each log."""
    problem = verdict.evidence.problem
    nominal = problem.traces(problem.theta0)
    corrected = problem.traces(corrected_parameters(verdict))
    after = "corrected" if verdict.selected else "retuned"
    return [
        trace_picture(
            LogTraces(
                name,
                after,
                units,
                nominal[j],
                corrected[j],
                problem.held_out_s[j],
                problem.restart_s,
            )
        )
        for j, name in enumerate(names)
    ]


def retuned_parts(verdict: Verdict) -> list[Part]:
    """Rig values that have a tolerance, as stated and as fitted."""
    rig = verdict.evidence.problem.rig
    rows = [[key, rig.value(key), value] for key, value in verdict.retuned_parameters.items()]
    if not rows:
        return []
    header = ["key", "rig", "retuned"]
    return [Table("retuned", "Rig values within their tolerance", header, rows)]
