"""Tables of blow detection on drawn cells."""

from collections.abc import Sequence

from vgroove.control_bench import blows_drawn
from vgroove.control_bench.draw import NOMINAL
from vgroove.control_bench.drawn_page import drawn_report, summaries
from vgroove.control_bench.goals import Goal, goals_of, goals_table
from vgroove.control_bench.jobs import Figures, present
from vgroove.html_page import table_from_dicts
from vgroove.result_files import Report

SUMMARY = [
    ("tool", "stratum"),
    ("variant", "variant"),
    ("set", "set"),
    ("cells", "cells"),
    ("blows", "blows"),
    ("off by more than 1 % and a blow", "failures"),
    ("share, 95 % interval from", "failures_low"),
    ("to", "failures_high"),
    ("error, mean", "error"),
    ("95 % quantile", "error_tail"),
    ("worst", "worst"),
    ("repeats", "repeats"),
    ("precision", "precision"),
    ("recall", "recall"),
]
FAILED = [
    ("tool", "stratum"),
    ("variant", "variant"),
    ("set", "set"),
    ("supply in V", "supply_v"),
    ("trigger", "trigger"),
    ("start in rad", "start_rad"),
    ("joint", "kind"),
    ("slip torque in N m", "slip_nm"),
    ("slope in N m/rad", "slope"),
    ("screw", "size"),
    ("wood", "wood"),
    ("blows", "blows"),
    ("error", "error"),
]


def of_source(rows: Sequence[Figures], source: str) -> Figures:
    """The figures of the cells whose blows are counted by a source (variant)."""
    chosen = [row for row in rows if row["variant"] == source]
    return {"variant": source, **blows_drawn.compare(chosen)}


def goals(found: Sequence[Figures]) -> list[Goal]:
    """The goals with the nominal tool."""
    listed: list[Goal] = []
    for f in found:
        if f["stratum"] == NOMINAL:
            within = 1.0 - f["failures"] / f["cells"]
            listed += goals_of(
                f["variant"],
                f["set"],
                ("share of cells within 1 % or a blow", within, blows_drawn.WITHIN, False),
                ("error of the worst cell", f["worst"], blows_drawn.WORST),
                ("repeats reported, precision", f["precision"], blows_drawn.REPEAT_GOAL, False),
                ("repeats reported, recall", f["recall"], blows_drawn.REPEAT_GOAL, False),
            )
    return listed


def blows_drawn_report(rows: Sequence[Figures]) -> Report:
    """The part `blows_drawn` as a report."""
    chosen = present(rows)
    found = summaries(chosen, of_source)
    listed = goals(found)
    failed = [r for r in chosen if blows_drawn.error_share(r) > blows_drawn.GOAL]
    tables = [
        table_from_dicts("blows_drawn_summary", "Blow detection, drawn cells", SUMMARY, found),
        goals_table("blows_drawn", listed),
        table_from_dicts(
            "blows_drawn_failed",
            "Cells off by more than 1 % and a blow, the worst first",
            FAILED,
            sorted(failed, key=blows_drawn.error_share, reverse=True),
        ),
    ]
    data = {"summary": found, "cells": list(rows)}
    return drawn_report("blows_drawn", "blow detection", tables, listed, data)
