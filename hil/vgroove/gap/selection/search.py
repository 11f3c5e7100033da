"""Finds the set of effects that predicts held-out rows best: singles, then forward steps and
exchanges, then backward elimination.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vgroove.gap.catalogue import (
    BY_ID,
    FRICTION_LAWS,
    LESS_LIKELY,
    SPECIAL_CASES,
    contains,
    equations,
    equations_and_sensors,
)
from vgroove.gap.fitting.cross_validation import predict_held_out
from vgroove.gap.fitting.fit import Fit, Hypothesis
from vgroove.gap.selection.basins import deepest_minimum
from vgroove.gap.selection.extension import extensions, restarted_extensions
from vgroove.gap.selection.model_comparison import draw_means
from vgroove.gap.selection.search_state import CLIP, WORTH, Search, key, plausible, rescale
from vgroove.gap.selection.single_effects import singles

LARGEST_SET = 4
WORTH_FORM = 0.03
NEAR_NOISE = 2.0  # a set that leaves less has found what is there; real machines stay above
# of the squared gap that effects close: a form off by a quarter of its size leaves (1 / 4)^2
FORM_SHARE = 0.05
# in equations that they do not enter; of what is left there, that one effect must close
ELSEWHERE_SHARE, ELSEWHERE_PART = 0.01, 0.5
SHAPE_SHARE = 0.3 / 0.7  # by the contract an effect of another form closes at least 0.7
UNSURE_SHARE = 0.1  # of what the others close, that a member which goes by several names must gain
EXCHANGES = 3


def run(search: Search) -> tuple[Fit, list[Fit]]:
    """The whole search: the selected fit (the retuned one when no effect is worth it) and its
    rivals.
    """
    singles(search)
    best = forward(search)
    if not best.ids:
        return best, []
    best = backward(search, lean(search, best))
    search.tell("rivals")
    return settled(search, trimmed(search, exchanged(search, best), FORM_SHARE))


def settled(search: Search, best: Fit) -> tuple[Fit, list[Fit]]:
    """The selected fit and its rivals. A small member that goes by several names is none that could
    be named; nor is one that only bends another law of friction, when several laws bend it as well.
    """
    found = rivals(search, best)
    doubtful = [i for i in best.ids if any(i not in f.ids for f in found)]
    leaner = trimmed(search, best, UNSURE_SHARE, doubtful) if doubtful else best
    bends = bending(best, found)
    leaner = trimmed(search, best, SHAPE_SHARE, bends) if leaner is best and bends else leaner
    return (best, found) if leaner is best else settled(search, leaner)


def bending(best: Fit, found: Sequence[Fit]) -> list[str]:
    """Laws of friction in the best set that rivals replace by other such laws, beside one that
    stays.
    """
    replaced = {
        i: [set(f.ids) - set(best.ids) for f in found if i not in f.ids]
        for i in FRICTION_LAWS.intersection(best.ids)
    }
    if len(replaced) < 2:
        return []
    return sorted(
        i
        for i, instead in replaced.items()
        if instead and all(new <= FRICTION_LAWS for new in instead)
    )


def forward(search: Search) -> Fit:
    """Grow the set while a further effect, or an exchange, is better in both senses."""
    best = (
        simplest(search, deepest_minimum(search, search.ranked(1)[0]))
        if search.ranked(1)
        else search.retuned
    )
    if not search.better(best, search.retuned) or not search.visible(best):
        pair = grow(search, best)
        return (
            pair
            if pair is not None and search.better(pair, search.retuned) and search.visible(pair)
            else search.retuned
        )
    while len(best.ids) < LARGEST_SET:
        larger = grow(search, best)
        if larger is not None and not search.better(larger, best):
            larger = two_further(search, best, larger)
        if larger is None:
            return best
        best = larger
        if search.score(best) < NEAR_NOISE**2:
            rescale(search)
    return best


def two_further(search: Search, base: Fit, larger: Fit) -> Fit | None:
    """A set of two more effects than base that is better than base, where one more gains enough and
    still is not: what the second leaves may hide what the first gains. It is looked for only where
    both promise to close the larger part of what is left: effects that are there leave nothing.
    """
    if (
        not gains(search, larger, base)
        or not has_room_for_two(search, base)
        or len(larger.ids) >= LARGEST_SET
    ):
        return None
    promised = extensions(search, larger)
    if not promised or search.score(promised[0]) - search.level() > 0.5 * (
        search.score(base) - search.level()
    ):
        return None
    search.add(distinct(promised))
    both = simplest(search, search.ranked(len(larger.ids) + 1)[0], base)
    return both if search.better(both, base, 2.0 * WORTH) else None


def has_room_for_two(search: Search, base: Fit) -> bool:
    """Whether base leaves a gap that is one, and one from which two effects could take more than
    its members' forms may leave.
    """
    above = search.score(base) - search.level()
    return search.leaves_a_gap(base) and above > 2.0 * FORM_SHARE * (
        search.score(search.retuned) - search.score(base)
    )


def grow(search: Search, base: Fit) -> Fit | None:
    """Best converged set with one more effect than base: extensions of base and of its closest
    rivals.
    """
    search.tell(f"a further effect beside {', '.join(base.ids)}")
    size = len(base.ids) + 1
    rivals = (
        []
        if nothing_left(search, base)
        else [f for f in search.ranked(size - 1) if key(f.ids) != key(base.ids)][:2]
    )
    proposals = [f for rival in rivals for f in extensions(search, rival, 3)]
    search.add(distinct(extensions(search, base) + proposals))
    found = next(iter(search.ranked(size)), base)
    if search.leaves_a_gap(found):
        search.add(
            distinct(
                [
                    one
                    for one in restarted_extensions(search, base)
                    if search.score(one) < search.score(found)
                ]
            )
        )
    ranked = search.ranked(size)
    return simplest(search, deepest_minimum(search, ranked[0]), base) if ranked else None


def nothing_left(search: Search, base: Fit) -> bool:
    """Whether base leaves so little above the noise that no further effect, beside it or beside its
    rivals, could be worth its place.
    """
    return search.score(base) < (1.0 + WORTH) * search.level()


def simplest(search: Search, best: Fit, base: Fit | None = None) -> Fit:
    """Put special cases in the place of general effects that are not clearly better, as long as
    they gain anything over a base.
    """
    for member in best.ids:
        known = {e.id for e in search.effects} - set(best.ids)
        for special in (s for s in SPECIAL_CASES.get(member, ()) if s in known):
            one = fit_set(search, [special if i == member else i for i in best.ids], best)
            if not search.better(best, one, WORTH_FORM) and gains(search, one, base):
                return simplest(search, one, base)
    return best


def gains(search: Search, one: Fit, base: Fit | None) -> bool:
    """Whether a set leaves less than a base by an amount that matters."""
    return base is None or search.score(base) - search.score(one) > search.least_gain(base)


def distinct(proposals: Sequence[Fit]) -> list[Hypothesis]:
    """Hypotheses of first-order fits, each set once in each form."""
    seen: dict[tuple[object, ...], Hypothesis] = {}
    for one in proposals:
        seen.setdefault((key(one.ids), one.hypothesis.fixed), replace(one.hypothesis, start=one.x))
    return list(seen.values())


def fit_set(search: Search, ids: Sequence[str], near: Fit) -> Fit:
    """Converged fit of a set of ids, started from the numbers of a related fit."""
    known = search.fits.get(key(ids))
    if known is not None:
        predict_held_out(search.engine, [known])
        return known
    return search.add(started(search, ids, near))[0]


def started(search: Search, ids: Sequence[str], near: Fit) -> list[Hypothesis]:
    """Hypotheses of a set of ids, one of each form (no slope leads to another), that start from the
    numbers of a related fit.
    """
    values = {c.name: x for c, x in zip(near.hypothesis.coordinates, near.x, strict=True)}
    forms: dict[tuple[tuple[int, float], ...], Hypothesis] = {}
    for h in search.engine.hypotheses([BY_ID[i] for i in ids]):
        start = np.array(
            [values.get(c.name, s) for c, s in zip(h.coordinates, h.start, strict=True)]
        )
        forms.setdefault(h.fixed, replace(h, start=np.clip(start, h.low, h.high)))
    return list(forms.values())


def leaner(search: Search, best: Fit) -> list[Fit]:
    """The sets of all members but one. Each starts once from the best set's numbers too: what it
    was first fitted from may have led it astray, and a member that is needed nowhere else would
    then be kept.
    """
    if search.leaned is not best:
        search.add([h for i in best.ids for h in started(search, others(best, i), best)])
        search.leaned = best
    return [without(search, best, i) for i in best.ids]


def without(search: Search, best: Fit, member: str) -> Fit:
    """Converged fit of all members but one."""
    return fit_set(search, others(best, member), best)


def others(best: Fit, member: str) -> list[str]:
    """All members but one."""
    return [i for i in best.ids if i != member]


def backward(search: Search, best: Fit) -> Fit:
    """Drop members that are not worth their place, the least useful first."""
    search.tell("is every effect needed")
    while len(best.ids) > 1:
        leanest = min(leaner(search, best), key=search.score)
        if search.better(best, leanest):
            return best
        best = leanest
    return best


def trimmed(search: Search, best: Fit, share: float, members: Sequence[str] | None = None) -> Fit:
    """The best set without those members (default: any) that do so little beside the others that it
    may be what the others' forms leave.
    """
    while len(best.ids) > 1:
        leanest = min(
            (without(search, best, i) for i in best.ids if members is None or i in members),
            key=search.score,
            default=best,
        )
        if leanest is best or beyond_forms(
            search,
            best,
            leanest,
            ELSEWHERE_SHARE if works_elsewhere(search, best, leanest) else share,
        ):
            return best
        best = leanest
    return best


def works_elsewhere(search: Search, best: Fit, leaner: Fit) -> bool:
    """Whether what a leaner set lacks enters equations that its forms do not reach, and closes the
    larger part of what it leaves: there they leave little, and what they leave no single effect
    closes.
    """
    mine = frozenset().union(*map(equations, set(best.ids) - set(leaner.ids)))
    gain = search.score(leaner) - search.score(best)
    return not mine & frozenset().union(
        *map(equations_and_sensors, leaner.ids)
    ) and gain > ELSEWHERE_PART * (search.score(leaner) - search.level())


def beyond_forms(search: Search, best: Fit, leaner: Fit, share: float) -> bool:
    """Whether a set gains more than a share of what a leaner one closes, over all signals or in one
    of them: what the form of an effect leaves lies where the effect shows. Gaps are as the contract
    clips them, whatever the search compares in.
    """
    left, more, alone = (search.by_signal(f, CLIP) for f in (best, leaner, search.retuned))
    beyond = more - left - share * np.maximum(alone - more, 0.0)
    return bool(
        np.sum(more - left) > share * np.sum(alone - more)
        or np.max(beyond) > search.least_gain(leaner)
    )


def exchanged(search: Search, best: Fit) -> Fit:
    """The best set after exchanges of one member, as long as one is clearly better; steps that add
    one effect at a time miss pairs whose members say little alone.
    """
    for _ in range(EXCHANGES):
        exchange(search, best)
        other = search.ranked(len(best.ids))[0]
        if other is best or search.score(other) >= search.score(best) or search.tied(best, other):
            break
        best = backward(search, lean(search, simplest(search, other)))
    return best


def rivals(search: Search, best: Fit) -> list[Fit]:
    """Converged sets that predict the held-out rows as well as best, are no larger, and do not just
    generalise it; best first.
    """
    pool = [
        f
        for k, f in search.fits.items()
        if k and key(best.ids) != k and f.hypothesis.count <= best.hypothesis.count + 2
    ]
    pool = [
        f
        for f in pool
        if len(f.ids) <= len(best.ids) and plausible(f) and not contains(f.ids, best.ids)
    ]
    return sorted((f for f in pool if search.tied(f, best)), key=search.score)


def exchange(search: Search, best: Fit) -> None:
    """Try every other effect in each member's place, to first order, and converge the close ones."""
    if len(best.ids) < 2:
        return
    close: list[Fit] = []
    for out in best.ids:
        close += [
            f
            for f in extensions(search, without(search, best, out), 4)
            if key(f.ids) not in search.fits
        ]
    search.add(distinct(close))


