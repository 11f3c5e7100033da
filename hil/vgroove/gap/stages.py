"""The stages of a diagnosis, one function each: problem, search, remainder, decision, location,
parameter values, next run, verdict.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from vgroove.errors import VgrooveError
from vgroove.gap.catalogue import BY_ID, CATALOGUE
from vgroove.gap.cleaning.time_range import TimeRange
from vgroove.gap.fitting.engine import Engine
from vgroove.gap.fitting.hypothesis import Fit
from vgroove.gap.log_check import checked_logs
from vgroove.gap.log_check.compared import refuse_uncompared
from vgroove.gap.next_run import experiment_design
from vgroove.gap.residual.loading import load_problem
from vgroove.gap.residual.problem import Problem
from vgroove.gap.result import Evidence, Verdict
from vgroove.gap.selection.comparison import begin_in_better_comparison
from vgroove.gap.selection.intervals import Estimate, best_estimate
from vgroove.gap.selection.log_content import effect_scales, log_flags, shown_effects
from vgroove.gap.selection.options import DiagnosisOptions
from vgroove.gap.selection.search import Selection, select
from vgroove.gap.selection.search_state import Search
from vgroove.gap.stage_shares import RepeatedProgress
from vgroove.gap.verdict import decision
from vgroove.gap.verdict.covariates import Covariates, covariates_of
from vgroove.gap.verdict.decision import Finding
from vgroove.gap.verdict.effect_findings import effect_findings, indistinguishable, selected
from vgroove.gap.verdict.gap_figures import gap_figures
from vgroove.gap.verdict.location import largest_share, regime_shares, shapley_shares
from vgroove.gap.verdict.remainder import Remainder, correlate_shares, remaining, unexplained
from vgroove.gap.verdict.row_delay import row_delay_remarks, row_interval_s
from vgroove.gap.verdict.schema import NextExperiment, Where
from vgroove.gap.verdict.unnamed_shares import unnamed_share_remarks
from vgroove.log import NO_MAP, as_log
from vgroove.rig import Rig

__all__ = [
    "begin_search",
    "decide",
    "estimate",
    "load",
    "locate_gap",
    "locate_remainder",
    "propose",
    "read_logs",
    "select",
    "state_verdict",
]


@dataclass(frozen=True)
class Located:
    """A selection with its problem with aligned shaft angles, the covariates (n,) of its residuals,
    and the remainder of the selected fit.
    """

    selection: Selection
    problem: Problem
    covariates: Covariates
    remainder: Remainder

    @property
    def simulated(self) -> Problem:
        """The problem of the forward simulation, with aligned shaft angles."""
        search = self.search
        return self.problem if search.gap_problem is None else search.gap_problem

    @property
    def search(self) -> Search:
        """The finished search."""
        return self.selection.search


@dataclass(frozen=True)
class Decision:
    """A located selection, the finding on it, and the fit whose gap is reported as `after`."""

    located: Located
    finding: Finding
    reported: Fit


def load(logs: Sequence[Any], rig: Rig, options: DiagnosisOptions) -> Problem:
    """Logs, within the range of the options, and rig as normalised residuals; VgrooveError for
    unusable logs or an unknown id.
    """
    for name in options.without:
        if name not in BY_ID:
            known = ", ".join(e.id for e in CATALOGUE)
            raise VgrooveError(
                f"--without: {name} is not in the catalogue of this diagnosis ({known})"
            )
    problem = load_problem(read_logs(logs, rig, options), rig, joints=options.joints)
    if not options.as_is:
        refuse_uncompared(problem)
    return problem


def read_logs(logs: Sequence[Any], rig: Rig, options: DiagnosisOptions) -> list[Any]:
    """The logs within the range of the options, checked; VgrooveError for unusable ones."""
    time_range = TimeRange(options.from_s, options.to_s)
    columns = options.columns or NO_MAP
    tables = [time_range.select(as_log(log, columns)) for log in logs]
    return checked_logs(tables, rig, options.as_is, options.joints)


def begin_search(problem: Problem, options: DiagnosisOptions) -> Search:
    """A search over the effects of the catalogue that the columns and motion of the logs allow, in
    the comparison that leaves the sharper values.
    """
    rig, progress = problem.rig, RepeatedProgress(options.progress)
    options = replace(options, progress=progress)
    engine = Engine(problem, effect_scales(problem), problem.tolerance, frozenset(rig.effects))
    engine.on_work = progress.repeat
    effects = shown_effects(problem, frozenset(options.without))
    return begin_in_better_comparison(engine, effects, options)


def locate_remainder(selection: Selection) -> Located:
    """The remainder of the selected fit, and the quantity that it depends on."""
    search = selection.search
    search.progress("what remains, and where the gap lies")
    problem = search.problem.with_angles(search.engine.angles)
    covariates = covariates_of(problem, selection.best.theta(problem.theta0))
    remainder = remaining(search, selection.best, covariates)
    return Located(selection, problem, covariates, remainder)


def decide(located: Located) -> Decision:
    """The verdict (none, effect, partial, ambiguous or unlisted) with the fit that is reported."""
    finding = decision.decide(located.selection, located.remainder, located.covariates)
    return Decision(located, finding, decision.reported_fit(located.search, finding))


def locate_gap(decided: Decision) -> Where:
    """Shares of subsystems, regimes and covariates in the gap."""
    search, finding = decided.located.search, decided.finding
    share = shapley_shares(search, finding.best) if finding.verdict != "none" else {}
    return Where(
        largest_share(share),
        share,
        regime_shares(search),
        correlate_shares(search, decided.located.covariates),
    )


def estimate(decided: Decision) -> Estimate:
    """Parameter values of the reported fit with 95 % intervals."""
    return best_estimate(decided.located.search, decided.reported)


def propose(decided: Decision) -> NextExperiment | None:
    """The run to record next, where one log does not decide."""
    search = decided.located.search
    return experiment_design.propose(search.simulated, search, decided.finding)


def state_verdict(
    decided: Decision, where: Where, estimated: Estimate, next_run: NextExperiment | None
) -> Verdict:
    """The verdict of docs/spec/gap.md, section 5."""
    search, finding = decided.located.search, decided.finding
    problem = decided.located.simulated
    rivals = indistinguishable(search, finding, log_flags(problem))
    names, effects = selected(search, finding), effect_findings(search, finding, estimated)
    fitted = {effect.id: effect.parameters for effect in effects if effect.id in names}
    holds_after = problem.rig.command_holds_after
    remarks = row_delay_remarks(fitted, row_interval_s(problem), holds_after)
    remarks += unnamed_share_remarks(where.share, names)
    return Verdict(
        verdict=finding.verdict,
        selected=names,
        gap=gap_figures(search, decided.reported, estimated),
        where=where,
        effects=effects,
        indistinguishable=[r for r in rivals if r.id not in search.without],
        retuned_parameters=estimated.retuned_parameters(),
        next_experiment=next_run,
        unexplained=unexplained(search, finding.remainder),
        warnings=[*problem.warnings, *remarks],
        evidence=Evidence(problem, search, estimated),
    )
