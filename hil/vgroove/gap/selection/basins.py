"""Continues a fit with a torque ripple from a poor local minimum by a pattern search.

A cogging that stops the shaft makes the squared gap piecewise constant over its amplitude and
phase, so that Gauss-Newton stops on the piece on which it starts. The pattern search evaluates
square grids of points around the fit ("rings"), wide to narrow; a better point is the start of a
further fit.
"""

from dataclasses import replace

import numpy as np

from vgroove.gap.fitting.cross_validation import predict_held_out
from vgroove.gap.fitting.hypothesis import Fit
from vgroove.gap.fitting.neighbour_points import GRID_HALF_WIDTHS, ripple_neighbours
from vgroove.gap.selection.search_state import COMPARISON, Search, key

MAX_FITS_PER_RING = 3  # further fits from one width of grid; bounds the time of a search


def deepest_minimum(search: Search, one: Fit) -> Fit:
    """The best fit that the pattern search finds from a fit that leaves a visible gap; the given
    fit where it leaves none or no other is better.
    """
    best = one
    for spread in GRID_HALF_WIDTHS if search.leaves_gap(one) else ():
        for _ in range(MAX_FITS_PER_RING):
            moved = better_neighbour(search, best, spread)
            if moved is None:
                break
            best = moved
    if best is not one:
        predict_held_out(search.engine, [best])
        search.fits[key(best.ids)] = best
    return best


def better_neighbour(search: Search, one: Fit, spread: float) -> Fit | None:
    """A converged fit of less cost, started from the best point of a ring around a fit; None where
    no point or fit is better.
    """
    points = ripple_neighbours(one, spread)
    if not len(points):
        return None
    costs = search.engine.costs(one, points)
    if not search.engine.is_gain(one, min(costs)):
        return None
    start = points[int(np.argmin(costs))]
    again = search.engine.fit([replace(one.hypothesis, start=start)], COMPARISON.max_rounds)[0]
    return again if search.engine.gains_on(again, one) else None
