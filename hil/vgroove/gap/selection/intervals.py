"""Parameter values of a fit with 95 % intervals; fitted again over long stretches where the shaft's
speed decays more slowly than the model restarts.

The friction of a shaft that coasts for a second is estimated more precisely from one simulation
over the second than from four that each begin with a measured, noisy state.
"""

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np

from vgroove.gap.catalogue import BY_ID, FORMS_BEYOND_SPECIFICATION
from vgroove.gap.cleaning.logging_interval import logging_interval_s
from vgroove.gap.fitting.covariance import interval_half_widths, region_excludes_zero
from vgroove.gap.fitting.cross_validation import predict_held_out
from vgroove.gap.fitting.engine import Engine
from vgroove.gap.fitting.hypothesis import Fit
from vgroove.gap.residual import angle_alignment
from vgroove.gap.residual.impact.problem import OF_LOG
from vgroove.gap.residual.loading import load_problem
from vgroove.gap.residual.protocol import MeasuredProblem
from vgroove.gap.residual.restarts import RESTART, restart_interval_s
from vgroove.gap.selection.parameter_estimate import ParameterEstimate
from vgroove.gap.selection.search_state import COMPARISON, Search


@dataclass(frozen=True)
class EstimateLimits:
    """Thresholds of the reported parameter values; chosen on the tuning half of the blind set
    (docs/gap_bench.md) where no source is stated.
    """

    time_constants: float = 16.0  # length of a long stretch, in time constants of the shaft
    rounds: int = 8  # Gauss-Newton rounds over long stretches
    # largest gap over long stretches, in noise floors, with which their values are reported: the
    # simulation of a model that lacks an effect drifts from the log
    max_gap: float = 1.1
    # length of a cluster of correlated residuals, a stroke of a machine, and the fewest of a log
    cluster_s: float = 0.5
    min_clusters: int = 8
    # relative half width, 95 %, of the error of a value from the form error of the effect (see
    # limits.py); measured by `vgroove gap bench` (share of true values inside their interval)
    form_error: float = 0.03
    # the catalogue's form of an effect is reported, instead of the selected form, if the gap is
    # larger by no more than this
    max_form_gap: float = COMPARISON.visible_gap


ESTIMATE = EstimateLimits()
Flags = tuple[tuple[int, float], ...]
Z95 = 1.96  # two-sided 95 % quantile of the standard normal distribution


@dataclass(frozen=True)
class Estimate:
    """A fit, the engine of its problem, and clusterings (n,) of its rows: the residuals of one
    cluster may be correlated.
    """

    engine: Engine
    fit: Fit
    clusters: tuple[np.ndarray, ...]

    @cached_property
    def half_widths(self) -> np.ndarray:
        """Half widths (p,) of the 95 % intervals of the fitted numbers, in the numbers' units."""
        return (
            interval_half_widths(self.engine, self.fit, self.clusters)
            if len(self.fit.x)
            else np.zeros(0)
        )

    def excludes_zero(self, effect_id: str, names: Collection[str]) -> bool:
        """Whether the 95 % confidence region of one of the fitted sizes of an effect, given by
        their parameters' names, or that of all of them together, excludes 0, with its other numbers
        (time constants, periods) free or held at their values; True where none of the sizes was
        fitted. An amplitude with a phase has two numbers.
        """
        sizes = size_places(self.fit, names)
        held = [
            k
            for k, c in enumerate(self.fit.hypothesis.coordinates)
            if c.name.startswith(f"effects.{effect_id}.") and k not in sum(sizes, [])
        ]
        fits = [self.fit, self.fit.holding(held)] if held else [self.fit]
        return not sizes or any(self._region_excludes_zero(one, names) for one in fits)

    def _region_excludes_zero(self, one: Fit, names: Collection[str]) -> bool:
        """Whether the region of one of the numbers with these names, or of all, excludes 0."""
        groups = size_places(one, names)
        if len(groups) > 1:
            groups.append(sum(groups, []))
        return region_excludes_zero(self.engine, one, self.clusters, *groups)

    def parameters(self, effect_id: str) -> dict[str, ParameterEstimate]:
        """Reported parameters of one effect, with 95 % intervals from cluster-robust covariance."""
        problem = self.engine.problem
        if BY_ID[effect_id].counted:
            return dropout_parameters(problem)
        found, theta = {}, self.fit.theta(problem.theta0)
        for parameter in (p for p in BY_ID[effect_id].parameters if p.reported):
            name = BY_ID[effect_id].name(parameter)
            value = float(theta[problem.index(name)])
            interval = parameter_interval(self.fit, name, value, self.half_widths)
            found[parameter.name] = ParameterEstimate(value, interval, parameter.unit)
        return found

    def retuned_parameters(self) -> dict[str, float]:
        """Fitted values of the rig keys that have a tolerance, in their own units."""
        theta = self.fit.theta(self.engine.problem.theta0)
        found = {c.name: float(theta[c.columns[0]]) for c in self.engine.nuisance}
        return {name: value for name, value in found.items() if OF_LOG not in name}


