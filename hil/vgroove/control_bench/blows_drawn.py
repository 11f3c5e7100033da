"""Blow detection between chosen values: joints, supplies, triggers, start angles and tools that are
drawn.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vgroove.control_bench.blows import (
    GOAL,
    RELEASE_S,
    SECONDS,
    VARIANTS,
    count_figures,
    in_range,
    repeat_score,
)
from vgroove.control_bench.draw import (
    TAIL,
    DrawnPart,
    Span,
    drawn_cells,
    drawn_tool,
    failure_interval,
)
from vgroove.control_bench.jobs import Figures, Job, Variant
from vgroove.control_bench.runs import pull, reference, sil_run
from vgroove.reference.joints import REFERENCE_JOINTS
from vgroove.rig import Rig

SLIP, HARD, WOOD = "slip", "hard joint", "wood"
KINDS = (SLIP, SLIP, SLIP, HARD, WOOD)  # of the joint; each entry has the same share of the cells
SIZES = ("m6", "m8", "m10")
SPANS = {
    "trigger": Span(0.3, 1.0),
    "kind": Span(0, len(KINDS)),
    "slip_nm": Span(5.0, 100.0),
    "slope": Span(50.0, 800.0, logarithmic=True),  # N m/rad, hard joint
    "size": Span(0, len(SIZES)),
    "wood": Span(0.75, 1.25),  # of the screw's torques
}
DRAWS = 60  # cells of a half and stratum
WORST = 0.03  # goal of the worst cell
WITHIN = 0.98  # goal of the share of cells within GOAL or one blow
REPEAT_GOAL = 0.9  # of precision and recall


def cells(draws: int = DRAWS) -> list[dict[str, Any]]:
    """`draws` cells in each half, for the nominal tool and for tools that are off."""
    return [
        {**cell, "kind": KINDS[int(cell["kind"])], "size": SIZES[int(cell["size"])]}
        for cell in drawn_cells(DrawnPart.BLOWS, SPANS, draws)
    ]


def load(cell: Mapping[str, Any]) -> Mapping[str, Any]:
    """Section [load] of a cell's joint."""
    if cell["kind"] == WOOD:
        screw = REFERENCE_JOINTS[cell["size"]].load
        return {**screw, **{key: cell["wood"] * screw[key] for key in ("start_nm", "end_nm")}}
    if cell["kind"] == HARD:
        return {**REFERENCE_JOINTS["hard_joint"].load, "slip_slope_nm_per_rad": cell["slope"]}
    return {**REFERENCE_JOINTS["slip_60"].load, "run_torque_nm": cell["slip_nm"]}


def rig_of(cell: Mapping[str, Any]) -> Rig:
    """The tool of a cell on its joint."""
    return drawn_tool(reference(load(cell)), cell)


def work(variant: Variant, **cell: Any) -> Figures:
    """One drive: the count over the whole of it, and the figures of its repeats and periods."""
    run = sil_run(
        rig_of(cell),
        mode=variant.mode,
        params=variant.params,
        profile=pull(cell["trigger"], release_s=RELEASE_S),
        duration_s=SECONDS,
        seed=cell["seed"],
    )
    return count_figures(run)


def jobs(chosen: Sequence[dict[str, Any]]) -> list[Job]:
    """Every chosen cell by both sources, without control."""
    return [Job(work, variant, cell) for variant in VARIANTS for cell in chosen]


def error_share(row: Figures) -> float:
    """Error of a cell's count as a share of its blows; an error of one blow counts as none."""
    error = abs(row["error"])
    return 0.0 if error <= 1 else float(error / row["blows"])


def compare(rows: Sequence[Figures]) -> Figures:
    """A source over the cells within the range of rates: cells whose count is off by more than GOAL
    and one blow, with the 95 % interval of their share; error of the count (mean, 95 % quantile,
    worst); precision and recall of the repeats.
    """
    chosen = in_range(rows)
    errors = np.array([error_share(row) for row in chosen])
    failures = int((errors > GOAL).sum())
    low, high = failure_interval(failures, len(chosen))
    return {
        "cells": len(chosen),
        "blows": sum(row["blows"] for row in chosen),
        "failures": failures,
        "failures_low": low,
        "failures_high": high,
        "error": float(errors.mean()),
        "error_tail": float(np.quantile(errors, 1.0 - TAIL)),
        "worst": float(errors.max()),
        **repeat_score(chosen),
    }
