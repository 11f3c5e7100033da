"""Tightening factor of `vgroove study load`: preload of a bolt by friction and by supply
voltage.
"""

from typing import Any

from vgroove import _core
from vgroove.html_page import Table
from vgroove.reference.bolt import FRICTIONS, lever_m
from vgroove.reference.joints import REFERENCE_JOINTS
from vgroove.rig import Rig
from vgroove.study.impact_runs import simulate, with_joint

SUPPLIES_V = (17.0, 18.5, 20.0)  # of a battery pack between nearly empty and full


def bolt_rows() -> list[dict[str, float]]:
    """For each of FRICTIONS: assembly preload and tightening torque at 90 % of yield, and the
    preload that the torque of the middle friction leads to.
    """
    middle = _core.bolt_torque(_core.bolt_preload(FRICTIONS[1]), FRICTIONS[1], FRICTIONS[1])
    rows = []
    for mu in FRICTIONS:
        preload = _core.bolt_preload(mu)
        rows.append(
            {
                "friction": mu,
                "preload_kn": preload / 1e3,
                "torque_nm": _core.bolt_torque(preload, mu, mu),
                "preload_at_middle_torque_kn": middle / lever_m(mu) / 1e3,
            }
        )
    return rows


def reached_torques(
    rig: Rig, voltages: tuple[float, ...], duration_s: float
) -> list[dict[str, float]]:
    """Slip torque of the hard joint after duration_s of full duty, for each supply voltage."""
    rigs = [with_joint(rig, "hard_joint", {"supply.voltage_v": v}) for v in voltages]
    rows = simulate(rigs, duration_s, 1.0)
    load = REFERENCE_JOINTS["hard_joint"].load
    head = rows["head_rad"][:, -1]
    return [
        {
            "supply_v": v,
            "torque_nm": float(load["run_torque_nm"] + load["slip_slope_nm_per_rad"] * h),
        }
        for v, h in zip(voltages, head, strict=True)
    ]


def tightening(rig: Rig, duration_s: float) -> dict[str, Any]:
    """Tightening factor F_max / F_min of VDI 2230: by the scatter of the friction, of the tool's
    supply, and of both.
    """
    bolt = bolt_rows()
    reached = reached_torques(rig, SUPPLIES_V, duration_s)
    by_friction = lever_m(FRICTIONS[-1]) / lever_m(FRICTIONS[0])
    torques = [r["torque_nm"] for r in reached]
    by_supply = max(torques) / min(torques)
    return {
        "bolt": bolt,
        "reached": reached,
        "factor_friction": by_friction,
        "factor_supply": by_supply,
        "factor": by_friction * by_supply,
    }


def bolt_table(bolt: dict[str, Any]) -> Table:
    """Preload and torque of the bolt at three frictions."""
    return Table(
        "bolt",
        "Bolt M16, 12.9 at 90 % of yield (VDI 2230)",
        [
            "friction",
            "assembly preload in kN",
            "tightening torque in N m",
            "preload at the torque of 0.12 in kN",
        ],
        [list(r.values()) for r in bolt["bolt"]],
    )


def reached_table(bolt: dict[str, Any]) -> Table:
    """Torques reached, and the tightening factors."""
    rows: list[list[Any]] = [
        [f"torque reached at {r['supply_v']:g} V in N m", r["torque_nm"]] for r in bolt["reached"]
    ]
    rows += [
        ["tightening factor by friction 0.10 to 0.14", bolt["factor_friction"]],
        ["tightening factor by supply 17 to 20 V", bolt["factor_supply"]],
        ["tightening factor by both", bolt["factor"]],
    ]
    return Table(
        "tightening",
        "Tightening factor of the hard joint, tool switched off after a fixed time",
        ["figure", "value"],
        rows,
    )
