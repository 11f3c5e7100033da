"""Tables and figures of the blow detection."""

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go

from vgroove.control_bench import blows
from vgroove.control_bench.goals import Goal, goals_table, met_line, table_of
from vgroove.control_bench.jobs import PLAIN, Figures, absent_lines, present
from vgroove.control_bench.runs import Run, pull, reference
from vgroove.control_bench.sets import by_half
from vgroove.control_bench.sync import LOAD_WORDS, LOADS
from vgroove.control_bench.waves import Drive, Panel, Wave, wave_picture
from vgroove.page import Picture, style
from vgroove.study.report import Study

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
    ("cells told right", "repeat_cells"),
    ("cells", "cells"),
    ("error of the period", "period_error"),
    ("spread in step", "spread"),
    ("spread told", "spread_told"),
]
REPEAT_CELLS = [
    ("variant", "variant"),
    ("set", "set"),
    ("V", "supply_v"),
    ("load", "load"),
    ("trigger", "trigger"),
    ("blows", "blows"),
    ("repeats", "repeats"),
    ("told", "repeats_told"),
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
    """Error of the count over the true rate, a colour each load, a symbol each source."""
    figure = go.Figure()
    for load, colour in zip(LOADS, COLOURS, strict=True):
        for variant, symbol in zip(blows.VARIANTS, ("circle", "x"), strict=True):
            chosen = [
                r for r in rows if (r["load"], r["variant"]) == (load, variant.name) and r["blows"]
            ]
            error = [100.0 * r["error"] / r["blows"] for r in chosen]
            rate = [r["blows_per_min"] for r in chosen]
            name = f"{LOAD_WORDS[load]}, {variant.name}"
            figure.add_trace(
                go.Scatter(
                    x=rate,
                    y=error,
                    mode="markers",
                    name=name,
                    marker={"color": colour, "symbol": symbol},
                )
            )
    figure.update_xaxes(title="blows per minute")
    figure.update_yaxes(title="error of the count in %")
    return Picture(
        "Blow detection",
        style(figure, 480),
        "every supply, load and trigger; a drive of 2.5 s each, its start included",
    )


def hall_rpm(run: Run) -> np.ndarray:
    """Speed that the board tells, at the times of the truth."""
    return np.interp(run.truth["time_s"], run.telemetry["time_s"], run.telemetry["speed_rpm"])


def counted(run: Run) -> np.ndarray:
    """Blows that the board counts less those that struck, at the times of the truth."""
    struck = run.hits["time_s"][run.hits["kind"] == 0]
    told = np.searchsorted(run.control["time_s"], run.truth["time_s"], side="right") - 1
    count = np.where(told >= 0, run.control["blow_count"][np.maximum(told, 0)], 0.0)
    return count - np.searchsorted(struck, run.truth["time_s"], side="right")


def wave() -> Wave:
    """The speed that the board sees, the hammer that makes it so, and the count, in step and out of
    it.
    """
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


def blows_study(rows: Sequence[Figures]) -> Study:
    """The whole part."""
    chosen = present(rows)
    names = dict.fromkeys(r["variant"] for r in chosen)
    halves = [
        (name, *part)
        for name in names
        for part in by_half([r for r in chosen if r["variant"] == name])
    ]
    found = [{"variant": name, "set": half, **blows.summary(part)} for name, half, part in halves]
    listed = [
        Goal(
            f["variant"],
            f["set"],
            "cells off by more than 1 % and a blow",
            f["cells"] - f["cells_within"],
            0,
        )
        for f in found
    ]
    listed += [
        Goal(f["variant"], f["set"], "miscounted share of all blows", f["error_of_all"], blows.GOAL)
        for f in found
    ]
    for words, key in (
        ("repeats told, precision", "precision"),
        ("repeats told, recall", "recall"),
    ):
        listed += [
            Goal(f["variant"], f["set"], words, f[key], blows.REPEAT_GOALS[key], at_most=False)
            for f in found
        ]
    listed += [
        Goal(
            f["variant"],
            f["set"],
            "error of the running period, mean",
            f["period_error"],
            blows.GOAL,
        )
        for f in found
    ]
    lines = [*([met_line(listed)] if listed else []), *absent_lines(rows, "blow detection")]
    tables = [
        table_of("blows_summary", "Blow detection", SUMMARY, found),
        goals_table("blows", listed),
        table_of("blows_repeats", "Repeats told from blows, period and spread", REPEATS, found),
        table_of(
            "blows_repeat_cells",
            "Repeats of every cell that has them, or where some are told",
            REPEAT_CELLS,
            [
                r
                for r in blows.in_range(chosen)
                if max(r["repeats"], r["repeats_told"]) > blows.FEW_REPEATS
            ],
        ),
        table_of(
            "blows_cells",
            "Count of every cell that is off by more than a blow",
            CELLS,
            [r for r in chosen if abs(r["error"]) > 1],
        ),
    ]
    pictures = [error_picture(chosen), wave_picture(wave())] if chosen else []
    data = {
        "blows": {"summary": found, "goals": [g.as_dict() for g in listed], "cells": list(rows)}
    }
    return Study("control", "Controllers", lines, [t for t in tables if t.rows], pictures, data)
