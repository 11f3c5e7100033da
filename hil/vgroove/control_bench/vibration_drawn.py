"""Low vibration between chosen values: joints, supplies, triggers, start angles and tools that are
drawn.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vgroove.control_bench import vibration
from vgroove.control_bench.draw import (
    TAIL,
    DrawnPart,
    Span,
    drawn_cells,
    drawn_tool,
    failure_interval,
)
from vgroove.control_bench.jobs import PLAIN, Figures, Job, Variant
from vgroove.control_bench.runs import PULL_S, Run, passing_s, pull, reference, sil_run
from vgroove.control_bench.scores import ripple
from vgroove.reference.joints import REFERENCE_JOINTS
from vgroove.rig import Rig

KINDS = ("hard_joint", "disc_spring", "m6", "m8", "m10")
SPANS = {
    "kind": Span(0, len(KINDS)),
    "slope": Span(50.0, 800.0, logarithmic=True),  # N m/rad, hard joint
    "wood": Span(0.75, 1.25),  # of the screw's torques
}
DRAWS = 25  # cells of a half and stratum
LATE_S = 0.15  # after the first blow
LATE_LEAST_S = 0.1  # a shorter rest of the drive is not evaluated
WORST = 0.05  # goal of every run
LONGEST_S = vibration.SECONDS - PULL_S  # from the pull to the end of a run
FULL_V = (
    16.0  # of the motor before the supply's drop, from which on the start governs the vibration
)


def cells(draws: int = DRAWS) -> list[dict[str, Any]]:
    """`draws` cells in each half, for the nominal tool and for tools that are off."""
    return [
        {**cell, "kind": KINDS[int(cell["kind"])]}
        for cell in drawn_cells(DrawnPart.VIBRATION, SPANS, draws)
    ]


def rig_of(cell: Mapping[str, Any]) -> Rig:
    """The tool of a cell on its joint."""
    load = dict(REFERENCE_JOINTS[cell["kind"]].load)
    if load["kind"] == "hard_joint":
        load["slip_slope_nm_per_rad"] = cell["slope"]
    if load["kind"] == "wood_screw":
        load |= {key: cell["wood"] * load[key] for key in ("start_nm", "end_nm", "seat_nm")}
    return drawn_tool(reference(load), cell)


def work(variant: Variant, **cell: Any) -> Figures:
    """One drive to the same head angle as without control."""
    rig, profile = rig_of(cell), pull(cell["trigger"])
    aim = vibration.aim_of(rig, profile)
    run = sil_run(
        rig,
        mode=variant.mode,
        params=variant.params,
        profile=profile,
        duration_s=vibration.SECONDS,
        seed=cell["seed"],
        truth_every=1,
        stop_when=vibration.beyond(aim),
    )
    return {**vibration.run_figures(run, aim), "late_nm": late_nm(run, aim)}


def late_nm(run: Run, aim: float) -> float | None:
    """AC RMS in N m from LATE_S after the first blow to the aim; None where less is left than
    LATE_LEAST_S.
    """
    end_s, first = passing_s(run, aim), run.hits["time_s"]
    if end_s is None or not len(first) or first[0] + LATE_S + LATE_LEAST_S > end_s:
        return None
    return ripple(run, float(first[0]) + LATE_S, end_s)


def jobs(chosen: Sequence[dict[str, Any]]) -> list[Job]:
    """Every chosen cell under every variant."""
    return [Job(work, variant, cell) for variant in vibration.VARIANTS for cell in chosen]


def pairs(rows: Sequence[Figures], variant: str) -> list[tuple[Figures, Figures]]:
    """(without, with control) of the same cells."""
    plain = {row["seed"]: row for row in rows if row["variant"] == PLAIN.name}
    return [(plain[row["seed"]], row) for row in rows if row["variant"] == variant]


def has_aim(pair: tuple[Figures, Figures]) -> bool:
    """Whether the uncontrolled tool turns the joint. Where its blows are too weak for that, no run
    does work that vibration could be compared for, and the cell is not judged.
    """
    return pair[0]["aim_rad"] > 0.0


def misses(pair: tuple[Figures, Figures]) -> bool:
    """Whether one of the two runs of a cell with an aim does not reach it."""
    return None in (pair[0]["rms_nm"], pair[1]["rms_nm"])


def changes(found: Sequence[tuple[Figures, Figures]], key: str) -> np.ndarray:
    """Relative changes (n,) of a figure over the pairs (without, with control) that have it."""
    return np.array([b[key] / a[key] - 1.0 for a, b in found if a[key] and b[key]])


def time_changes(found: Sequence[tuple[Figures, Figures]]) -> np.ndarray:
    """Relative changes (n,) of the time to the aim; a controlled run that misses it counts with the
    longest time of a run, which is less than the time that it needs.
    """
    return np.array(
        [(b["time_s"] or LONGEST_S) / a["time_s"] - 1.0 for a, b in found if a["time_s"]]
    )


def mean(values: np.ndarray) -> float | None:
    """Mean; None of no values."""
    return float(values.mean()) if len(values) else None


def compare(rows: Sequence[Figures], variant: str) -> Figures:
    """A method against no control over the same cells: cells without an aim (has_aim), which are
    not judged; cells that miss their aim; change of the RMS of the others (mean, 95 % quantile,
    worst); `above`: cells above WORST or without their aim reached, with the 95 % interval of their
    share of the judged cells; the mean over the cells in which trigger and supply give FULL_V or
    more; change from LATE_S after the first blow on; change of the time.
    """
    found = pairs(rows, variant)
    judged = [pair for pair in found if has_aim(pair)]
    rms, late, time = changes(judged, "rms_nm"), changes(judged, "late_nm"), time_changes(judged)
    full = changes([p for p in judged if p[0]["supply_v"] * p[0]["trigger"] >= FULL_V], "rms_nm")
    missed = sum(misses(pair) for pair in judged)
    failures = missed + int((rms > WORST).sum())
    low, high = failure_interval(failures, len(judged))
    return {
        "variant": variant,
        "cells": len(found),
        "without_aim": len(found) - len(judged),
        "judged": len(judged),
        "missed": missed,
        "change": mean(rms),
        "change_tail": float(np.quantile(rms, 1.0 - TAIL)) if len(rms) else None,
        "worst": float(rms.max()) if len(rms) else None,
        "above": failures,
        "above_low": low,
        "above_high": high,
        "full_cells": len(full),
        "full_change": mean(full),
        "late_cells": len(late),
        "late": mean(late),
        "late_worst": float(late.max()) if len(late) else None,
        "time": mean(time),
        "time_most": float(time.max()) if len(time) else None,
    }
