"""Synchronisation: 4 supplies x 3 triggers x 6 loads, with and without control; which blows are
clean.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from vgroove.control_bench.jobs import PLAIN, Figures, Job, Variant
from vgroove.control_bench.runs import PULL_S, Run, pull, reference, sil_run
from vgroove.control_bench.scores import sync_figures
from vgroove.control_bench.sets import SUPPLIES_V, halved, seed_of
from vgroove.rig import Rig
from vgroove.study.impact_runs import JOINT_WORDS, JOINTS

LOADS = ("locked", "slip_60", "slip_15", "slip_6", "m8", "disc_spring")
LOAD_WORDS = {**JOINT_WORDS, "slip_15": "slips at 15 N m", "m8": "wood, M8"}
TRIGGERS = (0.6, 0.8, 1.0)
VARIANTS = (
    PLAIN,
    Variant("method 1", "sync", {"sync_method": 1}),
    Variant("method 2", "sync", {"sync_method": 2}),
)
SETTLE_S = 0.5  # behind the pull: run-up and the first blows
SECONDS = 2.0  # of the run
POOR = 0.83  # cells whose clean share is below this without control
TOLERANCE = 0.10  # of every parameter of another tool, uniform, independent
TOOL_PARAMETERS = ("motor.resistance_ohm", "motor.torque_constant_nm_per_a", "motor.inertia_kg_m2", "mechanism.spring_rate_n_per_m",
                   "mechanism.spring_preload_n", "mechanism.hammer_inertia_kg_m2", "mechanism.hammer_mass_kg", "mechanism.lug_height_m",
                   "supply.resistance_ohm")  # fmt: skip
# of the search for a constant duty that is clean
DUTIES = tuple(round(0.30 + 0.025 * n, 3) for n in range(29))
FULL_DUTY = 0.98
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
            found.append(
                {"set": half, "supply_v": supply_v, "load": load, "trigger": trigger, "seed": seed}
            )
    return found


def other_cells() -> list[dict[str, Any]]:
    """The same cells, a drawn tool in each."""
    return [{**cell, "tool": cell["seed"]} for cell in cells()]


def tool(supply_v: float, load: str, drawn: int | None) -> Rig:
    """The reference tool on a load, or one whose TOOL_PARAMETERS are drawn."""
    rig = reference(load_of(load), supply_v=supply_v)
    if drawn is None:
        return rig
    share = 1.0 + np.random.default_rng([drawn, 6]).uniform(
        -TOLERANCE, TOLERANCE, len(TOOL_PARAMETERS)
    )
    return rig.with_values(
        {name: rig.value(name) * float(s) for name, s in zip(TOOL_PARAMETERS, share, strict=True)}
    )


def work(
    variant: Variant,
    *,
    supply_v: float,
    load: str,
    trigger: float,
    seed: int,
    tool: int | None = None,
    **_: Any,
) -> Figures:
    """One cell."""
    run = drive(variant, (supply_v, load, tool), trigger, seed)
    from_s = PULL_S + SETTLE_S
    duty = run.truth["duty"][run.truth["time_s"] > from_s]
    return {**sync_figures(run, from_s), "duty": float(np.nan_to_num(duty).mean())}


def drive(variant: Variant, what: tuple[float, str, int | None], trigger: float, seed: int) -> Run:
    """A run of SECONDS with tool(*what)."""
    options = {"profile": pull(trigger), "duration_s": SECONDS, "seed": seed, "truth_every": 31}
    return sil_run(tool(*what), mode=variant.mode, params=variant.params, **options)


def unclean(rows: Sequence[Figures]) -> list[Figures]:
    """Runs under control with less than the clean share that is asked for in the mean."""
    return [
        r
        for r in rows
        if r["variant"] != PLAIN.name and "absent" not in r and r["clean"] < GOALS["clean"]
    ]


def search_jobs(rows: Sequence[Figures]) -> list[Job]:
    """For each cell among the rows: whether any constant duty is clean there."""
    keys = ("set", "supply_v", "load", "trigger", "seed", "tool")
    found = {(*cell_key(r), r.get("tool")): {key: r.get(key) for key in keys} for r in rows}
    return [Job(search_work, PLAIN, cell) for cell in found.values()]


def search_work(
    variant: Variant, *, supply_v: float, load: str, seed: int, tool: int | None, **_: Any
) -> Figures:
    """The constant duty with the largest clean share; of equals the largest."""
    shares = [
        sync_figures(drive(variant, (supply_v, load, tool), duty, seed), PULL_S + SETTLE_S)["clean"]
        for duty in DUTIES
    ]
    best = max(range(len(DUTIES)), key=lambda n: (shares[n], DUTIES[n]))
    return {"best_clean": shares[best], "best_duty": DUTIES[best]}


def with_reason(row: Figures, searched: Sequence[Figures]) -> Figures:
    """A run that is not clean, beside what a constant duty could do there."""
    same = [
        s for s in searched if cell_key(s) == cell_key(row) and s.get("tool") == row.get("tool")
    ][0]
    if same["best_clean"] < GOALS["clean"]:
        reason = "no constant duty is clean"
    elif row["duty"] >= FULL_DUTY:
        reason = "full duty gives less than the band that is held"
    else:
        reason = "the controller's"
    return {
        **row,
        "best_clean": same["best_clean"],
        "best_duty": same["best_duty"],
        "reason": reason,
    }


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
