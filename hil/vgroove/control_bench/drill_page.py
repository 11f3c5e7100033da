"""Tables and figures of the drill driver."""

from collections.abc import Sequence
from dataclasses import replace

import plotly.graph_objects as go

from vgroove.control_bench import drill
from vgroove.control_bench.goals import Goal, goals_of, goals_table, part_lines, part_report
from vgroove.control_bench.jobs import Figures, Variant, present
from vgroove.control_bench.runs import pull
from vgroove.control_bench.sets import by_half
from vgroove.control_bench.waves import Drive, Panel, Wave, wave_picture
from vgroove.html_page import Picture, style, table_from_dicts
from vgroove.lockstep import Profile
from vgroove.result_files import Report
from vgroove.units import RPM_PER_RAD_S

CLUTCH = [
    ("set", "set"),
    ("gear", "gear"),
    ("setting in N m", "clutch_nm"),
    ("runs", "runs"),
    ("stopped by the clutch", "stopped"),
    ("mean in N m", "mean_nm"),
    ("spread, 1 sigma", "spread"),
]
LOCKS = [
    ("set", "set"),
    ("gear", "gear"),
    ("locks", "locks"),
    ("of them in reverse", "reverse"),
    ("bridge opened", "opened"),
    ("median in ms", "median_ms"),
    ("largest in ms", "most_ms"),
    ("open for good, largest in ms", "good_ms"),
    ("stop reason not kickback", "tripped"),
]
COLOURS = {"low": "#00798c", "high": "#d1495b"}
NEVER_MS = 1e3  # of a gear in which no lock opened the bridge


def goals(rows: Sequence[Figures], half: str) -> list[Goal]:
    """The goals of drill.GOALS on the rows of one half."""
    figures: list[tuple] = []
    clutch, locks = drill.clutch_rows(rows), drill.lock_rows(rows)
    normal = [r for r in rows if r["kind"] == drill.NORMAL]
    if clutch:
        spreads = [c["spread"] for c in clutch]
        worst = None if None in spreads else max(spreads)
        other = sum(c["runs"] - c["stopped"] for c in clutch)
        figures += [
            ("clutch, spread of the worst setting", worst, drill.GOALS["clutch"]),
            ("clutch, runs not stopped by it", other, 0),
        ]
    if locks:
        missed = sum(g["locks"] - g["opened"] for g in locks)
        most_ms = max((g["good_ms"] or NEVER_MS) for g in locks)
        figures += [
            ("locks that the bridge did not open on", missed, 0),
            ("lock to the bridge open for good in ms, most", most_ms, drill.GOALS["open_ms"]),
        ]
    if normal:
        stopped = sum(r["reason"] not in ("none", "unknown") for r in normal)
        figures.append((f"stopped by the controller among {len(normal)} normal runs", stopped, 0))
    return goals_of(drill.CONTROLLER.name, half, *figures)


def open_picture(rows: Sequence[Figures]) -> Picture:
    """Time from the begin of a lock to the open bridge, over the trigger."""
    figure = go.Figure()
    for gear, colour in COLOURS.items():
        chosen = [r for r in rows if r["kind"] == "lock" and r["gear"] == gear]
        figure.add_trace(
            go.Scatter(
                x=[r["trigger"] for r in chosen],
                y=[r["open_ms"] for r in chosen],
                mode="markers",
                name=f"{gear} gear",
                marker={"color": colour},
            )
        )
    figure.add_hline(y=drill.GOALS["open_ms"], line={"dash": "dash", "color": "#888"})
    figure.update_xaxes(title="trigger")
    figure.update_yaxes(title="lock to open bridge in ms")
    return Picture(
        "Anti-kickback", style(figure, 460), "from the begin of a lock that builds up in 5 ms"
    )


def wave() -> Wave:
    """Chuck speed and motor current: pulse mode under load, a joint that the clutch stops, a
    jam.
    """
    rig, mode = drill.drill_rig("low", 18.0), drill.CONTROLLER.mode
    pulsed = Variant("pulse", mode, drill.drill_params("low", pulse=True))
    clutched = Variant("clutch", mode, drill.drill_params("low", 5.0))
    jammed = Variant("jam", mode, drill.drill_params("low"))
    jam = loaded((0.9, 2.0), (0.905, 1.5 * drill.stall_nm("low", 18.0)))
    step = loaded((0.9, 0.0), (0.95, 6.0), (1.5, 6.0), (1.55, 0.0))
    screw = drill.drill_rig("low", 18.0, drill.Screw(9.5, 5.0))
    drives = [
        Drive("pulse mode, 6 N m for 0.6 s", rig, pulsed, step, to_s=1.9),
        Drive("clutch at 5 N m, joint of 30 degrees", screw, clutched, to_s=1.3),
        Drive(
            "jam within 5 ms",
            rig,
            jammed,
            jam,
            from_s=0.88,
            to_s=0.95,
            every=1,
            event=(0.9, "jam begins"),
        ),
    ]
    rpm_per_rad_s = RPM_PER_RAD_S / drill.GEARS["low"].ratio
    panels = (
        Panel("speed_rad_s", "motor speed / gear ratio in rpm", rpm_per_rad_s),
        Panel("current_a", "motor current in A"),
        Panel("duty", "duty; a gap: the bridge is open"),
    )
    return Wave("drill", "Drill driver", "low gear, 18 V, full trigger", drives, panels)


def loaded(*points: tuple[float, float]) -> Profile:
    """The trigger is pulled; the load at the chuck follows points (s, N m), and before the first
    point has its value.
    """
    return replace(pull(), load_nm=((0.0, 0.0), (0.6, 0.0), (0.65, points[0][1]), *points))


def drill_report(rows: Sequence[Figures]) -> Report:
    """The part `drill` as a report."""
    chosen = present(rows)
    halves = by_half(chosen)
    listed = [goal for half, part in halves for goal in goals(part, half)]
    clutch = [{"set": half, **row} for half, part in halves for row in drill.clutch_rows(part)]
    locks = [{"set": half, **row} for half, part in halves for row in drill.lock_rows(part)]

    tables = [
        goals_table("drill", listed),
        table_from_dicts("drill_clutch", "Electronic clutch, 16 to 20.5 V", CLUTCH, clutch),
        table_from_dicts("drill_locks", "Anti-kickback", LOCKS, locks),
    ]
    pictures = [open_picture(chosen), wave_picture(wave())] if chosen else []
    data = {
        "drill": {
            "goals": [g.as_dict() for g in listed],
            "clutch": clutch,
            "locks": locks,
            "runs": list(rows),
        }
    }
    return part_report(part_lines(listed, rows, "drill driver"), tables, pictures, data)
