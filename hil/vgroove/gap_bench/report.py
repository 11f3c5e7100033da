"""Tables and page of the blind set's figures."""

from typing import Any

import plotly.graph_objects as go

from vgroove.gap_bench.goals import GOALS, IMPACT_GOALS
from vgroove.gap_bench.needs import needs_table
from vgroove.gap_bench.score import KINDS, POWER_EDGES
from vgroove.html_page import Card, Page, Picture, Table, style

# Quantiles of a cost: key of the JSON -> words.
QUANTILES = {"median": "median", "p90": "90th percentile", "max": "maximum"}
# Unit and goal of each cost; goals of the median and the 90th percentile, or of the maximum.
COST_UNITS = {
    "seconds": ("s", "8 / 20 s"),
    "cpu_seconds": ("s of processor", ""),
    "memory_mib": ("MiB", "1024 MiB"),
}
FURTHER_SINGLES = {
    "single_alone": "single, nothing besides",
    "single_listed_first": "single, first of what is listed",
}
REGIMES = {
    "exact": "rig exact, 3 times visible and more",
    "hard": "rig off, other forms, from just visible on",
    "measured": "as hard, with disturbances",
    "loose": "joint or tool off by the stated tolerances",
}
# Rates of the regime `measured`: key of the JSON -> words
MEASURED = {
    "single": "single, named first",
    "single_alone": "single, exactly right",
    "pair_both_named": "pair, both named",
    "pair": "pair, exactly right",
    "sure_and_wrong": "named with 90 % and wrong",
    "disturbances": "disturbances alone, `none` or `unlisted`",
    "disturbances_named": "disturbances alone, an effect named",
}


def share(one: dict[str, Any]) -> str:
    """A rate with its counts and its interval in %."""
    if not one["of"]:
        return "-"
    low, high = (f"{100 * end:.0f}" for end in one["ci95"])
    return f"{100 * one['share']:.1f} % ({one['hits']}/{one['of']}; {low}..{high})"


def tables(figures: dict[str, Any]) -> list[Table]:
    """All tables in their order on the page."""
    regimes = figures.get("calibration_by_regime", {})
    out = [
        rate_table(figures),
        *([measured_table(figures)] if "measured" in figures["rates"] else []),
        further_table(figures),
        calibration_table(figures),
        *([regime_calibration_table(regimes)] if len(regimes) > 1 else []),
        power_table(figures),
        confusion_table(figures),
    ]
    return out + ([removed_table(figures["removed"])] if "removed" in figures else [])


def rate_table(figures: dict[str, Any]) -> Table:
    """Right verdicts by kind and regime, with the goals."""
    what = f"half '{figures['set']}', {figures['cases']} cases, engine {figures['engine']}"
    rows = []
    regimes = regimes_of(figures["rates"])
    goals = IMPACT_GOALS if figures.get("impact") else GOALS
    for kind in (*KINDS[:1], *FURTHER_SINGLES, *KINDS[1:]):
        cells = []
        for regime in regimes:
            goal = goals[regime].get(kind)
            cells.append(
                share(figures["rates"][regime][kind])
                + (f"  goal {100 * goal:.0f} %" if goal else "")
            )
        rows.append([FURTHER_SINGLES.get(kind, kind), *cells])
    return Table(
        "rates",
        f"Blind set, {what}: right, with 95 % intervals",
        ["", *(REGIMES[regime] for regime in regimes)],
        rows,
    )


def regimes_of(rates: dict[str, Any]) -> list[str]:
    """The regimes that have cases."""
    return [
        regime for regime in REGIMES if any(one["of"] for one in rates.get(regime, {}).values())
    ]


def measured_table(figures: dict[str, Any]) -> Table:
    """Rates of the cases with disturbances."""
    rates = figures["rates"]["measured"]
    rows = [[words, share(rates[key])] for key, words in MEASURED.items()]
    title = f"Regime `measured`, half '{figures['set']}', with 95 % intervals"
    return Table("measured", title, ["", "cases"], rows)


