"""Figures of scored cases: rates, confusion, calibration, power, parameters, cost."""

from collections import Counter, defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np

from vgroove.gap_bench.needs import count_needs
from vgroove.gap_bench.rates import rate
from vgroove.gap_bench.scored import (
    LIMITS,
    UNNAMED,
    Scored,
    WithoutEffect,
    leading_parameter,
    true_parameter,
)

CALIBRATION_EDGES = (0.0, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0000001)
POWER_EDGES = (1.5, 2.0, 3.0, 4.5, 6.5, 10.01)
KINDS = ("single", "pair", "triple", "none", "unlisted")
REGIMES = ("exact", "hard", "measured", "loose")


def rates(cases: Sequence[Scored]) -> dict[str, Any]:
    """Rates of right verdicts by regime and kind; over all cases those of sure and wrong names,
    false alarms, ambiguous verdicts on separable cases, and failures.
    """
    out: dict[str, Any] = {}
    for regime in REGIMES:
        mine = [c for c in cases if c.answer["regime"] == regime]
        if regime in ("measured", "loose") and not mine:
            continue
        out[regime] = {kind: rate(c.right for c in mine if c.kind == kind) for kind in KINDS}
        singles = [c for c in mine if c.kind == "single"]
        out[regime]["single_alone"] = rate(c.complete or c.right_by_tie for c in singles)
        out[regime]["single_listed_first"] = rate(c.listed_first or c.right_by_tie for c in singles)
        out[regime]["sure_and_wrong"] = rate(c.sure_and_wrong for c in mine)
        if regime == "measured":
            out[regime] |= measured_rates(mine)
    clear = [c for c in cases if c.answer["label"] == "effect" and not c.tied]
    return out | {
        "sure_and_wrong": rate(c.sure_and_wrong for c in cases),
        "false_alarms": rate(c.outcome != "none" for c in cases if c.kind == "none"),
        "ambiguous_though_separable": rate(c.outcome == "ambiguous" for c in clear),
        "failed": rate(c.outcome == "failed" for c in cases),
        **hammering_rates([c for c in cases if "bench" in c.answer]),
    }


def hammering_rates(cases: Sequence[Scored]) -> dict[str, Any]:
    """Right verdicts of a hammering tool: with exact rigs, from drive signals alone and with
    channels of a test bench; with a joint or tool that is not known.
    """
    exact = [c for c in cases if c.answer["regime"] == "exact"]
    return {
        "exact_drive_signals": rate(c.right for c in exact if not c.answer["bench"]),
        "exact_bench_channels": rate(c.right for c in exact if c.answer["bench"]),
        "loose_all": rate(c.right for c in cases if c.answer["regime"] == "loose"),
    }


def measured_rates(cases: Sequence[Scored]) -> dict[str, Any]:
    """Further rates of the regime `measured`: pairs of which both are named, perhaps with others;
    disturbances alone with a right verdict, and those where an effect is named.
    """
    alone = [c for c in cases if c.kind == "disturbances"]
    return {
        "pair_both_named": rate(c.all_named or c.right_by_tie for c in cases if c.kind == "pair"),
        "disturbances": rate(c.right for c in alone),
        "disturbances_named": rate(c.names_something for c in alone),
    }


def confusion(cases: Sequence[Scored]) -> list[tuple[str, str, int]]:
    """(truth, verdict, count) of singles, and of cases without named effects, most frequent
    mistakes first.
    """
    counts: Counter[tuple[str, str]] = Counter()
    for c in (c for c in cases if c.kind in ("single", *UNNAMED)):
        truth = c.answer["ids"][0] if c.kind == "single" else c.kind
        counts[truth, "right" if c.right else verdict_text(c)] += 1
    return sorted(
        ((truth, answer, n) for (truth, answer), n in counts.items()),
        key=lambda row: (row[1] == "right", -row[2], row),
    )


def calibration(cases: Sequence[Scored]) -> list[dict[str, Any]]:
    """For each bin of probabilities the mean probability of the names in it, and the share of true
    names.
    """
    pairs = [
        (p, c.true_name(i)) for c in cases if c.names_something for i, p in c.probabilities.items()
    ]
    out = []
    for low, high in zip(CALIBRATION_EDGES, CALIBRATION_EDGES[1:], strict=False):
        mine = [(p, true) for p, true in pairs if low <= p < high]
        mean = float(np.mean([p for p, _ in mine])) if mine else None
        out.append({"from": low, "to": min(high, 1.0), "said": mean} | rate(t for _, t in mine))
    return out


def power(cases: Sequence[Scored]) -> dict[str, dict[str, Any]]:
    """For each effect the rates of right single cases by size (in visible limits), and the least
    size from which on 95 % are right (None: not reached).
    """
    by_id: dict[str, list[tuple[float, bool]]] = defaultdict(list)
    for c in cases:
        if c.kind == "single":
            by_id[c.answer["ids"][0]].append(
                (next(iter(c.answer["times_visible"].values())), c.right)
            )
    return {
        i: {
            "bins": [
                rate(hit for m, hit in rows if low <= m < high)
                for low, high in zip(POWER_EDGES, POWER_EDGES[1:], strict=False)
            ],
            "named": rate(hit for _, hit in rows),
            "named in 95 % from": power_size(rows),
        }
        for i, rows in sorted(by_id.items())
    }


def power_size(rows: Sequence[tuple[float, bool]]) -> float | None:
    """The least size from which on at least LIMITS.power of the cases (size, right) are right."""
    ordered = sorted(rows, reverse=True)
    hits, best = 0, None
    for n, (size, hit) in enumerate(ordered, 1):
        hits += hit
        best = size if hit and hits >= LIMITS.power * n else best
    return best


