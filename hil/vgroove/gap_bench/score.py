"""Scores verdicts against opened answers: rates with intervals, confusion, calibration, power,
parameters, cost.
"""

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import norm

from vgroove.gap.catalogue import contains

SURE = 0.9
CALIBRATION_EDGES = (0.0, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0000001)
POWER_EDGES = (1.5, 2.0, 3.0, 4.5, 6.5, 10.01)
KINDS = ("single", "pair", "triple", "none", "unlisted")
POWER = 0.95
CLOSE = 0.05
# The parameter that an effect's size stands for, and its value for a size; the others' parameter is
# the size itself.
PARAMETER = {
    "supply_resistance": "resistance_ohm",
    "supply_droop": "volt_per_coulomb",
    "dead_time": "dead_time_s",
    "bridge_resistance": "resistance_ohm",
    "winding_resistance": "relative",
    "winding_heating": "kelvin_per_joule",
    "brush_drop": "voltage_v",
    "inductance": "relative",
    "torque_constant": "relative",
    "magnetic_saturation": "saturation_a",
    "coulomb_friction": "torque_nm",
    "stribeck_friction": "breakaway_nm",
    "viscous_friction": "nm_s_per_rad",
    "quadratic_drag": "nm_s2_per_rad2",
    "asymmetric_friction": "forward_nm",
    "directional_viscous": "nm_s_per_rad",
    "cogging_torque": "torque_nm",
    "added_inertia": "kg_m2",
    "cold_grease": "nm_s_per_rad",
    "load_dependent_friction": "relative",
    "gear_eccentricity": "torque_nm",
    "coupler_compliance": "stiffness_nm_per_rad",
    "gear_backlash": "play_rad",
    "current_lag": "time_constant_s",
    "current_gain": "relative",
    "current_offset": "offset_a",
    "current_saturation": "limit_a",
    "speed_gain": "relative",
    "speed_lag": "time_constant_s",
    "hall_eccentricity": "amplitude_rad",
    "hall_dropout": "probability",
    "supply_gain": "relative",
    "transport_delay": "delay_s",
    "clock_skew": "relative",
}
OF_SIZE = {
    "magnetic_saturation": lambda size: size**-0.5,
    "coupler_compliance": lambda size: 1.0 / size,
    "current_saturation": lambda size: 1.0 / size,
}


