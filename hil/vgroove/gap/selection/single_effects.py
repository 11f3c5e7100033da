"""Every effect alone: from all its starts, the shaft's angle after stops set where an effect that
follows it tells, to convergence.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vgroove.gap.fitting.cross_validation import predict_held_out
from vgroove.gap.fitting.fit import Fit, Hypothesis
from vgroove.gap.residual import angle_alignment
from vgroove.gap.residual.batches import portions
from vgroove.gap.residual.problem import Problem
from vgroove.gap.selection.extension import AddedEffect, differenced
from vgroove.gap.selection.search_state import CONVERGED, Search, key, reblock, rescale

# starts of one effect beyond which they are screened, and how many are fitted then
SCREEN_ABOVE, SCREENED = 6, 3
AMPLITUDES, PHASES = (3.0, 8.0), 8  # of a periodic effect, in its size, that are screened
STARTS = 32  # that are fitted at once, with their Jacobians in memory
MANY_STARTS = 4  # of more starts than this two are taken on
# squared gap after retuning, in noise, below which no start of a resonance, a play or a large
# ripple is looked for
LARGE = 1.1
# squared sigmas that offsets at stops must gain an effect which follows the angle; times the best
# gain without
FIRM, FIRMER = 100.0, 1.2


def singles(search: Search) -> None:
    """Every effect alone, all starts briefly, the best start of each to convergence."""
    search.tell("each effect alone")
    x_keys, swings = search.retuned.x, swinging(search)
    starts = [
        screened(search, swings.get((e.id,)) or search.engine.hypotheses([e], x_keys))
        for e in search.effects
    ]
    again = []
    for part in portions([len(group) for group in starts], STARTS):
        brief = search.engine.fit([h for group in starts[part] for h in group], 2)
        again += [
            replace(f.hypothesis, start=f.x)
            for group in by_effect(brief)
            for f in group[: 2 if len(group) > MANY_STARTS else 1]
        ]
    search.add(again, CONVERGED)
    align_to_best_single(search)
    for effect in search.effects:
        if len(search.engine.hypotheses([effect])) > SCREEN_ABOVE and not effect.phase:
            search.engine.remember(search.fits[(effect.id,)])
    rescale(search)
    reblock(search)


def swinging(search: Search) -> dict[tuple[str, ...], list[Hypothesis]]:
    """Starts of the effects that follow the angle, each with the amplitudes that a straight line
    asks for; before that the shaft of each stretch between stops, and of each log, is set where the
    one of them that gains most wants it.
    """
    engine, problem = search.engine, search.engine.problem
    starts = [
        h for e in search.effects if e.phase for h in engine.hypotheses([e], search.retuned.x)
    ]
    if not starts or not hasattr(problem, "runs"):
        return {}
    parts, found = angle_alignment.angle_stretches(problem), {}
    free = parts.count > 1 and problem.rig.load["kind"] != "pendulum"
    trials = [
        (one.hypothesis, swing_of(one, parts, problem))
        for one in differenced(
            search,
            search.retuned,
            [replace(h, start=with_ripple_amplitudes(h, (1e-3, 1e-3))) for h in starts],
        )
    ]
    shift = (
        clearest_shifts(problem, parts, [one for _, one in trials])
        if free
        else np.zeros(parts.count)
    )
    engine.problem = (
        angle_alignment.with_angle_shift(problem, parts, shift) if shift.any() else problem
    )
    for h, one in trials:
        found.setdefault(h.ids, []).append(
            replace(h, start=with_ripple_amplitudes(h, one.amplitudes(shift)))
        )
    return found


def swing_of(
    one: AddedEffect, parts: angle_alignment.AngleStretches, problem: Problem
) -> angle_alignment.FirstOrderRipple:
    """First order of a periodic effect from its residuals at next to no amplitude and their slopes."""
    at = cosine_at(one.hypothesis)
    return angle_alignment.FirstOrderRipple.of(
        parts,
        periods_of(one.hypothesis, problem.rig.gearbox["ratio"]),
        one.residual,
        one.columns[:, at : at + 2],
    )


def clearest_shifts(
    problem: Problem,
    parts: angle_alignment.AngleStretches,
    swings: Sequence[angle_alignment.FirstOrderRipple],
) -> np.ndarray:
    """Offsets (stretches,) that the effect which gains most by them wants; zeros where any gains
    about as much without.
    """
    none = np.zeros(parts.count)
    best, shift = max(FIRM, FIRMER * max(swing.gain(none) for swing in swings)), none
    for swing in swings:
        found = swing.best_shifts(
            [angle_alignment.offsets(problem, parts, g, swing.periods) for g in range(parts.count)],
            parts.reference,
        )
        gain = swing.gain(found)
        if gain > best:
            best, shift = gain, found
    return shift


def align_to_best_single(search: Search) -> None:
    """Set the stretches anew by the converged fit of the best effect that follows the angle, where
    it is a good one; fit those again.
    """
    mine = [search.fits[(e.id,)] for e in search.effects if e.phase]
    best = min(mine, key=search.score, default=search.retuned)
    if not hasattr(search.engine.problem, "runs") or not search.likely_better(best, search.retuned):
        return
    problem = search.engine.problem
    search.engine.problem = angle_alignment.align_angles(problem, best.theta(problem.theta0))
    if search.engine.problem is problem:
        return
    for one in mine:
        del search.fits[key(one.ids)]
    search.add([replace(one.hypothesis, start=one.x) for one in mine], CONVERGED)


def align_to_selection(search: Search, loaded: Problem, best: Fit) -> Fit:
    """The selected fit with the shaft's angles as anyone finds them who loads the logs with its
    parameters (`vgroove sim`).
    """
    theta = best.theta(loaded.theta0)
    if not angle_alignment.active_periodic_effects(loaded, theta):
        return best
    now, wanted = search.engine.problem, angle_alignment.align_angles(loaded, theta)
    if all(
        np.array_equal(a.restarts.measured, b.restarts.measured)
        for a, b in zip(now.runs, wanted.runs, strict=True)
    ):
        return best
    search.engine.problem = wanted
    again = search.engine.fit([replace(best.hypothesis, start=best.x)], CONVERGED)[0]
    predict_held_out(search.engine, [again])
    search.fits[key(best.ids)] = again
    return again


def with_ripple_amplitudes(h: Hypothesis, amplitudes: Sequence[float]) -> np.ndarray:
    """Start of a periodic effect with these sine and cosine amplitudes."""
    start = h.start.copy()
    start[cosine_at(h) : cosine_at(h) + 2] = amplitudes
    return np.clip(start, h.low, h.high)


def cosine_at(h: Hypothesis) -> int:
    """Place of a periodic effect's first amplitude among its numbers."""
    return next(i for i, c in enumerate(h.coordinates) if c.role == "cosine")


