"""Blow detection: what the board counts against what really struck, over rates, loads, supplies and duties."""

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
VARIANTS = (Variant("by speed", params={"blow_source": 0}), Variant("by current", params={"blow_source": 1}))
GOAL = 0.01  # of the true count


def cells() -> list[dict[str, Any]]:
    """All cells, each in one of the halves."""
    found = []
    for (s, supply_v), (n, load), (t, trigger) in product(enumerate(SUPPLIES_V), enumerate(LOADS), enumerate(TRIGGERS)):
        half = half_of(s, n)
        found.append({"set": half, "supply_v": supply_v, "load": load, "trigger": trigger, "seed": seed_of(half, s, n, t)})
    return found


def opened_s(run: Run) -> float:
    """When the release opened the bridge: board and truth count until then. The run-out behind it, a blow or two without power, counts in
    neither."""
    driven = np.flatnonzero(run.telemetry["coast"] == 0)
    return float(run.telemetry["time_s"][driven[-1]])


def work(variant: Variant, *, supply_v: float, load: str, trigger: float, seed: int, **_: Any) -> Figures:
    """One cell: the drive's whole count, released before the end so that the last blow is told."""
    profile = pull(trigger, release_s=SECONDS - 0.2)
    rig = reference(load_of(load), supply_v=supply_v)
    run = sil_run(rig, mode=variant.mode, params=variant.params, profile=profile, duration_s=SECONDS, seed=seed)
    if not len(run.control["time_s"]):
        raise AbsentError("this firmware reports no blows: it sends no frame CONTROL")
    counts = run.control["blow_count"][run.control["time_s"] > PULL_S]
    hits = run.hits
    first = hits["time_s"][hits["kind"] == 0]
    driven = first[first < opened_s(run)]
    counted = int(counts.max()) if len(counts) else 0
    return {
        "blows": len(driven),
        "repeats": int((hits["kind"] == 1).sum()),
        "counted": counted,
        "error": counted - len(driven),
        "blows_per_min": float(60.0 / np.diff(driven).mean()) if len(driven) > 2 else 0.0,
        "faults": run.faults,
    }


def jobs(chosen: Sequence[dict[str, Any]]) -> list[Job]:
    """Every chosen cell by both sources, in the plain mode: detection runs in all."""
    return [Job(work, variant, cell) for variant in VARIANTS for cell in chosen]


def in_range(rows: Sequence[Figures]) -> list[Figures]:
    """Cells whose true rate lies in the range asked for."""
    return [r for r in rows if RATES_PER_MIN[0] <= r["blows_per_min"] <= RATES_PER_MIN[1]]


def summary(rows: Sequence[Figures]) -> Figures:
    """Errors over all cells: in the sum, cell by cell, and with one blow allowed where 1 % is less than a blow."""
    chosen = in_range(rows)
    errors = np.array([abs(r["error"]) for r in chosen], float)
    blows = np.array([r["blows"] for r in chosen], float)
    return {
        "cells": len(chosen),
        "blows": int(blows.sum()),
        "repeats": sum(r["repeats"] for r in chosen),
        "error_of_all": float(errors.sum() / blows.sum()) if len(chosen) else None,
        "cells_within": int((errors <= np.maximum(1.0, GOAL * blows)).sum()),
        "worst": float((errors / blows).max()) if len(chosen) else None,
        "rate_least": min((r["blows_per_min"] for r in chosen), default=None),
        "rate_most": max((r["blows_per_min"] for r in chosen), default=None),
    }
