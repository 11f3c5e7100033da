"""Candidates of forward selection: a fitted set with one effect more, predicted to first order.

One Gauss-Newton step from the fitted set predicts the gain of each further effect without a fit of
its own. Only the best candidates are then fitted.
"""

import heapq
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np

from vgroove.gap.catalogue import BY_ID, Effect
from vgroove.gap.fitting.engine import FINAL_HUBER_SIGMAS
from vgroove.gap.fitting.hypothesis import Fit, Hypothesis
from vgroove.gap.fitting.steps import difference_steps
from vgroove.gap.selection.search_state import Search, key

# first-order candidates that are kept of a set; chosen on the tuning half of the blind set
# (docs/gap_bench.md)
MAX_EXTENSIONS = 6
MAX_STARTS = 2  # of these, candidates with the same further effect at other start values
NO_COST = np.inf  # cost of a first-order fit, which is not evaluated


@dataclass(frozen=True)
class AddedEffect:
    """A further effect beside a fitted set: hypothesis of both, its residuals (n,) at its start,
    and their slopes (n, new) along each new parameter.
    """

    hypothesis: Hypothesis
    residual: np.ndarray
    columns: np.ndarray


@dataclass(frozen=True)
class RankedExtensions:
    """The best first-order extensions of a base set, best first, with the state of the search in
    which they were computed.
    """

    base: Fit
    exact: bool
    fits: list[Fit]

    def holds_for(self, base: Fit) -> bool:
        """Whether they were computed for this base set in its present state."""
        return self.base is base and self.exact == base.exact


def extensions(search: Search, base: Fit, count: int = MAX_EXTENSIONS) -> list[Fit]:
    """The best first-order fits (at most MAX_EXTENSIONS) of base plus a further effect, best first.

    The columns of the Jacobian are computed for the further effect and taken from base for the
    rest. The fits keep no Jacobian, because they are many.
    """
    known = search.cache.extensions.get(key(base.ids))
    if known is None or not known.holds_for(base):
        every = (first_order(search, base, one) for one in added_effects(search, base))
        found = heapq.nsmallest(
            MAX_EXTENSIONS, best_of_each_effect(every, search.score), key=search.score
        )
        known = RankedExtensions(base, base.exact, found)
        search.cache.extensions[key(base.ids)] = known
    return known.fits[:count]


def best_of_each_effect(fits: Iterable[Fit], score: Callable[[Fit], float]) -> list[Fit]:
    """Of the fits that end with the same effect, the MAX_STARTS of the smallest score: an effect
    with many start values must not take the places of all other effects. The rest is not kept in
    memory, because each fit holds the residuals of all rows.
    """
    best: dict[str, list[tuple[float, Fit]]] = {}
    for one in fits:
        mine = best.setdefault(one.ids[-1], [])
        mine.append((score(one), one))
        mine.sort(key=itemgetter(0))
        del mine[MAX_STARTS:]
    return [one for mine in best.values() for _, one in mine]


def added_effects(search: Search, base: Fit) -> list[AddedEffect]:
    """Each further effect beside base. Those of the largest base are cached, because beam search
    and location of the gap use them again.
    """
    found = cached_effects(search, base)
    if found is None:
        found = list(differentiate_added(search, base, hypotheses_beside(search, base)))
        largest = search.cache.added
        if largest is None or len(base.ids) >= len(largest[0].ids):
            search.cache.added = base, found
    return found


def cached_effects(search: Search, base: Fit) -> list[AddedEffect] | None:
    """What added_effects() has cached for this base set, None if nothing."""
    cached = search.cache.added
    return cached[1] if cached is not None and cached[0] is base else None


def slopes_of_subsystem(search: Search, base: Fit, subsystem: str) -> list[np.ndarray]:
    """Derivatives (n, new) of the residuals with respect to the parameters of each further effect
    of one subsystem, one array for each effect.
    """
    found = cached_effects(search, base)
    if found is None:
        trials = [
            h for h in hypotheses_beside(search, base) if BY_ID[h.ids[-1]].subsystem == subsystem
        ]
        return [one.columns for one in differentiate_added(search, base, trials)]
    return [a.columns for a in found if BY_ID[a.hypothesis.ids[-1]].subsystem == subsystem]


