"""Tables of torque control on drawn cells."""

from collections.abc import Sequence

from vgroove.control_bench import torque_drawn
from vgroove.control_bench.draw import NOMINAL, STRATA, seeds_line
from vgroove.control_bench.goals import Goal, goals_of, goals_table, part_lines, part_report
from vgroove.control_bench.jobs import Figures, present
from vgroove.control_bench.sets import by_half
from vgroove.page import table_from_dicts
from vgroove.report import Report

SUMMARY = [
    ("tool", "variant"),
    ("set", "set"),
    ("runs", "runs"),
    ("reached", "reached"),
    ("mean error", "mean_error"),
    ("std", "std"),
    ("5 % quantile", "quantile_low"),
    ("95 % quantile", "quantile_high"),
    ("worst", "worst"),
    ("reached, error > 3 %", "beyond_goal"),
    ("misses not reported", "untold"),
    ("their share, 95 % interval from", "untold_low"),
    ("to", "untold_high"),
    ("reported as missed, error <= 3 %", "false_alarms"),
    ("targets", "targets"),
    ("targets met", "targets_met"),
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
    ("misses not reported", "untold"),
    ("met", "met"),
]


def strata(rows: Sequence[Figures]) -> list[tuple[str, str, list[Figures]]]:
    """(stratum, half, its rows) for each stratum and each half, and both halves together."""
    found = [(name, [r for r in rows if r["stratum"] == name]) for name in STRATA]
    return [(name, half, part) for name, chosen in found for half, part in by_half(chosen)]


def goals(found: Sequence[Figures]) -> list[Goal]:
    """The goals of the nominal tool."""
    listed: list[Goal] = []
    for f in found:
        if f["variant"] == NOMINAL:
            listed += goals_of(
                NOMINAL,
                f["set"],
                ("targets that miss a goal", f["targets"] - f["targets_met"], 0),
                ("misses not reported", f["untold"], 0),
            )
    return listed


def torque_drawn_report(rows: Sequence[Figures]) -> Report:
    """The part `torque_drawn` as a report."""
    parts = strata(present(rows))
    found = [
        {"variant": name, "set": half, **torque_drawn.compare(part)} for name, half, part in parts
    ]
    targets = [
        {"variant": name, "set": half, **figures}
        for name, half, part in parts
        for figures in torque_drawn.target_figures(part)
    ]
    listed = goals(found)
    tables = [
        table_from_dicts("torque_drawn_summary", "Torque control, drawn cells", SUMMARY, found),
        goals_table("torque_drawn", listed),
        table_from_dicts(
            "torque_drawn_missed",
            "Targets that miss a goal",
            TARGETS,
            [target for target in targets if not target["met"]],
        ),
    ]
    data = {
        "torque_drawn": {
            "summary": found,
            "goals": [g.as_dict() for g in listed],
            "targets": targets,
            "runs": list(rows),
        }
    }
    lines = [*part_lines(listed, rows, "torque control"), seeds_line()]
    return part_report(lines, tables, [], data)
