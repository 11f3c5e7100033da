"""Tables and figures of the drill driver."""

from collections.abc import Sequence

import plotly.graph_objects as go

from vgroove.control_bench import drill
from vgroove.control_bench.goals import Goal, goals_table, met_line, table_of
from vgroove.control_bench.jobs import Figures, absent_lines, present
from vgroove.control_bench.sets import by_half
from vgroove.study.report import Picture, Study, style

CLUTCH = [
    ("set", "set"),
    ("gear", "gear"),
    ("setting in N m", "clutch_nm"),
    ("runs", "runs"),
    ("stopped by it", "stopped"),
    ("mean in N m", "mean_nm"),
    ("spread, 1 sigma", "spread"),
]
LOCKS = [
    ("set", "set"),
    ("gear", "gear"),
    ("locks", "locks"),
    ("bridge opened", "opened"),
    ("median in ms", "median_ms"),
    ("most in ms", "most_ms"),
    ("for good, most in ms", "good_ms"),
    ("by the over-current trip instead", "tripped"),
]
COLOURS = {"low": "#00798c", "high": "#d1495b"}


def goals(rows: Sequence[Figures], half: str) -> list[Goal]:
    """Issue 5's, on some rows."""
    name, listed = drill.CONTROLLER.name, []
    clutch, locks = drill.clutch_rows(rows), drill.lock_rows(rows)
    normal = [r for r in rows if r["kind"] == drill.SOUND]
    if clutch:
        spreads = [c["spread"] for c in clutch]
        listed += [
            Goal(name, half, "clutch, spread of the worst setting", None if None in spreads else max(spreads), drill.GOALS["clutch"]),
            Goal(name, half, "clutch, runs not stopped by it", sum(c["runs"] - c["stopped"] for c in clutch), 0),
        ]
    if locks:
        missed = sum(g["locks"] - g["opened"] for g in locks)
        listed += [
            Goal(name, half, "locks that the bridge did not open on", missed, 0),
            Goal(name, half, "lock to open bridge in ms, most", max((g["most_ms"] or 1e3) for g in locks), drill.GOALS["open_ms"]),
        ]
    if normal:
        listed += [
            Goal(name, half, f"stopped among {len(normal)} normal runs", sum(r["reason"] not in ("none", "unknown") for r in normal), 0)
        ]
    return listed


def open_picture(rows: Sequence[Figures]) -> Picture:
    """Time to the open bridge over the trigger."""
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
    return Picture("Anti-kickback", style(figure, 460), "from the begin of a lock that builds up in 5 ms")


def drill_study(rows: Sequence[Figures]) -> Study:
    """The whole part."""
    chosen = present(rows)
    halves = by_half(chosen)
    listed = [goal for half, part in halves for goal in goals(part, half)]
    clutch = [{"set": half, **row} for half, part in halves for row in drill.clutch_rows(part)]
    locks = [{"set": half, **row} for half, part in halves for row in drill.lock_rows(part)]
    lines = [*([met_line(listed)] if listed else []), *absent_lines(rows, "drill driver")]
    tables = [
        goals_table("drill", listed),
        table_of("drill_clutch", "Electronic clutch, 16 to 20.5 V", CLUTCH, clutch),
        table_of("drill_locks", "Anti-kickback", LOCKS, locks),
    ]
    data = {"drill": {"goals": [g.as_dict() for g in listed], "clutch": clutch, "locks": locks, "runs": list(rows)}}
    return Study("control", "Controllers", lines, [t for t in tables if t.rows], [open_picture(chosen)] if chosen else [], data)
