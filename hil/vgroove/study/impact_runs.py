"""Runs of the impact tool for the studies: the reference set, the joints of the design, statistics
of blows.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vgroove import _core
from vgroove.errors import VgrooveError, refused_by_plant
from vgroove.rig import Rig, read_rig, rig_from_dict

# physics.md section 4, the reference set; its section [load] is replaced by the study's joints
REFERENCE_RIG: dict[str, Any] = {
    "schema": "vgroove.rig/1",
    "name": "reference impact driver, 18 V class",
    "input": {"kind": "duty"},
    "supply": {"voltage_v": 18.5, "resistance_ohm": 0.10},
    "motor": {
        "resistance_ohm": 0.19,
        "inductance_h": 100e-6,
        "torque_constant_nm_per_a": 0.0109,
        "inertia_kg_m2": 1.6e-5,
        "viscous_nm_s_per_rad": 4.5e-6,
        "coulomb_nm": 0.012,
    },
    "gearbox": {"ratio": 5.6, "output_inertia_kg_m2": 6e-6},
    "mechanism": {
        "kind": "impact",
        "hammer_inertia_kg_m2": 4.5e-5,
        "hammer_mass_kg": 0.19,
        "groove_lead_m_per_rad": 4.4e-3,
        "groove_radius_m": 0.010,
        "vertex_rad": 0.05,
        "travel_rad": 2.8,
        "spring_preload_n": 220,
        "spring_rate_n_per_m": 29400,
        "lug_count": 2,
        "lug_height_m": 4.5e-3,
        "lug_radius_m": 0.015,
        "lug_overlap_rad": 1.0,
        "contact_stiffness_n_per_m": 3e7,
        "contact_damping_n_s_per_m": 2e3,
        "contact_ramp_m": 1e-5,
        "anvil_inertia_kg_m2": 1.2e-5,
    },
    "load": {"kind": "locked", "stiffness_nm_per_rad": 3000, "damping_nm_s_per_rad": 0.3},
}
_STIFF = {"stiffness_nm_per_rad": 3000, "damping_nm_s_per_rad": 0.3}
_WOOD = {
    "kind": "wood_screw",
    "stiffness_nm_per_rad": 100,
    "damping_nm_s_per_rad": 0.3,
    "seat_deg": 90,
    "stripped_ratio": 0.35,
    "loosen_ratio": 0.6,
}
# Joints of physics.md sections 4 and 6 and of the gap contract
JOINTS: dict[str, dict[str, Any]] = {
    "locked": {"kind": "locked", **_STIFF},
    "hard_joint": {
        "kind": "hard_joint",
        **_STIFF,
        "run_torque_nm": 0.3,
        "slip_slope_nm_per_rad": 700,
        "loosen_ratio": 0.75,
    },
    "slip_60": {
        "kind": "hard_joint",
        **_STIFF,
        "run_torque_nm": 60,
        "slip_slope_nm_per_rad": 0,
        "loosen_ratio": 0.75,
    },
    "slip_6": {
        "kind": "hard_joint",
        **_STIFF,
        "run_torque_nm": 6,
        "slip_slope_nm_per_rad": 0,
        "loosen_ratio": 0.75,
    },
    "disc_spring": {
        "kind": "disc_spring",
        **_STIFF,
        "parallel": 4,
        "series": 42,
        "friction": 0.12,
        "from_turns": 4,
        "run_torque_nm": 0.3,
    },
    "m6": {**_WOOD, "start_nm": 0.5, "end_nm": 6.0, "turns": 36, "seat_nm": 12.0, "from_turns": 12},
    "m8": {
        **_WOOD,
        "start_nm": 0.9,
        "end_nm": 11.0,
        "turns": 26,
        "seat_nm": 22.0,
        "from_turns": 12,
    },
    "m10": {
        **_WOOD,
        "start_nm": 1.5,
        "end_nm": 18.0,
        "turns": 21,
        "seat_nm": 38.0,
        "from_turns": 12,
    },
}
JOINT_WORDS = {
    "locked": "locked",
    "hard_joint": "hard joint, 700 N m/rad",
    "slip_60": "slips at 60 N m",
    "slip_6": "slips at 6 N m",
    "disc_spring": "disc springs, n = 4, i = 42",
    "m6": "lag screw M6",
    "m8": "lag screw M8",
    "m10": "lag screw M10",
}
JOINT_SHORT = {
    "locked": "locked",
    "hard_joint": "hard 700",
    "slip_60": "slip 60",
    "slip_6": "slip 6",
    "disc_spring": "disc springs",
    "m6": "M6",
    "m8": "M8",
    "m10": "M10",
}
CLEAN_HEIGHT, CLEAN_PERIOD = 0.5, 0.10  # of the lug height; of the median period
RPM = 30.0 / np.pi


def impact_rig(path: Path | None) -> Rig:
    """The rig of a file, or the reference set; VgrooveError when it has no impact mechanism or is
    not driven by a duty.
    """
    rig = read_rig(path) if path else rig_from_dict(REFERENCE_RIG, "the reference set")
    if rig.mechanism["kind"] != "impact":
        raise VgrooveError(f'{path}: this study needs [mechanism] kind = "impact"')
    if rig.input["kind"] != "duty" or "voltage_v" not in rig.supply:
        raise VgrooveError(
            f"{path}: this study drives the tool by a duty: [input] kind and [supply] voltage_v"
        )
    return rig


def with_joint(rig: Rig, load: Mapping[str, Any], values: Mapping[str, float] | None = None) -> Rig:
    """The same tool on another joint, other values of dotted keys with it."""
    return rig_from_dict(
        {**rig.as_dict(), "load": dict(load)}, "the rig on another joint"
    ).with_values(values or {})


def simulate(rigs: Sequence[Rig], duration_s: float, duty: float, **options: Any) -> dict[str, Any]:
    """Rows of 1 ms of tools that differ in values only, from rest at a constant duty, reference
    accuracy.

    `row_s` among the options changes the rows' distance; the others are those of
    vgroove._core.simulate_impact.
    """
    row_s = options.pop("row_s", 1e-3)
    time_s = np.linspace(0.0, duration_s, round(duration_s / row_s) + 1)
    drive = _core.LogInput(
        time_s, "duty", np.full(len(time_s), duty), load_kind=rigs[0].load["kind"]
    )
    with refused_by_plant(rigs[0].name or "the rig"):
        rows = _core.simulate_impact(
            drive,
            np.array([rig.parameters() for rig in rigs]),
            **{"mode": "reference", "threads": 2, **options},
        )
    return {"time_s": time_s, **rows}


def hits_between(blows: np.ndarray, start_s: float, end_s: float) -> np.ndarray:
    """Blows and repeats (rebounds belong to their blow) within a stretch."""
    hits = blows[blows["kind"] < 2]
    return hits[(hits["time_s"] >= start_s) & (hits["time_s"] < end_s)]


def clean(hits: np.ndarray, lug_height_m: float) -> np.ndarray:
    """Which hits are clean (n,): not a repeat, no lug skipped, half of the lug height engaged, 10 %
    from the median period at most.
    """
    first = hits["kind"] == 0
    period = np.full(len(hits), np.nan)
    period[first] = np.diff(hits["time_s"][first], prepend=np.nan)
    median = np.nanmedian(period) if np.isfinite(period).any() else np.nan
    # the first hit has no period: it is not held against it
    regular = ~(np.abs(period - median) > CLEAN_PERIOD * median)
    return (
        first
        & (hits["skipped"] == 0)
        & (hits["engaged_m"] >= CLEAN_HEIGHT * lug_height_m)
        & regular
    )


def blow_figures(
    rows: Mapping[str, Any], index: int, start_s: float, lug_height_m: float
) -> dict[str, float | int | None]:
    """Rate, current, torque and synchronism of one run from start_s to its end."""
    time_s = rows["time_s"]
    end_s, late = float(time_s[-1]), time_s > start_s
    hits = hits_between(rows["blows"][index], start_s, end_s)
    first = hits[hits["kind"] == 0]
    period = np.diff(first["time_s"])
    head = rows["head_rad"][index][late]
    figures: dict[str, float | int | None] = {
        "hits": len(hits),
        "current_a": float(rows["current_a"][index][late].mean()),
        "speed_rpm": float(rows["speed_rad_s"][index][late].mean() * RPM),
        "hammer_max_mm": float(rows["hammer_mm"][index][late].max()),
        "blows_per_min": None,
        "period_spread_percent": None,
        "torque_peak_nm": None,
        "engaged_percent": None,
        "synchronism": None,
        "angle_per_blow_deg": None,
    }
    if len(period):
        figures |= {
            "blows_per_min": float(60.0 / period.mean()),
            "period_spread_percent": float(100 * period.std() / period.mean()),
            "torque_peak_nm": float(first["peak_torque_nm"].mean()),
            "engaged_percent": float(100 * first["engaged_m"].mean() / lug_height_m),
            "synchronism": float(clean(hits, lug_height_m).mean()),
            "angle_per_blow_deg": float(np.degrees(head[-1] - head[0]) / len(first)),
        }
    return figures
