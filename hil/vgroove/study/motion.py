"""Torque, current and hammer motion over time at two duties, for `vgroove study load`."""

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from vgroove.html_page import Picture, Table, style, thin
from vgroove.rig import Rig
from vgroove.study.impact_runs import simulate, with_joint

SAMPLE_S = 2e-5
PANELS = (
    ("torque_nm", "torque in N m", "#30343b"),
    ("current_a", "current in A", "#d1495b"),
    ("hammer_mm", "hammer in mm", "#edae49"),
)


def motion(rig: Rig, load: str, duty: float, duration_s: float) -> dict[str, np.ndarray]:
    """Torque, current, hammer displacement and head angle over time, (n,) each, at one duty."""
    time_s = np.arange(SAMPLE_S, duration_s, SAMPLE_S)
    trace = simulate([with_joint(rig, load)], duration_s, duty, trace_s=time_s)["trace"]
    return {
        "time_s": time_s,
        "torque_nm": trace["anvil_torque_nm"],
        "current_a": trace["current_a"],
        "hammer_mm": 1e3 * trace["hammer_m"],
        "head_deg": np.degrees(trace["head_rad"]),
    }


def motion_row(duty: float, m: dict[str, np.ndarray]) -> dict[str, float]:
    """Figures of one duty: the torque over the whole run, current and hammer over its second
    half.
    """
    late = m["time_s"] > 0.5 * m["time_s"][-1]
    return {
        "duty": duty,
        "torque_peak_nm": float(m["torque_nm"].max()),
        "current_mean_a": float(m["current_a"][late].mean()),
        "hammer_max_mm": float(m["hammer_mm"][late].max()),
        "head_end_deg": float(m["head_deg"][-1]),
    }


def motion_table(rows: list[dict[str, float]]) -> Table:
    """The figures of motion_row at every duty."""
    return Table(
        "motion",
        "Hard joint at 50 and 100 % duty",
        [
            "duty in %",
            "largest torque in N m",
            "mean current in A",
            "largest hammer displacement in mm",
            "head turned in deg",
        ],
        [[100 * duty, *others] for duty, *others in (r.values() for r in rows)],
    )


def motion_picture(motions: dict[float, dict[str, np.ndarray]]) -> Picture:
    """Torque, current and hammer displacement over time, a column for each duty."""
    figure = make_subplots(
        rows=len(PANELS),
        cols=len(motions),
        shared_xaxes=True,
        shared_yaxes=True,
        vertical_spacing=0.04,
        horizontal_spacing=0.04,
        column_titles=[f"{100 * duty:g} % duty" for duty in motions],
    )
    for col, m in enumerate(motions.values(), 1):
        for row, (key, title, colour) in enumerate(PANELS, 1):
            x, y = thin(m["time_s"], m[key])
            figure.add_trace(
                go.Scatter(
                    x=x,
                    y=y,
                    name=title,
                    showlegend=False,
                    line={"color": colour, "width": 1},
                ),
                row=row,
                col=col,
            )
            figure.update_yaxes(title_text=title if col == 1 else "", row=row, col=col)
        figure.update_xaxes(title_text="time in s", row=len(PANELS), col=col)
    return Picture(
        "Torque, current and hammer motion over time",
        style(figure, 760),
        "Hard joint of 700 N m/rad, from rest.",
    )
