"""Diagnosis of the gap between measured logs and the simulation of one tool: the public Python API.

    from vgroove.gap import diagnose
    from vgroove.rig import read_rig

    verdict = diagnose(["run.csv"], read_rig("tool.toml"))
    verdict.selected, verdict.gap.closed, verdict.figures(), verdict.corrected_rig()

Comments name two halves of a blind set: simulated cases with known answers (docs/gap_bench.md). On
the tuning half thresholds are chosen; on the other half the reported figures are computed.

In a notebook a verdict shows its page. Importing this package loads no numerical package and not
vgroove.rig, whose keys come from vgroove.gap.catalogue: diagnose() imports the stages.
"""

from typing import TYPE_CHECKING, Any

from vgroove.gap.result import Verdict
from vgroove.gap.selection.options import DiagnosisOptions
from vgroove.gap.selection.parameter_estimate import ParameterEstimate
from vgroove.gap.verdict.schema import (
    ComparisonEvidence,
    CorrelateShare,
    EffectFinding,
    Gap,
    NameEvidence,
    NextExperiment,
    ProfileSeparation,
    RegimeShare,
    Rival,
    SignalGap,
    Unexplained,
    Where,
)

if TYPE_CHECKING:
    from vgroove.rig import Rig

__all__ = [
    "ComparisonEvidence",
    "CorrelateShare",
    "DiagnosisOptions",
    "EffectFinding",
    "Gap",
    "NameEvidence",
    "NextExperiment",
    "ParameterEstimate",
    "ProfileSeparation",
    "RegimeShare",
    "Rival",
    "SignalGap",
    "Unexplained",
    "Verdict",
    "Where",
    "diagnose",
]

DEFAULT_OPTIONS = DiagnosisOptions()


def diagnose(logs: Any, rig: "Rig", options: DiagnosisOptions = DEFAULT_OPTIONS) -> Verdict:
    """Diagnose one log of a tool, or a list of them, against its rig: none, effect, partial,
    ambiguous or unlisted. A log is a path, a vgroove.log.Log, a DataFrame or a dict of arrays
    (docs/input_format.md).

    VgrooveError for unusable logs, a rig that cannot be simulated, or an unknown excluded effect.
    """
    from vgroove.gap import stages
    from vgroove.log import as_list

    problem = stages.load(as_list(logs), rig, options)
    search = stages.begin_search(problem, options)
    selection = stages.select(search)
    located = stages.locate_remainder(selection)
    decision = stages.decide(located)
    where = stages.locate_gap(decision)
    estimate = stages.estimate(decision)
    next_run = stages.propose(decision)
    return stages.state_verdict(decision, where, estimate, next_run)
