"""Blow detection: what the board counts against what really struck, over rates, loads, supplies and
duties.
"""

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np

from vgroove.control_bench.jobs import Figures, Job, Variant
from vgroove.control_bench.runs import PULL_S, AbsentError, Run, pull, reference, sil_run
from vgroove.control_bench.sets import SUPPLIES_V, half_of, seed_of
from vgroove.control_bench.sync import LOADS, load_of

TRIGGERS = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
RATES_PER_MIN = (1200.0, 4000.0)
SECONDS = 3.0
VARIANTS = (
    Variant("by speed", params={"blow_source": 0}),
    Variant("by current", params={"blow_source": 1}),
)
GOAL = 0.01  # of the true count
FEW_REPEATS = 6  # of the run-up, which come in every cell
IN_STEP = 0.03
REPEAT_GOALS = {"precision": 0.85, "recall": 0.9}
SETTLE_S = 0.5  # behind the pull: periods are judged from then on


def cells() -> list[dict[str, Any]]:
    """All cells, each in one of the halves."""
    found = []
    for (s, supply_v), (n, load), (t, trigger) in product(
        enumerate(SUPPLIES_V), enumerate(LOADS), enumerate(TRIGGERS)
    ):
        half = half_of(s, n)
        found.append(
            {
                "set": half,
                "supply_v": supply_v,
                "load": load,
                "trigger": trigger,
                "seed": seed_of(half, s, n, t),
            }
        )
    return found


def opened_s(run: Run) -> float:
    """When the release opened the bridge: board and truth count until then, neither the run-out, a
    blow or two without power.
    """
    driven = np.flatnonzero(run.telemetry["coast"] == 0)
    return float(run.telemetry["time_s"][driven[-1]])


def repeat_figures(told: np.ndarray, blows_s: np.ndarray, repeats_s: np.ndarray) -> Figures:
    """Repeats, those that the board told, and those that are right: from a true blow to the next as
    many as were both told and true.
    """
    if len(blows_s) < 2:
        return {"repeats": len(repeats_s), "repeats_told": 0, "repeats_right": 0}
    edges = np.append(blows_s, np.inf)
    true = np.histogram(repeats_s, edges)[0]
    said = np.histogram(told[:, 0], edges, weights=told[:, 1] * told[:, 2])[0]
    right = np.minimum(true, said).sum()
    return {
        "repeats": int(true.sum()),
        "repeats_told": int(said.sum()),
        "repeats_right": int(right),
    }


def period_figures(told: np.ndarray, blows_s: np.ndarray) -> Figures:
    """Periods behind the settling, told against true: error of the running mean, both spreads (mean
    deviation over mean).
    """
    true = np.diff(blows_s[blows_s > PULL_S + SETTLE_S])
    rows = told[told[:, 0] > PULL_S + SETTLE_S]
    if len(true) < 8 or len(rows) < 8:
        return {"period_error": None, "spread": None, "spread_told": None}
    mean = true.mean()
    return {
        "period_error": float(abs(rows[:, 4].mean() / mean - 1.0)),
        "spread": float(np.abs(true - mean).mean() / mean),
        "spread_told": float(rows[:, 5].mean()),
    }


def work(
    variant: Variant, *, supply_v: float, load: str, trigger: float, seed: int, **_: Any
) -> Figures:
    """One cell: the drive's whole count, released before the end so that the last blow is told."""
    profile = pull(trigger, release_s=SECONDS - 0.2)
    rig = reference(load_of(load), supply_v=supply_v)
    run = sil_run(
        rig,
        mode=variant.mode,
        params=variant.params,
        profile=profile,
        duration_s=SECONDS,
        seed=seed,
    )
    if not len(run.control["time_s"]):
        raise AbsentError("this firmware reports no blows: it sends no frame CONTROL")
    counts = run.control["blow_count"][run.control["time_s"] > PULL_S]
    hits = run.hits
    first = hits["time_s"][hits["kind"] == 0]
    driven = first[first < opened_s(run)]
    counted = int(counts.max()) if len(counts) else 0
    again = hits["time_s"][hits["kind"] == 1]
    return {
        "blows": len(driven),
        "counted": counted,
        "error": counted - len(driven),
        "blows_per_min": float(60.0 / np.diff(driven).mean()) if len(driven) > 2 else 0.0,
        **repeat_figures(run.told, driven, again[again < opened_s(run)]),
        **period_figures(run.told, driven),
        "faults": run.faults,
    }


def jobs(chosen: Sequence[dict[str, Any]]) -> list[Job]:
    """Every chosen cell by both sources, in the plain mode: detection runs in all."""
    return [Job(work, variant, cell) for variant in VARIANTS for cell in chosen]


def in_range(rows: Sequence[Figures]) -> list[Figures]:
    """Cells whose true rate lies in the range asked for."""
    return [r for r in rows if RATES_PER_MIN[0] <= r["blows_per_min"] <= RATES_PER_MIN[1]]


def repeat_score(chosen: Sequence[Figures]) -> Figures:
    """Precision and recall of the repeats over all cells, and in how many both reach their goals."""
    said, true, right = (
        sum(r[key] for r in chosen) for key in ("repeats_told", "repeats", "repeats_right")
    )
    return {
        "repeats": true,
        "precision": right / said if said else None,
        "recall": right / true if true else None,
        "repeat_cells": sum(repeats_right(r) for r in chosen),
    }


def repeats_right(row: Figures) -> bool:
    """Whether a cell's repeats are told: few or none of both, or precision and recall within the
    goals.
    """
    said, true, right = row["repeats_told"], row["repeats"], row["repeats_right"]
    few = said <= FEW_REPEATS and true <= FEW_REPEATS
    return few or (
        right >= REPEAT_GOALS["precision"] * said and right >= REPEAT_GOALS["recall"] * true
    )


def period_score(chosen: Sequence[Figures]) -> Figures:
    """Mean error of the running period, and of the spread where the tool is in step (true spread up
    to 3 %).
    """
    judged = [r for r in chosen if r["period_error"] is not None]
    steady = [r for r in judged if r["spread"] <= IN_STEP]
    return {
        "period_error": float(np.mean([r["period_error"] for r in judged])) if judged else None,
        "spread": float(np.mean([r["spread"] for r in steady])) if steady else None,
        "spread_told": float(np.mean([r["spread_told"] for r in steady])) if steady else None,
    }


def summary(rows: Sequence[Figures]) -> Figures:
    """Errors over all cells: in the sum, cell by cell, and with one blow allowed where 1 % is less
    than a blow.
    """
    chosen = in_range(rows)
    errors = np.array([abs(r["error"]) for r in chosen], float)
    blows = np.array([r["blows"] for r in chosen], float)
    return {
        "cells": len(chosen),
        "blows": int(blows.sum()),
        **repeat_score(chosen),
        **period_score(chosen),
        "error_of_all": float(errors.sum() / blows.sum()) if len(chosen) else None,
        "cells_within": int((errors <= np.maximum(1.0, GOAL * blows)).sum()),
        "worst": float((errors / blows).max()) if len(chosen) else None,
        "rate_least": min((r["blows_per_min"] for r in chosen), default=None),
        "rate_most": max((r["blows_per_min"] for r in chosen), default=None),
    }
