"""Points around a fit with a ripple of torque: where the shaft breaks away one tooth later the gap
jumps, and no slope leads across.
"""

import numpy as np

from vgroove.gap.fitting.fit import Fit

# half widths of the rings, in the ripple's amplitude: along it, and across it (a turn of its phase)
SPREADS = (0.4, 0.2, 0.1, 0.05)
SIDE = np.linspace(-1.0, 1.0, 5)


def ripple_neighbours(one: Fit, spread: float) -> np.ndarray:
    """Points (k, p) around a fit, one torque that follows the angle moved in each: its amplitude
    and phase as a complex number, times 1 and up to spread more or less along and across.
    """
    factors = 1.0 + spread * (SIDE[:, None] + 1j * SIDE).ravel()
    points = []
    for at in (
        i
        for i, c in enumerate(one.hypothesis.coordinates)
        if c.role == "cosine" and c.name.endswith("torque_nm")
    ):
        moved = np.tile(one.x, (len(factors), 1))
        swing = complex(*one.x[at : at + 2]) * factors
        moved[:, at], moved[:, at + 1] = swing.real, swing.imag
        points.append(moved)
    return (
        np.clip(np.concatenate(points), one.hypothesis.low, one.hypothesis.high)
        if points
        else np.zeros((0, len(one.x)))
    )
