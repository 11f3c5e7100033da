"""Torque control: target torques on joints of several slopes, with drawn friction, slope, supply
and winding; the torque of the joint at the end.
"""

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np

from vgroove import telemetry
from vgroove.control_bench.jobs import PLAIN, Figures, Job, Variant
from vgroove.control_bench.runs import PULL_S, Run, reference, sil_run
from vgroove.control_bench.sets import half_of, seed_of
from vgroove.reference.bolt import FRICTIONS, lever_m
from vgroove.reference.joints import REFERENCE_JOINTS
from vgroove.rig import Rig

TARGETS_NM = (40.0, 60.0, 80.0, 100.0, 120.0)
SLOPES = (60.0, 120.0, 240.0, 450.0, 700.0)  # N m/rad
SCATTER = 0.10  # of friction, slope, supply and winding; uniform, independent
FAST_STEP = 0.06  # of the target: with a larger step in one blow the controller may refuse it
MAX_SECONDS = 6.0
MAP_S = 4.0  # of full trigger: a target that is not reached by then is out of reach
REST_S = 0.15  # with the bridge open for so long a drive is over
RUNS = 10  # drawn joints of a cell
REFUSED_S = 0.3  # without a drive for so long after the pull the target was refused
TRUTH_EVERY = 15  # PWM periods: about 0.5 ms
FIXED_TIME, FIXED_COUNT = "fixed time", "fixed count"  # stop rules of simpler tools
VARIANTS = (Variant(FIXED_TIME), Variant(FIXED_COUNT), Variant("torque", "torque"))
REASONS_REFUSED = ("unreachable", "missed")
GOALS = {
    "std": 0.03,
    "mean": 0.03,
}  # of the target: the project's goals (docs/controllers/torque.md)
PRACTICE_ALPHA = (2.5, 4.0)  # tightening factor of impact wrenches, VDI 2230 part 1, table A8


def cells(runs: int = RUNS) -> list[dict[str, Any]]:
    """Every target on every slope with `runs` drawn joints each, in one of the halves."""
    found = []
    for (t, target_nm), (s, slope), n in product(
        enumerate(TARGETS_NM), enumerate(SLOPES), range(runs)
    ):
        half = half_of(t, s)
        found.append(
            {"set": half, "target_nm": target_nm, "slope": slope, "seed": seed_of(half, n, t, s)}
        )
    return found


def joint(slope: float, seed: int | None) -> Rig:
    """The reference tool on a hard joint; a seed draws friction, slope, supply and winding."""
    scatter = (
        np.zeros(4)
        if seed is None
        else np.random.default_rng([seed, 5]).uniform(-SCATTER, SCATTER, 4)
    )
    friction, of_slope, supply, winding = 1.0 + scatter
    rig = reference(
        {**REFERENCE_JOINTS["hard_joint"].load, "slip_slope_nm_per_rad": slope * of_slope}
    )
    rig = rig.with_values(
        {
            "supply.voltage_v": rig.supply["voltage_v"] * supply,
            "motor.resistance_ohm": rig.motor["resistance_ohm"] * winding,
        }
    )
    return rig.with_effects({"thread_friction": {"relative": friction - 1.0}})


def torques_at_blows(run: Run) -> np.ndarray:
    """Torque of the joint in N m before each blow and after the last, (blows + 1,)."""
    times_s = [*run.struck_s, run.duration_s]
    heads = np.interp(times_s, run.truth["time_s"], run.truth["head_rad"])
    return run.slip_nm(np.maximum.accumulate(heads))


def nominal(slope: float) -> dict[str, Any]:
    """The uncontrolled tool on the nominal joint: times of the blows and the torque after each."""
    run = sil_run(
        joint(slope, None), duration_s=PULL_S + MAP_S, truth_every=TRUTH_EVERY, noise=False
    )
    return {
        "slope": slope,
        "time_s": run.struck_s - PULL_S,
        "torque_nm": torques_at_blows(run)[1:],
    }


