"""Sets with one effect more, to first order: what a newcomer beside a fitted set promises."""

import heapq
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vgroove.gap.catalogue import BY_ID, Effect
from vgroove.gap.fitting.fit import NARROW, Fit, Hypothesis
from vgroove.gap.selection.search_state import Search, key

PROPOSALS = 6


@dataclass(frozen=True)
class AddedEffect:
    """A further effect beside a fitted set: the hypothesis of both, its residuals (n,) at its
    start, their slopes (n, new) along each new number.
    """

    hypothesis: Hypothesis
    residual: np.ndarray
    columns: np.ndarray


@dataclass(frozen=True)
class RankedExtensions:
    """What was found beside a base as it was then: its best first-order extensions, best first."""

    base: Fit
    exact: bool
    clip: float
    fits: list[Fit]


def extensions(search: Search, base: Fit, count: int = PROPOSALS) -> list[Fit]:
    """The best first-order fits (at most PROPOSALS) of base plus a further effect, best first: own
    Jacobian columns for the newcomer, those of base for the rest. They are many: they keep no
    Jacobian.
    """
    known = search.promised.get(key(base.ids))
    if (
        known is None
        or known.base is not base
        or (known.exact, known.clip) != (base.exact, search.clip)
    ):
        found = heapq.nsmallest(
            PROPOSALS,
            (first_order(search, base, one) for one in added_effects(search, base)),
            key=search.score,
        )
        search.promised[key(base.ids)] = known = RankedExtensions(
            base, base.exact, search.clip, found
        )
    return known.fits[:count]


def added_effects(search: Search, base: Fit) -> Iterator[AddedEffect]:
    """Each further effect beside base. The slopes of the last set asked for that is no smaller are
    kept: `where` asks for them again.
    """
    kept: list[tuple[Hypothesis, np.ndarray]] = []
    for one in differenced(search, base, trials_beside(search, base)):
        kept.append((one.hypothesis, one.columns))
        yield one
    if search.reach is None or len(base.ids) >= len(search.reach[0].ids):
        search.reach = base, kept


def extension_slopes(search: Search, base: Fit) -> list[tuple[Hypothesis, np.ndarray]]:
    """Hypotheses of base plus each further effect, and the slopes (n, new) along the newcomer's
    numbers.
    """
    if search.reach is not None and search.reach[0] is base:
        return search.reach[1]
    return [(one.hypothesis, one.columns) for one in added_effects(search, base)]


def trials_beside(search: Search, base: Fit) -> list[Hypothesis]:
    """Hypotheses of base plus each further effect, started from base and the newcomer's own starts."""
    return [
        h
        for effect in search.effects
        if effect.id not in base.ids
        for h in starts_beside(search, base, effect)
    ]


def starts_beside(
    search: Search, base: Fit, effect: Effect, anew: bool = False
) -> list[Hypothesis]:
    """Hypotheses of base plus an effect, started from base and the effect's own starts, anew
    wherever it ended alone; none twice.
    """
    count, trials = base.hypothesis.count, {}
    for h in search.engine.hypotheses(
        [*(BY_ID[i] for i in base.ids), effect], anew=effect if anew else None
    ):
        new = h.count - count
        if new >= 1 and same_coordinates(h, base, count):
            trial = replace(
                h,
                start=np.concatenate(
                    [base.x[:count], h.start[count : count + new], base.x[count:]]
                ),
            )
            trials.setdefault((trial.fixed, trial.start.tobytes()), trial)
    return list(trials.values())


def restarted_extensions(search: Search, base: Fit) -> list[Fit]:
    """First-order fits of base plus each effect of many starts, from the best of them beside base:
    where it ended alone it may have done another effect's work.
    """
    found = []
    for effect in (e for e in search.effects if search.engine.is_known(e) and e.id not in base.ids):
        trials = differenced(search, base, starts_beside(search, base, effect, anew=True))
        found += heapq.nsmallest(
            1, (first_order(search, base, one) for one in trials), key=search.score
        )
    return found


def differenced(search: Search, base: Fit, trials: list[Hypothesis]) -> Iterator[AddedEffect]:
    """Each trial's residuals at its start and their slopes along each of its new numbers, by one
    step forward.
    """
    engine, count = search.engine, base.hypothesis.count
    jobs = []
    for h in trials:
        steps = np.diag([c.step_at(float(x)) for c, x in zip(h.coordinates, h.start, strict=True)])[
            count : h.count
        ]
        jobs.append((h, np.vstack([h.start, h.start + steps])))
    for h, (start, *moved) in zip(trials, engine.shown(jobs), strict=True):
        yield AddedEffect(h, start, slopes(h, start, moved, count))


def slopes(h: Hypothesis, start: np.ndarray, moved: Sequence[np.ndarray], count: int) -> np.ndarray:
    """Slopes (n, new) in single precision along a newcomer's numbers, those after the first
    `count`, from residuals (n,) one step on.
    """
    out = np.zeros((len(moved), len(start)), np.float32)
    for column, c, x, row in zip(out, h.coordinates[count:], h.start[count:], moved, strict=False):
        # next to no amplitude says nothing about periods: they stay as they start
        if not c.name.endswith("periods_per_rev"):
            column[:] = (row - start) / c.step_at(float(x))
    return out.T


def same_coordinates(h: Hypothesis, base: Fit, count: int) -> bool:
    """True when an extension begins with its base's coordinates and form (a Coulomb newcomer
    changes what asymmetric_friction means, a coupler is the flanks of a play).
    """
    return h.coordinates[:count] == base.hypothesis.coordinates[:count] and set(
        base.hypothesis.fixed
    ) <= set(h.fixed)


def first_order(search: Search, base: Fit, newcomer: AddedEffect) -> Fit:
    """The extended fit as one Newton step from base predicts it."""
    engine, count, h = search.engine, base.hypothesis.count, newcomer.hypothesis
    jacobian = np.vstack([base.jacobian.T[:count], newcomer.columns.T, base.jacobian.T[count:]]).T
    one = Fit(h, h.start.copy(), newcomer.residual, jacobian, np.inf, max(base.delta, NARROW))
    whole, apart = engine.steps(one)
    one.residual = one.held = engine.foretold(one, apart, whole)
    one.x, one.jacobian = one.x + whole, jacobian[:0]
    return one
