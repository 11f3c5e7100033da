"""Tables and figures of low vibration."""

from collections.abc import Sequence

import plotly.graph_objects as go

from vgroove.control_bench import vibration
from vgroove.control_bench.goals import Goal, goals_of, goals_table, part_lines, part_report
from vgroove.control_bench.jobs import PLAIN, Figures, present
from vgroove.control_bench.runs import PULL_S, reference
from vgroove.control_bench.sets import by_half
from vgroove.control_bench.sync_page import METHOD_TITLES, methods
from vgroove.control_bench.waves import Drive, Panel, Wave, wave_picture
from vgroove.html_page import Picture, style, table_from_dicts
from vgroove.reference.joints import REFERENCE_JOINTS
from vgroove.result_files import Report

SUMMARY = [
    ("variant", "variant"),
    ("set", "set"),
    ("cells", "cells"),
    ("not reached", "not_reached"),
    ("RMS change", "change"),
    ("worst cell", "worst"),
    ("ISO-weighted change", "weighted"),
    ("change while impacting", "impacting"),
    ("time change, mean", "time"),
    ("time change, most", "time_most"),
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
MARGIN = [
    ("variant", "variant"),
    ("disturbance", "disturbance"),
    ("RMS in N m", "rms_nm"),
    ("change", "change"),
    ("time in s", "time_s"),
]
COLOURS = ("#30343b", "#d1495b", "#00798c", "#edae49")


def goals(found: Sequence[Figures]) -> list[Goal]:
    """The goals of vibration.GOALS for each summary."""
    limits, listed = vibration.GOALS, []
    for f in found:
        listed += goals_of(
            f["variant"],
            f["set"],
            ("RMS change, mean", f["change"], limits["mean"]),
            ("RMS change, worst cell", f["worst"], limits["worst"]),
            ("time change, mean", f["time"], limits["time"]),
            ("cells that do not reach the aim", f["not_reached"], 0),
        )
    return listed


def cell_picture(rows: Sequence[Figures]) -> Picture:
    """RMS of every cell, a bar for each variant."""
    figure = go.Figure()
    for name, colour in zip(dict.fromkeys(r["variant"] for r in rows), COLOURS, strict=False):
        chosen = [r for r in rows if r["variant"] == name]
        figure.add_trace(
            go.Bar(
                x=[f"{REFERENCE_JOINTS[r['load']].title}, {r['supply_v']:g} V" for r in chosen],
                y=[r["rms_nm"] for r in chosen],
                name=name,
                marker={"color": colour},
            )
        )
    figure.update_yaxes(title="AC RMS of the reaction in N m")
    return Picture(
        "Vibration from the motor to the housing",
        style(figure, 520),
        "6 to 1,250 Hz, from the pull of the trigger to the same head angle for all variants",
    )


def wave() -> Wave:
    """Motor torque, housing reaction and hammer from the pull of the trigger on."""
    rig = reference("disc_spring", supply_v=18.5)
    drives = [
        Drive(METHOD_TITLES[v.name], rig, v, from_s=PULL_S - 0.01, to_s=PULL_S + 0.35)
        for v in vibration.VARIANTS
    ]
    panels = (
        Panel("current_a", "motor torque k i in N m", rig.value("motor.torque_constant_nm_per_a")),
        Panel("housing_nm", "reaction on the housing in N m"),
        Panel("hammer_mm", "hammer displacement in mm; ticks: blows", blows=True),
    )
    return Wave(
        "vibration",
        "Motor torque and reaction on the housing",
        "disc springs, 18.5 V, full trigger",
        drives,
        panels,
    )


def margin_rows(rows: Sequence[Figures]) -> list[Figures]:
    """RMS under each disturbance and method, relative to no control under the same disturbance."""
    plain = {r["disturbance"]: r["rms_nm"] for r in rows if r["variant"] == PLAIN.name}
    chosen = [r for r in rows if r["variant"] != PLAIN.name]
    changes = [
        None if r["rms_nm"] is None else r["rms_nm"] / plain[r["disturbance"]] - 1.0 for r in chosen
    ]
    return [{**r, "change": change} for r, change in zip(chosen, changes, strict=True)]


def margin_picture(rows: Sequence[Figures]) -> Picture:
    """Change of RMS under each disturbance."""
    figure = go.Figure()
    for name, colour in zip(dict.fromkeys(r["variant"] for r in rows), COLOURS[1:], strict=False):
        chosen = [r for r in rows if r["variant"] == name]
        change = [None if r["change"] is None else 100.0 * r["change"] for r in chosen]
        figure.add_trace(
            go.Bar(
                x=[r["disturbance"] for r in chosen], y=change, name=name, marker={"color": colour}
            )
        )
    figure.update_yaxes(title="change of the RMS in %")
    note = (
        f"over three blows, on disc springs at {vibration.MARGIN_V:g} V; against no control under "
        "the same disturbance"
    )
    return Picture(
        "Margin of the controllers: missed blows and a jump of the period", style(figure, 460), note
    )


def phase_picture(rows: Sequence[Figures]) -> Picture | None:
    """Change of the RMS over an error of the phase of the searched harmonic; None without a
    search.
    """
    found = [r for r in rows if r.get("margin")]
    if not found:
        return None
    points = [p for p in found[0]["margin"] if p["change"] is not None]
    figure = go.Figure()
    figure.add_trace(
        go.Scatter(
            x=[p["phase_error"] for p in points],
            y=[100.0 * p["change"] for p in points],
            mode="lines+markers",
        )
    )
    figure.update_xaxes(title="error of the phase in periods")
    figure.update_yaxes(title="change of the RMS in %")
    note = (
        f"full knowledge, {REFERENCE_JOINTS[found[0]['load']].title} at {found[0]['supply_v']:g} V"
    )
    return Picture("Margin of the phase", style(figure, 420), note)


def vibration_report(rows: Sequence[Figures], margin: Sequence[Figures] = ()) -> Report:
    """The part `vibration` as a report."""
    chosen = present(rows)
    found = [
        {"set": half, **vibration.compare(part, name)}
        for name in methods(rows)
        for half, part in by_half(chosen)
    ]
    listed = goals([f for f in found if f["variant"] != vibration.BOUND])
    margins = margin_rows(present(margin))
    tables = [
        table_from_dicts("vibration_summary", "Low vibration", SUMMARY, found),
        goals_table("vibration", listed),
        table_from_dicts("vibration_cells", "Housing reaction, every cell", CELLS, chosen),
        table_from_dicts("vibration_margin", "Margin: three blows disturbed", MARGIN, margins),
    ]
    pictures = [
        cell_picture(chosen),
        wave_picture(wave()),
        margin_picture(margins) if margins else None,
        phase_picture(chosen),
    ]
    data = {
        "vibration": {
            "summary": found,
            "goals": [g.as_dict() for g in listed],
            "cells": list(rows),
            "margin": margins,
        }
    }
    return part_report(part_lines(listed, rows, "low vibration"), tables, pictures, data)