def further_table(figures: dict[str, Any]) -> Table:
    """Wrong verdicts, gap closed, parameters and cost over all cases."""
    rates, closed, parameters = figures["rates"], figures["closed"], figures["parameters"]
    rows = [
        ["named with 90 % and wrong", share(rates["sure_and_wrong"]), "at most 1 %"],
        ["false alarms of none", share(rates["false_alarms"]), "at most 1 %"],
        ["ambiguous though separable", share(rates["ambiguous_though_separable"]), "at most 10 %"],
        ["failed", share(rates["failed"]), "0"],
        ["gap closed, median", number(closed["closed"]["median"]), "0.97"],
        [
            "gap closed beyond retuning, median",
            number(closed["closed_beyond_retuning"]["median"]),
            "",
        ],
        ["parameter within 5 % or inside", share(parameters["within 5 % or inside"]), ""],
        ["parameter inside its interval", share(parameters["inside the interval"]), "95 %"],
        *hammering_rows(rates),
        *cost_rows("all logs", figures["cost"]),
        *cost_rows("logs of 5..7 s", figures["cost_of_6_s"]),
    ]
    return Table("further", "Over all cases", ["", "figure", "goal"], rows)


def hammering_rows(rates: dict[str, Any]) -> list[list[str]]:
    """Right verdicts of a hammering tool over all kinds of cases, with the goals."""
    rows = (
        ("exact_drive_signals", "right, exact rig, drive signals alone", "85 %"),
        ("exact_bench_channels", "right, exact rig, with channels of a test bench", "92 %"),
        ("loose_all", "right, joint or tool uncertain", "75 %"),
    )
    found = [(words, rates.get(key), goal) for key, words, goal in rows]
    return [[words, share(one), goal] for words, one, goal in found if one and one["of"]]


def cost_rows(name: str, cost: dict[str, Any]) -> list[list[str]]:
    """Seconds, processor seconds and memory of a diagnosis, with the goals."""
    rows = []
    for key, (unit, goal) in COST_UNITS.items():
        values = [f"{cost[key][q]:.1f}" for q in QUANTILES] if cost[key] else []
        text = f"{' / '.join(values)} {unit}" if values else "-"
        rows.append([f"{name}: {' / '.join(QUANTILES.values())}", text, goal])
    return rows


def number(value: float | None) -> str:
    """A figure with three digits."""
    return "-" if value is None else f"{value:.3f}"


def calibration_table(figures: dict[str, Any]) -> Table:
    """Given probabilities and the shares of true names."""
    rows = [
        [f"{one['from']:.2f} .. {one['to']:.2f}", number(one["said"]), share(one)]
        for one in figures["calibration"]
    ]
    title = "Calibration: share of true names by the probability that the verdict gives"
    return Table("calibration", title, ["probability", "mean", "true"], rows)


def regime_calibration_table(regimes: dict[str, list[dict[str, Any]]]) -> Table:
    """Mean probability and share of true names in each bin, by regime."""
    rows = [
        [
            f"{bins[0]['from']:.2f} .. {bins[0]['to']:.2f}",
            *(f"{number(one['said'])}: {share(one)}" if one["of"] else "-" for one in bins),
        ]
        for bins in zip(*regimes.values(), strict=True)
    ]
    title = "Calibration by regime: mean probability, share of true names"
    return Table("calibration_regimes", title, ["probability", *regimes], rows)


def power_table(figures: dict[str, Any]) -> Table:
    """Right single cases by effect and size."""
    bins = [
        f"{low:g}..{high:.0f}" if high > 9 else f"{low:g}..{high:g}"
        for low, high in zip(POWER_EDGES, POWER_EDGES[1:], strict=False)
    ]
    rows = []
    for effect, one in figures["power"].items():
        size = one["named in 95 % from"]
        cells = [f"{b['hits']}/{b['of']}" if b["of"] else "" for b in (*one["bins"], one["named"])]
        rows.append([effect, *cells, "-" if size is None else f"{size:.1f}"])
    return Table(
        "power",
        "Power: single effects named, by size in visible limits",
        ["effect", *bins, "all", "95 % from"],
        rows,
    )


