"""Tables and figures of the synchronisation matrix."""

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from vgroove.control_bench import sync
from vgroove.control_bench.goals import Goal, goals_of, goals_table, part_lines, part_report
from vgroove.control_bench.jobs import PLAIN, Figures, present
from vgroove.control_bench.runs import pull, reference
from vgroove.control_bench.sets import by_half
from vgroove.control_bench.waves import Drive, Panel, Wave, wave_picture
from vgroove.html_page import Picture, Table, style, table_from_dicts
from vgroove.result_files import Report
from vgroove.units import RPM_PER_RAD_S

SUMMARY = [
    ("variant", "variant"),
    ("set", "set"),
    ("cells", "cells"),
    ("clean without control", "clean_before"),
    ("clean with control", "clean"),
    ("unclean with / without", "unclean_ratio"),
    ("poor cells", "poor_cells"),
    ("gain in poor cells", "poor_gain"),
    ("cells worse", "worse_cells"),
    ("worst change", "worst_change"),
    ("period spread, mean", "spread"),
    ("spread, largest", "spread_most"),
    ("work per second with / without", "work_ratio"),
]

UNCLEAN = [
    ("tool drawn", "tool"),
    ("variant", "variant"),
    ("V", "supply_v"),
    ("load", "load"),
    ("trigger", "trigger"),
    ("clean", "clean"),
    ("mean duty", "duty"),
    ("best of any constant duty", "best_clean"),
    ("at duty", "best_duty"),
    ("reason", "reason"),
]


METHOD_TITLES = {
    PLAIN.name: "without control",
    "method 1": "method 1, motor speed",
    "method 2": "method 2, motor current",
}


def methods(rows: Sequence[Figures]) -> list[str]:
    """Names of the controllers that the firmware has."""
    return [
        name for name in dict.fromkeys(r["variant"] for r in present(rows)) if name != PLAIN.name
    ]


def summaries(rows: Sequence[Figures]) -> list[Figures]:
    """Each method on each half and on all cells."""
    return [
        {"set": half, **sync.compare(chosen, name)}
        for name in methods(rows)
        for half, chosen in by_half(present(rows))
    ]


def goals(found: Sequence[Figures]) -> list[Goal]:
    """The goals of sync.GOALS for each summary."""
    limits, listed = sync.GOALS, []
    for f in found:
        gain = ("gain where clean was below 0.83", f["poor_gain"], limits["poor_gain"], False)
        listed += goals_of(
            f["variant"],
            f["set"],
            ("unclean with / without", f["unclean_ratio"], limits["unclean_ratio"]),
            ("clean, mean", f["clean"], limits["clean"], False),
            gain,
            ("cells worse than without", f["worse_cells"], 0),
            ("period spread, mean", f["spread"], limits["spread"]),
            ("work per second with / without", f["work_ratio"], 1.0, False),
        )
    return listed


def cell_table(rows: Sequence[Figures]) -> Table:
    """Every cell under every variant."""
    chosen = present(rows)
    names = list(dict.fromkeys(r["variant"] for r in chosen))
    cells: dict[tuple, dict[str, Figures]] = {}
    for r in chosen:
        cells.setdefault((r["set"], *sync.cell_key(r)), {})[r["variant"]] = r
    header = ["set", "V", "load", "trigger"]
    for name in names:
        header += [f"clean, {name}", "blows/min", "spread", "work in W"]
    body = []
    for (half, supply_v, load, trigger), found in cells.items():
        figures = [
            found[name].get(key) if name in found else None
            for name in names
            for key in ("clean", "blows_per_min", "spread", "work_w")
        ]
        body.append([half, supply_v, sync.MATRIX_JOINTS[load].title, trigger, *figures])
    return Table("sync_cells", "Clean share of blows, every cell", header, body)


def clean_picture(rows: Sequence[Figures]) -> Picture:
    """Clean share over the matrix, one panel for each variant."""
    chosen = present(rows)
    names = list(dict.fromkeys(r["variant"] for r in chosen))
    columns = [(v, t) for v in sync.SUPPLIES_V for t in sync.TRIGGERS]
    figure = make_subplots(
        rows=len(names), cols=1, shared_xaxes=True, vertical_spacing=0.08, subplot_titles=names
    )
    for n, name in enumerate(names):
        share = np.full((len(sync.LOADS), len(columns)), np.nan)
        for r in chosen:
            if r["variant"] == name:
                share[sync.LOADS.index(r["load"]), columns.index((r["supply_v"], r["trigger"]))] = (
                    r["clean"]
                )
        cells = go.Heatmap(
            z=share,
            x=[f"{v:g} V, {t:g}" for v, t in columns],
            y=[joint.title for joint in sync.MATRIX_JOINTS.values()],
            zmin=0,
            zmax=1,
            colorscale="RdYlGn",
            showscale=n == 0,
            texttemplate="%{z:.2f}",
        )
        figure.add_trace(cells, row=n + 1, col=1)
    return Picture(
        "Clean share of blows",
        style(figure, 130 + 250 * len(names)),
        "supply and trigger across, joints down; 1 is all clean",
    )


def wave() -> Wave:
    """Motor speed and hammer displacement in a cell that is out of step without control."""
    rig = reference("slip_60", supply_v=17.5)
    drives = [
        Drive(METHOD_TITLES[v.name], rig, v, pull(0.8), from_s=1.0, to_s=1.25)
        for v in sync.VARIANTS
    ]
    panels = (
        Panel("speed_rad_s", "motor speed in rpm", RPM_PER_RAD_S),
        Panel("hammer_mm", "hammer displacement in mm; ticks: blows, repeats orange", blows=True),
    )
    return Wave(
        "sync",
        "Motor speed and hammer displacement",
        "joint slips at 60 N m, 17.5 V, trigger 0.8",
        drives,
        panels,
    )


def unclean_line(unclean: Sequence[Figures]) -> str:
    """A sentence: how many runs are not clean under control, of which tools."""
    own = sum(r.get("tool") is None for r in unclean)
    limit, off = sync.GOALS["clean"], f"{sync.TOLERANCE:.0%}"
    counted = f"{own} runs of the reference tool, {len(unclean) - own} of tools off by up to {off}"
    return (
        f"Clean share below {limit:g} under control: {counted}; a table gives the reason of each."
    )


def sync_report(
    rows: Sequence[Figures], others: Sequence[Figures] = (), unclean: Sequence[Figures] = ()
) -> Report:
    """The part `sync` as a report."""
    found, drawn = summaries(rows), summaries(others) if others else []
    listed = goals(found)
    before = [r["clean"] for r in rows if r["variant"] == PLAIN.name]
    lines = [
        f"Synchronisation: without control {np.mean(before):.3f} of the blows are clean over "
        f"{len(before)} cells.",
        unclean_line(unclean),
        *part_lines(listed, rows, "synchronisation"),
    ]
    tables = [
        table_from_dicts("sync_summary", "Synchronisation", SUMMARY, found),
        goals_table("sync", listed),
        cell_table(rows),
    ]
    tables += [
        table_from_dicts(
            "sync_tools",
            f"Tools whose parameters are off by up to {sync.TOLERANCE:.0%}, one draw a cell",
            SUMMARY,
            drawn,
        ),
        table_from_dicts(
            "sync_unclean", "Cells that are not clean under control, and why", UNCLEAN, unclean
        ),
    ]
    pictures = [clean_picture(rows), wave_picture(wave())]
    cells = {"cells": list(rows), "tools": drawn, "unclean": list(unclean)}
    data = {"sync": {"summary": found, "goals": [g.as_dict() for g in listed], **cells}}
    return part_report(lines, tables, pictures, data)
