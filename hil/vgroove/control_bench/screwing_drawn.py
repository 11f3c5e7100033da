"""Precise screwing between chosen values: wood, supplies, triggers, start angles and tools that are
drawn.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from vgroove.control_bench import screwing
from vgroove.control_bench.draw import (
    TAIL,
    DrawnPart,
    Span,
    drawn_cells,
    drawn_tool,
    failure_interval,
)
from vgroove.control_bench.jobs import PLAIN, Figures, Job, Variant
from vgroove.rig import Rig

SPANS = {
    "trigger": Span(0.5, 1.0),
    "size": Span(0, len(screwing.SIZES)),
    "wood": Span(0.75, 1.25),  # of the screw's torques
    "knot": Span(0, 2),
}
DRAWS = 30  # screws of a half and stratum
NORMAL_95 = 1.96  # standard errors of a mean, 95 % interval
SCREWS_PER_STRIPPED = 600  # goal: at most one of so many is turned past the end of the ramp
# Value -> limits of its groups: the goal of the time holds in each group of supplies and triggers.
GROUP_LIMITS = {
    "supply_v": (16.0, 17.5, 19.0, 20.5),
    "trigger": (0.5, 0.625, 0.75, 0.875, 1.0),
    "wood": (0.75, 1.0, 1.25),
}
TIMED = ("supply_v", "trigger")


def cells(draws: int = DRAWS) -> list[dict[str, Any]]:
    """`draws` screws in each half, for the nominal tool and for tools that are off."""
    return [
        {**cell, "size": screwing.SIZES[int(cell["size"])], "knot": bool(int(cell["knot"]))}
        for cell in drawn_cells(DrawnPart.SCREWING, SPANS, draws)
    ]


def rig_of(cell: Mapping[str, Any]) -> Rig:
    """The tool of a cell on its screw."""
    keys = ("size", "supply_v", "wood", "knot", "seed")
    return drawn_tool(screwing.screw(**{key: cell[key] for key in keys}), cell)


def work(variant: Variant, **cell: Any) -> Figures:
    """One screw."""
    return screwing.drive(variant, rig_of(cell), cell["trigger"], cell["seed"])


def jobs(chosen: Sequence[dict[str, Any]]) -> list[Job]:
    """Every chosen screw with and without control."""
    return [Job(work, variant, cell) for variant in screwing.VARIANTS for cell in chosen]


def groups(rows: Sequence[Figures]) -> dict[tuple[str, str], list[Figures]]:
    """(value, range) -> the rows whose value lies in this range of GROUP_LIMITS; the sizes last."""
    found = {
        (name, f"{low:g} to {high:g}"): [r for r in rows if low <= r[name] < high]
        for name, limits in GROUP_LIMITS.items()
        for low, high in pairwise(limits)
    }
    found |= {("size", size): [r for r in rows if r["size"] == size] for size in screwing.SIZES}
    return {group: chosen for group, chosen in found.items() if chosen}


def group_figures(rows: Sequence[Figures], variant: str) -> dict[str, Figures]:
    """Figures of a variant against no control (screwing.compare), by the name of a group."""
    return {
        f"{name} {span}": screwing.compare(chosen, variant)
        for (name, span), chosen in groups(rows).items()
    }


def slowest_group(rows: Sequence[Figures], variant: str) -> float | None:
    """Greatest mean ratio of the times to the seat over the groups of TIMED."""
    ratios = [
        screwing.compare(chosen, variant)["time_ratio"]
        for (name, _), chosen in groups(rows).items()
        if name in TIMED
    ]
    return max((ratio for ratio in ratios if ratio is not None), default=None)


def compare(rows: Sequence[Figures], variant: str) -> Figures:
    """A variant against no control as screwing.compare; 95 % intervals of the mean change of the
    impact rate, of the share past the ramp and of the share stopped early; adverse quantile of the
    turn past the seat; mean ratio of the times in the slowest group.
    """
    plain = {row["seed"]: row for row in rows if row["variant"] == PLAIN.name}
    here = [row for row in rows if row["variant"] == variant]
    changes = np.array(
        [
            row["rate_per_s"] / plain[row["seed"]]["rate_per_s"] - 1.0
            for row in here
            if screwing.is_soft(row) and row["rate_per_s"] and plain[row["seed"]]["rate_per_s"]
        ]
    )
    error = NORMAL_95 * float(changes.std(ddof=1)) / np.sqrt(len(changes))
    past = [row["past_deg"] for row in here if row["seat_s"] is not None]
    stripped = failure_interval(sum(row["stripped"] for row in here), len(here))
    early = failure_interval(sum(row["early"] for row in here), len(here))
    return {
        **screwing.compare(rows, variant),
        "time_group": slowest_group(rows, variant),
        "rate_low": float(changes.mean() - error),
        "rate_high": float(changes.mean() + error),
        "past_deg_tail": float(np.quantile(past, 1.0 - TAIL)) if past else None,
        "stripped_low": stripped[0],
        "stripped_high": stripped[1],
        "early_low": early[0],
        "early_high": early[1],
    }
