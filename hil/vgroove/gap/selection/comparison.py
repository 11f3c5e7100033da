"""Chooses the comparison in which effects are looked for: the forward simulation between restarts,
or the torque balance along the measured motion, whichever determines parameter values more
precisely.

Where the driving column is measured with noise, or sampled more slowly than the tool responds, the
forward simulation is no prediction, because the errors of that column add up in the speed (an
errors-in-variables model: W. A. Fuller, Measurement Error Models, 1987).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from vgroove.gap.catalogue import BY_ID, Effect
from vgroove.gap.cleaning.missing_values import has_values
from vgroove.gap.fitting.covariance import white_noise_half_widths
from vgroove.gap.fitting.engine import Engine
from vgroove.gap.fitting.hypothesis import Fit
from vgroove.gap.residual.problem import Problem, SignalInfo
from vgroove.gap.residual.torque_balance import BalanceProblem, balance_problem
from vgroove.gap.selection.intervals import estimate_of
from vgroove.gap.selection.options import DiagnosisOptions
from vgroove.gap.selection.search_state import COMPARISON, Search, begin
from vgroove.gap.selection.single_effects import least_costly
from vgroove.gap.selection.size_prior import MIN_PRIOR, size_density

FORWARD, BALANCE = "forward simulation", "torque balance"
# Effects that let a mass move against the motor, since the torque balance holds all masses on its
# motion; a clock, which acts there as an inertia does, and besides shifts the driving column (see
# SHIFTS); and an error of the measured angle itself.
NOT_IN_BALANCE = frozenset(
    {"coupler_compliance", "gear_backlash", "clock_skew", "hall_eccentricity"}
)
# Errors of a speed sensor: where an encoder measures the motion, the balance has no speed sensor.
OF_SPEED_SENSOR = frozenset({"speed_gain", "speed_lag"})
# Effects that shift the driving column in time. Where torques are means of few rows, a shift by a
# part of a row averages the noise of further rows, which any noisy log rewards.
SHIFTS = frozenset({"transport_delay"})
# the effects by whose intervals the two comparisons are ranked: almost every machine shows them,
# and both comparisons estimate them
REFERENCE_EFFECTS = ("coulomb_friction", "viscous_friction")
# what a rig may misstate besides by so much that the forward simulation fails for it alone: an
# inertia, and the torque of a pendulum or of another weight that it lacks; and any effect that the
# torque balance cannot show
INERTIA, WEIGHT = "added_inertia", "gear_eccentricity"


@dataclass(frozen=True)
class ComparisonRules:
    """When the torque balance is tried, and when it is used; chosen on the logs of tests/data/real
    and on the tuning half of the blind set (docs/gap_bench.md).
    """

    # The forward simulation of a signal fails if sigma, which includes the propagated errors of
    # the driving column, exceeds this share of the measured signal's RMS,
    max_input_share: float = 0.3
    # or if the RMS error of the nominal model exceeds the first of these shares of it (a model that
    # predicts 0 would be better) and that of the reference effects the second.
    max_nominal_share: float = 1.0
    max_reference_share: float = 0.5
    min_rows_of_shift: int = 10  # fewest rows of a mean torque that shows a shift in time


RULES = ComparisonRules()
MIN_HALF_WIDTH = 1e-12  # keeps a logarithm finite
MIN_INFORMATION = 1e-6  # of a value of typical size: below it the logs do not show the effect


def comparison_of(search: Search) -> str:
    """Name, as the verdict states it, of the comparison that a search fits."""
    name = FORWARD if search.gap_problem is None else BALANCE
    return name if search.unwhitened is None else f"{name}, prewhitened"


def begin_in_better_comparison(
    engine: Engine, effects: list[Effect], options: DiagnosisOptions
) -> Search:
    """A search in the comparison with the smaller mean_interval_width(): the forward simulation,
    which is the engine's problem, or the torque balance of the same logs. The balance is tried only
    where the forward simulation fails.
    """
    search = begin(engine, effects, options)
    problem = search.problem
    if not isinstance(problem, Problem):
        return search
    if not any(has_measured_motion(signal) for signal in problem.signals):
        return search
    reference = reference_fit(search)
    if reference is None or not forward_simulation_fails(search, problem, reference):
        return search
    balance = balance_problem(problem)
    if balance is None:
        return search
    shown = effects_in_balance(balance, effects)
    if any(
        not forward_simulation_fails(search, problem, one)
        for one in reference_fits_with_one_more(search, [e for e in effects if e not in shown])
    ):
        return search
    options.progress("the torque balance along the measured motion")
    balancing = Engine(balance, engine.scales, problem.rig.tolerance, engine.present)
    balancing.on_work = engine.on_work
    other = begin(balancing, shown, options, gap_problem=problem)
    widths = (
        mean_interval_width(search, reference),
        mean_interval_width(other, reference_fit(other)),
    )
    return other if widths[1] < widths[0] else search


def effects_in_balance(balance: BalanceProblem, effects: Sequence[Effect]) -> list[Effect]:
    """The effects that a torque balance can show. What repeats with the shaft's angle needs a
    measured angle: one summed from speeds drifts by more than a period. The motion comes from the
    angle where it is measured, else from the speed.
    """
    left_out = NOT_IN_BALANCE
    if balance.rows_per_span < RULES.min_rows_of_shift:
        left_out |= SHIFTS
    angle = all(has_values(log.columns, "position_rad") for log in balance.logs)
    if angle:
        left_out |= OF_SPEED_SENSOR
    return [e for e in effects if e.id not in left_out and (angle or e.periodic is None)]


def reference_fit(search: Search, ids: Sequence[str] = REFERENCE_EFFECTS) -> Fit | None:
    """The best fit of the effects `ids` together, from their first start and those of least cost;
    None if the search does not have all of them.
    """
    found = [e for e in search.effects if e.id in ids]
    if len(found) < len(ids):
        return None
    starts = search.engine.hypotheses(found)
    starts = starts[:1] + (least_costly(search, starts[1:]) if len(starts) > 1 else [])
    return search.engine.closest(search.engine.fit(starts, COMPARISON.max_rounds))[0]


def reference_fits_with_one_more(search: Search, not_in_balance: list[Effect]) -> Iterator[Fit]:
    """The reference effects fitted together with one more that may be all that the forward
    simulation lacks: an added inertia, a weight, or an effect that the torque balance cannot show.
    A size that is implausible is left out, except that of a weight: of a rotor that is heavy enough
    the simulation predicts the speed at the restart, whatever the input.
    """
    for effect_id in (INERTIA, WEIGHT, *(e.id for e in not_in_balance if e.id != WEIGHT)):
        one = reference_fit(search, (*REFERENCE_EFFECTS, effect_id))
        if one is None:
            continue
        if effect_id == WEIGHT or size_density(search, one, BY_ID[effect_id]) >= MIN_PRIOR:
            yield one


def forward_simulation_fails(search: Search, problem: Problem, reference: Fit) -> bool:
    """Whether the forward simulation of a speed or angle is no prediction (ComparisonRules). Speeds
    made from Hall edges are left out: they give no torque balance.
    """
    nominal, left = (error_shares(problem, f.out_of_fold) for f in (search.nominal, reference))
    floor = error_shares(problem, np.ones(problem.n))
    return any(
        floor[k] > RULES.max_input_share
        or (nominal[k] > RULES.max_nominal_share and left[k] > RULES.max_reference_share)
        for k, signal in enumerate(problem.signals)
        if has_measured_motion(signal)
    )


def has_measured_motion(signal: SignalInfo) -> bool:
    """Whether a signal is a speed or an angle that is not made from Hall edges."""
    return signal.column in ("speed_rpm", "position_rad") and not signal.edges


def error_shares(problem: Problem, residual: np.ndarray) -> np.ndarray:
    """RMS error (signals,) of each signal from residuals (n,) in sigmas of the sensors, divided by
    the RMS of the measured signal.
    """
    every = np.ones(problem.n, dtype=bool)
    errors, sizes = problem.gap_by_signal(residual, every), problem.rms_by_signal(every)
    return np.array([errors[c] / size if size > 0.0 else 0.0 for c, size in sizes.items()])


def mean_interval_width(search: Search, reference: Fit | None) -> float:
    """Geometric mean of the half widths of the 95 % intervals of the reference effects' values, in
    their typical sizes: small values are precise. Infinite where the logs hold no information.

    The scatter of residuals far below their standard deviation is no evidence of a small error: the
    intervals are at least those of that deviation.
    """
    if reference is None:
        return np.inf
    count = reference.hypothesis.count
    power = (reference.jacobian[search.engine.train, :count] ** 2).sum(axis=0)
    if np.any(power < MIN_INFORMATION):
        return np.inf
    scatter = estimate_of(search, reference).half_widths[:count]
    widths = np.maximum(scatter, white_noise_half_widths(search.engine, reference)[:count])
    return float(np.exp(np.mean(np.log(np.maximum(widths, MIN_HALF_WIDTH)))))
