"""Forward stepwise selection: grows the set of effects while a further one is significantly better
and gains more than the minimum effect size.
"""

import numpy as np

from vgroove.gap.fitting.hypothesis import Fit
from vgroove.gap.selection.basins import deepest_minimum
from vgroove.gap.selection.candidate_sets import distinct_hypotheses, gains, prefer_special_cases
from vgroove.gap.selection.discrepancy import rescale
from vgroove.gap.selection.extension import extensions, restarted_extensions
from vgroove.gap.selection.limits import STEPWISE
from vgroove.gap.selection.search_state import COMPARISON, Search, key


def forward(search: Search) -> tuple[Search, Fit]:
    """The search, rescaled after each step, and the last of a sequence of growing sets of which
    each is better than the one before; the retuned fit where no effect is better.
    """
    if not search.may_have_gap:
        return search, search.retuned
    best = best_single(search)
    if not is_visibly_better(search, best):
        pair = grow(search, best)
        if pair is None or not is_visibly_better(search, pair):
            return search, search.retuned
        best, search = pair, rescale(search)
    while len(best.ids) < STEPWISE.max_effects and leaves_enough(search, best):
        larger = grow(search, best)
        if larger is not None and not search.is_better(larger, best):
            larger = add_two(search, best, larger)
        if larger is None or not gains_enough_to_grow(search, larger, best):
            break
        best = larger
        search = rescale(search)
    return search, best


def best_single(search: Search) -> Fit:
    """The best single effect, or the retuned fit where none could be fitted."""
    singles = search.ranked(1)
    if not singles:
        return search.retuned
    return prefer_special_cases(search, deepest_minimum(search, singles[0]))


def is_visibly_better(search: Search, one: Fit) -> bool:
    """Whether a set is better than retuning and closes a visible gap."""
    return search.is_better(one, search.retuned) and search.closes_visible_gap(one)


def add_two(search: Search, base: Fit, larger: Fit) -> Fit | None:
    """A set of two more effects that is better than base, where the gain of one more, `larger`, is
    not significant: the gap of the second may hide the gain of the first.

    It is fitted only where both are predicted to close the larger part of what is left.
    """
    if (
        not gains(search, larger, base)
        or not leaves_enough_for_two(search, base)
        or len(larger.ids) >= STEPWISE.max_effects
    ):
        return None
    candidates = extensions(search, larger)
    if not candidates or search.excess_power(
        candidates[0]
    ) > STEPWISE.max_part_left_by_two * search.excess_power(base):
        return None
    search.fit_and_keep(distinct_hypotheses(candidates))
    sets = search.ranked(len(larger.ids) + 1)
    if not sets:
        return None
    both = prefer_special_cases(search, sets[0], base)
    return both if search.is_better(both, base, 2.0 * COMPARISON.min_gain) else None


def gains_enough_to_grow(search: Search, larger: Fit, base: Fit) -> bool:
    """Whether the further member of a larger set gains enough of what the base leaves. Near the
    noise any significant gain suffices: a set without remainder is named as it was selected.
    """
    if np.all(search.engine.discrepancy == 1.0):
        return True
    gain = search.score(base) - search.score(larger)
    return gain >= COMPARISON.min_growth_of_left * (search.score(base) - search.floor_power)


def leaves_enough(search: Search, base: Fit) -> bool:
    """Whether a set of the torque balance is extended; along a forward simulation a set is extended
    down to the noise.
    """
    return search.gap_problem is None or leaves_established_share(search, base)


def leaves_established_share(search: Search, base: Fit) -> bool:
    """Whether a further member could gain the share that an established one needs, over all signals
    or in one alone.
    """
    return search.is_substantial(search.loss_by_column(base) - search.floor_by_column)


def leaves_enough_for_two(search: Search, base: Fit) -> bool:
    """Whether base leaves a visible gap that is larger than twice the form error of its members."""
    closed = search.score(search.retuned) - search.score(base)
    return search.leaves_gap(base) and (
        search.excess_power(base) > 2.0 * STEPWISE.max_form_share * closed
    )


def grow(search: Search, base: Fit) -> Fit | None:
    """Best converged set with one effect more than base, from extensions of base and of its closest
    rivals.
    """
    search.progress(f"a further effect beside {', '.join(base.ids)}")
    size = len(base.ids) + 1
    proposals = [
        f
        for rival in close_rivals(search, base)
        for f in extensions(search, rival, STEPWISE.extensions_of_rival)
    ]
    search.fit_and_keep(distinct_hypotheses(extensions(search, base) + proposals))
    found = next(iter(search.ranked(size)), base)
    if search.leaves_gap(found):
        restarted = restarted_extensions(search, base)
        limit = search.score(found)
        search.fit_and_keep(
            distinct_hypotheses([one for one in restarted if search.score(one) < limit])
        )
    ranked = search.ranked(size)
    if not ranked:
        return None
    return prefer_special_cases(search, deepest_minimum(search, ranked[0]), base)


def close_rivals(search: Search, base: Fit) -> list[Fit]:
    """The best other sets of the same size; none where base leaves too little for any further
    effect.
    """
    if leaves_nothing(search, base):
        return []
    others = [f for f in search.ranked(len(base.ids)) if key(f.ids) != key(base.ids)]
    return others[: STEPWISE.rivals_extended]


def leaves_nothing(search: Search, base: Fit) -> bool:
    """Whether base leaves less above the noise than the minimum effect size."""
    return search.score(base) < (1.0 + COMPARISON.min_gain)