def map_row(found: dict[str, Any], target_nm: float) -> Figures:
    """The blow with which the nominal joint passes a target, the time half-way to the next blow,
    and the torque that this blow adds, as a share of the target.
    """
    there = np.flatnonzero(found["torque_nm"] >= target_nm)
    row: Figures = {
        "target_nm": target_nm,
        "slope": found["slope"],
        "most_nm": float(found["torque_nm"][-1]),
    }
    if not len(there):
        return {**row, "blow": None, "time_s": None, "step": None, "kind": "out of reach"}
    at = int(there[0])
    before = found["torque_nm"][at - 1] if at else 0.0
    step = float((found["torque_nm"][at] - before) / target_nm)
    # the blow after it, or a typical period later
    later = found["time_s"][at + 1] if at + 1 < len(found["time_s"]) else found["time_s"][at] + 0.02
    kind = "in reach" if step < FAST_STEP else "too fast"
    return {
        **row,
        "blow": at + 1,
        "time_s": float(0.5 * (found["time_s"][at] + later)),
        "step": step,
        "kind": kind,
    }


def map_work(variant: Variant, *, slope: float) -> Figures:
    """The reachable targets of one slope."""
    del variant
    found = nominal(slope)
    return {"map": [map_row(found, target) for target in TARGETS_NM]}


def map_jobs() -> list[Job]:
    """One job a slope."""
    return [Job(map_work, PLAIN, {"slope": slope}) for slope in SLOPES]


class DriveEnd:
    """Stop condition of a run: the bridge has been open for REST_S after the drive, or no drive has
    begun REFUSED_S after the pull.
    """

    def __init__(self) -> None:
        self._driven_s: float | None = None

    def __call__(self, tool: Any, progress: Any) -> bool:
        """Whether the run ends; called after each 16 ms."""
        del tool
        if not progress.gates.coast:
            self._driven_s = progress.time_s
        last = PULL_S + REFUSED_S if self._driven_s is None else self._driven_s
        return progress.time_s - last > REST_S


def work(variant: Variant, **cell: Any) -> Figures:
    """One drawn joint. Fixed time and fixed count stop where the nominal joint has the target."""
    rig, seed = joint(cell["slope"], cell["seed"]), cell["seed"]
    if variant.mode == "duty":
        return fixed_work(rig, variant.name, cell["blow"], cell["time_s"], seed)
    run = sil_run(
        rig,
        mode=variant.mode,
        params={**variant.params, "torque_target_nm": cell["target_nm"]},
        duration_s=MAX_SECONDS,
        seed=seed,
        stop_when=DriveEnd(),
    )
    reported = len(run.control["time_s"]) > 0
    return {
        "torque_nm": run.tightened_nm,
        "reason": reason_of(run),
        "blows": len(run.struck_s),
        "estimate_nm": float(run.control["estimate"][-1]) / 10 if reported else None,
        "faults": run.faults,
    }


def fixed_work(rig: Rig, rule: str, blow: int | None, time_s: float | None, seed: int) -> Figures:
    """One drawn joint under one of the simple rules."""
    if blow is None or time_s is None:
        return {"torque_nm": None, "reason": "out of reach", "blows": 0, "faults": 0}
    # after a fixed time, or long enough that a slower tool makes the same number of blows
    seconds = time_s + 0.02 if rule == FIXED_TIME else 3.0 * time_s + 0.3
    run = sil_run(rig, duration_s=PULL_S + seconds, seed=seed, truth_every=TRUTH_EVERY)
    return {
        "torque_nm": fixed_torque(run, rule, blow, time_s),
        "reason": "stopped",
        "blows": blow,
        "faults": run.faults,
    }


def fixed_torque(run: Run, rule: str, blow: int, time_s: float) -> float:
    """Torque of an uncontrolled run at a time, or after a blow."""
    blows = run.struck_s - PULL_S
    done = int((blows < time_s).sum()) if rule == FIXED_TIME else min(blow, len(blows))
    return float(torques_at_blows(run)[done])


