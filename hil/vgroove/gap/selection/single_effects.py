"""Fits every effect alone, to convergence, and aligns the shaft angle after stops where an effect
that is periodic in the angle determines it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vgroove.gap.catalogue import BY_ID, PERIODIC
from vgroove.gap.fitting.cross_validation import predict_held_out
from vgroove.gap.fitting.hypothesis import Fit, Hypothesis
from vgroove.gap.fitting.population import start_near
from vgroove.gap.residual import angle_alignment
from vgroove.gap.residual.batches import split_by_size
from vgroove.gap.residual.protocol import MeasuredProblem
from vgroove.gap.selection.discrepancy import reblock, rescale
from vgroove.gap.selection.extension import AddedEffect, differentiate_added
from vgroove.gap.selection.model_comparison import MIN_POWER, clipped_squares
from vgroove.gap.selection.retuned_again import may_retune_again, retune_again
from vgroove.gap.selection.search_state import COMPARISON, Search, key


@dataclass(frozen=True)
class StartLimits:
    """How many starts of an effect are tried, and when the shaft angle is aligned. Chosen on the
    tuning half of the blind set (docs/gap_bench.md).
    """

    # an effect with more starts is fitted from those of least cost only, evaluated without a fit
    max_unscreened: int = 6
    screened: int = 3  # number of these starts
    many: int = 4  # of more starts than this, two, not one, are fitted to convergence
    brief_rounds: int = 2  # Gauss-Newton rounds after which the best starts are chosen
    fitted_at_once: int = 32  # starts whose Jacobians are in memory together
    # squared gap after retuning, in noise powers, below which no large ripple is tried and the
    # starts are not evaluated
    min_squared_gap: float = 1.1
    ripple_sizes: tuple[float, ...] = (3.0, 8.0)  # amplitudes that are screened, in typical sizes
    ripple_phases: int = 8  # phases that are screened, evenly over a turn
    # leading numbers that are screened on a hammering tool far from the noise, in plausible sizes;
    # and a plausible size, in typical ones, where the catalogue states none
    large_sizes: tuple[float, ...] = (0.3, 1.0, 3.0)
    large_in_sizes: float = 10.0
    parts: int = 16  # of the range in which an effect that acts in a region is placed
    regions: int = 16  # regions that close most to first order, evaluated without a fit
    region_sizes: tuple[float, ...] = (1.0, 1.7)  # each at these multiples of its best size
    on_line: int = 31  # sizes on a fine grid up to the largest of these, both ways
    kept_on_line: int = 2  # of these, as starts of fits
    tiny_ripple: float = 1e-3  # amplitude at which a ripple's slopes are taken, in typical sizes
    populations: int = 4  # effects of least cost that are fitted again by populations
    max_widenings: int = 2  # of the bounds of the search at which a fit ends
    # gain that a periodic effect must have with aligned angles: squared sigmas, and ratio to the
    # largest gain of any effect without alignment
    min_alignment_gain: float = 100.0
    min_alignment_ratio: float = 1.2


STARTS = StartLimits()
RippleStarts = Mapping[tuple[str, ...], list[Hypothesis]]


def fit_single_effects(search: Search) -> Search:
    """Fit every effect alone: all starts briefly, the best starts to convergence.

    Returns the search with aligned shaft angles, its clip from the residuals of the best fit, and
    bootstrap blocks of a length from their correlation time. The fitted numbers of effects with
    many starts are stored: fits of larger sets start from them.
    """
    search.progress("each effect alone")
    search, ripples = ripple_starts(search)
    if may_retune_again(search):
        fit_from_retuned(search, ripples, STARTS.brief_rounds)
        retuned, search = search.retuned, retune_again(search)
        if search.retuned is not retuned and search.leaves_gap(search.retuned):
            fit_from_retuned(search, ripples, COMPARISON.max_rounds)
        else:
            finish_fits(search)
    else:
        fit_from_retuned(search, ripples, COMPARISON.max_rounds)
    search = leave_poor_minima(search)
    refit_at_wider_bounds(search)
    fit_along_lines(search)
    search = align_to_best_single(search)
    for effect in search.effects:
        starts = search.engine.hypotheses([effect])
        many = len(starts) > STARTS.max_unscreened and not effect.has_phase
        if many or starts[0].local.any():
            search.engine.remember(search.fits[(effect.id,)])
    return reblock(rescale(search))


def fit_from_retuned(search: Search, ripples: RippleStarts, rounds: int) -> None:
    """Fit every effect alone, the nuisance parameters started at their retuned values, in at most
    so many rounds after the brief fits, and those near the best to convergence.
    """
    nuisance = search.retuned.x
    starts = [
        screened(search, ripples.get((e.id,)) or search.engine.hypotheses([e], nuisance))
        for e in search.effects
    ]
    search.fit_and_keep(best_brief_starts(search, starts), rounds)


def finish_fits(search: Search) -> None:
    """Continue the brief fits of single effects to convergence, and predict the held-out rows of
    those near the best.
    """
    singles = [search.fits[(e.id,)] for e in search.effects]
    rest = [one for one in singles if one.improving and not one.exact]
    search.engine.continue_fits(rest, range(STARTS.brief_rounds, COMPARISON.max_rounds))
    near = {id(one) for one in search.near_best(singles)}
    predict_held_out(search.engine, [one for one in rest if id(one) in near])


def leave_poor_minima(search: Search) -> Search:
    """The search with the effects of least cost fitted again from the best points of populations
    around them, where tolerated keys have several minima and retuning leaves a gap; then without
    effects from the values of the keys that these found.
    """
    if not may_retune_again(search) or not search.leaves_gap(search.retuned):
        return search
    closest = search.engine.closest([search.fits[(e.id,)] for e in search.effects])
    starts = [start_near(search.engine, one, search.seed) for one in closest[: STARTS.populations]]
    search.fit_and_keep(starts, COMPARISON.max_rounds)
    return retune_again(search)


def refit_at_wider_bounds(search: Search) -> None:
    """Fit the effects again whose numbers end at a bound of the search, with wider bounds."""
    for _ in range(STARTS.max_widenings):
        fits = [search.fits[(e.id,)] for e in search.effects]
        at_bound = [one for one in fits if search.engine.builder.widen(one)]
        starts = [near_start(search, one) for one in at_bound]
        again = [h for one, h in zip(at_bound, starts, strict=True) if leaves_bound(one, h)]
        if not again:
            return
        for h in again:
            del search.fits[h.ids]
        search.fit_and_keep(again, COMPARISON.max_rounds)


def leaves_bound(one: Fit, wider: Hypothesis) -> bool:
    """Whether wider bounds free a fit: one of its numbers lies at a bound of the search, but inside
    the bounds of the wider hypothesis. It does not where the catalogue limits how far the bound is
    widened (widest_low, widest_high).
    """
    pairs = zip(one.hypothesis.coordinates, wider.coordinates, one.x, strict=True)
    return any(
        narrow.ends_at_search_bound(float(x)) and not wide.ends_at_search_bound(float(x))
        for narrow, wide, x in pairs
    )


def near_start(search: Search, one: Fit) -> Hypothesis:
    """The hypothesis of a fit within the present bounds, started at the fit."""
    same = [
        h
        for h in search.engine.hypotheses([BY_ID[i] for i in one.ids])
        if h.fixed == one.hypothesis.fixed
    ][0]
    return replace(same, start=np.clip(one.x, same.low, same.high))


def best_brief_starts(search: Search, starts: list[list[Hypothesis]]) -> list[Hypothesis]:
    """The best start of each effect after a brief fit, or the best two where it has many."""
    found = []
    for part in split_by_size([len(group) for group in starts], STARTS.fitted_at_once):
        brief = search.engine.fit([h for group in starts[part] for h in group], STARTS.brief_rounds)
        for group in by_effect(search, brief):
            kept = group[: 2 if len(group) > STARTS.many else 1]
            found += [replace(f.hypothesis, start=f.x) for f in kept]
    return found


def ripple_starts(search: Search) -> tuple[Search, RippleStarts]:
    """The search with the shaft angle of each stretch between stops aligned for the periodic effect
    that gains most by it, and the starts of the periodic effects by id, with the amplitudes of a
    linear fit.
    """
    problem = search.problem
    starts = [
        h
        for e in search.effects
        if e.has_phase
        for h in search.engine.hypotheses([e], search.retuned.x)
    ]
    if not starts:
        return search, {}
    parts = angle_alignment.angle_stretches(problem)
    tiny = (STARTS.tiny_ripple, STARTS.tiny_ripple)
    trials = [
        (one.hypothesis, first_order_ripple(one, parts, problem))
        for one in differentiate_added(
            search,
            search.retuned,
            [replace(h, start=with_ripple_amplitudes(h, tiny)) for h in starts],
        )
    ]
    shift = np.zeros(parts.count)
    if parts.count > 1 and problem.rig.load["kind"] != "pendulum":
        shift = clearest_shifts(problem, parts, [one for _, one in trials])
    if shift.any():
        search = search.with_angles(search.engine.angles.shifted(parts.restart, shift))
    found: dict[tuple[str, ...], list[Hypothesis]] = {}
    for h, one in trials:
        start = with_ripple_amplitudes(h, one.amplitudes(shift))
        found.setdefault(h.ids, []).append(replace(h, start=start))
    return search, found


def first_order_ripple(
    one: AddedEffect, parts: angle_alignment.AngleStretches, problem: MeasuredProblem
) -> angle_alignment.FirstOrderRipple:
    """A periodic effect to first order, from its residuals and slopes at nearly zero amplitude."""
    at = cosine_index(one.hypothesis)
    return angle_alignment.FirstOrderRipple.of(
        parts,
        periods_per_rev(one.hypothesis, problem.rig.gearbox["ratio"]),
        one.residual,
        one.columns[:, at : at + 2],
    )


def clearest_shifts(
    problem: MeasuredProblem,
    parts: angle_alignment.AngleStretches,
    ripples: Sequence[angle_alignment.FirstOrderRipple],
) -> np.ndarray:
    """Angle shifts (stretches,) in rad for the periodic effect that gains most by them; zeros where
    some effect gains about as much without.
    """
    none = np.zeros(parts.count)
    unaligned = max(ripple.gain(none) for ripple in ripples)
    best = max(STARTS.min_alignment_gain, STARTS.min_alignment_ratio * unaligned)
    shift = none
    for ripple in ripples:
        found = ripple.best_shifts(
            [
                angle_alignment.candidate_shifts(problem, parts, g, ripple.periods)
                for g in range(parts.count)
            ],
            parts.reference,
        )
        gain = ripple.gain(found)
        if gain > best:
            best, shift = gain, found
    return shift


def align_to_best_single(search: Search) -> Search:
    """The search with shaft angles aligned by the best converged periodic effect, if that effect is
    likely better than retuning; the periodic effects are fitted again.
    """
    periodic = [search.fits[(e.id,)] for e in search.effects if e.has_phase]
    if not periodic:
        return search
    best = min(periodic, key=search.score)
    if not search.is_likely_better(best, search.retuned):
        return search
    problem, known = search.problem, search.engine.angles
    angles = angle_alignment.align_angles(problem, best.theta(problem.theta0), known)
    if angles is known:
        return search
    search = search.with_angles(angles)
    for one in periodic:
        del search.fits[key(one.ids)]
    search.fit_and_keep(
        [replace(one.hypothesis, start=one.x) for one in periodic], COMPARISON.max_rounds
    )
    return search


def align_to_selection(search: Search, best: Fit) -> tuple[Search, Fit]:
    """The search and the selected fit with the shaft angles that the fit's own parameters align in
    the problem as it was loaded, as `vgroove sim` aligns them.
    """
    problem = search.problem
    theta = best.theta(problem.theta0)
    if not angle_alignment.active_periodic_effects(problem, theta):
        return search, best
    angles = angle_alignment.align_angles(problem, theta, problem.angles)
    if search.engine.angles.equals(angles):
        return search, best
    search = search.with_angles(angles)
    again = search.engine.fit([replace(best.hypothesis, start=best.x)], COMPARISON.max_rounds)[0]
    predict_held_out(search.engine, [again])
    search.fits[key(best.ids)] = again
    return search, again


def with_ripple_amplitudes(h: Hypothesis, amplitudes: Sequence[float]) -> np.ndarray:
    """Start (p,) of a periodic effect with [amplitude cos(phase), amplitude sin(phase)]."""
    start = h.start.copy()
    start[cosine_index(h) : cosine_index(h) + 2] = amplitudes
    return np.clip(start, h.low, h.high)


def cosine_index(h: Hypothesis) -> int:
    """Index of the coordinate of role "cosine" of a periodic effect; the "sine" follows it."""
    return next(i for i, c in enumerate(h.coordinates) if c.role == "cosine")


def periods_per_rev(h: Hypothesis, ratio: float) -> float:
    """Periods per motor revolution of a periodic effect at its start; ratio: of the gearbox."""
    effect = h.ids[0]
    starts = {c.name: float(x) * c.factors[0] for c, x in zip(h.coordinates, h.start, strict=True)}
    return PERIODIC[effect].periods_per_rev(lambda name: starts[f"effects.{effect}.{name}"], ratio)


def by_effect(search: Search, fits: Sequence[Fit]) -> list[list[Fit]]:
    """Fits of single effects grouped by effect, the best start first."""
    groups: dict[str, list[Fit]] = {}
    for one in fits:
        groups.setdefault(one.ids[0], []).append(one)
    return [search.engine.closest(group) for group in groups.values()]


def screened(search: Search, starts: list[Hypothesis]) -> list[Hypothesis]:
    """The starts of an effect that are fitted; of many those of least cost, evaluated without a
    fit.

    A fit converges to a resonance, a play or a large ripple only from a start near it.
    """
    small_gap = search.score(search.retuned) < STARTS.min_squared_gap
    if starts[0].local.any():
        return regions(search, starts[0])
    if search.problem.sigma_is_bound and search.is_far_from_noise(search.retuned):
        starts = starts + large_sizes(search, starts)
    if any(c.role == "cosine" for c in starts[0].coordinates):
        hammers = search.problem.rig.mechanism["kind"] == "impact"  # no ripple stops its shaft
        if small_gap or hammers:
            return starts
        return starts + least_costly(search, [start for h in starts for start in large_ripples(h)])
    if small_gap:
        return starts[:: max(1, len(starts) // STARTS.screened)]
    return starts if len(starts) <= STARTS.max_unscreened else least_costly(search, starts)


def least_costly(search: Search, starts: list[Hypothesis]) -> list[Hypothesis]:
    """The STARTS.screened starts with the smallest sum of clipped squared residuals, not fitted."""
    shown = search.engine.residuals_of_jobs([(h, h.start[None, :]) for h in starts])
    train, clip = search.engine.train, COMPARISON.clip_sigma
    cost = [float(clipped_squares(row[train], clip).sum()) for (row,) in shown]
    return [starts[k] for k in np.argsort(cost, kind="stable")[: STARTS.screened]]


def large_sizes(search: Search, starts: list[Hypothesis]) -> list[Hypothesis]:
    """Of an effect of a hammering tool further starts, of each form that which fits best over a few
    sizes up to large ones: along a motion with impacts the response to a large size is no multiple
    of that to a small one.
    """
    sizes = np.outer([1.0, -1.0], STARTS.large_sizes).ravel()
    found = []
    for h in {h.fixed: h for h in starts}.values():
        (best, cost), *_ = sized_starts(search, h, sizes) or [(h, np.inf)]
        if cost < np.log1p(search.retuned.residual**2).sum():
            found.append(best)
    return found


def fit_along_lines(search: Search) -> None:
    """Fit the effects of a hammering tool's mechanism and joint from the best sizes on a fine grid
    where no single effect comes near the noise: they lead from one limit cycle to another one, and
    each of these is a minimum of its own.
    """
    singles = search.ranked(1)
    if not search.problem.sigma_is_bound or not singles:
        return
    if not search.is_far_from_noise(singles[0]):
        return
    sizes, starts = np.linspace(-1.0, 1.0, STARTS.on_line) * STARTS.large_sizes[-1], []
    for effect in (e for e in search.effects if e.subsystem in ("mechanism", "load")):
        h = near_start(search, search.fits[(effect.id,)])
        starts += [one for one, _ in sized_starts(search, h, sizes)[: STARTS.kept_on_line]]
    search.fit_and_keep(starts, COMPARISON.max_rounds)


def sized_starts(
    search: Search, h: Hypothesis, sizes: np.ndarray
) -> list[tuple[Hypothesis, float]]:
    """A start with other values of its leading number (k,), in plausible sizes, best first, each
    with its sum of Cauchy's losses; empty for an effect without a size of 0.
    """
    effect, scales = BY_ID[h.ids[0]], search.engine.scales
    if effect.has_phase or effect.leading.neutral != 0.0:
        return []
    unit, plausible = h.coordinates[0].factors[0], effect.leading.plausible
    scale = plausible(scales) / unit if plausible else STARTS.large_in_sizes
    values = np.unique(np.clip(scale * sizes, h.low[0], h.high[0]))
    points = np.tile(h.start, (len(values), 1))
    points[:, 0] = values
    (rows,) = search.engine.residuals_of_jobs([(h, points)])
    costs = np.array([np.log1p(row**2).sum() for row in rows])
    return [(replace(h, start=points[k]), costs[k]) for k in np.argsort(costs, kind="stable")]


def regions(search: Search, h: Hypothesis) -> list[Hypothesis]:
    """Starts of an effect that acts in a region of the log between two local numbers: of the
    regions that close most to first order those of least cost, at about their best sizes.

    The effect is simulated in each of STARTS.parts parts of the whole range; the response to a
    region is the sum of those to its parts, and least squares give its size (variable projection:
    G. H. Golub, V. Pereyra, SIAM Journal on Numerical Analysis 10, 1973).
    """
    begin, end = np.flatnonzero(h.local)
    edges = np.linspace(h.start[begin], h.start[end], STARTS.parts + 1)
    points = np.tile(h.start, (STARTS.parts, 1))
    points[:, begin], points[:, end] = edges[:-1], edges[1:]
    (rows,) = search.engine.residuals_of_jobs([(h, points)])
    train, base = search.engine.train, search.retuned.residual
    change = np.cumsum([np.zeros(train.sum()), *(np.array(rows) - base)[:, train]], axis=0)
    found = []
    for first in range(STARTS.parts):
        for last in range(first + 1, STARTS.parts + 1):
            response = change[last] - change[first]
            along, power = float(response @ base[train]), float(response @ response)
            size = max(-along, 0.0) / max(power, MIN_POWER)
            found.append((size * along, size, edges[first], edges[last]))
    starts = []
    for _, size, at, to in sorted(found)[: STARTS.regions]:
        for factor in STARTS.region_sizes:
            start = h.start.copy()
            start[0], start[begin], start[end] = factor * size * h.start[0], at, to
            starts.append(replace(h, start=np.clip(start, h.low, h.high)))
    return least_costly(search, starts)


def large_ripples(h: Hypothesis) -> list[Hypothesis]:
    """Starts of a periodic effect with large amplitudes over all phases: a large ripple stops the
    shaft, and a fit from a small amplitude does not converge to it.
    """
    at, found = cosine_index(h), []
    for size in STARTS.ripple_sizes:
        for angle in np.arange(STARTS.ripple_phases) * (2.0 * np.pi / STARTS.ripple_phases):
            start = h.start.copy()
            start[at : at + 2] = size * np.cos(angle), size * np.sin(angle)
            found.append(replace(h, start=np.clip(start, h.low, h.high)))
    return found
