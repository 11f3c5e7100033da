"""Tables of synchronisation on drawn cells."""

from collections.abc import Sequence

from vgroove.control_bench import sync_drawn
from vgroove.control_bench.draw import NOMINAL
from vgroove.control_bench.drawn_page import drawn_report, summaries
from vgroove.control_bench.goals import Goal, goals_of, goals_table
from vgroove.control_bench.jobs import PLAIN, Figures, present
from vgroove.html_page import table_from_dicts
from vgroove.result_files import Report

SUMMARY = [
    ("tool", "stratum"),
    ("variant", "variant"),
    ("set", "set"),
    ("cells", "cells"),
    ("clean, mean", "clean"),
    ("5 % quantile", "clean_tail"),
    ("worst", "clean_worst"),
    ("spread, median", "spread"),
    ("95 % quantile", "spread_tail"),
    ("worst", "spread_worst"),
    ("out of step", "out_of_step"),
    ("share, 95 % interval from", "out_low"),
    ("to", "out_high"),
    ("worse than without", "worse"),
    ("largest loss", "worst_change"),
]
STEADY = [
    (title, key if key in ("stratum", "variant", "set") else f"steady_{key}")
    for title, key in SUMMARY
]
WORST = [
    ("tool", "stratum"),
    ("variant", "variant"),
    ("set", "set"),
    ("supply in V", "supply_v"),
    ("trigger", "trigger"),
    ("slip torque in N m", "slip_nm"),
    ("start in rad", "start_rad"),
    ("clean", "clean"),
    ("spread", "spread"),
    ("clean, steady", "steady_clean"),
    ("spread, steady", "steady_spread"),
]


def goals(found: Sequence[Figures]) -> list[Goal]:
    """The goals of the controllers with the nominal tool."""
    listed: list[Goal] = []
    for f in found:
        if f["stratum"] == NOMINAL and f["variant"] != PLAIN.name:
            listed += goals_of(
                f["variant"],
                f["set"],
                ("clean share, mean", f["clean"], sync_drawn.MEAN_CLEAN, False),
                ("cells out of step", f["out_of_step"], 0),
                ("cells worse than without control", f["worse"], 0),
                ("steady: clean share, mean", f["steady_clean"], sync_drawn.MEAN_CLEAN, False),
                ("steady: cells out of step", f["steady_out_of_step"], 0),
                ("steady: cells worse than without control", f["steady_worse"], 0),
            )
    return listed


def sync_drawn_report(rows: Sequence[Figures]) -> Report:
    """The part `sync_drawn` as a report."""
    chosen = present(rows)
    found = summaries(chosen, sync_drawn.compare)
    listed = goals(found)
    failed = [r for r in chosen if r["variant"] != PLAIN.name and not sync_drawn.in_step(r)]
    tables = [
        table_from_dicts("sync_drawn_summary", "Synchronisation, drawn cells", SUMMARY, found),
        table_from_dicts(
            "sync_drawn_steady",
            f"The same from {sync_drawn.STEADY_S:g} s on",
            STEADY,
            found,
        ),
        goals_table("sync_drawn", listed),
        table_from_dicts(
            "sync_drawn_failed",
            "Cells out of step, the least clean first",
            WORST,
            sorted(failed, key=lambda row: row["clean"]),
        ),
    ]
    data = {"summary": found, "cells": list(rows)}
    return drawn_report("sync_drawn", "synchronisation", tables, listed, data)
