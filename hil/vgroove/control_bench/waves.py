"""Waveforms of a drive with and without control: what the plant did, one panel a quantity, one colour a variant."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from vgroove.control_bench.jobs import Variant
from vgroove.control_bench.runs import AbsentError, pull, sil_run
from vgroove.rig import Rig
from vgroove.study.report import Picture, style, thin

COLOURS = ("#30343b", "#d1495b", "#00798c", "#edae49")


@dataclass(frozen=True)
class Panel:
    """A column of the truth, how it is called, and what it is multiplied by."""

    column: str
    words: str
    scale: float = 1.0


@dataclass(frozen=True)
class Drive:
    """The drive that is shown: tool, trigger, length, the stretch of it that is drawn."""

    rig: Rig
    trigger: float = 1.0
    from_s: float = 0.25
    to_s: float = 1.0
    seed: int = 3
    every: int = 4
    stop_when: Callable[[Any, Any], bool] | None = None


def wave_picture(title: str, note: str, drive: Drive, variants: Sequence[Variant], panels: Sequence[Panel]) -> Picture:
    """Every variant that the firmware has, over the same drive."""
    figure = make_subplots(rows=len(panels), cols=1, shared_xaxes=True, vertical_spacing=0.06)
    for variant, colour in zip(variants, COLOURS, strict=False):
        try:
            columns = truth_of(drive, variant, panels)
        except AbsentError:
            continue
        for n, panel in enumerate(panels):
            line = {"name": variant.name, "legendgroup": variant.name, "showlegend": n == 0, "line": {"color": colour, "width": 1.5}}
            figure.add_trace(go.Scatter(x=columns[0], y=columns[n + 1] * panel.scale, **line), row=n + 1, col=1)
    for n, panel in enumerate(panels):
        figure.update_yaxes(title=panel.words, row=n + 1)
    figure.update_xaxes(title="time in s", row=len(panels))
    return Picture(title, style(figure, 180 + 200 * len(panels)), note)


def truth_of(drive: Drive, variant: Variant, panels: Sequence[Panel]) -> list[Any]:
    """Time and the panels' columns within the stretch, thinned."""
    options = {"profile": pull(drive.trigger), "duration_s": drive.to_s, "seed": drive.seed, "truth_every": drive.every}
    run = sil_run(drive.rig, mode=variant.mode, params=variant.params, stop_when=drive.stop_when, **options)
    shown = run.truth["time_s"] > drive.from_s
    return thin(run.truth["time_s"][shown], *(run.truth[panel.column][shown] for panel in panels))
