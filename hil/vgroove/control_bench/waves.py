"""Waveforms of drives with and without control, a column a drive, a row a quantity: on the bench's
page and as a figure.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from vgroove.control_bench.jobs import Variant
from vgroove.control_bench.runs import PULL_S, AbsentError, Run, pull, sil_run
from vgroove.lockstep import Profile
from vgroove.page import Picture, style, thin
from vgroove.rig import Rig

PLAIN_COLOUR, CONTROLLED_COLOURS = "#30343b", ("#c1394f", "#00798c", "#7a5195")
BLOW_COLOUR, REPEAT_COLOUR = "#444444", "#e07b00"
REFERENCE = {"dash": "dash", "color": "#666666", "width": 1}
# CSS pixels; share of it between panels; share of a panel's range free above its curves
PANEL_HEIGHT, GAP, AIR = 175, 0.19, 0.08
POINTS = 420  # of a curve, at most about
Quantity = Callable[[Run], np.ndarray]


@dataclass(frozen=True)
class Line:
    """A level across a panel, and what it is called."""

    value: float
    words: str
    below: bool = False  # stand the words


@dataclass(frozen=True)
class Panel:
    """A quantity: a column of the truth or what a run makes of it, how it is called, and what it is
    multiplied by.
    """

    column: str | Quantity
    words: str
    scale: float = 1.0
    blows: bool = False  # are marked
    lines: tuple[Line, ...] = ()

    def of(self, run: Run) -> np.ndarray:
        """(n,), a value each row of the truth."""
        return self.scale * (
            run.truth[self.column] if isinstance(self.column, str) else self.column(run)
        )


@dataclass(frozen=True)
class Drive:
    """A drive and the stretch of it that is drawn: what it is called, tool, variant, profile."""

    words: str
    rig: Rig
    variant: Variant
    profile: Profile = field(default_factory=pull)
    from_s: float = 0.25
    to_s: float = 1.0
    seed: int = 3
    every: int = 4
    stop_when: Callable[[Any, Any], bool] | None = None
    event: tuple[float, str] | None = None  # what happens at a time


@dataclass(frozen=True)
class Wave:
    """The drives of a controller side by side; times are shown from the trigger's pull on."""

    name: str
    title: str
    note: str
    drives: Sequence[Drive]
    panels: Sequence[Panel]


def run_of(drive: Drive) -> Run | None:
    """The drive; None where the firmware does not have its controller."""
    options = {
        "profile": drive.profile,
        "duration_s": drive.to_s,
        "seed": drive.seed,
        "truth_every": drive.every,
    }
    try:
        return sil_run(
            drive.rig,
            mode=drive.variant.mode,
            params=drive.variant.params,
            stop_when=drive.stop_when,
            **options,
        )
    except AbsentError:
        return None


def runs_of(wave: Wave) -> list[tuple[Drive, str, Run]]:
    """Drives that there are, the colour of each, and their runs."""
    found, controlled = [], 0
    for drive in wave.drives:
        run = run_of(drive)
        colour = (
            PLAIN_COLOUR
            if drive.variant.mode == "duty"
            else CONTROLLED_COLOURS[controlled % len(CONTROLLED_COLOURS)]
        )
        controlled += drive.variant.mode != "duty"
        found += [(drive, colour, run)] if run else []
    return found


