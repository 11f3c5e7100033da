"""The verdict of a diagnosis: its content as dataclasses, as JSON, text, figures and page, and the
corrected rig.
"""

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vgroove.gap.verdict.schema import (
    EffectFinding,
    Gap,
    NextExperiment,
    Rival,
    Unexplained,
    Where,
)

if TYPE_CHECKING:
    import plotly.graph_objects as go

    from vgroove.gap.residual.problem import Problem
    from vgroove.gap.selection.intervals import Estimate
    from vgroove.gap.selection.search_state import Search
    from vgroove.html_page import Page
    from vgroove.rig import Rig

SCHEMA = "vgroove.gap/1"
NOTEBOOK_HEIGHT_PX = 900  # of the frame that holds a page; the page scrolls in it


@dataclass(frozen=True)
class Evidence:
    """What a verdict was computed from: the problem of the forward simulation with aligned shaft
    angles, the search, and the fit whose parameter values are reported.
    """

    problem: "Problem"
    search: "Search"
    estimate: "Estimate"


@dataclass(frozen=True)
class Verdict:
    """The verdict of a diagnosis (docs/spec/gap.md, section 5).

    verdict: none, effect, partial, ambiguous or unlisted. selected: ids of the named effects,
    strongest first. effects: all that were tried, likeliest first. retuned_parameters: rig keys
    that have a tolerance, with their fitted values.
    """

    verdict: str
    selected: Sequence[str]
    gap: Gap
    where: Where
    effects: Sequence[EffectFinding]
    indistinguishable: Sequence[Rival]
    retuned_parameters: Mapping[str, float]
    next_experiment: NextExperiment | None
    unexplained: Unexplained
    warnings: Sequence[str]
    evidence: Evidence = field(repr=False, compare=False)

    def as_dict(self) -> dict[str, Any]:
        """The verdict's JSON as dicts, lists and Python numbers."""
        from vgroove.gap.verdict.json_values import as_json

        names = [f.name for f in fields(self) if f.name != "evidence"]
        return {"schema": SCHEMA} | {name: as_json(getattr(self, name)) for name in names}

    def effect(self, effect_id: str) -> EffectFinding:
        """The finding on one effect; KeyError for an effect that was not tried."""
        for one in self.effects:
            if one.id == effect_id:
                return one
        raise KeyError(effect_id)

    def summary(self) -> list[str]:
        """The verdict in sentences, as the command prints them."""
        from vgroove.gap.report import summary_lines

        return summary_lines(self)

    def corrected_rig(self) -> "Rig":
        """The rig with the fitted values of the keys that have a tolerance, the selected effects,
        and the clip of each column.
        """
        from vgroove.gap.corrected_rig import corrected_rig

        return corrected_rig(self)

    def log_names(self) -> list[str]:
        """File names of the diagnosed logs."""
        return [Path(str(log.source)).name for log in self.evidence.problem.logs]

    def page(self, names: Sequence[str] | None = None) -> "Page":
        """The page of the verdict; names: titles of the logs, by default their file names."""
        from vgroove.gap.page import verdict_page

        return verdict_page(self, self.log_names() if names is None else names)

    def figures(self) -> dict[str, "go.Figure"]:
        """The figures of the page by title, as Plotly objects."""
        from vgroove.html_page import Picture

        return {part.title: part.figure for part in self.page().parts if isinstance(part, Picture)}

    def _repr_html_(self) -> str:
        """The page in a frame of its own, as a notebook shows it."""
        text = html.escape(self.page().as_html())
        style = f"width:100%;height:{NOTEBOOK_HEIGHT_PX}px;border:0"
        return f'<iframe srcdoc="{text}" style="{style}"></iframe>'
