"""Tables of low vibration on drawn cells."""

from collections.abc import Sequence
from typing import Any

from vgroove.control_bench import vibration, vibration_drawn
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
    ("joint not turned", "without_aim"),
    ("judged", "judged"),
    ("aim missed", "missed"),
    ("RMS change, mean", "change"),
    ("95 % quantile", "change_tail"),
    ("worst", "worst"),
    ("above +5 % or aim missed", "above"),
    ("share, 95 % interval from", "above_low"),
    ("to", "above_high"),
    ("full voltage: cells", "full_cells"),
    ("RMS change, mean", "full_change"),
    ("later part: cells", "late_cells"),
    ("RMS change, mean", "late"),
    ("time change, mean", "time"),
    ("time change, most", "time_most"),
]
WORST = [
    ("tool", "stratum"),
    ("variant", "variant"),
    ("set", "set"),
    ("supply in V", "supply_v"),
    ("trigger", "trigger"),
    ("start in rad", "start_rad"),
    ("joint", "kind"),
    ("slope in N m/rad", "slope"),
    ("wood", "wood"),
    ("RMS without", "plain_nm"),
    ("RMS change", "rms_change"),
]


def goals(found: Sequence[Figures]) -> list[Goal]:
    """The goals of each stratum and method."""
    listed: list[Goal] = []
    for f in found:
        listed += goals_of(
            f"{f['variant']}, {f['stratum']}",
            f["set"],
            ("RMS change, mean", f["change"], vibration.GOALS["mean"]),
            ("RMS change at full voltage, mean", f["full_change"], vibration.GOALS["mean"]),
            ("cells above +5 % or that miss the aim", f["above"], 0),
            ("time change, mean", f["time"], vibration.GOALS["time"]),
        )
    return listed


def failed(rows: Sequence[Figures]) -> list[dict[str, Any]]:
    """Cells that miss their aim, then those whose RMS rises by more than the goal, the worst
    first.
    """
    pairs = [
        pair
        for variant in dict.fromkeys(row["variant"] for row in rows)
        for pair in vibration_drawn.pairs(rows, variant)
        if vibration_drawn.has_aim(pair)
    ]
    missed = [pair for pair in pairs if vibration_drawn.misses(pair)]
    found = [
        {
            **after,
            "plain_nm": before["rms_nm"],
            "rms_change": after["rms_nm"] / before["rms_nm"] - 1.0,
        }
        for before, after in pairs
        if not vibration_drawn.misses((before, after))
    ]
    above = [row for row in found if row["rms_change"] > vibration_drawn.WORST]
    return [
        *({**after, "plain_nm": before["rms_nm"]} for before, after in missed),
        *sorted(above, key=lambda row: row["rms_change"], reverse=True),
    ]


def vibration_drawn_report(rows: Sequence[Figures]) -> Report:
    """The part `vibration_drawn` as a report."""
    chosen = present(rows)
    found = summaries(chosen, vibration_drawn.compare, without=PLAIN.name)
    listed = goals(found)
    tables = [
        table_from_dicts("vibration_drawn_summary", "Low vibration, drawn cells", SUMMARY, found),
        goals_table("vibration_drawn", listed),
        table_from_dicts(
            "vibration_drawn_failed",
            "Cells that miss their aim or are above +5 %",
            WORST,
            failed(chosen),
        ),
    ]
    data = {"summary": found, "cells": list(rows)}
    return drawn_report("vibration_drawn", "low vibration", tables, listed, data)
