"""Waveforms of drives with and without control, one column a drive and one row a quantity, for the
bench's page and as figures of the controllers' pages.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from vgroove.control_bench.jobs import Variant
from vgroove.control_bench.runs import PULL_S, Run, RunPlan, pull, run_plan
from vgroove.eeprom_image import AbsentError
from vgroove.html_page import Picture, style, thin
from vgroove.lockstep import Profile
from vgroove.reference.blows import REPEAT
from vgroove.rig import Rig

PLAIN_COLOUR, CONTROLLED_COLOURS = "#30343b", ("#c1394f", "#00798c", "#7a5195")
BLOW_COLOUR, REPEAT_COLOUR = "#444444", "#e07b00"
LEVEL_LINE = {"dash": "dash", "color": "#666666", "width": 1}
PANEL_HEIGHT, TOP_HEIGHT = 175, 130  # CSS pixels, of a panel and of all above and below
GAP = 0.19  # between panels, of the figure's height
MARGIN_SHARE = 0.08  # of a panel's range: free above and below its curves
NEAR_ZERO = 0.4  # of a panel's range: a smallest value below it lets the axis begin at 0
POINTS = 420  # of a curve, about
Quantity = Callable[[Run], np.ndarray]


@dataclass(frozen=True)
class Line:
    """A level across a panel with its text, above or below the line."""

    value: float
    text: str
    below: bool = False


@dataclass(frozen=True)
class Panel:
    """A quantity: a column of the plant's states or a function of the run, its title, its factor,
    whether blows are marked, and levels.
    """

    column: str | Quantity
    title: str
    scale: float = 1.0
    blows: bool = False
    lines: tuple[Line, ...] = ()

    def of(self, run: Run) -> np.ndarray:
        """The quantity (n,) at the times of the plant's states."""
        return self.scale * (
            run.truth[self.column] if isinstance(self.column, str) else self.column(run)
        )


@dataclass(frozen=True)
class Drive:
    """A drive and the part of it that is drawn, from from_s to to_s; `every` is the number of PWM
    periods between kept states, `event` a time with its text.
    """

    title: str
    rig: Rig
    variant: Variant
    profile: Profile = field(default_factory=pull)
    from_s: float = 0.25
    to_s: float = 1.0
    seed: int = 3
    every: int = 4
    stop_when: Callable[[Any, Any], bool] | None = None
    event: tuple[float, str] | None = None


@dataclass(frozen=True)
class Wave:
    """The drives of a controller side by side; times count from the pull of the trigger."""

    name: str
    title: str
    note: str
    drives: Sequence[Drive]
    panels: Sequence[Panel]


def run_of(drive: Drive) -> Run | None:
    """The run of a drive; None where the firmware lacks its controller."""
    plan = RunPlan(
        drive.profile,
        drive.variant.mode,
        drive.variant.params,
        drive.to_s,
        drive.seed,
        drive.every,
        stop_when=drive.stop_when,
    )
    try:
        return run_plan(drive.rig, plan)
    except AbsentError:
        return None


@dataclass(frozen=True)
class DrawnRun:
    """A drive with its run and the colour of its curves."""

    drive: Drive
    run: Run
    colour: str

    def part(self, panel: Panel) -> list[np.ndarray]:
        """Time and quantity of the part that is drawn, thinned such that peaks remain."""
        time_s = self.run.truth["time_s"]
        shown = time_s > self.drive.from_s
        return thin(time_s[shown] - PULL_S, panel.of(self.run)[shown], points=POINTS)

    @property
    def shown_hits(self) -> list[Any]:
        """Blows and repeats in the part that is drawn; a drill driver has none."""
        hits = self.run.hits if self.run.blows.dtype.names else []
        return [hit for hit in hits if self.drive.from_s < hit["time_s"] < self.drive.to_s]


def runs_of(wave: Wave) -> list[DrawnRun]:
    """The runs of the drives whose controllers the firmware has."""
    found, controlled = [], 0
    for drive in wave.drives:
        run = run_of(drive)
        colour = (
            PLAIN_COLOUR
            if drive.variant.mode == "duty"
            else CONTROLLED_COLOURS[controlled % len(CONTROLLED_COLOURS)]
        )
        controlled += drive.variant.mode != "duty"
        found += [DrawnRun(drive, run, colour)] if run else []
    return found


