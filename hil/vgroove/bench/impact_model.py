"""The impact tool of docs/spec/model.md, section 4, as one right-hand side compiled by numba, for
general-purpose solvers without event location.

The contact of a lug follows from the angles alone. Below the lug height a hammer lug that has
passed a forward flank by less than NEAR_RAD touches that flank; it touches a rear flank where it is
deeper than DEEP_M; elsewhere over a lug it stands on the top. In the timed runs this gives the
contacts of the specification.
"""

import math

import numba as nb
import numpy as np
import numpy.typing as npt

from vgroove.bench.impact_tool import DEEP_M, NEAR_RAD

Floats = npt.NDArray[np.float64]


@nb.njit(inline="always")
def contact(pen: float, rate: float, stiffness: float, damping: float, ramp: float) -> float:
    """Contact force in N (docs/spec/model.md, section 5, exponent 1)."""
    if pen <= 0.0:
        return 0.0
    return stiffness * pen + (damping * rate * min(pen / ramp, 1.0) if rate > 0.0 else 0.0)


@nb.njit(inline="always")
def lug_forces(x: float, dx: float, phi: float, dphi: float, p: Floats) -> tuple[float, float]:
    """Torque on the hammer's lugs and axial force on the hammer, positive towards the anvil."""
    pitch, height, radius, overlap = p[17], p[18], p[19], p[20]
    into = phi - pitch * math.floor(phi / pitch)  # angle of the flank past the last anvil flank
    if x >= height or into >= overlap:
        return 0.0, 0.0
    if into < NEAR_RAD:
        return radius * contact(radius * into, radius * dphi, p[21], p[22], p[23]), 0.0
    if into > overlap - NEAR_RAD and height - x > DEEP_M:
        return -radius * contact(
            radius * (overlap - into), -radius * dphi, p[21], p[22], p[23]
        ), 0.0
    return 0.0, -contact(height - x, -dx, p[21], p[22], p[23])


@nb.njit
def derivative(y: Floats, dy: Floats, p: Floats) -> None:
    """dy/dt of STATES (8,); p is ImpactTool.vector()."""
    q, dq = y[1] - y[3], y[2] - y[4]
    root = math.sqrt(q * q + p[13] * p[13])
    x, s, ds = (
        p[12] * (root - p[13]),
        p[12] * q / root,
        p[12] * p[13] * p[13] / (root * root * root),
    )
    lug, axial = lug_forces(x, s * dq, y[3] - y[5], y[4] - y[6], p)
    travel = p[12] * (math.sqrt(p[14] * p[14] + p[13] * p[13]) - p[13])
    axial += contact(x - travel, s * dq, p[21], p[22], p[23])
    force = p[15] + p[16] * x + axial + p[11] * ds * dq * dq
    speed = p[8] * y[2]
    rub = p[7] if speed > 0.0 else (-p[7] if speed < 0.0 else max(-p[7], min(p[7], p[4] * y[0])))
    spindle = p[8] * (p[4] * y[0] - p[6] * speed - rub) - s * force
    hammer = s * force - lug
    ms2, a, b = p[11] * s * s, p[9] + p[8] * p[8] * p[5], p[10]
    det = a * b + (a + b) * ms2
    gained = p[28] * max(y[5] - y[7], 0.0)
    torque = max(-p[27] - p[29] * gained, min(p[27] + gained, p[25] * y[7] + p[26] * y[6]))
    dy[0] = (p[30] * (p[0] - p[1] * p[30] * y[0]) - p[2] * y[0] - p[4] * speed) / p[3]
    dy[1], dy[2] = y[2], ((b + ms2) * spindle + ms2 * hammer) / det
    dy[3], dy[4] = y[4], (ms2 * spindle + (a + ms2) * hammer) / det
    dy[5], dy[6] = y[6], (lug - torque) / p[24]
    dy[7] = (torque - p[25] * y[7]) / p[26]