@dataclass(frozen=True)
class Scored:
    """A case with its answer, its verdict and what that is worth."""

    number: int
    name: str
    without: str | None
    answer: dict[str, Any]
    verdict: dict[str, Any]
    seconds: float
    cpu_seconds: float
    memory_mib: float

    @property
    def kind(self) -> str:
        return self.answer["kind"]

    @property
    def word(self) -> str:
        return self.verdict["verdict"]

    @property
    def selected(self) -> list[str]:
        return self.verdict["selected"] or []

    @property
    def named(self) -> set[str]:
        """All that the verdict speaks of: selected and rivals."""
        return {r["id"] for r in self.verdict["indistinguishable"] or []} | set(self.selected)

    @property
    def tied(self) -> bool:
        """Nobody could tell it from something else on this log."""
        return bool(self.answer.get("ties"))

    def true_name(self, name: str) -> bool:
        return any(name in ids for ids in self.answer["accept"])

    @property
    def complete(self) -> bool:
        """Exactly the true names, or none or unlisted where that is the truth."""
        accept = self.answer["accept"]
        if self.answer["label"] != "effect":
            return self.word == self.answer["label"]
        return (
            self.word == "effect"
            and len(self.selected) == len(accept)
            and all(set(ids) & set(self.selected) for ids in accept)
        )

    @property
    def honest_tie(self) -> bool:
        """Ambiguous where the case is, with the truth among what it names."""
        return (
            self.word == "ambiguous"
            and self.tied
            and all(set(ids) & self.named for ids in self.answer["accept"])
        )

    @property
    def simpler_tie(self) -> bool:
        """Special cases of the truth named where nobody could tell them from it: between equals the
        contract selects fewer numbers.
        """
        ids = tuple(self.answer["ids"])
        simpler = (
            tie
            for tie in self.answer.get("ties") or []
            if len(tie) == len(ids) and contains(ids, tuple(tie))
        )
        return self.word == "effect" and any(set(tie) == set(self.selected) for tie in simpler)

    @property
    def fair_tie(self) -> bool:
        """As much as anybody could say of a case that has ties."""
        return self.honest_tie or self.simpler_tie

    @property
    def leads(self) -> bool:
        """The first name is true."""
        return bool(self.selected) and self.true_name(self.selected[0])

    @property
    def first(self) -> bool:
        """The first name is true, as a verdict that stands."""
        if self.answer["label"] != "effect":
            return self.complete
        return self.word == "effect" and self.leads

    @property
    def listed_first(self) -> bool:
        """The first name is true, whether it stands or has rivals."""
        return self.first or self.word == "ambiguous" and self.leads

    @property
    def right(self) -> bool:
        """Right as the goals count it: singles by their first name, pairs and triples with all
        names and no other; fair ties.
        """
        return self.fair_tie or (self.first if self.kind == "single" else self.complete)

    @property
    def probabilities(self) -> dict[str, float]:
        return {
            e["id"]: e["probability"]
            for e in self.verdict["effects"] or []
            if e["id"] in self.selected
        }

    @property
    def sure_and_wrong(self) -> bool:
        """A name given with 90 % and more that is not at work, in a verdict that stands."""
        return self.word == "effect" and any(
            p >= SURE and not self.true_name(i) for i, p in self.probabilities.items()
        )


def wilson(hits: int, count: int, level: float = 0.95) -> tuple[float, float]:
    """Wilson's interval of a share (Wilson 1927)."""
    if count == 0:
        return 0.0, 1.0
    z = float(norm.ppf(0.5 + level / 2.0))
    share, square = hits / count, z * z / count
    middle = (share + square / 2.0) / (1.0 + square)
    half = z * np.sqrt(share * (1.0 - share) / count + square / (4.0 * count)) / (1.0 + square)
    return max(0.0, float(middle - half)), min(1.0, float(middle + half))


def rate(flags: Iterable[bool]) -> dict[str, Any]:
    """Share of the true flags with its 95 % interval."""
    flags = list(flags)
    hits = sum(bool(flag) for flag in flags)
    return {
        "hits": hits,
        "of": len(flags),
        "share": hits / len(flags) if flags else None,
        "ci95": list(wilson(hits, len(flags))),
    }


def rates(cases: Sequence[Scored]) -> dict[str, Any]:
    """By regime and kind what is right; over all what is sure and wrong, false alarms, and what is
    ambiguous without need.
    """
    out: dict[str, Any] = {}
    for regime in ("exact", "hard"):
        mine = [c for c in cases if c.answer["regime"] == regime]
        out[regime] = {kind: rate(c.right for c in mine if c.kind == kind) for kind in KINDS}
        out[regime]["single_alone"] = rate(
            c.complete or c.fair_tie for c in mine if c.kind == "single"
        )
        out[regime]["single_listed_first"] = rate(
            c.listed_first or c.fair_tie for c in mine if c.kind == "single"
        )
    clear = [c for c in cases if c.answer["label"] == "effect" and not c.tied]
    return out | {
        "sure_and_wrong": rate(c.sure_and_wrong for c in cases),
        "false_alarms": rate(c.word != "none" for c in cases if c.kind == "none"),
        "ambiguous_though_separable": rate(c.word == "ambiguous" for c in clear),
        "failed": rate(c.word == "failed" for c in cases),
    }


