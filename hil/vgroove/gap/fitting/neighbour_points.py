"""Points around a fit with a ripple of torque: where the ripple stops the shaft, the gap is
piecewise constant over amplitude and phase, so that a gradient does not lead to a lower value.
"""

import numpy as np

from vgroove.gap.fitting.hypothesis import Fit

# half widths of the square grids of points ("rings") in the complex plane of the ripple, relative
# to its amplitude
GRID_HALF_WIDTHS = (0.4, 0.2, 0.1, 0.05)
SIDE = np.linspace(-1.0, 1.0, 5)  # grid along a side, in half widths


def ripple_neighbours(one: Fit, half_width: float) -> np.ndarray:
    """Points (k, p) around a fit, one torque ripple changed in each: the complex number
    amplitude exp(i phase) is multiplied by 1 + half_width (a + i b), with a and b from SIDE.
    """
    factors = 1.0 + half_width * (SIDE[:, None] + 1j * SIDE).ravel()
    points = []
    for at in _torque_ripples(one):
        changed = np.tile(one.x, (len(factors), 1))
        ripple = complex(*one.x[at : at + 2]) * factors
        changed[:, at], changed[:, at + 1] = ripple.real, ripple.imag
        points.append(changed)
    if not points:
        return np.zeros((0, len(one.x)))
    return np.clip(np.concatenate(points), one.hypothesis.low, one.hypothesis.high)


def _torque_ripples(one: Fit) -> list[int]:
    """Indices in x of the coordinates of role "cosine" of torque ripples."""
    return [
        i
        for i, c in enumerate(one.hypothesis.coordinates)
        if c.role == "cosine" and c.name.endswith("torque_nm")
    ]