def size_places(one: Fit, names: Collection[str]) -> list[list[int]]:
    """Places in x of a fit's numbers with these names, each with that of its sine."""
    return [
        [k, k + 1] if c.role == "cosine" else [k]
        for k, c in enumerate(one.hypothesis.coordinates)
        if c.name in names
    ]


def estimate_of(search: Search, one: Fit) -> Estimate:
    """The parameter values of a fit of the search, with its restarts."""
    problem = search.problem
    clusters = (search.blocks.cluster, time_clusters(problem.log, problem.time_s))
    return Estimate(search.engine, one, clusters)


def best_estimate(search: Search, shown: Fit) -> Estimate:
    """Parameter values of a fit over long stretches where these can be used, else of the fit with
    the restarts of the search.
    """
    if search.gap_problem is not None:
        return estimate_of(search, shown)
    return estimate_over_long_stretches(search.engine, shown) or estimate_of(search, shown)


def dropout_parameters(problem: MeasuredProblem) -> dict[str, ParameterEstimate]:
    """Probability of a missed Hall edge, counted and not fitted: any value above 0 makes the model
    reproduce the edges that were missed. The interval is Wilson's (JASA 22, 1927).
    """
    missed, edges = problem.missed_edges
    share, pull = missed / max(1.0, edges), Z95**2 / max(1.0, edges)
    middle = (share + 0.5 * pull) / (1.0 + pull)
    half = (
        Z95
        * np.sqrt(share * (1.0 - share) / max(1.0, edges) + 0.25 * (pull / Z95) ** 2)
        / (1.0 + pull)
    )
    interval = (float(middle - half), float(middle + half))
    return {"probability": ParameterEstimate(share, interval, "1")}


def parameter_interval(
    one: Fit, name: str, value: float, half_widths: np.ndarray
) -> tuple[float, float] | None:
    """95 % interval of a fitted parameter from half_widths (p,) and the form error; None if the
    parameter was not fitted.

    For an amplitude with a phase the larger half width of its two coordinates is used.
    """
    for i, c in enumerate(one.hypothesis.coordinates):
        if c.name == name or sets_backward_friction(c, name):
            fitted = half_widths[i : i + 2].max() if c.role == "cosine" else half_widths[i]
            half = float(np.hypot(float(fitted) * abs(c.factors[0]), ESTIMATE.form_error * value))
            return value - half, value + half
    return None


def sets_backward_friction(coordinate: object, name: str) -> bool:
    """Whether a name is that of a backward friction which the coordinate of the forward one sets
    too (asymmetric_friction beside coulomb_friction).
    """
    both = coordinate.name.endswith("forward_nm") and len(coordinate.columns) == 2
    return name.endswith("backward_nm") and both


