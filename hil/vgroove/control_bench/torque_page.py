"""Tables and figures of torque control."""

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go

from vgroove.control_bench import torque
from vgroove.control_bench.goals import Goal, goals_of, goals_table, part_lines, part_report
from vgroove.control_bench.jobs import PLAIN, Figures, Variant, present
from vgroove.control_bench.runs import Run
from vgroove.control_bench.sets import by_half
from vgroove.control_bench.waves import Drive, Line, Panel, Wave, wave_picture
from vgroove.html_page import Picture, Table, style, table_from_dicts
from vgroove.result_files import Report

SUMMARY = [
    ("variant", "variant"),
    ("set", "set"),
    ("cells in reach", "cells"),
    ("cells met", "cells_met"),
    ("std of a cell, RMS", "std_rms"),
    ("std of a cell, largest", "std_most"),
    ("mean error, largest", "mean_error_most"),
    ("refused or missed", "refused_or_missed"),
    ("tightening factor, torque alone", "alpha_torque"),
    ("tightening factor with bolt friction", "alpha"),
]
CELLS = [
    ("variant", "variant"),
    ("target in N m", "target_nm"),
    ("slope", "slope"),
    ("joint", "kind"),
    ("runs", "runs"),
    ("std", "std"),
    ("mean error", "mean_error"),
    ("least in N m", "least_nm"),
    ("largest in N m", "most_nm"),
    ("refused or missed", "refused_or_missed"),
]
WAVE_NM = 80.0
COLOURS = ("#888888", "#edae49", "#d1495b")


def map_table(maps: Sequence[Figures]) -> Table:
    """For each target and slope the blow that passes the target and its step in %."""
    rows = []
    for target in torque.TARGETS_NM:
        cells = {m["slope"]: m for m in maps if m["target_nm"] == target}
        rows.append([target, *(cell_text(cells[slope]) for slope in torque.SLOPES)])
    return Table(
        "torque_map",
        "Reachable targets: the blow that passes the target, and its step",
        ["target in N m", *(f"slope {s:g}" for s in torque.SLOPES)],
        rows,
    )


def cell_text(cell: Figures) -> str:
    """One cell of the table of reachable targets."""
    if cell["blow"] is None:
        return "out of reach"
    return f"blow {cell['blow']}: {100 * cell['step']:.1f} %" + (
        ", too fast" if cell["kind"] == "too fast" else ""
    )


def cell_rows(rows: Sequence[Figures], maps: Sequence[Figures]) -> list[Figures]:
    """The figures of every cell under every variant."""
    names = dict.fromkeys(r["variant"] for r in rows)
    found = [
        (m, torque.cell_figures(rows, m["target_nm"], m["slope"], name))
        for name in names
        for m in maps
    ]
    return [{**f, "kind": m["kind"]} for m, f in found if f]


def goals(found: Sequence[Figures]) -> list[Goal]:
    """The goals of torque.GOALS, for the controller."""
    limits, listed = torque.GOALS, []
    for f in found:
        if f["variant"] in (torque.FIXED_TIME, torque.FIXED_COUNT):
            continue
        listed += goals_of(
            f["variant"],
            f["set"],
            ("standard deviation, worst cell in reach", f["std_most"], limits["std"]),
            ("mean error, worst cell in reach", f["mean_error_most"], limits["mean"]),
            ("refused or missed although in reach", f["refused_or_missed"], 0),
        )
    return listed


def error_picture(cells: Sequence[Figures]) -> Picture:
    """Mean error and standard deviation of each cell in reach."""
    figure = go.Figure()
    for name, colour in zip(dict.fromkeys(c["variant"] for c in cells), COLOURS, strict=False):
        chosen = [
            c
            for c in cells
            if c["variant"] == name and c["std"] is not None and c["kind"] == "in reach"
        ]
        spread = {"type": "data", "array": [100.0 * c["std"] for c in chosen]}
        figure.add_trace(
            go.Scatter(
                x=[f"{c['target_nm']:g} N m, {c['slope']:g}" for c in chosen],
                y=[100.0 * c["mean_error"] for c in chosen],
                error_y=spread,
                mode="markers",
                name=name,
                marker={"color": colour, "size": 9},
            )
        )
    figure.add_hrect(y0=-3.0, y1=3.0, fillcolor="#66a182", opacity=0.15, line_width=0)
    figure.update_yaxes(title="error of the torque in %, mean +- 1 sigma")
    return Picture(
        "Torque control", style(figure, 520), "targets in reach; target and slope in N m/rad below"
    )


def held_nm(run: Run) -> np.ndarray:
    """Slip torque of the joint over time; by the largest head angle so far, since an elastic
    spring-back of the head does not loosen the joint.
    """
    return run.slip_nm(np.maximum.accumulate(run.truth["head_rad"]))


def wave() -> Wave:
    """Torque of the joint, motor current and duty over a tightening: without control, and to 80 N m
    on a soft and on a hard joint.
    """
    aimed = Variant("torque", "torque", {"torque_target_nm": WAVE_NM})
    soft, hard = torque.joint(60.0, 3), torque.joint(240.0, 3)
    end = torque.DriveEnd
    drives = [
        Drive("without control, 120 N m/rad", torque.joint(120.0, 3), PLAIN, to_s=1.5),
        Drive("to 80 N m, 60 N m/rad", soft, aimed, to_s=4.0, stop_when=end()),
        Drive("to 80 N m, 240 N m/rad", hard, aimed, to_s=6.0, stop_when=end()),
    ]
    panels = (
        Panel(held_nm, "torque that the joint holds in N m", lines=(Line(WAVE_NM, "target"),)),
        Panel("current_a", "motor current in A"),
        Panel("duty", "duty"),
    )
    return Wave(
        "torque",
        "Torque control over time",
        "friction, slope, supply and winding scattered",
        drives,
        panels,
    )


def torque_report(rows: Sequence[Figures], maps: Sequence[Figures]) -> Report:
    """The part `torque` as a report."""
    chosen = present(rows)
    names = dict.fromkeys(r["variant"] for r in chosen)
    found = [
        {"set": half, **torque.compare(part, maps, name)}
        for name in names
        for half, part in by_half(chosen)
    ]
    listed, cells = goals(found), cell_rows(chosen, maps)
    low, high = torque.PRACTICE_ALPHA
    lines = [
        *part_lines(listed, rows, "torque control"),
        f"Tightening factor of impact wrenches in practice: {low:g} to {high:g} (VDI 2230 part 1).",
    ]
    tables = [
        map_table(maps),
        table_from_dicts("torque_summary", "Torque control", SUMMARY, found),
        goals_table("torque", listed),
        table_from_dicts("torque_cells", "Torque reached, every cell", CELLS, cells),
    ]
    data = {
        "torque": {
            "map": list(maps),
            "summary": found,
            "goals": [g.as_dict() for g in listed],
            "cells": cells,
            "runs": list(rows),
        }
    }
    return part_report(lines, tables, [error_picture(cells), wave_picture(wave())], data)