def wave_picture(wave: Wave) -> Picture:
    """For the bench's page, and for a page of docs/controllers as a figure that prints."""
    found = runs_of(wave)
    headings = [drive.words for drive, _, _ in found]
    spaces = {
        "vertical_spacing": GAP / len(wave.panels),
        "horizontal_spacing": 0.03,
        "shared_xaxes": "columns",
        "shared_yaxes": "rows",
    }
    figure = make_subplots(len(wave.panels), len(found), column_titles=headings, **spaces)
    for c, (drive, colour, run) in enumerate(found):
        add_drive(figure, drive, colour, run, wave.panels, c + 1)
        figure.update_xaxes(title="s from the trigger's pull", row=len(wave.panels), col=c + 1)
    for r, panel in enumerate(wave.panels):
        values = [v for drive, _, run in found for v in stretch(drive, run, panel)[1]] + [
            line.value for line in panel.lines
        ]
        least, greatest = range_of(values)
        figure.update_yaxes(range=[least, greatest], row=r + 1)
        figure.add_annotation(
            text=panel.words,
            row=r + 1,
            col=1,
            xref="x domain",
            yref="y domain",
            x=0.0,
            y=1.0,
            yanchor="bottom",
            xanchor="left",
            showarrow=False,
        )
        for c, (drive, _, run) in enumerate(found):
            add_marks(
                figure, drive, run, panel, greatest - 0.4 * AIR * (greatest - least), (r + 1, c + 1)
            )
    figure.update_annotations(font_size=14)
    figure.for_each_annotation(
        lambda note: note.update(yshift=24) if note.text in headings else None
    )
    return Picture(
        wave.title,
        style(figure, 130 + PANEL_HEIGHT * len(wave.panels)).update_layout(margin_t=70),
        wave.note,
    )


def stretch(drive: Drive, run: Run, panel: Panel) -> list[np.ndarray]:
    """Time and quantity of the stretch that is drawn, thinned so that peaks stay."""
    shown = run.truth["time_s"] > drive.from_s
    return thin(run.truth["time_s"][shown] - PULL_S, panel.of(run)[shown], points=POINTS)


def range_of(values: Iterable[float]) -> tuple[float, float]:
    """Least and greatest with some air; 0 where it is near."""
    least, greatest = float(np.nanmin(list(values))), float(np.nanmax(list(values)))
    span = max(greatest - least, 1e-6 * max(abs(greatest), 1.0))
    return (0.0 if 0.0 <= least < 0.4 * span else least - AIR * span), greatest + AIR * span


def add_drive(
    figure: go.Figure, drive: Drive, colour: str, run: Run, panels: Sequence[Panel], column: int
) -> None:
    """The curves and levels of one drive, and its event."""
    for row, panel in enumerate(panels, 1):
        time, value = (np.round(part, 5) for part in stretch(drive, run, panel))
        curve = go.Scatter(
            x=time, y=value, mode="lines", showlegend=False, line={"color": colour, "width": 1.5}
        )
        figure.add_trace(curve, row=row, col=column)
        for line in panel.lines:
            place = {
                "annotation_text": line.words,
                "annotation_position": "bottom left" if line.below else "top left",
            }
            figure.add_hline(line.value, row=row, col=column, line=REFERENCE, **place)
        if drive.event:
            words = (
                {"annotation_text": drive.event[1], "annotation_position": "top right"}
                if row == 1
                else {}
            )
            figure.add_vline(drive.event[0] - PULL_S, row=row, col=column, line=REFERENCE, **words)


def add_marks(
    figure: go.Figure, drive: Drive, run: Run, panel: Panel, top: float, place: tuple[int, int]
) -> None:
    """Blows and repeats as ticks at the panel's upper edge; a drill driver has none."""
    hits = run.hits if panel.blows and run.blows.dtype.names else []
    shown = [hit for hit in hits if drive.from_s < hit["time_s"] < drive.to_s]
    if shown:
        colours = [REPEAT_COLOUR if hit["kind"] == 1 else BLOW_COLOUR for hit in shown]
        marker = {"symbol": "line-ns-open", "size": 10, "color": colours, "line": {"width": 2}}
        ticks = go.Scatter(
            x=[round(hit["time_s"] - PULL_S, 5) for hit in shown],
            y=[top] * len(shown),
            mode="markers",
            marker=marker,
            showlegend=False,
            cliponaxis=False,
        )
        figure.add_trace(ticks, row=place[0], col=place[1])
