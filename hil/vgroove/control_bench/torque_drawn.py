"""Torque control between chosen values: every integer target, on joints, supplies, start angles and
tools that are drawn.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
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
from vgroove.control_bench.jobs import Figures, Job, Variant
from vgroove.control_bench.runs import pull, sil_run
from vgroove.control_bench.torque import REASONS_REFUSED, DriveEnd, reason_of, sample_std
from vgroove.reference.joints import REFERENCE_JOINTS
from vgroove.reference.rigs import reference_rig, with_load
from vgroove.rig import Rig

FIRST_NM, LAST_NM = 40, 120  # range of torque_target_nm
TARGETS_NM = tuple(range(FIRST_NM, LAST_NM + 1))
SPANS = {
    "target_nm": Span(FIRST_NM, LAST_NM + 1),  # each integer has the same share of it
    "slope": Span(50.0, 800.0, logarithmic=True),  # N m/rad
    "joint_friction": Span(0.9, 1.1),  # of the slip torque
    "rough_share": Span(0.0, 0.03),  # torque of a rough place of the thread, of the target
    "rough_at": Span(0.3, 1.0),  # where it begins, of the head angle at the target
}
ROUGH_WIDTH = 0.1  # of the rough place, of the head angle at the target
DRAWS = 2  # of each target in a half and stratum
MAX_SECONDS = 16.0  # more than the firmware's time limits together
GOAL = 0.03  # mean error and standard deviation at a target, of the target
MISSED = 1 / 16  # a larger error is a miss, which the firmware has to report as one
BOOTSTRAP_SEED, BOOTSTRAP_DRAWS = 1, 2000  # of the interval of a mean
CONTROLLER = Variant("torque", "torque")


@dataclass(frozen=True)
class Adapted:
    """What is written to a board for a tool: the bytes of its torque map (None: the map of the
    firmware stays), and physical values of parameters by name (others keep their defaults).
    """

    torque_map: bytes | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)


NOT_ADAPTED = Adapted()


def cells(draws: int = DRAWS) -> list[dict[str, Any]]:
    """`draws` cells of each target in each half, for the nominal tool and for tools that are
    off.
    """
    found = drawn_cells(DrawnPart.TORQUE, SPANS, draws * len(TARGETS_NM))
    return [{**cell, "target_nm": float(int(cell["target_nm"]))} for cell in found]


def joint(cell: Mapping[str, Any], tool: Rig | None = None) -> Rig:
    """The tool, by default the reference tool, with the values of a cell on its joint."""
    load = {**REFERENCE_JOINTS["hard_joint"].load, "slip_slope_nm_per_rad": cell["slope"]}
    rig = drawn_tool(with_load(tool or reference_rig(), load), cell)
    turn_rad = cell["target_nm"] / cell["slope"]
    from_rad = cell["rough_at"] * turn_rad
    return rig.with_effects(
        {
            "thread_friction": {"relative": cell["joint_friction"] - 1.0},
            "wood_knot": {
                "torque_nm": cell["rough_share"] * cell["target_nm"],
                "from_rad": from_rad,
                "to_rad": from_rad + ROUGH_WIDTH * turn_rad,
            },
        }
    )


def work(
    variant: Variant, *, base: Rig | None = None, adapted: Adapted = NOT_ADAPTED, **cell: Any
) -> Figures:
    """One drive: the torque that the joint holds, its error, and what the board reports.
    base: in place of the reference tool.
    """
    run = sil_run(
        joint(cell, base),
        mode=variant.mode,
        params={**adapted.parameters, "torque_target_nm": cell["target_nm"]},
        profile=pull(cell["trigger"]),
        duration_s=MAX_SECONDS,
        seed=cell["seed"],
        stop_when=DriveEnd(),
        torque_map=adapted.torque_map,
    )
    reported = len(run.control["time_s"]) > 0
    return {
        "torque_nm": run.tightened_nm,
        "error": run.tightened_nm / cell["target_nm"] - 1.0,
        "reason": reason_of(run),
        "estimate_nm": float(run.control["estimate"][-1]) / 10 if reported else None,
        "blows": len(run.struck_s),
        "seconds": run.duration_s,
        "faults": run.faults,
    }


def jobs(chosen: Sequence[dict[str, Any]]) -> list[Job]:
    """One drive a cell."""
    return [Job(work, CONTROLLER, cell) for cell in chosen]


def reached(row: Figures) -> bool:
    """Whether the board reported the target as reached."""
    return row["reason"] not in (*REASONS_REFUSED, "timeout")


def missed_reported_reached(row: Figures) -> bool:
    """Whether a miss was reported as reached."""
    return reached(row) and abs(row["error"]) > MISSED


def target_figures(rows: Sequence[Figures]) -> list[Figures]:
    """Each target of a stratum: mean error, standard deviation and largest error of the drives
    reported as reached, misses that were not reported, and whether the goals are met. A target has
    a standard deviation, and can meet the goals, from two drives reported as reached on.
    """
    found = []
    for target in sorted({row["target_nm"] for row in rows}):
        here = [row for row in rows if row["target_nm"] == target]
        errors = np.array([row["error"] for row in here if reached(row)])
        std = sample_std(errors)
        unreported = sum(missed_reported_reached(row) for row in here)
        within = std is not None and max(abs(errors.mean()), std) <= GOAL
        found.append(
            {
                "target_nm": target,
                "runs": len(here),
                "reached": len(errors),
                "missed_reported_reached": unreported,
                "mean_error": float(errors.mean()) if len(errors) else None,
                "std": std,
                "worst": float(errors[np.argmax(abs(errors))]) if len(errors) else None,
                "met": bool(within and not unreported),
            }
        )
    return found


def units(rows: Sequence[Figures]) -> list[list[Figures]]:
    """The rows in groups that were drawn independently of each other: the drives of one tool that
    is off are a group, since its deviation is the same in all of them; each drive of the nominal
    tool is one.
    """
    found: dict[Any, list[Figures]] = {}
    for number, row in enumerate(rows):
        tool = row.get("tool")
        found.setdefault(tuple(sorted(tool.items())) if tool else number, []).append(row)
    return list(found.values())


def mean_interval(groups: Sequence[Sequence[Figures]]) -> tuple[float, float] | None:
    """95 % interval of the mean error of the drives reported as reached, by the cluster bootstrap
    over groups of rows (Davison and Hinkley 1997, section 3.8); None of fewer than two groups.
    """
    errors = [[row["error"] for row in group if reached(row)] for group in groups]
    sums = np.array([sum(group) for group in errors if group])
    counts = np.array([len(group) for group in errors if group])
    if len(sums) < 2:
        return None
    random = np.random.default_rng(BOOTSTRAP_SEED)
    drawn = random.integers(0, len(sums), (BOOTSTRAP_DRAWS, len(sums)))
    means = sums[drawn].sum(axis=1) / counts[drawn].sum(axis=1)
    low, high = np.quantile(means, [0.025, 0.975])
    return float(low), float(high)


def compare(rows: Sequence[Figures]) -> Figures:
    """A stratum: mean with its 95 % interval, standard deviation, adverse quantiles and worst error
    of the drives reported as reached; those beyond GOAL; misses that were not reported; `units`
    drawn independently of each other, those of them with such a miss, and the 95 % interval of
    their share; targets that meet the goals, and those without a standard deviation: no drive
    reported as reached, or a single one.
    """
    errors = np.array([row["error"] for row in rows if reached(row)])
    failures = sum(missed_reported_reached(row) for row in rows)
    groups = units(rows)
    failed = sum(any(map(missed_reported_reached, group)) for group in groups)
    low, high = failure_interval(failed, len(groups))
    targets = target_figures(rows)
    false_alarms = [row for row in rows if not reached(row) and abs(row["error"]) <= GOAL]
    figures: Figures = {
        "runs": len(rows),
        "reached": len(errors),
        "false_alarms": len(false_alarms),
        "beyond_goal": int((abs(errors) > GOAL).sum()),
        "missed_reported_reached": failures,
        "units": len(groups),
        "units_failed": failed,
        "missed_reported_reached_low": low,
        "missed_reported_reached_high": high,
        "targets": len(targets),
        "targets_met": sum(target["met"] for target in targets),
        "targets_not_reached": sum(target["reached"] == 0 for target in targets),
        "targets_reached_once": sum(target["reached"] == 1 for target in targets),
    }
    if not len(errors):
        return figures
    least, most = np.quantile(errors, [TAIL, 1.0 - TAIL])
    mean_low, mean_high = mean_interval(groups) or (None, None)
    return figures | {
        "mean_error": float(errors.mean()),
        "mean_error_low": mean_low,
        "mean_error_high": mean_high,
        "std": sample_std(errors),
        "quantile_low": float(least),
        "quantile_high": float(most),
        "worst": float(errors[np.argmax(abs(errors))]),
    }
