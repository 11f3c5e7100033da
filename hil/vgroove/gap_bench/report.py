"""Tables and the page of the blind set."""

from typing import Any

from rich.table import Table

from vgroove.gap_bench.score import KINDS, POWER_EDGES

# Goals of the project per regime and kind.
GOALS = {"exact": {"single": 0.98, "pair": 0.92}, "hard": {"single": 0.93, "pair": 0.80, "triple": 0.60}}
REGIMES = {"exact": "rig exact, 3 times visible and more", "hard": "rig off, other forms, from just visible on"}


def share(one: dict[str, Any]) -> str:
    """A rate as text."""
    if not one["of"]:
        return "-"
    return f"{100 * one['share']:.1f} % ({one['hits']}/{one['of']}; {100 * one['ci95'][0]:.0f}..{100 * one['ci95'][1]:.0f})"


def tables(figures: dict[str, Any]) -> list[Table]:
    """All tables in the order in which they are read."""
    out = [rate_table(figures), further_table(figures), calibration_table(figures), power_table(figures), confusion_table(figures)]
    return out + ([removed_table(figures["removed"])] if "removed" in figures else [])


def rate_table(figures: dict[str, Any]) -> Table:
    what = f"half '{figures['set']}', {figures['cases']} cases, engine {figures['engine']}"
    table = Table(title=f"Blind set, {what}: right, with 95 % intervals")
    for name in ("", *(REGIMES.values())):
        table.add_column(name)
    for kind in (*KINDS[:1], "single_alone", *KINDS[1:]):
        cells = []
        for regime in REGIMES:
            goal = GOALS[regime].get(kind)
            cells.append(share(figures["rates"][regime][kind]) + (f"  goal {100 * goal:.0f} %" if goal else ""))
        table.add_row(kind.replace("single_alone", "single, nothing besides"), *cells)
    return table


def further_table(figures: dict[str, Any]) -> Table:
    rates, closed, cost, six = figures["rates"], figures["closed"], figures["cost"], figures["cost_of_6_s"]
    table = Table(title="Over all cases")
    for name in ("", "figure", "goal"):
        table.add_column(name)
    table.add_row("named with 90 % and wrong", share(rates["sure_and_wrong"]), "at most 1 %")
    table.add_row("false alarms of none", share(rates["false_alarms"]), "at most 1 %")
    table.add_row("ambiguous though separable", share(rates["ambiguous_though_separable"]), "at most 10 %")
    table.add_row("failed", share(rates["failed"]), "0")
    table.add_row("gap closed, median", number(closed["closed"]["median"]), "0.97")
    table.add_row("gap closed beyond retuning, median", number(closed["closed_beyond_retuning"]["median"]), "")
    table.add_row("parameter within 5 % or inside", share(figures["parameters"]["within 5 % or inside"]), "")
    table.add_row("parameter inside its interval", share(figures["parameters"]["inside the interval"]), "95 %")
    for name, one in (("all logs", cost), ("logs of 5..7 s", six)):
        for key, unit in (("seconds", "s"), ("cpu_seconds", "s of processor"), ("memory_mib", "MiB")):
            text = f"{one[key]['median']:.1f} / {one[key]['tenth above']:.1f} / {one[key]['most']:.1f} {unit}" if one[key] else "-"
            table.add_row(f"{name}: median / tenth above / most", text, {"seconds": "8 / 20 s", "memory_mib": "1024 MiB"}.get(key, ""))
    return table


def number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def calibration_table(figures: dict[str, Any]) -> Table:
    table = Table(title="Calibration: of the names said with a probability, how many are at work")
    for name in ("said", "mean", "at work"):
        table.add_column(name)
    for one in figures["calibration"]:
        table.add_row(f"{one['from']:.2f} .. {one['to']:.2f}", number(one["said"]), share(one))
    return table


def power_table(figures: dict[str, Any]) -> Table:
    table = Table(title="Power: single effects named, by size in visible limits")
    bins = [f"{low:g}..{high:.0f}" if high > 9 else f"{low:g}..{high:g}" for low, high in zip(POWER_EDGES, POWER_EDGES[1:], strict=False)]
    for name in ("effect", *bins, "all", "95 % from"):
        table.add_column(name)
    for effect, one in figures["power"].items():
        size = one["named in 95 % from"]
        cells = [f"{b['hits']}/{b['of']}" if b["of"] else "" for b in (*one["bins"], one["named"])]
        table.add_row(effect, *cells, "-" if size is None else f"{size:.1f}")
    return table


def confusion_table(figures: dict[str, Any]) -> Table:
    table = Table(title="Confusion: singles, none and unlisted that are not right")
    for name in ("truth", "answer", "cases"):
        table.add_column(name)
    for truth, answer, count in figures["confusion"]:
        if answer != "right":
            table.add_row(truth, answer, str(count))
    return table


def removed_table(found: dict[str, Any]) -> Table:
    table = Table(title=f"Effects removed from the catalogue: not named wrongly {share(found['not named wrongly'])}, goal 90 %")
    for name in ("removed", "answers"):
        table.add_column(name)
    for effect, words in found["by effect"].items():
        table.add_row(effect, ", ".join(f"{n} x {word}" for word, n in words.items()))
    return table


def bench_page(figures: dict[str, Any]) -> str:
    """All tables and the calibration curve as one page that opens offline."""
    import io

    import plotly.graph_objects as go
    from rich.console import Console

    console = Console(record=True, width=160, file=io.StringIO())
    for table in tables(figures):
        console.print(table)
    text = console.export_html(inline_styles=True, code_format="<pre style='font-family:monospace'>{code}</pre>")
    rows = [one for one in figures["calibration"] if one["of"]]
    curve = go.Figure([go.Scatter(x=[0, 1], y=[0, 1], mode="lines", name="calibrated", line={"dash": "dot"}),
                       go.Scatter(x=[r["said"] for r in rows], y=[r["share"] for r in rows], mode="lines+markers", name="found",
                                  error_y={"type": "data", "symmetric": False, "array": [r["ci95"][1] - r["share"] for r in rows],
                                           "arrayminus": [r["share"] - r["ci95"][0] for r in rows]})])
    curve.update_layout(title="Calibration", xaxis_title="probability said", yaxis_title="share at work", width=700, height=500)
    return f"<!doctype html><meta charset='utf-8'><title>Blind set</title>{text}{curve.to_html(full_html=False, include_plotlyjs=True)}\n"
