"""Synchronisation between chosen values: slip torques of 5 to 100 N m, supplies, triggers, start
angles and tools that are drawn.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vgroove.control_bench.draw import (
    TAIL,
    DrawnPart,
    Span,
    drawn_cells,
    drawn_tool,
    failure_interval,
)
from vgroove.control_bench.jobs import PLAIN, Figures, Job, Variant
from vgroove.control_bench.runs import PULL_S, pull, reference, sil_run
from vgroove.control_bench.scores import sync_figures
from vgroove.control_bench.sync import SECONDS, SETTLE_S, VARIANTS
from vgroove.reference.joints import REFERENCE_JOINTS
from vgroove.rig import Rig

SPANS = {"slip_nm": Span(5.0, 100.0)}
DRAWS = 24  # cells of a half and stratum
TRUTH_EVERY = 31  # PWM periods: about 1 ms
CLEAN = 0.97  # least share of clean blows of a cell in step
SPREAD = 0.012  # largest spread of its periods (standard deviation over mean)
WORSE = 0.02  # a larger loss of the clean share against no control counts as worse
MEAN_CLEAN = 0.99
STEADY_S, STEADY_SECONDS = 2.5, 5.0  # the controller has searched a level; length of a run


def cells(draws: int = DRAWS) -> list[dict[str, Any]]:
    """`draws` cells in each half, for the nominal tool and for tools that are off."""
    return drawn_cells(DrawnPart.SYNC, SPANS, draws)


def joint(cell: Mapping[str, Any]) -> Rig:
    """The tool of a cell on a joint that slips at its torque."""
    load = {**REFERENCE_JOINTS["slip_60"].load, "run_torque_nm": cell["slip_nm"]}
    return drawn_tool(reference(load), cell)


def work(variant: Variant, **cell: Any) -> Figures:
    """One cell: share of clean blows and spread of the periods after the run-up, and of the blows
    from STEADY_S on (steady_clean, steady_spread).
    """
    run = sil_run(
        joint(cell),
        mode=variant.mode,
        params=variant.params,
        profile=pull(cell["trigger"]),
        duration_s=STEADY_SECONDS,
        seed=cell["seed"],
        truth_every=TRUTH_EVERY,
    )
    steady = sync_figures(run, STEADY_S)
    return {
        **sync_figures(run, PULL_S + SETTLE_S, SECONDS),
        "steady_clean": steady["clean"],
        "steady_spread": steady["spread"],
    }


def jobs(chosen: Sequence[dict[str, Any]]) -> list[Job]:
    """Every chosen cell under every variant."""
    return [Job(work, variant, cell) for variant in VARIANTS for cell in chosen]


def in_step(row: Figures, phase: str = "") -> bool:
    """Whether a cell is clean and its periods are equal; a motion that repeats every second blow
    has clean blows and a large spread. phase: "" after the run-up, "steady_" from STEADY_S on.
    """
    clean, spread = row[f"{phase}clean"], row[f"{phase}spread"]
    return clean >= CLEAN and spread is not None and spread <= SPREAD


def compare(rows: Sequence[Figures], variant: str) -> Figures:
    """A variant over its cells: clean share (mean, 5 % quantile, worst) and spread (median, 95 %
    quantile, worst); cells out of step with the 95 % interval of their share, and cells that are
    worse than without control; the same from STEADY_S on, with the prefix steady_.
    """
    return {"variant": variant, **phase_figures(rows, variant, "")} | {
        f"steady_{key}": value for key, value in phase_figures(rows, variant, "steady_").items()
    }


def phase_figures(rows: Sequence[Figures], variant: str, phase: str) -> Figures:
    """The figures of `compare` of one phase, as for in_step."""
    plain = {row["seed"]: row for row in rows if row["variant"] == PLAIN.name}
    here = [row for row in rows if row["variant"] == variant]
    clean = np.array([row[f"{phase}clean"] for row in here])
    before = np.array([plain[row["seed"]][f"{phase}clean"] for row in here])
    values = [row[f"{phase}spread"] for row in here]
    spread = np.array([value for value in values if value is not None])
    failures = sum(not in_step(row, phase) for row in here)
    low, high = failure_interval(failures, len(here))
    return {
        "cells": len(here),
        "clean": float(clean.mean()),
        "clean_tail": float(np.quantile(clean, TAIL)),
        "clean_worst": float(clean.min()),
        "spread": float(np.median(spread)) if len(spread) else None,
        "spread_tail": float(np.quantile(spread, 1.0 - TAIL)) if len(spread) else None,
        "spread_worst": float(spread.max()) if len(spread) else None,
        "out_of_step": failures,
        "out_low": low,
        "out_high": high,
        "worse": int((clean < before - WORSE).sum()),
        "worst_change": float((clean - before).min()),
    }
