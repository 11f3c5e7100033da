"""Looks around a fit with a ripple of torque: where the shaft breaks away one tooth later the gap jumps, and no slope leads across.

A cogging that stops the shaft makes the squared gap a staircase over its amplitude and phase; Gauss-Newton ends on some step of it. The
steps near by are tried as they are, rings of them around the fit, coarse to fine, and a better one is fitted in its turn.
"""

from dataclasses import replace

import numpy as np

from vgroove.gap.fit import Fit
from vgroove.gap.search_state import Search, key
from vgroove.gap.singles import CONVERGED

SPREADS = (0.4, 0.2, 0.1, 0.05)  # half widths of the rings, in the ripple's amplitude: along it, and across it (a turn of its phase)
SIDE = np.linspace(-1.0, 1.0, 5)
MOVES = 3  # fits that one ring may ask for


def deepest(search: Search, one: Fit) -> Fit:
    """The best fit of a set that leaves a gap around one of it, its ripples somewhat larger, smaller or turned."""
    best = one
    for spread in SPREADS if search.leaves_a_gap(one) else ():
        for _ in range(MOVES):
            moved = better_neighbour(search, best, spread)
            if moved is None:
                break
            best = moved
    if best is not one:
        search.engine.settle([best])
        search.fits[key(best.ids)] = best
    return best


def better_neighbour(search: Search, one: Fit, spread: float) -> Fit | None:
    """A converged fit that leaves less than one, from the best point of the rings around it; none where no point leaves less."""
    points = ring(one, spread)
    if not len(points):
        return None
    costs = search.engine.costs(one, points)
    if not search.engine.is_gain(one, min(costs)):
        return None
    again = search.engine.fit([replace(one.hypothesis, start=points[int(np.argmin(costs))])], CONVERGED)[0]
    return again if search.engine.is_gain(one, again.cost) else None


def ring(one: Fit, spread: float) -> np.ndarray:
    """Points (k, p) around a fit, one torque that follows the angle moved in each: its amplitude and phase as a complex number, times 1 and
    up to spread more or less along and across."""
    factors = 1.0 + spread * (SIDE[:, None] + 1j * SIDE).ravel()
    points = []
    for at in (i for i, c in enumerate(one.hypothesis.coordinates) if c.role == "cosine" and c.name.endswith("torque_nm")):
        moved = np.tile(one.x, (len(factors), 1))
        swing = complex(*one.x[at:at + 2]) * factors
        moved[:, at], moved[:, at + 1] = swing.real, swing.imag
        points.append(moved)
    return np.clip(np.concatenate(points), one.hypothesis.low, one.hypothesis.high) if points else np.zeros((0, len(one.x)))
