"""Tables and figures of low vibration."""

from collections.abc import Sequence

import plotly.graph_objects as go

from vgroove.control_bench import vibration
from vgroove.control_bench.goals import Goal, goals_table, met_line, table_of
from vgroove.control_bench.jobs import Figures, absent_lines, present
from vgroove.control_bench.sets import by_half
from vgroove.control_bench.sync_page import methods
from vgroove.study.impact_runs import JOINT_WORDS
from vgroove.study.report import Picture, Study, style

SUMMARY = [
    ("variant", "variant"),
    ("set", "set"),
    ("cells", "cells"),
    ("not reached", "not_reached"),
    ("RMS change", "change"),
    ("worst cell", "worst"),
    ("ISO-weighted change", "weighted"),
    ("change while impacting", "impacting"),
    ("time change", "time"),
    ("longest", "time_most"),
]
CELLS = [
    ("variant", "variant"),
    ("set", "set"),
    ("V", "supply_v"),
    ("load", "load"),
    ("RMS in N m", "rms_nm"),
    ("ISO-weighted", "weighted_nm"),
    ("while impacting", "impacting_nm"),
    ("time in s", "time_s"),
]
COLOURS = ("#30343b", "#d1495b", "#00798c", "#edae49")


def goals(found: Sequence[Figures]) -> list[Goal]:
    """Issue 5's, on each half and on all."""
    listed = []
    for f in found:
        name, half, limits = f["variant"], f["set"], vibration.GOALS
        listed += [
            Goal(name, half, "RMS change, mean", f["change"], limits["mean"]),
            Goal(name, half, "RMS change, worst cell", f["worst"], limits["worst"]),
            Goal(name, half, "time change, mean", f["time"], limits["time"]),
            Goal(name, half, "cells that do not reach the aim", f["not_reached"], 0),
        ]
    return listed


def cell_picture(rows: Sequence[Figures]) -> Picture:
    """RMS of every cell, a bar each variant."""
    figure = go.Figure()
    for name, colour in zip(dict.fromkeys(r["variant"] for r in rows), COLOURS, strict=False):
        chosen = [r for r in rows if r["variant"] == name]
        figure.add_trace(
            go.Bar(
                x=[f"{JOINT_WORDS[r['load']]}, {r['supply_v']:g} V" for r in chosen],
                y=[r["rms_nm"] for r in chosen],
                name=name,
                marker={"color": colour},
            )
        )
    figure.update_yaxes(title="AC RMS of the reaction in N m")
    return Picture(
        "Vibration from the motor to the housing", style(figure, 520), "6 to 1,250 Hz, from the pull of the trigger to the same work done"
    )


def vibration_study(rows: Sequence[Figures]) -> Study:
    """The whole part."""
    chosen = present(rows)
    found = [{"set": half, **vibration.compare(part, name)} for name in methods(rows) for half, part in by_half(chosen)]
    listed = goals([f for f in found if f["variant"] != vibration.BOUND])
    lines = [*([met_line(listed)] if listed else []), *absent_lines(rows, "low vibration")]
    tables = [
        table_of("vibration_summary", "Low vibration", SUMMARY, found),
        goals_table("vibration", listed),
        table_of("vibration_cells", "Housing reaction, every cell", CELLS, chosen),
    ]
    data = {"vibration": {"summary": found, "goals": [g.as_dict() for g in listed], "cells": list(rows)}}
    return Study("control", "Controllers", lines, [t for t in tables if t.rows], [cell_picture(chosen)], data)
