"""Goals of the controllers beside the figures reached, and the report that every part of the bench
ends in.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from vgroove.control_bench.jobs import Figures, absent_lines
from vgroove.html_page import Picture, Table
from vgroove.result_files import Report

ROUNDING = 1e-12  # of a figure that lies on its limit


@dataclass(frozen=True)
class Goal:
    """A figure of a variant on a half of the cells, and its limit; a figure of None misses it."""

    variant: str
    half: str
    figure: str
    value: float | None
    limit: float
    at_most: bool = True

    @property
    def met(self) -> bool:
        """Whether the goal is reached."""
        if self.value is None:
            return False
        if self.at_most:
            return self.value <= self.limit + ROUNDING
        return self.value >= self.limit - ROUNDING

    def as_dict(self) -> dict[str, Any]:
        """For the JSON."""
        side = "at most" if self.at_most else "at least"
        return {
            "variant": self.variant,
            "set": self.half,
            "goal": self.figure,
            "side": side,
            "limit": self.limit,
            "value": self.value,
            "met": self.met,
        }


def goals_of(variant: str, half: str, *figures: tuple[Any, ...]) -> list[Goal]:
    """Goals of one variant on one half from (figure, value, limit[, at_most])."""
    return [Goal(variant, half, *figure) for figure in figures]


def goals_table(name: str, goals: Sequence[Goal]) -> Table:
    """Every goal with its figure."""
    rows = [
        [
            g.variant,
            g.half,
            g.figure,
            ("<= " if g.at_most else ">= ") + f"{g.limit:g}",
            g.value,
            "yes" if g.met else "NO",
        ]
        for g in goals
    ]
    return Table(
        f"{name}_goals", "Goals", ["variant", "set", "figure", "goal", "reached", "met"], rows
    )


def met_line(goals: Sequence[Goal]) -> str:
    """A sentence: how many goals are met, and which are missed on the largest set of cells (all of
    them where both halves were run).
    """
    widest = goals[-1].half
    missed = [f"{g.variant}: {g.figure}" for g in goals if not g.met and g.half == widest]
    counted = f"{sum(g.met for g in goals)} of {len(goals)} goals are met"
    return counted + (f"; missed, set {widest}: {'; '.join(missed)}." if missed else ".")


def part_lines(goals: Sequence[Goal], rows: Sequence[Figures], part: str) -> list[str]:
    """Sentences of a part: the goals met, and the controllers that the firmware lacks."""
    return [*([met_line(goals)] if goals else []), *absent_lines(rows, part)]


def part_report(
    lines: Sequence[str],
    tables: Sequence[Table],
    pictures: Sequence[Picture | None],
    data: dict[str, Any],
) -> Report:
    """A part of the bench as a report; empty tables and missing pictures are left out."""
    return Report(
        "control",
        "Controllers",
        lines,
        [table for table in tables if table.rows],
        [picture for picture in pictures if picture],
        data,
    )