def reason_of(run: Run) -> str:
    """Name of the last stop reason; unknown where the firmware sends no frame CONTROL."""
    if not len(run.control["time_s"]):
        return "unknown"
    return telemetry.value_table("CONTROL", "stop_reason")[int(run.control["stop_reason"][-1])]


def jobs(
    chosen: Sequence[dict[str, Any]],
    maps: Sequence[Figures],
    variants: Sequence[Variant] = VARIANTS,
) -> list[Job]:
    """Every chosen joint under every variant; `maps` are the rows of map_work."""
    where = {(row["target_nm"], row["slope"]): row for row in maps}
    found = []
    for variant, cell in product(variants, chosen):
        row = where[cell["target_nm"], cell["slope"]]
        found.append(Job(work, variant, {**cell, "blow": row["blow"], "time_s": row["time_s"]}))
    return found


def sample_std(values: np.ndarray) -> float | None:
    """Standard deviation of a sample (n,), with n - 1 degrees of freedom; None of fewer than 2."""
    return float(values.std(ddof=1)) if len(values) > 1 else None


def cell_figures(
    rows: Sequence[Figures], target_nm: float, slope: float, variant: str
) -> Figures | None:
    """Standard deviation and mean error of one cell over its joints; `refused_or_missed` counts the
    joints whose target the controller reported as refused or missed. None without joints.
    """
    chosen = [
        r for r in rows if (r["target_nm"], r["slope"], r["variant"]) == (target_nm, slope, variant)
    ]
    done = np.array(
        [
            r["torque_nm"]
            for r in chosen
            if r["torque_nm"] is not None and r["reason"] not in REASONS_REFUSED
        ]
    )
    if not chosen:
        return None
    return {
        "target_nm": target_nm,
        "slope": slope,
        "variant": variant,
        "runs": len(chosen),
        "refused_or_missed": len(chosen) - len(done),
        "std": sample_std(done / target_nm),
        "mean_error": float(done.mean() / target_nm - 1.0) if len(done) else None,
        "least_nm": float(done.min()) if len(done) else None,
        "most_nm": float(done.max()) if len(done) else None,
    }


def compare(rows: Sequence[Figures], maps: Sequence[Figures], variant: str) -> Figures:
    """Over the cells in reach: mean and worst spread and error, and the tightening factor with the
    friction of a bolt.
    """
    reach = [(m["target_nm"], m["slope"]) for m in maps if m["kind"] == "in reach"]
    found = [f for f in (cell_figures(rows, *cell, variant) for cell in reach) if f]
    good = [f for f in found if f["std"] is not None]
    pooled = np.array(
        [
            r["torque_nm"] / r["target_nm"]
            for r in rows
            if r["variant"] == variant
            and (r["target_nm"], r["slope"]) in reach
            and r["torque_nm"] is not None
            and r["reason"] not in REASONS_REFUSED
        ]
    )
    return {
        "variant": variant,
        "cells": len(found),
        "cells_met": sum(
            f["std"] <= GOALS["std"]
            and abs(f["mean_error"]) <= GOALS["mean"]
            and f["refused_or_missed"] == 0
            for f in good
        ),
        "std_rms": float(np.sqrt(np.mean([f["std"] ** 2 for f in good]))) if good else None,
        "std_most": max((f["std"] for f in good), default=None),
        "mean_error_most": max((abs(f["mean_error"]) for f in good), default=None),
        "refused_or_missed": sum(f["refused_or_missed"] for f in found),
        **alpha(pooled),
    }


def alpha(share: np.ndarray) -> Figures:
    """Tightening factor F_max / F_min of VDI 2230 of torques (n,) over their targets: of the torque
    alone (mean +- 2 sigma), and with the friction of a bolt from least to largest.
    """
    std = sample_std(share)
    if std is None:
        return {"alpha_torque": None, "alpha": None}
    of_torque = float((share.mean() + 2 * std) / (share.mean() - 2 * std))
    return {
        "alpha_torque": of_torque,
        "alpha": of_torque * lever_m(FRICTIONS[-1]) / lever_m(FRICTIONS[0]),
    }
