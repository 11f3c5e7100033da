"""Tables and the page of the blind set."""

from typing import Any

import plotly.graph_objects as go

from vgroove.gap_bench.needs import needs_table
from vgroove.gap_bench.score import KINDS, POWER_EDGES
from vgroove.page import Card, Page, Picture, Table, style

# Goals of the project per regime and kind.
GOALS = {
    "exact": {"single": 0.98, "pair": 0.92},
    "hard": {"single": 0.93, "pair": 0.80, "triple": 0.60},
}
FURTHER_SINGLES = {
    "single_alone": "single, nothing besides",
    "single_listed_first": "single, first of what is listed",
}
REGIMES = {
    "exact": "rig exact, 3 times visible and more",
    "hard": "rig off, other forms, from just visible on",
}


def share(one: dict[str, Any]) -> str:
    """A rate as text."""
    if not one["of"]:
        return "-"
    return f"{100 * one['share']:.1f} % ({one['hits']}/{one['of']}; {100 * one['ci95'][0]:.0f}..{100 * one['ci95'][1]:.0f})"


def tables(figures: dict[str, Any]) -> list[Table]:
    """All tables in the order in which they are read."""
    out = [
        rate_table(figures),
        further_table(figures),
        calibration_table(figures),
        power_table(figures),
        confusion_table(figures),
    ]
    return out + ([removed_table(figures["removed"])] if "removed" in figures else [])


def rate_table(figures: dict[str, Any]) -> Table:
    """Right answers per kind and regime, with the goals."""
    what = f"half '{figures['set']}', {figures['cases']} cases, engine {figures['engine']}"
    rows = []
    for kind in (*KINDS[:1], *FURTHER_SINGLES, *KINDS[1:]):
        cells = []
        for regime in REGIMES:
            goal = GOALS[regime].get(kind)
            cells.append(
                share(figures["rates"][regime][kind])
                + (f"  goal {100 * goal:.0f} %" if goal else "")
            )
        rows.append([FURTHER_SINGLES.get(kind, kind), *cells])
    return Table(
        "rates", f"Blind set, {what}: right, with 95 % intervals", ["", *REGIMES.values()], rows
    )


def further_table(figures: dict[str, Any]) -> Table:
    """Wrong answers, parameters, cost."""
    rates, closed, cost, six = (
        figures["rates"],
        figures["closed"],
        figures["cost"],
        figures["cost_of_6_s"],
    )
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
        [
            "parameter within 5 % or inside",
            share(figures["parameters"]["within 5 % or inside"]),
            "",
        ],
        [
            "parameter inside its interval",
            share(figures["parameters"]["inside the interval"]),
            "95 %",
        ],
    ]
    for name, one in (("all logs", cost), ("logs of 5..7 s", six)):
        for key, unit in (
            ("seconds", "s"),
            ("cpu_seconds", "s of processor"),
            ("memory_mib", "MiB"),
        ):
            text = (
                f"{one[key]['median']:.1f} / {one[key]['tenth above']:.1f} / {one[key]['most']:.1f} {unit}"
                if one[key]
                else "-"
            )
            rows.append(
                [
                    f"{name}: median / tenth above / most",
                    text,
                    {"seconds": "8 / 20 s", "memory_mib": "1024 MiB"}.get(key, ""),
                ]
            )
    return Table("further", "Over all cases", ["", "figure", "goal"], rows)


def number(value: float | None) -> str:
    """A figure as text."""
    return "-" if value is None else f"{value:.3f}"


def calibration_table(figures: dict[str, Any]) -> Table:
    """Probabilities said and found."""
    rows = [
        [f"{one['from']:.2f} .. {one['to']:.2f}", number(one["said"]), share(one)]
        for one in figures["calibration"]
    ]
    title = "Calibration: of the names said with a probability, how many are at work"
    return Table("calibration", title, ["said", "mean", "at work"], rows)


def power_table(figures: dict[str, Any]) -> Table:
    """Names by size."""
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
    """Wrong answers by truth."""
    rows = [
        [truth, answer, count] for truth, answer, count in figures["confusion"] if answer != "right"
    ]
    return Table(
        "confusion",
        "Confusion: singles, none and unlisted that are not right",
        ["truth", "answer", "cases"],
        rows,
    )


def removed_table(found: dict[str, Any]) -> Table:
    """Answers without the effect in the catalogue."""
    rows = [
        [effect, ", ".join(f"{n} x {word}" for word, n in words.items())]
        for effect, words in found["by effect"].items()
    ]
    title = (
        f"Effects removed from the catalogue: not named wrongly {share(found['not named wrongly'])}, goal 90 %; "
        f"named with 90 % and wrong {share(found['named with 90 % and wrong'])}"
    )
    return Table("removed", title, ["removed", "answers"], rows)


def calibration_figure(figures: dict[str, Any]) -> go.Figure:
    """Share at work over probability said."""
    rows = [one for one in figures["calibration"] if one["of"]]
    bars = {
        "type": "data",
        "symmetric": False,
        "array": [r["ci95"][1] - r["share"] for r in rows],
        "arrayminus": [r["share"] - r["ci95"][0] for r in rows],
    }
    said, found = [r["said"] for r in rows], [r["share"] for r in rows]
    curve = go.Figure(
        [
            go.Scatter(x=[0, 1], y=[0, 1], mode="lines", name="calibrated", line={"dash": "dot"}),
            go.Scatter(x=said, y=found, mode="lines+markers", name="found", error_y=bars),
        ]
    )
    return style(curve, 500, xaxis_title="probability said", yaxis_title="share at work")


def cards(figures: dict[str, Any]) -> list[Card]:
    """Rates against their goals at first sight."""
    rates, out = figures["rates"], []
    for kind in ("single", "pair"):
        goal = GOALS["exact"][kind]
        out.append(
            Card(
                f"{kind} effects, rig exact",
                percent(rates["exact"][kind]),
                f"goal {100 * goal:.0f} %",
            )
        )
    out.append(Card("named with 90 % and wrong", percent(rates["sure_and_wrong"]), "at most 1 %"))
    out.append(Card("false alarms", percent(rates["false_alarms"]), "at most 1 %"))
    return out


def percent(one: dict[str, Any]) -> str:
    """A rate in a word."""
    return f"{100 * one['share']:.1f} % of {one['of']}" if one["of"] else "-"


def bench_page(figures: dict[str, Any]) -> str:
    """All tables and the calibration curve as one page that opens offline."""
    title = f"Blind set of the diagnosis, half '{figures['set']}', {figures['cases']} cases"
    parts = tables(figures)
    note = "of the names said with a probability, the share that is at work, with 95 % intervals"
    curve = Picture("Calibration", calibration_figure(figures), note)
    return Page(
        "gap_bench", title, [], [*parts[:2], curve, *parts[2:]], cards=cards(figures)
    ).as_html()


def renewed(page: str, figures: dict[str, Any]) -> str:
    """A Markdown page with the table of needs and all tables of figures between their marks."""
    page = between(page, "needs", needs_table(figures["needs"]))
    return between(
        page,
        "figures",
        "\n\n".join(f"**{one.title}**\n\n{one.as_markdown()}" for one in tables(figures)),
    )


def between(page: str, name: str, text: str) -> str:
    """The page with a text between its marks of that name; ValueError where they are missing."""
    begin, end = f"<!--{name}-->", f"<!--end of {name}-->"
    head, mark, rest = page.partition(begin)
    _, closing, tail = rest.partition(end)
    if not mark or not closing:
        raise ValueError(f"the page has no {begin} ... {end}")
    return f"{head}{begin}\n{text}\n{end}{tail}"
