"""Tables and figures of precise screwing."""

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go

from vgroove.control_bench import screwing
from vgroove.control_bench.goals import Goal, goals_of, goals_table, part_lines, part_report
from vgroove.control_bench.jobs import PLAIN, Figures, present
from vgroove.control_bench.runs import passing_s, pull
from vgroove.control_bench.screwing import DriveEnd
from vgroove.control_bench.sets import by_half
from vgroove.control_bench.sync_page import methods
from vgroove.control_bench.waves import Drive, Line, Panel, Wave, wave_picture
from vgroove.html_page import Picture, style, table_from_dicts
from vgroove.reference.joints import REFERENCE_JOINTS
from vgroove.result_files import Report

SUMMARY = [
    ("variant", "variant"),
    ("set", "set"),
    ("screw", "size"),
    ("screws", "screws"),
    ("past the seat in deg, median", "past_deg_median"),
    ("past the seat in deg, largest", "past_deg_most"),
    ("limit in deg, median", "limit_deg_median"),
    ("stripped", "stripped"),
    ("stopped before the seat", "early"),
    ("not seated within the time", "never"),
    ("time to seat in s", "seat_s_median"),
    ("impact rate change, small and soft", "rate_change_soft"),
    ("time with / without, mean", "time_ratio"),
    ("time with / without, largest", "time_ratio_most"),
]
COLOURS = ("#30343b", "#d1495b")


def summaries(rows: Sequence[Figures]) -> list[Figures]:
    """Each variant by screw size and over all sizes, on each half and on all cells."""
    chosen = present(rows)
    found = []
    for name in (PLAIN.name, *methods(rows)):
        for half, part in by_half(chosen):
            found += [
                {"set": half, **screwing.compare(part, name, size)}
                for size in (*screwing.SIZES, None)
            ]
    return [f for f in found if f["screws"]]


def goals(found: Sequence[Figures]) -> list[Goal]:
    """The goals of screwing.GOALS over all screw sizes, on each half and on all cells."""
    limits, listed = screwing.GOALS, []
    for f in found:
        if f["variant"] == PLAIN.name or f["size"] != "all":
            continue
        past = f["past_deg_median"], f["limit_deg_median"]
        listed += goals_of(
            f["variant"],
            f["set"],
            ("impact rate change, small and soft", f["rate_change_soft"], limits["rate"]),
            ("turn past the seat in deg, median", *past),
            ("screws past the end of the ramp", f["stripped"], 0),
            ("share stopped before the seat", f["early"] / f["screws"], limits["early"]),
            ("screws not seated within the time", f["never"], 0),
            ("time to seat with / without, mean", f["time_ratio"], limits["time"]),
        )
    return listed


def past_picture(rows: Sequence[Figures]) -> Picture:
    """Turn past the seat of every screw, a box for each size and trigger."""
    figure = go.Figure()
    for name, colour in zip(dict.fromkeys(r["variant"] for r in rows), COLOURS, strict=False):
        chosen = [r for r in rows if r["variant"] == name and r["past_deg"] > -360.0]
        figure.add_trace(
            go.Box(
                x=[
                    f"{REFERENCE_JOINTS[r['size']].short}, trigger {r['trigger']:g}" for r in chosen
                ],
                y=[r["past_deg"] for r in chosen],
                name=name,
                marker={"color": colour},
                boxpoints="all",
                pointpos=0,
                jitter=0.4,
            )
        )
    figure.add_hline(
        y=90.0, line={"dash": "dash", "color": "#888"}, annotation_text="the ramp ends: stripped"
    )
    figure.add_hline(y=0.0, line={"color": "#888"})
    figure.update_layout(boxmode="group")
    figure.update_yaxes(title="turn past the seat in deg", range=[-120, 300])
    return Picture(
        "Angle of the screw at the end",
        style(figure, 560),
        "0 is the head's contact; below it the drive stopped early; screws beyond 300 deg have "
        "turned on without resistance",
    )


def wave() -> Wave:
    """Turns of the screw, torque and motor current up to the seat and beyond, without control and
    with it.
    """
    rig = screwing.screw("m6", 18.5, 1.0, False, 6)
    plain = screwing.plain_run(rig, 0.8, 6)
    seated_s = passing_s(plain, plain.seat_rad)
    released = pull(0.8, release_s=seated_s + screwing.RELEASE_S)
    drives = [
        Drive(
            "without control: released 0.2 s behind the seat",
            rig,
            PLAIN,
            released,
            to_s=seated_s + 0.5,
            every=31,
        ),
        Drive(
            "precise screwing",
            rig,
            screwing.VARIANTS[1],
            pull(0.8),
            to_s=screwing.MAX_SECONDS,
            every=31,
            stop_when=DriveEnd(1e9),
        ),
    ]
    turns = 0.5 / np.pi
    ends = (
        Line(turns * plain.seat_rad, "head contact", below=True),
        Line(turns * screwing.ramp_end_rad(rig), "ramp ends: stripped"),
    )
    panels = (
        Panel("head_rad", "screw in turns", turns, lines=ends),
        Panel("joint_nm", "torque on the screw in N m"),
        Panel("current_a", "motor current in A"),
    )
    return Wave("screwing", "A screw to its seat", "M6, 18.5 V, trigger 0.8", drives, panels)


def screwing_report(rows: Sequence[Figures]) -> Report:
    """The part `screwing` as a report."""
    found = summaries(rows)
    listed = goals(found)

    tables = [
        table_from_dicts("screwing_summary", "Precise screwing", SUMMARY, found),
        goals_table("screwing", listed),
    ]
    data = {
        "screwing": {"summary": found, "goals": [g.as_dict() for g in listed], "cells": list(rows)}
    }
    lines = part_lines(listed, rows, "precise screwing")
    pictures = [past_picture(present(rows)), wave_picture(wave())]
    return part_report(lines, tables, pictures, data)
