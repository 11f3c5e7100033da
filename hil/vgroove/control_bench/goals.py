"""Goals of issue 5 beside the figures reached: one row each, so that what is missed stands in the
table like what is met.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from vgroove.page import Table


@dataclass(frozen=True)
class Goal:
    """A figure, its limit, and on which side of it the figure has to be; a figure of None is not
    reached.
    """

    variant: str
    half: str
    words: str
    value: float | None
    limit: float
    at_most: bool = True

    @property
    def met(self) -> bool:
        """Whether the goal is reached."""
        if self.value is None:
            return False
        return (
            self.value <= self.limit + 1e-12 if self.at_most else self.value >= self.limit - 1e-12
        )

    def as_dict(self) -> dict[str, Any]:
        """For the JSON."""
        side = "at most" if self.at_most else "at least"
        return {
            "variant": self.variant,
            "set": self.half,
            "goal": self.words,
            "side": side,
            "limit": self.limit,
            "value": self.value,
            "met": self.met,
        }


def goals_table(name: str, goals: Sequence[Goal]) -> Table:
    """Every goal with its figure."""
    rows = [
        [
            g.variant,
            g.half,
            g.words,
            ("<= " if g.at_most else ">= ") + f"{g.limit:g}",
            g.value,
            "yes" if g.met else "NO",
        ]
        for g in goals
    ]
    return Table(
        f"{name}_goals", "Goals", ["variant", "set", "figure", "goal", "reached", "met"], rows
    )


def table_of(
    name: str, title: str, columns: Sequence[tuple[str, str]], rows: Iterable[dict[str, Any]]
) -> Table:
    """A table from dicts: columns are (header, key)."""
    return Table(
        name,
        title,
        [header for header, _ in columns],
        [[row.get(key) for _, key in columns] for row in rows],
    )


def met_line(goals: Sequence[Goal]) -> str:
    """How many goals are met, and which are not over the widest set, in a sentence."""
    widest = goals[-1].half
    missed = [f"{g.variant}: {g.words}" for g in goals if not g.met and g.half == widest]
    counted = f"{sum(g.met for g in goals)} of {len(goals)} goals are met"
    return counted + (f"; missed, set {widest}: {'; '.join(missed)}." if missed else ".")