def hypotheses_beside(search: Search, base: Fit) -> list[Hypothesis]:
    """Hypotheses of base plus each further effect, from base and from the effect's own starts."""
    return [
        h
        for effect in search.effects
        if effect.id not in base.ids
        for h in starts_beside(search, base, effect)
    ]


def starts_beside(
    search: Search, base: Fit, effect: Effect, restart: bool = False
) -> list[Hypothesis]:
    """Hypotheses of base plus an effect, started from base and from the effect's stored fit or,
    with restart or without such a fit, from all of its catalogue starts. Equal ones occur once.
    """
    count, trials = base.hypothesis.count, {}
    for h in search.engine.hypotheses(
        [*(BY_ID[i] for i in base.ids), effect], from_catalogue=effect if restart else None
    ):
        new = h.count - count
        if new >= 1 and extends_base(h, base, count):
            trial = replace(
                h,
                start=np.concatenate(
                    [base.x[:count], h.start[count : count + new], base.x[count:]]
                ),
            )
            trials.setdefault((trial.fixed, trial.start.tobytes()), trial)
    return list(trials.values())


def restarted_extensions(search: Search, base: Fit) -> list[Fit]:
    """First-order fits of base plus each effect of many starts, from the best of its starts.

    The fit of such an effect alone may have converged to values that imitate a member of base.
    """
    found = []
    for effect in (e for e in search.effects if search.engine.is_known(e) and e.id not in base.ids):
        trials = differentiate_added(
            search, base, starts_beside(search, base, effect, restart=True)
        )
        found += heapq.nsmallest(
            1, (first_order(search, base, one) for one in trials), key=search.score
        )
    return found


def differentiate_added(
    search: Search, base: Fit, trials: list[Hypothesis]
) -> Iterator[AddedEffect]:
    """Each trial's residuals at its start, and their slopes along its new parameters by forward
    differences.
    """
    engine, count = search.engine, base.hypothesis.count
    jobs = []
    for h in trials:
        steps = np.diag(difference_steps(h, h.start))[count : h.count]
        jobs.append((h, np.vstack([h.start, h.start + steps])))
    for h, (start, *moved) in zip(trials, engine.residuals_of_jobs(jobs), strict=True):
        # a copy: a view would keep the whole batch of residuals
        yield AddedEffect(h, start.copy(), forward_differences(h, start, moved, count))


def forward_differences(
    h: Hypothesis, start: np.ndarray, moved: Sequence[np.ndarray], count: int
) -> np.ndarray:
    """Slopes (n, new) in single precision along the parameters after the first `count`, from the
    residuals (n,) at the start and one step along each.
    """
    out = np.zeros((len(moved), len(start)), np.float32)
    steps = difference_steps(h, h.start)[count:]
    for column, c, step, row in zip(out, h.coordinates[count:], steps, moved, strict=False):
        # at nearly zero amplitude the number of periods has no effect: it keeps its start
        if not c.name.endswith("periods_per_rev"):
            column[:] = (row - start) / step
    return out.T


def extends_base(h: Hypothesis, base: Fit, count: int) -> bool:
    """Whether an extension begins with the coordinates and the form of its base.

    It does not where a member has other coordinates beside the further effect: beside Coulomb
    friction asymmetric_friction is a constant torque, and beside a play (gear_backlash) a coupler
    is the stiffness and damping of the play's flanks.
    """
    return h.coordinates[:count] == base.hypothesis.coordinates[:count] and set(
        base.hypothesis.fixed
    ) <= set(h.fixed)


def first_order(search: Search, base: Fit, added: AddedEffect) -> Fit:
    """The extended fit as one Gauss-Newton step from base predicts it."""
    engine, count, h = search.engine, base.hypothesis.count, added.hypothesis
    jacobian = np.vstack([base.jacobian.T[:count], added.columns.T, base.jacobian.T[count:]]).T
    one = Fit(
        h, h.start.copy(), added.residual, jacobian, NO_COST, max(base.delta, FINAL_HUBER_SIGMAS)
    )
    whole, apart = engine.steps(one)
    one.residual = one.out_of_fold = engine.predict_first_order(one, apart, whole)
    one.x, one.jacobian = one.x + whole, jacobian[:0]
    return one
