"""Tables of torque control on drawn cells, and of tools with a map of their own."""

from collections.abc import Sequence
from dataclasses import dataclass

from vgroove.control_bench import torque_adapted, torque_drawn
from vgroove.control_bench.draw import NOMINAL, STRATA, seeds_line
from vgroove.control_bench.goals import Goal, goals_of, goals_table, part_lines, part_report
from vgroove.control_bench.jobs import Figures, present
from vgroove.control_bench.sets import by_half
from vgroove.html_page import table_from_dicts
from vgroove.result_files import Report

SUMMARY = [
    ("tool", "variant"),
    ("set", "set"),
    ("runs", "runs"),
    ("reached", "reached"),
    ("mean error", "mean_error"),
    ("95 % interval from", "mean_error_low"),
    ("to", "mean_error_high"),
    ("std", "std"),
    ("5 % quantile", "quantile_low"),
    ("95 % quantile", "quantile_high"),
    ("worst", "worst"),
    ("reached, error > 3 %", "beyond_goal"),
    ("misses not reported", "missed_reported_reached"),
    ("drives, or tools off", "units"),
    ("of them with such a miss", "units_failed"),
    ("their share, 95 % interval from", "missed_reported_reached_low"),
    ("to", "missed_reported_reached_high"),
    ("reported as missed, error <= 3 %", "false_alarms"),
    ("targets", "targets"),
    ("targets met", "targets_met"),
    ("targets never reached", "targets_not_reached"),
    ("targets reached once", "targets_reached_once"),
]
TARGETS = [
    ("tool", "variant"),
    ("set", "set"),
    ("target in N m", "target_nm"),
    ("runs", "runs"),
    ("reached", "reached"),
    ("mean error", "mean_error"),
    ("std", "std"),
    ("worst", "worst"),
    ("misses not reported", "missed_reported_reached"),
    ("met", "met"),
]


@dataclass(frozen=True)
class Part:
    """A part of the bench: its name and title, its strata, and the one that has goals."""

    name: str
    title: str
    strata: Sequence[str]
    with_goals: str


DRAWN = Part("torque_drawn", "Torque control, drawn cells", STRATA, NOMINAL)
ADAPTED = Part(
    "torque_adapted",
    "Torque control of tools of their own, drawn cells",
    torque_adapted.STRATA,
    torque_adapted.ADAPTED,
)


def strata(names: Sequence[str], rows: Sequence[Figures]) -> list[tuple[str, str, list[Figures]]]:
    """(stratum, half, its rows) for each stratum and each half, and both halves together."""
    found = [(name, [r for r in rows if r["stratum"] == name]) for name in names]
    return [(name, half, part) for name, chosen in found for half, part in by_half(chosen)]


def goals(variant: str, found: Sequence[Figures]) -> list[Goal]:
    """The goals of one stratum."""
    listed: list[Goal] = []
    for f in found:
        if f["variant"] == variant:
            listed += goals_of(
                variant,
                f["set"],
                ("targets that miss a goal", f["targets"] - f["targets_met"], 0),
                ("misses not reported", f["missed_reported_reached"], 0),
            )
    return listed


def torque_drawn_report(rows: Sequence[Figures], part: Part = DRAWN) -> Report:
    """The part `torque_drawn` or `torque_adapted` as a report."""
    parts = strata(part.strata, present(rows))
    found = [
        {"variant": name, "set": half, **torque_drawn.compare(here)} for name, half, here in parts
    ]
    targets = [
        {"variant": name, "set": half, **figures}
        for name, half, here in parts
        for figures in torque_drawn.target_figures(here)
    ]
    listed = goals(part.with_goals, found)
    tables = [
        table_from_dicts(f"{part.name}_summary", part.title, SUMMARY, found),
        goals_table(part.name, listed),
        table_from_dicts(
            f"{part.name}_missed",
            "Targets that miss a goal",
            TARGETS,
            [target for target in targets if not target["met"]],
        ),
    ]
    data = {
        part.name: {
            "summary": found,
            "goals": [g.as_dict() for g in listed],
            "targets": targets,
            "runs": [{k: v for k, v in row.items() if k != "map_hex"} for row in rows],
        }
    }
    lines = [*part_lines(listed, rows, "torque control"), seeds_line()]
    return part_report(lines, tables, [], data)
