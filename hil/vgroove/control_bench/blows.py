"""Blow detection: blows that the board counts against blows of the plant, over supplies, loads and
triggers.
"""

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np

from vgroove.control_bench.jobs import Figures, Job, Variant
from vgroove.control_bench.runs import PULL_S, Run, pull, reference, sil_run
from vgroove.control_bench.sets import SUPPLIES_V, half_of, seed_of
from vgroove.control_bench.sync import MATRIX_JOINTS
from vgroove.eeprom_image import AbsentError
from vgroove.reference.blows import REPEAT

TRIGGERS = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
RATES_PER_MIN = (1200.0, 4000.0)  # cells outside are not evaluated
SECONDS = 3.0  # of the run
RELEASE_S = SECONDS - 0.2  # early enough that the run contains the report of the last blow
VARIANTS = (
    Variant("by speed", params={"blow_source": 0}),
    Variant("by current", params={"blow_source": 1}),
)
GOAL = 0.01  # largest error of the count, of the true count
FEW_REPEATS = 6  # so many occur in the run-up; a cell without more of them counts as right
# Largest period spread (mean absolute deviation over mean) of a synchronous tool
IN_STEP = 0.03
REPEAT_GOALS = {"precision": 0.85, "recall": 0.9}
SETTLE_S = 0.5  # after the pull; periods are evaluated from then on
MIN_PERIODS = 8  # with fewer no period is evaluated
TICKS_OF_BYTE = 256  # of CONTROL.control_tick, the low byte of the time in ms


