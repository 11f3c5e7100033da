"""Fits the tolerated keys of a rig without any effect once more, from the values that they have
beside single effects: where a motion may settle on several limit cycles, the sum of squares has
several minima, and a poor one would be credited to an effect.
"""

from dataclasses import replace

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
    """The search whose retuned fit is the best of all starts."""
    engine, known = search.engine, search.retuned
    if not may_retune_again(search):
        return search
    singles = [f for k, f in search.fits.items() if len(k) == 1 and f.cost < known.cost]
    closest = sorted(singles, key=lambda f: (f.cost, f.ids))[:STARTS]
    if not closest:
        return search
    (plain,) = engine.hypotheses([])
    search.fit_and_keep([replace(plain, start=nuisance(one)) for one in closest])
    found = search.fits[()]
    if not engine.is_gain(known, found.cost):
        search.fits[()] = known
        return search
    engine.nuisance_columns = found.jacobian
    return replace(search, retuned=found)


def nuisance(one: Fit) -> np.ndarray:
    """The fitted nuisance parameters (p,) of a set."""
    return one.x[one.hypothesis.count :]
