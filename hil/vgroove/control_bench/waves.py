"""Waveforms of drives with and without control, a column a drive, a row a quantity: on the bench's page and as a figure."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from vgroove.control_bench.jobs import Variant
from vgroove.control_bench.runs import PULL_S, AbsentError, Run, pull, sil_run
from vgroove.control_bench.svg import Cell, Chart, Curve, Line, Mark, drawn
from vgroove.lockstep import Profile
from vgroove.rig import Rig
from vgroove.study.report import Picture, style, thin

PLAIN_COLOUR, CONTROLLED_COLOURS = "#30343b", ("#c1394f", "#00798c", "#7a5195")
BLOW_COLOUR, REPEAT_COLOUR = "#444444", "#e07b00"
Quantity = Callable[[Run], np.ndarray]


@dataclass(frozen=True)
class Panel:
    """A quantity: a column of the truth or what a run makes of it, how it is called, and what it is multiplied by."""

    column: str | Quantity
    words: str
    scale: float = 1.0
    blows: bool = False  # are marked
    lines: tuple[Line, ...] = ()

    def of(self, run: Run) -> np.ndarray:
        """(n,), a value each row of the truth."""
        return self.scale * (run.truth[self.column] if isinstance(self.column, str) else self.column(run))


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
    options = {"profile": drive.profile, "duration_s": drive.to_s, "seed": drive.seed, "truth_every": drive.every}
    try:
        return sil_run(drive.rig, mode=drive.variant.mode, params=drive.variant.params, stop_when=drive.stop_when, **options)
    except AbsentError:
        return None


def runs_of(wave: Wave) -> list[tuple[Drive, str, Run]]:
    """Drives that there are, the colour of each, and their runs."""
    found, controlled = [], 0
    for drive in wave.drives:
        run = run_of(drive)
        colour = PLAIN_COLOUR if drive.variant.mode == "duty" else CONTROLLED_COLOURS[controlled % len(CONTROLLED_COLOURS)]
        controlled += drive.variant.mode != "duty"
        found += [(drive, colour, run)] if run else []
    return found


def wave_picture(wave: Wave) -> Picture:
    """For the bench's page."""
    found = runs_of(wave)
    headings = [drive.words for drive, _, _ in found]
    shared = {"shared_xaxes": "columns", "shared_yaxes": "rows"}
    figure = make_subplots(len(wave.panels), len(found), column_titles=headings, vertical_spacing=0.06, **shared)
    for c, (drive, colour, run) in enumerate(found):
        shown = run.truth["time_s"] > drive.from_s
        columns = thin(run.truth["time_s"][shown] - PULL_S, *(panel.of(run)[shown] for panel in wave.panels))
        for r, values in enumerate(columns[1:]):
            curve = go.Scatter(x=columns[0], y=values, showlegend=False, line={"color": colour, "width": 1.5})
            figure.add_trace(curve, row=r + 1, col=c + 1)
        figure.update_xaxes(title="s from the trigger's pull", row=len(wave.panels), col=c + 1)
    for r, panel in enumerate(wave.panels):
        figure.update_yaxes(title=panel.words, row=r + 1, col=1)
    return Picture(wave.title, style(figure, 180 + 200 * len(wave.panels)), wave.note)


def marks_of(drive: Drive, run: Run) -> list[Mark]:
    """Blows and repeats within the stretch; a drill driver has none."""
    hits = run.hits if run.blows.dtype.names else []
    shown = [hit for hit in hits if drive.from_s < hit["time_s"] < drive.to_s]
    return [Mark(float(hit["time_s"]) - PULL_S, REPEAT_COLOUR if hit["kind"] == 1 else BLOW_COLOUR) for hit in shown]


def cell_of(drive: Drive, colour: str, run: Run, panel: Panel, first: bool) -> Cell:
    """One quantity of one drive; the first says what the event is."""
    shown = run.truth["time_s"] > drive.from_s
    curve = Curve(run.truth["time_s"][shown] - PULL_S, panel.of(run)[shown], colour)
    event = [Mark(drive.event[0] - PULL_S, words=drive.event[1] if first else "", through=True)] if drive.event else []
    return Cell([curve], event + (marks_of(drive, run) if panel.blows else []), panel.lines)


def wave_svg(wave: Wave) -> str:
    """For a page of docs/controllers: the same drives as a figure that prints."""
    found = runs_of(wave)
    cells = [[cell_of(drive, colour, run, panel, n == 0) for drive, colour, run in found] for n, panel in enumerate(wave.panels)]
    words = [drive.words for drive, _, _ in found], [panel.words for panel in wave.panels]
    return drawn(Chart(f"{wave.title}: {wave.note}", *words, cells, "s from the trigger's pull"))