def wave_picture(wave: Wave) -> Picture:
    """The drives of a wave as a figure, for the page and for print."""
    found, count = runs_of(wave), len(wave.panels)
    headings = [one.drive.title for one in found]
    figure = make_subplots(
        count,
        len(found),
        column_titles=headings,
        vertical_spacing=GAP / count,
        horizontal_spacing=0.03,
        shared_xaxes="columns",
        shared_yaxes="rows",
    )
    for column, one in enumerate(found, 1):
        add_drive(figure, one, wave.panels, column)
        figure.update_xaxes(title="s from the trigger's pull", row=count, col=column)
    for row, panel in enumerate(wave.panels, 1):
        add_panel(figure, found, panel, row)
    figure.update_annotations(font_size=14)
    figure.for_each_annotation(
        lambda note: note.update(yshift=24) if note.text in headings else None
    )
    height = TOP_HEIGHT + PANEL_HEIGHT * count
    return Picture(wave.title, style(figure, height).update_layout(margin_t=70), wave.note)


def range_of(values: Iterable[float]) -> tuple[float, float]:
    """Range of an axis for values: least and greatest with a margin; from 0 where 0 is near."""
    least, greatest = float(np.nanmin(list(values))), float(np.nanmax(list(values)))
    span = max(greatest - least, 1e-6 * max(abs(greatest), 1.0))
    low = 0.0 if 0.0 <= least < NEAR_ZERO * span else least - MARGIN_SHARE * span
    return low, greatest + MARGIN_SHARE * span


def add_panel(figure: go.Figure, found: Sequence[DrawnRun], panel: Panel, row: int) -> None:
    """Range and title of a panel, and the marks of its blows."""
    values = [v for one in found for v in one.part(panel)[1]] + [line.value for line in panel.lines]
    least, greatest = range_of(values)
    figure.update_yaxes(range=[least, greatest], row=row)
    figure.add_annotation(
        text=panel.title,
        row=row,
        col=1,
        xref="x domain",
        yref="y domain",
        x=0.0,
        y=1.0,
        yanchor="bottom",
        xanchor="left",
        showarrow=False,
    )
    top = greatest - 0.4 * MARGIN_SHARE * (greatest - least)
    for column, one in enumerate(found, 1):
        if panel.blows and one.shown_hits:
            figure.add_trace(blow_marks(one, top), row=row, col=column)


def add_drive(figure: go.Figure, one: DrawnRun, panels: Sequence[Panel], column: int) -> None:
    """The curves and levels of one drive, and its event."""
    event = one.drive.event
    for row, panel in enumerate(panels, 1):
        time, value = (np.round(part, 5) for part in one.part(panel))
        line = {"color": one.colour, "width": 1.5}
        curve = go.Scatter(x=time, y=value, mode="lines", showlegend=False, line=line)
        figure.add_trace(curve, row=row, col=column)
        for level in panel.lines:
            place = {
                "annotation_text": level.text,
                "annotation_position": "bottom left" if level.below else "top left",
            }
            figure.add_hline(level.value, row=row, col=column, line=LEVEL_LINE, **place)
        if event:
            named = {"annotation_text": event[1], "annotation_position": "top right"}
            look = {"line": LEVEL_LINE, **(named if row == 1 else {})}
            figure.add_vline(event[0] - PULL_S, row=row, col=column, **look)


def blow_marks(one: DrawnRun, top: float) -> go.Scatter:
    """Blows and repeats as ticks at the upper edge of a panel."""
    hits = one.shown_hits
    colours = [REPEAT_COLOUR if hit["kind"] == REPEAT else BLOW_COLOUR for hit in hits]
    return go.Scatter(
        x=[round(hit["time_s"] - PULL_S, 5) for hit in hits],
        y=[top] * len(hits),
        mode="markers",
        marker={"symbol": "line-ns-open", "size": 10, "color": colours, "line": {"width": 2}},
        showlegend=False,
        cliponaxis=False,
    )