def periods_of(h: Hypothesis, ratio: float) -> float:
    """Periods a motor turn of a periodic effect as it starts."""
    if h.ids[0] == "gear_eccentricity":
        return 1.0 / ratio
    return next(
        (
            float(x) * c.factors[0]
            for c, x in zip(h.coordinates, h.start, strict=True)
            if c.name.endswith("periods_per_rev")
        ),
        1.0,
    )


def by_effect(fits: Sequence[Fit]) -> list[list[Fit]]:
    """Fits of single effects, effect by effect, the best start first."""
    groups: dict[str, list[Fit]] = {}
    for one in fits:
        groups.setdefault(one.ids[0], []).append(one)
    return [sorted(group, key=lambda f: f.cost) for group in groups.values()]


def screened(search: Search, starts: list[Hypothesis]) -> list[Hypothesis]:
    """The best few of many starts, by what they predict as they are: a resonance or a play is only
    found from nearby.
    """
    quiet = search.score(search.retuned) < LARGE
    if any(c.role == "cosine" for c in starts[0].coordinates):
        return (
            starts
            if quiet
            else starts + promising(search, [turned for h in starts for turned in around(h)])
        )
    if quiet:
        return starts[:: max(1, len(starts) // SCREENED)]
    return starts if len(starts) <= SCREEN_ABOVE else promising(search, starts)


def promising(search: Search, starts: list[Hypothesis]) -> list[Hypothesis]:
    """The SCREENED starts that predict best as they are."""
    shown = search.engine.shown([(h, h.start[None, :]) for h in starts])
    cost = [
        float((np.minimum(np.abs(row[search.engine.train]), search.clip) ** 2).sum())
        for (row,) in shown
    ]
    return [starts[k] for k in np.argsort(cost, kind="stable")[:SCREENED]]


def around(h: Hypothesis) -> list[Hypothesis]:
    """Starts of a periodic effect with amplitudes and phases that no straight line leads to from 0:
    large ones stop the shaft.
    """
    at, out = cosine_at(h), []
    for size in AMPLITUDES:
        for angle in np.arange(PHASES) * (2.0 * np.pi / PHASES):
            start = h.start.copy()
            start[at : at + 2] = size * np.cos(angle), size * np.sin(angle)
            out.append(replace(h, start=np.clip(start, h.low, h.high)))
    return out
