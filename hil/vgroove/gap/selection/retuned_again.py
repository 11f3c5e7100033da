"""Repeats the fit of a rig's tolerated keys without effects, started at the values that these keys
have in fits with one effect. The sum of squares of a hammering tool has a minimum for each limit
cycle; an effect would otherwise get credit for leading the keys to a better minimum.
"""

from dataclasses import replace
from itertools import takewhile

import numpy as np

from vgroove.gap.fitting.hypothesis import Fit
from vgroove.gap.selection.search_state import Search

STARTS = 3  # single effects, those of least cost, from whose nuisance parameters it is started


def may_retune_again(search: Search) -> bool:
    """Whether the tolerated keys may have a better minimum: not where the standard deviations are
    no bounds (the motion is then smooth in its parameters) or no key is tolerated.
    """
    return bool(search.engine.nuisance) and search.problem.sigma_is_bound


def retune_again(search: Search) -> Search:
    """The search with the best known fit of the tolerated keys without effects. New fits start at
    the values of the keys in the STARTS best fits with one effect.
    """
    engine, known = search.engine, search.retuned
    singles = [f for k, f in search.fits.items() if len(k) == 1]
    ranked = engine.closest([*singles, known])
    closest = list(takewhile(lambda f: f is not known, ranked))[:STARTS]
    if not closest:
        return search
    (plain,) = engine.hypotheses([])
    search.fit_and_keep([replace(plain, start=nuisance(one)) for one in closest])
    found = search.fits[()]
    if not engine.gains_on(found, known):
        search.fits[()] = known
        return search
    engine.nuisance_columns = found.jacobian
    return replace(search, retuned=found)


def nuisance(one: Fit) -> np.ndarray:
    """The fitted values (p,) of the tolerated keys, in the coordinates of the fit."""
    return one.x[one.hypothesis.count :]
