"""Tables of precise screwing on drawn screws."""

from collections.abc import Sequence

from vgroove.control_bench import screwing_drawn
from vgroove.control_bench.draw import STRATA
from vgroove.control_bench.drawn_page import ALL, drawn_report, summaries
from vgroove.control_bench.goals import Goal, goals_of, goals_table
from vgroove.control_bench.jobs import PLAIN, Figures, present
from vgroove.control_bench.screwing import GOALS
from vgroove.control_bench.sets import by_half
from vgroove.html_page import table_from_dicts
from vgroove.result_files import Report

SUMMARY = [
    ("tool", "stratum"),
    ("variant", "variant"),
    ("set", "set"),
    ("screws", "screws"),
    ("impact rate change, small and soft", "rate_change_soft"),
    ("95 % interval from", "rate_low"),
    ("to", "rate_high"),
    ("past the seat in deg, median", "past_deg_median"),
    ("95 % quantile", "past_deg_tail"),
    ("stripped", "stripped"),
    ("share, 95 % interval from", "stripped_low"),
    ("to", "stripped_high"),
    ("stopped before the seat", "early"),
    ("share, 95 % interval from", "early_low"),
    ("to", "early_high"),
    ("not seated within the time", "never"),
    ("time with / without, mean", "time_ratio"),
    ("mean of the slowest group", "time_group"),
]
GROUPS = [
    ("tool", "stratum"),
    ("set", "set"),
    ("group", "group"),
    ("screws", "screws"),
    ("impact rate change, small and soft", "rate_change_soft"),
    ("past the seat in deg, median", "past_deg_median"),
    ("stripped", "stripped"),
    ("stopped before the seat", "early"),
    ("not seated within the time", "never"),
    ("time with / without, mean", "time_ratio"),
]
FAILED = [
    ("tool", "stratum"),
    ("set", "set"),
    ("screw", "size"),
    ("supply in V", "supply_v"),
    ("trigger", "trigger"),
    ("wood", "wood"),
    ("knot", "knot"),
    ("start in rad", "start_rad"),
    ("past the seat in deg", "past_deg"),
    ("turn by a blow in deg", "blow_deg"),
    ("not seated within the time", "never"),
]


def groups(rows: Sequence[Figures]) -> list[Figures]:
    """The figures of each group of supplies, triggers, sizes and woods; both strata."""
    return [
        {"stratum": ALL, "set": half, "group": name, **figures}
        for variant in dict.fromkeys(row["variant"] for row in rows)
        if variant != PLAIN.name
        for half, part in by_half(rows)
        for name, figures in screwing_drawn.group_figures(part, variant).items()
    ]


def goals(found: Sequence[Figures]) -> list[Goal]:
    """The goals of screwing.GOALS, over the nominal tool and the tools that are off together."""
    listed: list[Goal] = []
    for f in found:
        if f["stratum"] == ALL and f["variant"] != PLAIN.name:
            listed += goals_of(
                f["variant"],
                f["set"],
                ("impact rate change, small and soft", f["rate_change_soft"], GOALS["rate"]),
                ("turn past the seat in deg, median", f["past_deg_median"], f["limit_deg_median"]),
                ("screws past the end of the ramp", f["stripped"], stripped_limit(f["screws"])),
                ("share stopped before the seat", f["early"] / f["screws"], GOALS["early"]),
                ("screws not seated within the time", f["never"], 0),
                ("time to seat with / without, mean", f["time_ratio"], GOALS["time"]),
                ("the same, slowest group", f["time_group"], GOALS["time"]),
            )
    return listed


def stripped_limit(screws: int) -> int:
    """Screws past the end of the ramp that the goal admits: one in 600, at least one."""
    return max(1, screws // screwing_drawn.SCREWS_PER_STRIPPED)


def screwing_drawn_report(rows: Sequence[Figures]) -> Report:
    """The part `screwing_drawn` as a report."""
    chosen = present(rows)
    found = summaries(chosen, screwing_drawn.compare, (*STRATA, ALL))
    grouped = groups(chosen)
    listed = goals(found)
    failed = [
        row
        for row in chosen
        if row["variant"] != PLAIN.name and (row["stripped"] or row["early"] or row["never"])
    ]
    tables = [
        table_from_dicts(
            "screwing_drawn_summary", "Precise screwing, drawn screws", SUMMARY, found
        ),
        table_from_dicts("screwing_drawn_groups", "The same in groups", GROUPS, grouped),
        goals_table("screwing_drawn", listed),
        table_from_dicts(
            "screwing_drawn_failed",
            "Screws stopped before the seat, past the end of the ramp, or not seated",
            FAILED,
            sorted(failed, key=lambda row: row["past_deg"]),
        ),
    ]
    data = {"summary": found, "groups": grouped, "cells": list(rows)}
    return drawn_report("screwing_drawn", "precise screwing", tables, listed, data)
