"""Converged fits of chosen sets of effects: started from a related fit, one member removed, or a
general effect replaced by its special case.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vgroove.gap.catalogue import BY_ID, SPECIAL_CASES
from vgroove.gap.fitting.cross_validation import predict_held_out
from vgroove.gap.fitting.hypothesis import Fit, Hypothesis
from vgroove.gap.selection.search_state import Search, key


def fit_set(search: Search, ids: Sequence[str], near: Fit) -> Fit:
    """Converged fit of a set of ids, started from the parameter values of a related fit."""
    known = search.fits.get(key(ids))
    if known is not None:
        predict_held_out(search.engine, [known])
        return known
    return fit_near(search, ids, near)


def fit_near(search: Search, ids: Sequence[str], near: Fit) -> Fit:
    """Converged fit of a set of ids, started from the parameter values of a related fit even where
    the set is known: the better of both.
    """
    one = search.fit_and_keep(hypotheses_near(search, ids, near))[0]
    predict_held_out(search.engine, [one])
    return one


def fit_without(search: Search, best: Fit, member: str) -> Fit:
    """Converged fit of all members of a set but one."""
    return fit_set(search, ids_without(best, member), best)


def ids_without(best: Fit, member: str) -> list[str]:
    """All members of a set but one."""
    return [i for i in best.ids if i != member]


def hypotheses_near(search: Search, ids: Sequence[str], near: Fit) -> list[Hypothesis]:
    """Hypotheses of a set of ids, started from the parameter values of a related fit.

    There is one hypothesis of each form (lag or delay, whose clock): no gradient leads from one
    form to another.
    """
    values = {c.name: x for c, x in zip(near.hypothesis.coordinates, near.x, strict=True)}
    forms: dict[tuple[tuple[int, float], ...], Hypothesis] = {}
    for h in search.engine.hypotheses([BY_ID[i] for i in ids]):
        start = np.array(
            [values.get(c.name, s) for c, s in zip(h.coordinates, h.start, strict=True)]
        )
        forms.setdefault(h.fixed, replace(h, start=np.clip(start, h.low, h.high)))
    return list(forms.values())


def distinct_hypotheses(proposals: Sequence[Fit]) -> list[Hypothesis]:
    """Hypotheses of first-order fits, started where these end; each set once in each form."""
    found: dict[tuple[object, ...], Hypothesis] = {}
    for one in proposals:
        found.setdefault((key(one.ids), one.hypothesis.fixed), replace(one.hypothesis, start=one.x))
    return list(found.values())


def prefer_special_cases(search: Search, best: Fit, base: Fit | None = None) -> Fit:
    """The set with each general effect replaced by its special case, where the general effect does
    not outdo it and the set with the special case gains more than the minimum effect size over a
    base set.

    Both must have ended in the same minimum: the special case is fitted again from the values of
    the general one, even where it is known.
    """
    for member in best.ids:
        known = {e.id for e in search.effects} - set(best.ids)
        for special in (s for s in SPECIAL_CASES.get(member, ()) if s in known):
            one = fit_near(search, [special if i == member else i for i in best.ids], best)
            if not search.outdoes_special_case(best, one) and gains(search, one, base):
                return prefer_special_cases(search, one, base)
    return best


def gains(search: Search, one: Fit, base: Fit | None) -> bool:
    """Whether a set gains more than the minimum effect size over a base set; True without one."""
    return base is None or search.score(base) - search.score(one) > search.min_gain(base)