def cells() -> list[dict[str, Any]]:
    """All cells, each in one of the halves."""
    found = []
    for (s, supply_v), (n, load), (t, trigger) in product(
        enumerate(SUPPLIES_V), enumerate(MATRIX_JOINTS), enumerate(TRIGGERS)
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
    """Time of the last driven row: repeats and periods of board and plant are compared up to it,
    since a blow or two follow without power.
    """
    driven = np.flatnonzero(run.telemetry["coast"] == 0)
    return float(run.telemetry["time_s"][driven[-1]])


def repeat_figures(reported: np.ndarray, blows_s: np.ndarray, repeats_s: np.ndarray) -> Figures:
    """Numbers of true, reported and rightly reported repeats.

    `reported` (n, len(REPORTED)) are the board's blows, `blows_s` and `repeats_s` the times of the
    plant's blows and repeats. Of the repeats between two true blows the smaller one of the true and
    the reported number counts as right. The board reports repeats for each lug.
    """
    if len(blows_s) < 2:
        return {"repeats": len(repeats_s), "repeats_reported": 0, "repeats_right": 0}
    edges = np.append(blows_s, np.inf)
    true = np.histogram(repeats_s, edges)[0]
    counted = np.histogram(reported[:, 0], edges, weights=reported[:, 1] * reported[:, 2])[0]
    right = np.minimum(true, counted).sum()
    return {
        "repeats": int(true.sum()),
        "repeats_reported": int(counted.sum()),
        "repeats_right": int(right),
    }


def period_figures(reported: np.ndarray, blows_s: np.ndarray) -> Figures:
    """Reported against true periods after SETTLE_S: relative error of the running mean, and the
    spreads (mean absolute deviation over mean) of the true and of the reported periods.
    """
    true = np.diff(blows_s[blows_s > PULL_S + SETTLE_S])
    rows = reported[reported[:, 0] > PULL_S + SETTLE_S]
    if len(true) < MIN_PERIODS or len(rows) < MIN_PERIODS:
        return {"period_error": None, "spread": None, "spread_reported": None}
    mean = true.mean()
    return {
        "period_error": float(abs(rows[:, 4].mean() / mean - 1.0)),
        "spread": float(np.abs(true - mean).mean() / mean),
        "spread_reported": float(rows[:, 5].mean()),
    }


def work(variant: Variant, **cell: Any) -> Figures:
    """One cell: the count over the whole drive, and the figures of its repeats and periods."""
    run = sil_run(
        reference(MATRIX_JOINTS[cell["load"]].load, supply_v=cell["supply_v"]),
        mode=variant.mode,
        params=variant.params,
        profile=pull(cell["trigger"], release_s=RELEASE_S),
        duration_s=SECONDS,
        seed=cell["seed"],
    )
    return count_figures(run)


def judged_s(blows_s: np.ndarray) -> float:
    """Time up to which a count is compared with the blows of the plant, at their times blows_s: the
    middle between the last two before the release of the trigger, or the release where there are
    none. The board reports a blow up to 7 ms after it, which is less than half a period, and after
    the release the falling duty leaves no valley in the speed.
    """
    before = blows_s[blows_s < RELEASE_S]
    return float(before[-2:].mean()) if len(before) > 1 else RELEASE_S


def counted_at(control: dict[str, np.ndarray], time_s: float) -> int:
    """Blows that the board has counted at a time, by the CONTROL frames (Run.control). A frame
    leaves up to 255 ms after its values hold, and gives the low byte of that millisecond.
    """
    sent_ms = np.round(1e3 * control["time_s"]).astype(int)
    held_ms = sent_ms - ((sent_ms - control["control_tick"].astype(int)) % TICKS_OF_BYTE)
    counts = control["blow_count"][(control["time_s"] > PULL_S) & (held_ms <= 1e3 * time_s)]
    return int(counts.max()) if len(counts) else 0


def count_figures(run: Run) -> Figures:
    """The count of a drive up to judged_s, and the figures of its repeats and periods up to the
    open bridge.

    Raises AbsentError for a firmware without blow detection.
    """
    if not len(run.control["time_s"]):
        raise AbsentError("this firmware reports no blows: it sends no frame CONTROL")
    hits, opened, end_s = run.hits, opened_s(run), judged_s(run.struck_s)
    driven = run.struck_s[run.struck_s < opened]
    blows, counted = int((run.struck_s < end_s).sum()), counted_at(run.control, end_s)
    again = hits["time_s"][hits["kind"] == REPEAT]
    return {
        "blows": blows,
        "counted": counted,
        "error": counted - blows,
        "blows_per_min": float(60.0 / np.diff(driven).mean()) if len(driven) > 2 else 0.0,
        **repeat_figures(run.reported, driven, again[again < opened]),
        **period_figures(run.reported, driven),
        "faults": run.faults,
    }


def jobs(chosen: Sequence[dict[str, Any]]) -> list[Job]:
    """Every chosen cell by both sources, without control, since the detection runs in all modes."""
    return [Job(work, variant, cell) for variant in VARIANTS for cell in chosen]


def in_range(rows: Sequence[Figures]) -> list[Figures]:
    """Cells whose true rate lies within RATES_PER_MIN."""
    return [r for r in rows if RATES_PER_MIN[0] <= r["blows_per_min"] <= RATES_PER_MIN[1]]


def repeat_score(chosen: Sequence[Figures]) -> Figures:
    """Precision and recall of the repeats over all cells, and the number of cells where both reach
    their goals.
    """
    reported, true, right = (
        sum(r[key] for r in chosen) for key in ("repeats_reported", "repeats", "repeats_right")
    )
    return {
        "repeats": true,
        "precision": right / reported if reported else None,
        "recall": right / true if true else None,
        "repeat_cells": sum(repeats_right(r) for r in chosen),
    }


def repeats_right(row: Figures) -> bool:
    """Whether precision and recall of a cell reach REPEAT_GOALS; true where both true and reported
    repeats are at most FEW_REPEATS.
    """
    reported, true, right = row["repeats_reported"], row["repeats"], row["repeats_right"]
    few = reported <= FEW_REPEATS and true <= FEW_REPEATS
    return few or (
        right >= REPEAT_GOALS["precision"] * reported and right >= REPEAT_GOALS["recall"] * true
    )


def period_score(chosen: Sequence[Figures]) -> Figures:
    """Mean error of the running period over all cells; true and reported spread over the cells
    whose true spread is at most IN_STEP.
    """
    judged = [r for r in chosen if r["period_error"] is not None]
    steady = [r for r in judged if r["spread"] <= IN_STEP]
    return {
        "period_error": float(np.mean([r["period_error"] for r in judged])) if judged else None,
        "spread": float(np.mean([r["spread"] for r in steady])) if steady else None,
        "spread_reported": (
            float(np.mean([r["spread_reported"] for r in steady])) if steady else None
        ),
    }


def summary(rows: Sequence[Figures]) -> Figures:
    """Errors of the count over all cells: their sum, the number of cells within GOAL or one blow,
    and the worst cell.
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
