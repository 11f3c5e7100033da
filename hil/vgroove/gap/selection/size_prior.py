"""How plausible the fitted sizes of a set of effects are in practice: the prior of
docs/spec/gap.md, section 5, which decides between sets that predict equally well.
"""

import numpy as np

from vgroove.gap.catalogue import BY_ID, Effect
from vgroove.gap.fitting.hypothesis import Fit
from vgroove.gap.selection.search_state import Search

MIN_PRIOR = 0.01  # smallest density of a plausible size, relative to that at 0
MIN_PRIOR_ODDS = 3.0  # of two tied sets, by which their sizes decide


def is_implausible(search: Search, one: Fit) -> bool:
    """Whether the prior density of a set's sizes is below MIN_PRIOR of that at sizes of 0."""
    return prior_density(search, one) < MIN_PRIOR


def prior_excludes(search: Search, rival: Fit, best: Fit) -> bool:
    """Whether the prior of the sizes decides against a tied set that has no fewer parameters than
    the best one.
    """
    odds = prior_density(search, best) / prior_density(search, rival)
    return rival.hypothesis.count >= best.hypothesis.count and odds > MIN_PRIOR_ODDS


def prior_density(search: Search, one: Fit) -> float:
    """Prior probability density of the sizes of a set's effects, divided by that at sizes of 0."""
    density = np.prod([size_density(search, one, BY_ID[i]) for i in one.ids])
    return max(float(density), np.finfo(float).tiny)


def size_density(search: Search, one: Fit, effect: Effect) -> float:
    """Prior density of the size of a member, relative to that at 0: Student's t of 3 degrees of
    freedom in units of the size that the catalogue calls plausible, of the least plausible of its
    numbers. Of an effect that the rig states already the change is its size.
    """
    stated, scales = search.problem.theta0, search.engine.scales
    theta = one.theta(stated)
    columns = [search.problem.index(effect.column(p)) for p in effect.parameters]
    distance = max(
        p.implausibility(float(theta[k]), scales, float(stated[k]))
        for p, k in zip(effect.parameters, columns, strict=True)
    )
    return float((1.0 + distance**2 / 3.0) ** -2.0)
