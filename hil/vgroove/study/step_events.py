"""Steps of a variable-step solver: their sizes, how far an event shrinks them, and the recovery."""

from collections.abc import Sequence
from typing import Any

import numpy as np

RECOVERED = 0.5  # of the step before an event: a step of this size counts as recovered
STEPS_BEFORE = 5  # the "step before" an event is the largest of the five steps that end at it
NO_EVENT = "none"  # the mark of a step that ends where the solver chose
STEP_HEADER = ["smallest in us", "median in us", "largest in us"]
EVENT_HEADER = ["event", "count", "step before in us", "smallest after in us", "recovery in ms"]


def event_rows(
    time_s: np.ndarray, length_s: np.ndarray, marks: Sequence[str]
) -> list[dict[str, Any]]:
    """For each event of a step history: the step before it, the smallest step after it until the
    step has recovered, and the time that the recovery takes.

    `time_s` (n,) are the ends of the steps, `length_s` (n,) their sizes, `marks` the event that
    ended each. A step that an event cuts short is not the solver's choice and does not count as
    smallest. `recovery_s` ignores later events; it is None where the run ends first.
    """
    rows = []
    chosen = np.where([mark == NO_EVENT for mark in marks], length_s, np.inf)
    for n in (n for n, mark in enumerate(marks) if mark != NO_EVENT and n + 1 < len(marks)):
        before = float(np.max(length_s[max(0, n + 1 - STEPS_BEFORE) : n + 1]))
        later = length_s[n + 1 :]
        recovered = np.flatnonzero(later >= RECOVERED * before)
        last = int(recovered[0]) if recovered.size else len(later) - 1
        rows.append(
            {
                "time_s": float(time_s[n]),
                "event": marks[n],
                "before_s": before,
                "smallest_after_s": float(min(np.min(chosen[n + 1 : n + 2 + last]), later[last])),
                "recovery_s": float(time_s[n + 1 + last] - time_s[n]) if recovered.size else None,
            }
        )
    return rows


def event_summary(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Events of one kind as one row, in the order of their first appearance: medians, and the
    smallest step of all.
    """
    found = []
    for kind in dict.fromkeys(row["event"] for row in rows):
        same = [row for row in rows if row["event"] == kind]
        recovered = [row["recovery_s"] for row in same if row["recovery_s"] is not None]
        found.append(
            {
                "event": kind,
                "count": len(same),
                "before_s": float(np.median([r["before_s"] for r in same])),
                "smallest_after_s": min(r["smallest_after_s"] for r in same),
                "recovery_s": float(np.median(recovered)) if recovered else None,
            }
        )
    return found


def step_figures(length_s: np.ndarray, marks: Sequence[str]) -> dict[str, Any]:
    """Number of the steps (n,), median and largest of all, smallest of those no event cut short."""
    chosen = length_s[[mark == NO_EVENT for mark in marks]]
    return {
        "steps": len(length_s),
        "smallest_s": float(chosen.min()),
        "median_s": float(np.median(length_s)),
        "largest_s": float(length_s.max()),
    }


def in_micro(value: float | None) -> float | None:
    """Seconds as microseconds."""
    return None if value is None else value * 1e6


def in_milli(value: float | None) -> float | None:
    """Seconds as milliseconds."""
    return None if value is None else value * 1e3


def step_cells(row: dict[str, Any]) -> list[float | None]:
    """The cells under STEP_HEADER."""
    return [in_micro(row[key]) for key in ("smallest_s", "median_s", "largest_s")]


def event_cells(row: dict[str, Any]) -> list[Any]:
    """The cells under EVENT_HEADER."""
    sizes = [in_micro(row[key]) for key in ("before_s", "smallest_after_s")]
    return [row["event"], row["count"], *sizes, in_milli(row["recovery_s"])]
