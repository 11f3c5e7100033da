"""Points around a fit with a ripple of torque: where the ripple stops the shaft, the gap is a
staircase over amplitude and phase, and no slope leads from one step to the next.
"""

import numpy as np

from vgroove.gap.fitting.hypothesis import Fit

# half widths of the square rings of points, relative to the ripple's amplitude: along it, and
# across it (a change of phase)
RING_HALF_WIDTHS = (0.4, 0.2, 0.1, 0.05)
SIDE = np.linspace(-1.0, 1.0, 5)


def ripple_neighbours(one: Fit, half_width: float) -> np.ndarray:
    """Points (k, p) around a fit, one torque that follows the angle changed in each: its amplitude
    and phase as a complex number, times 1 and up to half_width more or less along and across.
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
    """Places in x of the cosine amplitudes of torques that follow the angle."""
    return [
        i
        for i, c in enumerate(one.hypothesis.coordinates)
        if c.role == "cosine" and c.name.endswith("torque_nm")
    ]
