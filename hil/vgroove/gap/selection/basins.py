"""Looks around a fit with a ripple of torque, where no slope leads on.

A cogging that stops the shaft makes the squared gap a staircase over its amplitude and phase;
Gauss-Newton ends on some step of it. The steps near by are tried as they are, rings of them around
the fit, coarse to fine, and a better one is fitted in its turn.
"""

from dataclasses import replace

import numpy as np

from vgroove.gap.fitting.cross_validation import predict_held_out
from vgroove.gap.fitting.fit import Fit
from vgroove.gap.fitting.neighbour_points import SPREADS, ripple_neighbours
from vgroove.gap.selection.search_state import CONVERGED, Search, key

MOVES = 3  # fits that one ring may ask for


def deepest_minimum(search: Search, one: Fit) -> Fit:
    """The best fit of a set that leaves a gap around one of it, its ripples somewhat larger,
    smaller or turned.
    """
    best = one
    for spread in SPREADS if search.leaves_a_gap(one) else ():
        for _ in range(MOVES):
            moved = better_neighbour(search, best, spread)
            if moved is None:
                break
            best = moved
    if best is not one:
        predict_held_out(search.engine, [best])
        search.fits[key(best.ids)] = best
    return best


def better_neighbour(search: Search, one: Fit, spread: float) -> Fit | None:
    """A converged fit that leaves less than one, from the best point of the rings around it; none
    where no point leaves less.
    """
    points = ripple_neighbours(one, spread)
    if not len(points):
        return None
    costs = search.engine.costs(one, points)
    if not search.engine.is_gain(one, min(costs)):
        return None
    again = search.engine.fit(
        [replace(one.hypothesis, start=points[int(np.argmin(costs))])], CONVERGED
    )[0]
    return again if search.engine.is_gain(one, again.cost) else None
