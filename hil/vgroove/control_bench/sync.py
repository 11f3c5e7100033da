"""Synchronisation: the share of clean blows over 4 supplies, 3 triggers and 6 joints, with and
without control.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vgroove.control_bench.jobs import PLAIN, Figures, Job, Variant
from vgroove.control_bench.runs import PULL_S, Run, pull, reference, sil_run
from vgroove.control_bench.scores import sync_figures
from vgroove.control_bench.sets import SUPPLIES_V, halved, seed_of
from vgroove.reference.joints import REFERENCE_JOINTS, Joint
from vgroove.rig import Rig

SLIP_15 = Joint(
    {**REFERENCE_JOINTS["slip_60"].load, "run_torque_nm": 15}, "slips at 15 N m", "slip 15"
)
MATRIX_JOINTS = {
    "locked": REFERENCE_JOINTS["locked"],
    "slip_60": REFERENCE_JOINTS["slip_60"],
    "slip_15": SLIP_15,
    "slip_6": REFERENCE_JOINTS["slip_6"],
    "m8": replace(REFERENCE_JOINTS["m8"], title="wood, M8"),
    "disc_spring": REFERENCE_JOINTS["disc_spring"],
}
LOADS = tuple(MATRIX_JOINTS)
TRIGGERS = (0.6, 0.8, 1.0)
VARIANTS = (
    PLAIN,
    Variant("method 1", "sync", {"sync_method": 1}),
    Variant("method 2", "sync", {"sync_method": 2}),
)
SETTLE_S = 0.5  # after the pull: run-up and the first blows
SECONDS = 2.0  # of the run
POOR = 0.83  # a cell with a smaller clean share without control counts as poor
TOLERANCE = 0.10  # of every parameter of a drawn tool, uniform, independent
TOOL_PARAMETERS = (
    "motor.resistance_ohm",
    "motor.torque_constant_nm_per_a",
    "motor.inertia_kg_m2",
    "mechanism.spring_rate_n_per_m",
    "mechanism.spring_preload_n",
    "mechanism.hammer_inertia_kg_m2",
    "mechanism.hammer_mass_kg",
    "mechanism.lug_height_m",
    "supply.resistance_ohm",
)
DUTIES = tuple(round(0.30 + 0.025 * n, 3) for n in range(29))  # of the search for a clean duty
FULL_DUTY = 0.98  # a larger mean duty counts as full
# Ratio of the unclean shares with and without control, gain of poor cells, mean clean share, mean
# period spread (standard deviation over mean): the project's goals (docs/controllers/sync.md).
GOALS = {"unclean_ratio": 0.5, "poor_gain": 0.20, "clean": 0.97, "spread": 0.012}


@dataclass(frozen=True)
class CellTool:
    """The tool of a cell: supply, joint, and the seed that draws its parameters; None for the
    reference tool.
    """

    supply_v: float
    load: str
    drawn: int | None

    def rig(self) -> Rig:
        """The rig of the tool."""
        rig = reference(MATRIX_JOINTS[self.load].load, supply_v=self.supply_v)
        if self.drawn is None:
            return rig
        share = 1.0 + np.random.default_rng([self.drawn, 6]).uniform(
            -TOLERANCE, TOLERANCE, len(TOOL_PARAMETERS)
        )
        return rig.with_values(
            {
                name: rig.value(name) * float(s)
                for name, s in zip(TOOL_PARAMETERS, share, strict=True)
            }
        )


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
    """The same cells, each with a drawn tool."""
    return [{**cell, "tool": cell["seed"]} for cell in cells()]


def work(variant: Variant, **cell: Any) -> Figures:
    """One cell: its clean share and mean duty."""
    run = drive(variant, cell, cell["trigger"])
    from_s = PULL_S + SETTLE_S
    duty = run.truth["duty"][run.truth["time_s"] > from_s]
    return {**sync_figures(run, from_s), "duty": float(np.nan_to_num(duty).mean())}


def drive(variant: Variant, cell: Mapping[str, Any], trigger: float) -> Run:
    """A run of SECONDS with the tool of a cell."""
    tool = CellTool(cell["supply_v"], cell["load"], cell.get("tool"))
    return sil_run(
        tool.rig(),
        mode=variant.mode,
        params=variant.params,
        profile=pull(trigger),
        duration_s=SECONDS,
        seed=cell["seed"],
        truth_every=31,
    )


def unclean(rows: Sequence[Figures]) -> list[Figures]:
    """Runs under control whose clean share is below the goal of the mean."""
    return [
        r
        for r in rows
        if r["variant"] != PLAIN.name and "absent" not in r and r["clean"] < GOALS["clean"]
    ]


def search_jobs(rows: Sequence[Figures]) -> list[Job]:
    """For each cell among the rows a search for a constant duty that is clean."""
    keys = ("set", "supply_v", "load", "trigger", "seed", "tool")
    found = {(*cell_key(r), r.get("tool")): {key: r.get(key) for key in keys} for r in rows}
    return [Job(search_work, PLAIN, cell) for cell in found.values()]


def search_work(variant: Variant, **cell: Any) -> Figures:
    """The constant duty with the largest clean share; of equal ones the largest duty."""
    shares = [
        sync_figures(drive(variant, cell, duty), PULL_S + SETTLE_S)["clean"] for duty in DUTIES
    ]
    best = max(range(len(DUTIES)), key=lambda n: (shares[n], DUTIES[n]))
    return {"best_clean": shares[best], "best_duty": DUTIES[best]}


def with_reason(row: Figures, searched: Sequence[Figures]) -> Figures:
    """A run that is not clean, with the best constant duty of its cell and the reason."""
    same = [
        s for s in searched if cell_key(s) == cell_key(row) and s.get("tool") == row.get("tool")
    ][0]
    if same["best_clean"] < GOALS["clean"]:
        reason = "no constant duty is clean"
    elif row["duty"] >= FULL_DUTY:
        reason = "full duty gives less voltage than the controller holds"
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
    """The keys that identify a cell."""
    return row["supply_v"], row["load"], row["trigger"]


def compare(rows: Sequence[Figures], variant: str) -> Figures:
    """A method against no control over the same cells, by the measures of GOALS."""
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