def lean(search: Search, best: Fit) -> Fit:
    """Between equals the one with fewer numbers: a special case unless the general effect is
    clearly better, or any tied set; between sets of as many numbers that leave the same the
    likelier effects (added inertia rather than a clock that is off).
    """
    for one in sorted(
        (f for k, f in search.fits.items() if k and plausible(f)),
        key=lambda f: (*preference(search, f), search.score(f)),
    ):
        if not preferred(search, one, best) or len(one.ids) > len(best.ids):
            continue
        if (
            not search.better(best, one, WORTH_FORM)
            if contains(best.ids, one.ids)
            else search.tied(one, best)
        ):
            return one
    return best


def preferred(search: Search, one: Fit, best: Fit) -> bool:
    """Whether a set goes before the best one between equals; rare effects give way only where both
    leave the same.
    """
    mine, its = preference(search, one), preference(search, best)
    return mine[:2] < its[:2] or mine < its and search.alike(one, best)


def preference(search: Search, one: Fit) -> tuple[bool, int, int]:
    """Smaller is preferred between equals: what the edges do not contradict, fitted numbers, then
    rare effects.
    """
    return search.contradicted(one), one.hypothesis.count, sum(i in LESS_LIKELY for i in one.ids)


def win_shares(search: Search, candidates: Sequence[Fit]) -> np.ndarray:
    """Share of bootstrap draws in which each candidate set wins, with a handicap for each further
    number.
    """
    worth = 0.5 * WORTH * search.level()
    means = np.stack(
        [draw_means(search.blocks, search.sums(f)) + worth * f.hypothesis.count for f in candidates]
    )
    return np.bincount(np.argmin(means, axis=0), minlength=len(candidates)) / means.shape[1]
