"""The equations of impact_model.py as a CasADi expression, for CVODES with the exact Jacobian."""

from collections.abc import Callable
from dataclasses import fields

import casadi as ca
import numpy as np
import numpy.typing as npt

from vgroove.bench.impact_tool import DEEP_M, NEAR_RAD, PARAMETER_COUNT, STATES, ImpactTool

Floats = npt.NDArray[np.float64]


def contact(pen: ca.SX, rate: ca.SX, t: dict[str, ca.SX]) -> ca.SX:
    """Contact force in N (docs/spec/model.md, section 5, exponent 1)."""
    damping = ca.if_else(rate > 0, t["contact_n_s_m"] * rate * ca.fmin(pen / t["ramp_m"], 1), 0)
    return ca.if_else(pen > 0, t["contact_n_m"] * pen + damping, 0)


def lug_forces(
    x: ca.SX, dx: ca.SX, phi: ca.SX, dphi: ca.SX, t: dict[str, ca.SX]
) -> tuple[ca.SX, ca.SX]:
    """Torque on the hammer's lugs and axial force on the hammer, as in impact_model.py."""
    radius, overlap = t["lug_radius_m"], t["overlap_rad"]
    into = phi - t["pitch_rad"] * ca.floor(phi / t["pitch_rad"])
    deep = t["lug_height_m"] - x
    over = ca.logic_and(deep > 0, into < overlap)
    front = ca.logic_and(over, into < NEAR_RAD)
    rear = ca.logic_and(over, ca.logic_and(into > overlap - NEAR_RAD, deep > DEEP_M))
    top = ca.logic_and(over, ca.logic_not(ca.logic_or(front, rear)))
    forward = ca.if_else(front, radius * contact(radius * into, radius * dphi, t), 0)
    backward = ca.if_else(rear, radius * contact(radius * (overlap - into), -radius * dphi, t), 0)
    return forward - backward, ca.if_else(top, -contact(deep, -dx, t), 0)


def expression() -> tuple[ca.SX, ca.SX, ca.SX]:
    """States, parameters and dy/dt."""
    y, p = ca.SX.sym("y", len(STATES)), ca.SX.sym("p", PARAMETER_COUNT)
    t = {f.name: p[place] for place, f in enumerate(fields(ImpactTool))}
    q, dq, e, ratio = y[1] - y[3], y[2] - y[4], t["vertex_rad"], t["ratio"]
    root, lead = ca.sqrt(q * q + e * e), t["lead_m"]
    x, s, ds = lead * (root - e), lead * q / root, lead * e * e / root**3
    lug, axial = lug_forces(x, s * dq, y[3] - y[5], y[4] - y[6], t)
    axial += contact(x - lead * (ca.sqrt(t["travel_rad"] ** 2 + e * e) - e), s * dq, t)
    force = t["preload_n"] + t["rate_n_m"] * x + axial + t["hammer_kg"] * ds * dq * dq
    speed, drive = ratio * y[2], t["torque_constant"] * y[0]
    held = ca.fmax(-t["coulomb_nm"], ca.fmin(t["coulomb_nm"], drive))
    rub = ca.if_else(speed > 0, t["coulomb_nm"], ca.if_else(speed < 0, -t["coulomb_nm"], held))
    spindle = ratio * (drive - t["viscous"] * speed - rub) - s * force
    hammer, ms2 = s * force - lug, t["hammer_kg"] * s * s
    a, b = t["spindle_inertia"] + ratio**2 * t["motor_inertia"], t["hammer_inertia"]
    det = a * b + (a + b) * ms2
    gained = t["slope_nm_rad"] * ca.fmax(y[5] - y[7], 0)
    sticking = t["joint_nm_rad"] * y[7] + t["joint_nm_s_rad"] * y[6]
    torque = ca.fmax(
        -t["run_nm"] - t["loosen_ratio"] * gained, ca.fmin(t["run_nm"] + gained, sticking)
    )
    volts = t["duty"] * (t["supply_v"] - t["supply_ohm"] * t["duty"] * y[0])
    rates = [
        (volts - t["resistance_ohm"] * y[0] - t["torque_constant"] * speed) / t["inductance_h"],
        y[2],
        ((b + ms2) * spindle + ms2 * hammer) / det,
        y[4],
        (ms2 * spindle + (a + ms2) * hammer) / det,
        y[6],
        (lug - torque) / t["anvil_inertia"],
        (torque - t["joint_nm_rad"] * y[7]) / t["joint_nm_s_rad"],
    ]
    return y, p, ca.vertcat(*rates)


def load_casadi() -> Callable[[Floats, Floats, Floats, float], Floats]:
    """CVODES (BDF, faster here than Adams) with the right-hand side in CasADi's virtual machine."""
    y, p, rates = expression()
    made: dict[tuple[float, int], ca.Function] = {}

    def run(times: Floats, y0: Floats, parameters: Floats, rtol: float) -> Floats:
        key = (rtol, times.size)
        if key not in made:
            options = {
                "reltol": rtol,
                "abstol": rtol,
                "max_num_steps": 1_000_000,
                "show_eval_warnings": False,
            }
            made[key] = ca.integrator(
                "run", "cvodes", {"x": y, "p": p, "ode": rates}, float(times[0]), times[1:], options
            )
        states = np.array(made[key](x0=y0, p=parameters)["xf"]).T
        return np.vstack([y0[None, :], states])

    return run