def parameters(cases: Sequence[Scored]) -> dict[str, Any]:
    """Of the rightly named single effects in the catalogue's form: how often the leading parameter
    is within 5 % of the truth or has it in its interval.
    """
    rows = [row for c in cases if (row := found_parameter(c))]
    inside = [
        f["ci95"] is not None and f["ci95"][0] <= value <= f["ci95"][1] for _, value, f in rows
    ]
    close = [abs(f["value"] - value) <= LIMITS.close * abs(value) for _, value, f in rows]
    either = [a or b for a, b in zip(inside, close, strict=True)]
    wrong = [row for row, good in zip(rows, either, strict=True) if not good]
    outside = [
        {"id": i, "truth": value, "value": f["value"], "ci95": f["ci95"]} for i, value, f in wrong
    ]
    return {
        "within 5 % or inside": rate(either),
        "inside the interval": rate(inside),
        "within 5 %": rate(close),
        "outside": outside,
    }


def found_parameter(c: Scored) -> tuple[str, float, dict[str, Any]] | None:
    """(effect, true value, found value with its interval) of the leading parameter of a rightly
    named single effect; None for other cases.
    """
    plain = c.kind == "single" and c.answer["regime"] == "exact"
    if not plain or not c.first or c.selected[0] != c.answer["ids"][0]:
        return None
    effect = next(e for e in c.verdict["effects"] if e["id"] == c.selected[0])
    found = effect["parameters"].get(leading_parameter(effect["id"]))
    return found and (effect["id"], true_parameter(c.answer, effect["id"]), found)


def closed(cases: Sequence[Scored]) -> dict[str, Any]:
    """Median share of the gap that a right verdict closes on held-out data."""
    out = {}
    for name, key in (("closed", "closed"), ("closed_beyond_retuning", "closed_beyond_retuning")):
        all_of_them = [
            c.verdict["gap"].get(key) for c in cases if c.answer["label"] == "effect" and c.right
        ]
        shares = [x for x in all_of_them if x is not None]
        out[name] = {"median": float(np.median(shares)) if shares else None, "of": len(shares)}
    return out


def cost(cases: Sequence[Scored]) -> dict[str, Any]:
    """Seconds and memory of a diagnosis: median, 90th percentile (key "p90")
    and maximum (key "max").
    """
    out: dict[str, Any] = {"of": len(cases)}
    for key in ("seconds", "cpu_seconds", "memory_mib"):
        values = [getattr(c, key) for c in cases]
        out[key] = None
        if values:
            out[key] = {
                "median": float(np.median(values)),
                "p90": float(np.quantile(values, 0.9)),
                "max": float(max(values)),
            }
    return out


def removed(cases: Sequence[Scored]) -> dict[str, Any]:
    """Verdicts on cases whose effect the catalogue lacked: how often they are not wrong, how often
    sure and wrong, and which they are.
    """
    good = [not c.wrong for c in map(WithoutEffect, cases)]
    return {
        "not named wrongly": rate(good),
        "named with 90 % and wrong": rate(c.sure_and_wrong for c in cases),
        "words": dict(Counter(c.outcome for c in cases)),
        "by effect": {
            i: dict(Counter(verdict_text(c) for c in cases if c.without == i))
            for i in sorted({c.without for c in cases if c.without})
        },
    }


def score(cases: Sequence[Scored]) -> dict[str, Any]:
    """All figures of the bench."""
    whole = [c for c in cases if c.without is None]
    regimes = [r for r in REGIMES if any(c.answer["regime"] == r for c in whole)]
    out = {
        "of": len(whole),
        "rates": rates(whole),
        "confusion": confusion(whole),
        "calibration": calibration(whole),
        "calibration_by_regime": {
            regime: calibration([c for c in whole if c.answer["regime"] == regime])
            for regime in regimes
        },
        "power": power(whole),
        "needs": count_needs(whole),
        "parameters": parameters(whole),
        "closed": closed(whole),
        "cost": cost(whole),
        "cost_of_6_s": cost([c for c in whole if 5.0 <= c.answer["seconds"] <= 7.0]),
        "failures": [failure_of(c) for c in whole if not c.right],
        "sure_and_wrong": [c.number for c in whole if c.sure_and_wrong],
    }
    gone = [c for c in cases if c.without is not None]
    return out | ({"removed": removed(gone)} if gone else {})


def verdict_text(c: Scored) -> str:
    """Outcome and selected effects."""
    return f"{c.outcome} {'+'.join(c.selected)}".strip()


SETTING_KEYS = (
    "rig",
    "input",
    "bus",
    "sensor",
    "position",
    "profile",
    "logger",
    "seconds",
    "log_hz",
    "load",
    "joint",
    "bench",
)


def failure_of(c: Scored) -> dict[str, Any]:
    """Truth, verdict and setting of a case that is not right."""
    a, gap = c.answer, c.verdict["gap"] or {}
    return {
        "number": c.number,
        "kind": c.kind,
        "regime": a["regime"],
        "truth": a["ids"],
        "sizes": a["times_visible"],
        "disturbances": {d["id"]: d["times_visible"] for d in a.get("disturbances", [])},
        "ties": a.get("ties", []),
        "verdict": c.outcome,
        "selected": c.selected,
        "rivals": sorted(c.named - set(c.selected)),
        "probabilities": c.probabilities,
        "gap": [gap.get(k) for k in ("before", "retuned", "after")],
        "setting": {k: a[k] for k in SETTING_KEYS if k in a},
        "warnings": c.verdict["warnings"],
        "cpu_seconds": c.cpu_seconds,
    }