def in_catalogue_form(search: Search, best: Fit) -> Fit:
    """The same effects in the forms of docs/spec/gap.md, section 3, unless the gap of these is
    larger than that of the selected forms by more than the smallest visible gap.
    """
    beyond = {(search.problem.index(n), value) for n, value in FORMS_BEYOND_SPECIFICATION}
    if not beyond.intersection(best.hypothesis.fixed):
        return best
    forms = catalogue_forms(best.hypothesis.fixed, beyond)
    hypotheses = [replace(best.hypothesis, start=best.x, fixed=fixed) for fixed in forms]
    fits = search.engine.fit(hypotheses, COMPARISON.max_rounds)
    predict_held_out(search.engine, fits)
    again = min(fits, key=search.reported_gap)
    more = search.reported_gap(again) - search.reported_gap(best)
    return again if more <= ESTIMATE.max_form_gap else best


def catalogue_forms(fixed: Flags, beyond: set[tuple[int, float]]) -> list[Flags]:
    """Flags, as (column of theta, value), of a set in all forms that the agreed catalogue defines:
    with each form beyond it replaced by the others of its effect.
    """
    choices = [
        [((column, float(k)),) if k else () for k in range(int(value)) if (column, k) not in beyond]
        if (column, value) in beyond
        else [((column, value),)]
        for column, value in fixed
    ]
    return [sum(chosen, ()) for chosen in product(*choices)]


def time_clusters(log: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """Cluster (n,) of each row: the rows of one log within cluster_s, or within an eighth of the
    log where that is shorter: a variance cannot be estimated from one or two clusters.
    """
    numbers, of_log = np.unique(log, return_inverse=True)
    limits = np.array(
        [(t.min(), np.ptp(t)) for t in (time_s[of_log == k] for k in range(len(numbers)))]
    )
    first, length_s = limits.T
    # a little longer, so that the last row belongs to the last of the clusters
    size_s = np.minimum(ESTIMATE.cluster_s, length_s / ESTIMATE.min_clusters * (1.0 + 1e-9))
    size_s = np.where(size_s > 0.0, size_s, ESTIMATE.cluster_s)
    stretch = np.floor((time_s - first[of_log]) / size_s[of_log]).astype(np.int64)
    keys = of_log.astype(np.int64) * (int(stretch.max()) + 1) + stretch
    return np.unique(keys, return_inverse=True)[1]


def restarts_under_voltage_s(problem: MeasuredProblem) -> float:
    """Time in s between restarts of the model in the log with the slowest logger, as for a motor
    that a voltage drives: 0.25 s or 32 logging intervals.
    """
    return max(
        restart_interval_s(logging_interval_s(log.time_s), RESTART.nominal_s)
        for log in problem.logs
    )


def estimate_over_long_stretches(engine: Engine, shown: Fit) -> Estimate | None:
    """The same effects and nuisance parameters fitted with a restart only every several time
    constants of the shaft's speed.

    None where that time constant is shorter than the time between two restarts (that of a log which
    no current drives), where the fit has a periodic effect, whose angles are aligned for each
    stretch between stops, or where the model drifts from the log in the longer time.
    """
    problem = engine.problem
    constant_s = problem.rig.speed_time_constant_s
    if (
        not len(shown.x)
        or constant_s < min(problem.restart_s, restarts_under_voltage_s(problem))
        or angle_alignment.active_periodic_effects(problem, shown.theta(problem.theta0))
    ):
        return None
    longest_s = max(log.time_s[-1] - log.time_s[0] for log in problem.logs)
    length_s = float(min(ESTIMATE.time_constants * constant_s, longest_s))
    longer = load_problem(problem.logs, problem.rig, length_s, problem.threads)
    apart = Engine(longer, engine.scales, problem.rig.tolerance, engine.present)
    fit = apart.fit([replace(shown.hypothesis, start=shown.x)], ESTIMATE.rounds)[0]
    if longer.gap(fit.residual, longer.judged) > ESTIMATE.max_gap * longer.floor():
        return None
    return Estimate(apart, fit, (time_clusters(longer.log, longer.time_s),))
