"""Tables and figures of the blow detection."""

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go

from vgroove.control_bench import blows
from vgroove.control_bench.goals import Goal, goals_of, goals_table, part_lines, part_report
from vgroove.control_bench.jobs import PLAIN, Figures, present
from vgroove.control_bench.runs import Run, pull, reference
from vgroove.control_bench.sets import by_half
from vgroove.control_bench.sync import MATRIX_JOINTS
from vgroove.control_bench.waves import Drive, Panel, Wave, wave_picture
from vgroove.html_page import Picture, Table, style, table_from_dicts
from vgroove.result_files import Report

SUMMARY = [
    ("variant", "variant"),
    ("set", "set"),
    ("cells", "cells"),
    ("blows", "blows"),
    ("miscounted share", "error_of_all"),
    ("cells within 1 % or a blow", "cells_within"),
    ("worst cell", "worst"),
    ("least rate", "rate_least"),
    ("highest rate", "rate_most"),
]
REPEATS = [
    ("variant", "variant"),
    ("set", "set"),
    ("repeats", "repeats"),
    ("precision", "precision"),
    ("recall", "recall"),
    ("cells within the goals", "repeat_cells"),
    ("cells", "cells"),
    ("error of the period", "period_error"),
    ("spread in step", "spread"),
    ("spread reported", "spread_reported"),
]
REPEAT_CELLS = [
    ("variant", "variant"),
    ("set", "set"),
    ("V", "supply_v"),
    ("load", "load"),
    ("trigger", "trigger"),
    ("blows", "blows"),
    ("repeats", "repeats"),
    ("reported", "repeats_reported"),
    ("right", "repeats_right"),
]
CELLS = [
    ("variant", "variant"),
    ("set", "set"),
    ("V", "supply_v"),
    ("load", "load"),
    ("trigger", "trigger"),
    ("blows/min", "blows_per_min"),
    ("blows", "blows"),
    ("repeats", "repeats"),
    ("counted", "counted"),
    ("error", "error"),
]
COLOURS = ("#30343b", "#d1495b", "#edae49", "#00798c", "#66a182", "#8d6cab")


def error_picture(rows: Sequence[Figures]) -> Picture:
    """Error of the count over the true rate, a colour for each joint, a symbol for each source."""
    figure = go.Figure()
    for (load, joint), colour in zip(MATRIX_JOINTS.items(), COLOURS, strict=True):
        for variant, symbol in zip(blows.VARIANTS, ("circle", "x"), strict=True):
            chosen = [
                r for r in rows if (r["load"], r["variant"]) == (load, variant.name) and r["blows"]
            ]
            error = [100.0 * r["error"] / r["blows"] for r in chosen]
            rate = [r["blows_per_min"] for r in chosen]
            points = {"x": rate, "y": error, "name": f"{joint.title}, {variant.name}"}
            marker = {"color": colour, "symbol": symbol}
            figure.add_trace(go.Scatter(**points, mode="markers", marker=marker))
    figure.update_xaxes(title="blows per minute")
    figure.update_yaxes(title="error of the count in %")
    return Picture(
        "Blow detection",
        style(figure, 480),
        "every supply, load and trigger; a drive of 2.5 s each, its start included",
    )


def hall_rpm(run: Run) -> np.ndarray:
    """Speed in rpm in the board's telemetry, at the times of the plant's states."""
    return np.interp(run.truth["time_s"], run.telemetry["time_s"], run.telemetry["speed_rpm"])


def counted(run: Run) -> np.ndarray:
    """Blows that the board counts minus blows of the plant, at the times of the plant's states."""
    time_s = run.truth["time_s"]
    last = np.searchsorted(run.control["time_s"], time_s, side="right") - 1
    count = np.where(last >= 0, run.control["blow_count"][np.maximum(last, 0)], 0.0)
    return count - np.searchsorted(run.struck_s, time_s, side="right")


def wave() -> Wave:
    """Measured speed, hammer displacement and error of the count, in step and out of step."""
    locked = reference("locked")
    drives = [
        Drive("18.5 V, full trigger: in step", locked, PLAIN, pull(1.0), from_s=0.9, to_s=1.2),
        Drive(
            "half trigger: each lug is hit twice", locked, PLAIN, pull(0.5), from_s=0.9, to_s=1.2
        ),
    ]
    panels = (
        Panel(hall_rpm, "Hall speed on the board in rpm"),
        Panel("hammer_mm", "hammer displacement in mm; ticks: blows, repeats orange", blows=True),
        Panel(counted, "blows counted less blows struck"),
    )
    return Wave(
        "blow", "Blow detection", "locked joint; ticks: blows black, repeats orange", drives, panels
    )


def summaries(rows: Sequence[Figures]) -> list[Figures]:
    """Each source on each half and on all cells."""
    names = dict.fromkeys(r["variant"] for r in rows)
    return [
        {"variant": name, "set": half, **blows.summary(part)}
        for name in names
        for half, part in by_half([r for r in rows if r["variant"] == name])
    ]


def goals(found: Sequence[Figures]) -> list[Goal]:
    """Goals of the count, the repeats and the period, each for all sources and halves."""
    precision, recall = blows.REPEAT_GOALS["precision"], blows.REPEAT_GOALS["recall"]
    listed = [
        goals_of(
            f["variant"],
            f["set"],
            ("cells off by more than 1 % and a blow", f["cells"] - f["cells_within"], 0),
            ("miscounted share of all blows", f["error_of_all"], blows.GOAL),
            ("repeats reported, precision", f["precision"], precision, False),
            ("repeats reported, recall", f["recall"], recall, False),
            ("error of the running period, mean", f["period_error"], blows.GOAL),
        )
        for f in found
    ]
    return [goal for same_figure in zip(*listed, strict=True) for goal in same_figure]


def cell_tables(rows: Sequence[Figures]) -> list[Table]:
    """Cells with repeats, and cells with a wrong count."""
    repeats = [
        r
        for r in blows.in_range(rows)
        if max(r["repeats"], r["repeats_reported"]) > blows.FEW_REPEATS
    ]
    wrong = [r for r in rows if abs(r["error"]) > 1]
    return [
        table_from_dicts(
            "blows_repeat_cells",
            "Repeats of every cell that has or reports some",
            REPEAT_CELLS,
            repeats,
        ),
        table_from_dicts(
            "blows_cells", "Count of every cell that is off by more than a blow", CELLS, wrong
        ),
    ]


def blows_report(rows: Sequence[Figures]) -> Report:
    """The part `blows` as a report."""
    chosen = present(rows)
    found = summaries(chosen)
    listed = goals(found)
    tables = [
        table_from_dicts("blows_summary", "Blow detection", SUMMARY, found),
        goals_table("blows", listed),
        table_from_dicts("blows_repeats", "Reported repeats, period and spread", REPEATS, found),
        *cell_tables(chosen),
    ]
    pictures = [error_picture(chosen), wave_picture(wave())] if chosen else []
    data = {
        "blows": {"summary": found, "goals": [g.as_dict() for g in listed], "cells": list(rows)}
    }
    return part_report(part_lines(listed, rows, "blow detection"), tables, pictures, data)