def confusion_table(figures: dict[str, Any]) -> Table:
    """Wrong verdicts by truth."""
    rows = [
        [truth, answer, count] for truth, answer, count in figures["confusion"] if answer != "right"
    ]
    return Table(
        "confusion",
        "Confusion: singles, none and unlisted that are not right",
        ["truth", "verdict", "cases"],
        rows,
    )


def removed_table(found: dict[str, Any]) -> Table:
    """Verdicts without the effect in the catalogue."""
    rows = [
        [effect, ", ".join(f"{n} x {verdict}" for verdict, n in counts.items())]
        for effect, counts in found["by effect"].items()
    ]
    title = (
        "Effects removed from the catalogue: not named wrongly "
        f"{share(found['not named wrongly'])}, goal 90 %; "
        f"named with 90 % and wrong {share(found['named with 90 % and wrong'])}"
    )
    return Table("removed", title, ["removed", "verdicts"], rows)


def calibration_figure(figures: dict[str, Any]) -> go.Figure:
    """Share of true names over the given probability."""
    rows = [one for one in figures["calibration"] if one["of"]]
    bars = {
        "type": "data",
        "symmetric": False,
        "array": [r["ci95"][1] - r["share"] for r in rows],
        "arrayminus": [r["share"] - r["ci95"][0] for r in rows],
    }
    given, found = [r["said"] for r in rows], [r["share"] for r in rows]
    curve = go.Figure(
        [
            go.Scatter(x=[0, 1], y=[0, 1], mode="lines", name="calibrated", line={"dash": "dot"}),
            go.Scatter(x=given, y=found, mode="lines+markers", name="found", error_y=bars),
        ]
    )
    return style(curve, 500, xaxis_title="given probability", yaxis_title="share of true names")


def cards(figures: dict[str, Any]) -> list[Card]:
    """The main rates with their goals."""
    rates, out = figures["rates"], []
    goals = IMPACT_GOALS if figures.get("impact") else GOALS
    for kind in ("single", "pair"):
        goal = f"goal {100 * goals['exact'][kind]:.0f} %"
        if rates["exact"][kind]["of"] or "measured" not in rates:
            out.append(Card(f"{kind} effects, rig exact", percent(rates["exact"][kind]), goal))
        if "measured" in rates:
            out.append(Card(f"{kind} effects, disturbed", percent(rates["measured"][kind]), ""))
    out.append(Card("named with 90 % and wrong", percent(rates["sure_and_wrong"]), "at most 1 %"))
    out.append(Card("false alarms", percent(rates["false_alarms"]), "at most 1 %"))
    return out


def percent(one: dict[str, Any]) -> str:
    """A rate in % with its number of cases."""
    return f"{100 * one['share']:.1f} % of {one['of']}" if one["of"] else "-"


def bench_page(figures: dict[str, Any]) -> str:
    """All tables and the calibration curve as one page that opens offline."""
    title = f"Blind set of the diagnosis, half '{figures['set']}', {figures['cases']} cases"
    parts = tables(figures)
    note = "share of true names by the probability that the verdict gives, with 95 % intervals"
    curve = Picture("Calibration", calibration_figure(figures), note)
    return Page(
        "gap_bench", title, [], [*parts[:2], curve, *parts[2:]], cards=cards(figures)
    ).as_html()


def marks(name: str) -> tuple[str, str]:
    """The comments that begin and end the section `name` of a Markdown page."""
    return f"<!--{name}-->", f"<!--end of {name}-->"


MARKS = (*marks("needs"), *marks("figures"))  # of the sections that renewed() fills


def renewed(page: str, figures: dict[str, Any]) -> str:
    """A Markdown page with the table of needs and all other tables replaced between their marks."""
    page = between(page, "needs", needs_table(figures["needs"]))
    return between(
        page,
        "figures",
        "\n\n".join(f"**{one.title}**\n\n{one.as_markdown()}" for one in tables(figures)),
    )


def between(page: str, name: str, text: str) -> str:
    """The page with the text between the marks of that name replaced; ValueError without marks."""
    begin, end = marks(name)
    head, mark, rest = page.partition(begin)
    _, closing, tail = rest.partition(end)
    if not mark or not closing:
        raise ValueError(f"the page has no {begin} ... {end}")
    return f"{head}{begin}\n{text}\n{end}{tail}"
