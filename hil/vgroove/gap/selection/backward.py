"""Backward stepwise selection: drops the members of a set whose gain is too small, or no larger
than the form error of another member (see limits.py).
"""

from collections.abc import Sequence

import numpy as np

from vgroove.gap.catalogue import equations, equations_and_sensors
from vgroove.gap.fitting.hypothesis import Fit
from vgroove.gap.selection.candidate_sets import fit_without, hypotheses_near, ids_without
from vgroove.gap.selection.limits import STEPWISE
from vgroove.gap.selection.search_state import Search


def backward(search: Search, best: Fit) -> Fit:
    """The set without the members whose gain is not significant; the member of the smallest gain is
    removed first.
    """
    search.progress("whether every effect is needed")
    while len(best.ids) > 1:
        leanest = min(leaner_sets(search, best), key=search.score)
        if search.is_better(best, leanest):
            return best
        best = leanest
    return best


def leaner_sets(search: Search, best: Fit) -> list[Fit]:
    """The sets of all members but one.

    Each is fitted once more from the fuller set's values: its own first fit may have ended in a
    poor local minimum, from which the gain of the removed member would be overestimated.
    """
    if search.cache.refitted_leaner is not best:
        search.fit_and_keep(
            [h for i in best.ids for h in hypotheses_near(search, ids_without(best, i), best)]
        )
        search.cache.refitted_leaner = best
    return [fit_without(search, best, i) for i in best.ids]


def drop_form_corrections(
    search: Search, best: Fit, share: float, members: Sequence[str] | None = None
) -> Fit:
    """The set without the members (of those given; default: any) whose gain may be a form error of
    the others: it is no more than `share` of what the others close.
    """
    while len(best.ids) > 1:
        leanest = min(
            (fit_without(search, best, i) for i in best.ids if members is None or i in members),
            key=search.score,
            default=best,
        )
        if leanest is best:
            return best
        elsewhere = acts_elsewhere(search, best, leanest)
        allowed = STEPWISE.max_form_share_elsewhere if elsewhere else share
        if exceeds_form_error(search, best, leanest, allowed):
            return best
        best = leanest
    return best


def acts_elsewhere(search: Search, best: Fit, leaner: Fit) -> bool:
    """Whether the removed member enters only equations that the other members do not, and closes
    the larger part of what they leave.

    In these equations the form errors of the others are small, and one effect cannot close them.
    """
    removed = frozenset().union(*map(equations, set(best.ids) - set(leaner.ids)))
    gain = search.score(leaner) - search.score(best)
    part = STEPWISE.min_part_elsewhere * (search.score(leaner) - 1.0)
    return not removed & frozenset().union(*map(equations_and_sensors, leaner.ids)) and gain > part


def exceeds_form_error(search: Search, best: Fit, leaner: Fit, share: float) -> bool:
    """Whether a set gains more than a share of what a leaner one closes, over all signals or in one
    of them: the form error of an effect is large only in the signals in which the effect is large.
    """
    left, more, alone = (search.loss_by_column(f) for f in (best, leaner, search.retuned))
    beyond = more - left - share * np.maximum(alone - more, 0.0)
    return bool(
        np.sum(more - left) > share * np.sum(alone - more)
        or np.max(beyond) > search.min_gain(leaner)
    )