def confusion(cases: Sequence[Scored]) -> list[tuple[str, str, int]]:
    """(truth, answer, how often), most frequent mistakes first; singles, none and unlisted."""
    counts: Counter[tuple[str, str]] = Counter()
    for c in cases:
        truth = (
            "+".join(c.answer["ids"])
            if c.kind == "single"
            else (c.kind if c.kind in ("none", "unlisted") else "")
        )
        if truth:
            counts[truth, "right" if c.right else f"{c.word} {'+'.join(c.selected)}".strip()] += 1
    return sorted(
        ((truth, answer, n) for (truth, answer), n in counts.items()),
        key=lambda row: (row[1] == "right", -row[2], row),
    )


def calibration(cases: Sequence[Scored]) -> list[dict[str, Any]]:
    """Of the names given with a probability in a bin, how many are at work."""
    pairs = [
        (p, c.true_name(i))
        for c in cases
        if c.word in ("effect", "ambiguous")
        for i, p in c.probabilities.items()
    ]
    out = []
    for low, high in zip(CALIBRATION_EDGES, CALIBRATION_EDGES[1:], strict=False):
        mine = [(p, true) for p, true in pairs if low <= p < high]
        said = float(np.mean([p for p, _ in mine])) if mine else None
        out.append({"from": low, "to": min(high, 1.0), "said": said} | rate(t for _, t in mine))
    return out


