"""Synchronisation: 4 supplies x 3 triggers x 6 loads, with and without control; which blows are clean."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from vgroove.control_bench.jobs import PLAIN, Figures, Job, Variant
from vgroove.control_bench.runs import PULL_S, pull, reference, sil_run
from vgroove.control_bench.scores import sync_figures
from vgroove.control_bench.sets import SUPPLIES_V, halved, seed_of
from vgroove.study.impact_runs import JOINT_WORDS, JOINTS

LOADS = ("locked", "slip_60", "slip_15", "slip_6", "m8", "disc_spring")
LOAD_WORDS = {**JOINT_WORDS, "slip_15": "slips at 15 N m", "m8": "wood, M8"}
TRIGGERS = (0.6, 0.8, 1.0)
VARIANTS = (PLAIN, Variant("method 1", "sync", {"sync_method": 1}), Variant("method 2", "sync", {"sync_method": 2}))
SETTLE_S = 0.5  # behind the pull: run-up and the first blows
SECONDS = 2.0  # of the run
POOR = 0.83  # cells whose clean share is below this without control
GOALS = {"unclean_ratio": 0.5, "poor_gain": 0.20, "clean": 0.97, "spread": 0.012}


def load_of(name: str) -> dict[str, Any]:
    """[load] of one of LOADS."""
    return {**JOINTS["slip_60"], "run_torque_nm": 15} if name == "slip_15" else JOINTS[name]


def cells() -> list[dict[str, Any]]:
    """All cells, each in one of the halves."""
    found = []
    for half, supply_v, load in halved(SUPPLIES_V, LOADS):
        for n, trigger in enumerate(TRIGGERS):
            seed = seed_of(half, SUPPLIES_V.index(supply_v), LOADS.index(load), n)
            found.append({"set": half, "supply_v": supply_v, "load": load, "trigger": trigger, "seed": seed})
    return found


def work(variant: Variant, *, supply_v: float, load: str, trigger: float, seed: int, **_: Any) -> Figures:
    """One cell."""
    rig = reference(load_of(load), supply_v=supply_v)
    run = sil_run(rig, mode=variant.mode, params=variant.params, profile=pull(trigger), duration_s=SECONDS, seed=seed, truth_every=31)
    return sync_figures(run, PULL_S + SETTLE_S)


def jobs(chosen: Sequence[dict[str, Any]], variants: Sequence[Variant] = VARIANTS) -> list[Job]:
    """Every chosen cell under every variant."""
    return [Job(work, variant, cell) for variant in variants for cell in chosen]


def cell_key(row: Figures) -> tuple[Any, ...]:
    """What makes two rows the same cell."""
    return row["supply_v"], row["load"], row["trigger"]


def compare(rows: Sequence[Figures], variant: str) -> Figures:
    """A method against no control over the same cells, as issue 5 counts."""
    plain = {cell_key(r): r for r in rows if r["variant"] == PLAIN.name}
    pairs = [(plain[cell_key(r)], r) for r in rows if r["variant"] == variant]
    before, after = (np.array([pair[n]["clean"] for pair in pairs]) for n in (0, 1))
    poor = before < POOR
    spreads = [r["spread"] for _, r in pairs if r["spread"] is not None]
    work_ratio = [b["work_w"] / a["work_w"] for a, b in pairs if a["work_w"] > 0.0]
    return {
        "variant": variant,
        "cells": len(pairs),
        "clean_before": float(before.mean()),
        "clean": float(after.mean()),
        "unclean_ratio": float((1 - after).mean() / max((1 - before).mean(), 1e-9)),
        "poor_cells": int(poor.sum()),
        "poor_gain": float(after[poor].mean() / before[poor].mean() - 1.0) if poor.any() else None,
        "worse_cells": int((after < before).sum()),
        "worst_change": float((after - before).min()),
        "spread": float(np.mean(spreads)) if spreads else None,
        "spread_most": float(np.max(spreads)) if spreads else None,
        "work_ratio": float(np.mean(work_ratio)) if work_ratio else None,
    }