def power(cases: Sequence[Scored]) -> dict[str, dict[str, Any]]:
    """By effect: named among singles by size, and the least size from which on 95 % are named
    (None: not reached).
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
    """The least size of a case from which on at least 95 % are named."""
    ordered = sorted(rows, reverse=True)
    hits, best = 0, None
    for n, (size, hit) in enumerate(ordered, 1):
        hits += hit
        best = size if hit and hits >= POWER * n else best
    return best


def parameters(cases: Sequence[Scored]) -> dict[str, Any]:
    """Single effects in plain form, rightly named: the leading parameter within 5 % of the truth or
    in its interval.
    """
    rows = []
    for c in cases:
        if (
            c.kind == "single"
            and c.answer["regime"] == "exact"
            and c.first
            and c.selected[0] == c.answer["ids"][0]
        ):
            effect = next(e for e in c.verdict["effects"] if e["id"] == c.selected[0])
            found = effect["parameters"].get(PARAMETER[effect["id"]])
            if found is not None:
                rows.append((effect["id"], true_parameter(c.answer, effect["id"]), found))
    inside = [
        f["ci95"] is not None and f["ci95"][0] <= value <= f["ci95"][1] for _, value, f in rows
    ]
    close = [abs(f["value"] - value) <= CLOSE * abs(value) for _, value, f in rows]
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


def true_parameter(answer: dict[str, Any], effect_id: str) -> float:
    """What an effect's leading parameter is. A late speed column holds its samples from row to row:
    it shows whole rows of delay.
    """
    size = OF_SIZE.get(effect_id, float)(answer["sizes"][effect_id])
    return (
        float(np.ceil(size * answer["log_hz"]) / answer["log_hz"])
        if "speed_delay_s" in answer["truth"]
        else size
    )


def closed(cases: Sequence[Scored]) -> dict[str, Any]:
    """Share of the gap closed on held-out data where the effect is rightly named."""
    out = {}
    for name, key in (("closed", "closed"), ("closed_beyond_retuning", "closed_beyond_retuning")):
        all_of_them = [
            c.verdict["gap"].get(key) for c in cases if c.answer["label"] == "effect" and c.right
        ]
        shares = [x for x in all_of_them if x is not None]
        out[name] = {"median": float(np.median(shares)) if shares else None, "of": len(shares)}
    return out


def cost(cases: Sequence[Scored]) -> dict[str, Any]:
    """Seconds and memory of a diagnosis: median, nine tenths, most."""
    out: dict[str, Any] = {"of": len(cases)}
    for key in ("seconds", "cpu_seconds", "memory_mib"):
        values = [getattr(c, key) for c in cases]
        out[key] = None
        if values:
            out[key] = {
                "median": float(np.median(values)),
                "tenth above": float(np.quantile(values, 0.9)),
                "most": float(max(values)),
            }
    return out


def removed(cases: Sequence[Scored]) -> dict[str, Any]:
    """Cases of an effect that the catalogue lacked: unlisted or ambiguous; and how often a wrong
    name was given with certainty.
    """
    good = [not c.named_without for c in map(WithoutEffect, cases)]
    return {
        "not named wrongly": rate(good),
        "named with 90 % and wrong": rate(c.sure_and_wrong for c in cases),
        "words": dict(Counter(c.word for c in cases)),
        "by effect": {
            i: dict(
                Counter(f"{c.word} {'+'.join(c.selected)}".strip() for c in cases if c.without == i)
            )
            for i in sorted({c.without for c in cases if c.without})
        },
    }


@dataclass(frozen=True)
class WithoutEffect:
    """A case whose effect the catalogue lacked: any name that stands is wrong, another name of the
    same thing excepted.
    """

    case: Scored

    @property
    def named_without(self) -> bool:
        c = self.case
        return (
            c.word not in ("unlisted", "ambiguous")
            and any(not c.true_name(i) for i in c.selected)
            or c.word in ("none", "failed")
        )


GROUPS = {
    "input": lambda a: a["input"],
    "bus": lambda a: a["bus"],
    "speed from": lambda a: a["sensor"],
    "direction": lambda a: "both ways" if a["two_way"] else "one way",
    "load": lambda a: "loaded" if a["load"] else "free",
    "command": lambda a: "smooth" if a["profile"] in ("ramps", "hand", "chirp") else "steps",
}


def needs(cases: Sequence[Scored]) -> dict[str, dict[str, Any]]:
    """By effect and what the log holds: how many of the single cases are right."""
    out: dict[str, dict[str, Any]] = {}
    for c in cases:
        if c.kind == "single":
            mine = out.setdefault(c.answer["ids"][0], {})
            for name, group in GROUPS.items():
                cell = mine.setdefault(name, {}).setdefault(group(c.answer), {"hits": 0, "of": 0})
                cell["hits"] += int(c.right)
                cell["of"] += 1
    return dict(sorted(out.items()))


def score(cases: Sequence[Scored]) -> dict[str, Any]:
    """Everything that the bench prints."""
    whole = [c for c in cases if c.without is None]
    out = {
        "of": len(whole),
        "rates": rates(whole),
        "confusion": confusion(whole),
        "calibration": calibration(whole),
        "power": power(whole),
        "needs": needs(whole),
        "parameters": parameters(whole),
        "closed": closed(whole),
        "cost": cost(whole),
        "cost_of_6_s": cost([c for c in whole if 5.0 <= c.answer["seconds"] <= 7.0]),
        "failures": [line_of(c) for c in whole if not c.right],
        "sure_and_wrong": [c.number for c in whole if c.sure_and_wrong],
    }
    gone = [c for c in cases if c.without is not None]
    return out | ({"removed": removed(gone)} if gone else {})


def line_of(c: Scored) -> dict[str, Any]:
    """A case that is not right, in a line."""
    a, gap = c.answer, c.verdict["gap"] or {}
    return {
        "number": c.number,
        "kind": c.kind,
        "regime": a["regime"],
        "truth": a["ids"],
        "sizes": a["times_visible"],
        "ties": a.get("ties", []),
        "verdict": c.word,
        "selected": c.selected,
        "rivals": sorted(c.named - set(c.selected)),
        "probabilities": c.probabilities,
        "gap": [gap.get(k) for k in ("before", "retuned", "after")],
        "setting": {
            k: a[k]
            for k in (
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
            )
        },
        "warnings": c.verdict["warnings"],
        "cpu_seconds": c.cpu_seconds,
    }
