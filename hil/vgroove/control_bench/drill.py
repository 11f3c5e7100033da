"""Drill driver: repeatability of the electronic clutch, anti-kickback on a lock within 5 ms, and normal runs that nothing stops."""

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np

from vgroove.control_bench.jobs import Figures, Job, Variant
from vgroove.control_bench.runs import PULL_S, Run, sil_run
from vgroove.control_bench.sets import half_of, seed_of
from vgroove.lockstep import Profile
from vgroove.rig import Rig, rig_from_dict
from vgroove.study.impact_runs import REFERENCE_RIG

GEARS = {"low": (31.5, 6.0), "high": (8.75, 2.0)}  # ratio, nominal load in N m: physics.md section 7
SUPPLIES_V = (16.0, 17.0, 18.0, 19.0, 20.5)
CLUTCH_NM = {"low": (5.0, 10.0, 20.0), "high": (2.0, 4.0)}
CLUTCH_RISE = (10.0, 30.0)  # N m/rad of the joint
CLUTCH_RUNS, LOCK_RUNS, NORMAL_RUNS = 2, 4, 10  # of each cell; NORMAL_RUNS of a hundred normal cells
LOCK_S, LOCK_AT_S = 5e-3, 0.9
LOCK_SHARE = 1.4  # of the stall torque at 20.5 V
STALL_NM_PER_RATIO = 0.0109 * 20.5 / 0.19
NORMAL_CELLS = 100
NORMAL_S = 1.2
CLUTCH_S = 2.5
RAMP_S = 0.3
CONTROLLER = Variant("drill", "drill")
GOALS = {"clutch": 0.05, "open_ms": 30.0}
SOUND = "normal run"


def cells(draws: int = 1) -> list[dict[str, Any]]:
    """Clutch, locks and normal runs, each in one of the halves."""
    return [*clutch_cells(CLUTCH_RUNS * draws), *lock_cells(LOCK_RUNS * draws), *normal_cells(NORMAL_RUNS if draws > 1 else 1)]


def clutch_cells(runs: int) -> list[dict[str, Any]]:
    """Every setting of both gears on soft and hard joints at every supply."""
    found = []
    for (g, gear), (s, supply_v), (r, rise), n in product(enumerate(GEARS), enumerate(SUPPLIES_V), enumerate(CLUTCH_RISE), range(runs)):
        for c, clutch_nm in enumerate(CLUTCH_NM[gear]):
            half = half_of(s, r + c)
            cell = {"kind": "clutch", "gear": gear, "supply_v": supply_v, "clutch_nm": clutch_nm, "rise": rise}
            found.append({"set": half, **cell, "seed": seed_of(half, g, s, c, r, n)})
    return found


def lock_cells(runs: int) -> list[dict[str, Any]]:
    """A lock in both gears at every supply, from loads and triggers that the seed draws."""
    found = []
    for (g, gear), (s, supply_v), n in product(enumerate(GEARS), enumerate(SUPPLIES_V), range(runs)):
        half = half_of(g, s)
        found.append({"set": half, "kind": "lock", "gear": gear, "supply_v": supply_v, "seed": seed_of(half, 7, g, s, n)})
    return found


def normal_cells(runs: int) -> list[dict[str, Any]]:
    """Normal runs: everything is drawn by the seed."""
    found = []
    for number, n in product(range(NORMAL_CELLS), range(runs)):
        half = half_of(number, 0)
        found.append({"set": half, "kind": SOUND, "gear": list(GEARS)[number // 2 % 2], "seed": seed_of(half, 11, number, n)})
    return found


def drill_rig(gear: str, supply_v: float, rise: float = 0.0, from_rad: float = 0.0) -> Rig:
    """The drill driver of physics.md section 7 with an idle chuck, or one whose load rises with the angle from a turn on."""
    load = {"kind": "chuck", "torque_nm": 0.0, "from_s": 0.0, "to_s": 0.0, "breakaway_rad_s": 0.1}
    if rise:
        load |= {"rise_nm_per_rad": rise, "rise_from_rad": from_rad}
    mechanism = {"kind": "drill_driver", "shaft_stiffness_nm_per_rad": 3000, "shaft_damping_nm_s_per_rad": 0.02, "clutch_nm": 100.0}
    data = {
        "schema": "vgroove.rig/1",
        "name": f"drill driver, {gear} gear",
        "input": {"kind": "duty"},
        "supply": {"voltage_v": supply_v},
        "motor": REFERENCE_RIG["motor"],
        "gearbox": {"ratio": GEARS[gear][0], "output_inertia_kg_m2": 2e-4},
        "mechanism": mechanism,
        "load": load,
    }
    return rig_from_dict(data, "the drill driver")


def drill_params(gear: str, clutch_nm: float = 0.0, pulse: bool = False) -> dict[str, float]:
    """The controller's parameters for a gear."""
    return {"drill_ratio": GEARS[gear][0], "drill_clutch_dnm": 10.0 * clutch_nm, "drill_pulse": float(pulse)}


def opened_s(run: Run, after_s: float) -> float | None:
    """When the bridge first stood open behind after_s, the trigger still pulled."""
    time_s, open_then = run.truth["time_s"], np.isnan(run.truth["duty"])
    there = np.flatnonzero(open_then & (time_s > after_s))
    return float(time_s[there[0]]) if len(there) else None


def stop_reason(run: Run) -> str:
    """Why the drive ended, by name."""
    from vgroove.control_bench.torque import reason_of

    return reason_of(run)


def clutch_work(variant: Variant, *, gear: str, supply_v: float, clutch_nm: float, rise: float, seed: int, **_: Any) -> Figures:
    """Drive into a joint whose torque rises; what the shaft carried at most."""
    rig = drill_rig(gear, supply_v, rise, from_rad=20.0)
    profile = Profile(travel=((0.0, 0.0), (PULL_S, 0.0), (PULL_S + RAMP_S, 1.0)))
    run = sil_run(
        rig, mode=variant.mode, params=drill_params(gear, clutch_nm), profile=profile, duration_s=CLUTCH_S, seed=seed, truth_every=4
    )
    return {"peak_nm": float(rise * max(0.0, run.truth["head_rad"].max() - 20.0)), "reason": stop_reason(run), "faults": run.faults}


def lock_work(variant: Variant, *, gear: str, supply_v: float, seed: int, **_: Any) -> Figures:
    """The bit jams; how long after the lock began the bridge opened."""
    random = np.random.default_rng([seed, 3])
    ratio, nominal = GEARS[gear]
    before, trigger = nominal * random.uniform(0.0, 1.0), random.uniform(0.5, 1.0)
    lock = LOCK_SHARE * STALL_NM_PER_RATIO * ratio
    load = ((0.0, before), (LOCK_AT_S, before), (LOCK_AT_S + LOCK_S, lock))
    profile = Profile(travel=((0.0, 0.0), (PULL_S, 0.0), (PULL_S + RAMP_S, trigger)), load_nm=load)
    run = sil_run(
        drill_rig(gear, supply_v), mode=variant.mode, params=drill_params(gear), profile=profile, duration_s=1.3, seed=seed, truth_every=4
    )
    opened = opened_s(run, PULL_S + 0.1)
    delay = None if opened is None else 1e3 * (opened - LOCK_AT_S)
    return {"open_ms": delay, "trigger": trigger, "before_nm": before, "reason": stop_reason(run), "faults": run.faults}


def normal_work(variant: Variant, *, gear: str, seed: int, **_: Any) -> Figures:
    """An ordinary run: trigger, supply, load and its changes drawn; nothing may stop it."""
    random = np.random.default_rng([seed, 4])
    nominal = GEARS[gear][1]
    supply_v, trigger = random.uniform(16.0, 20.5), random.uniform(0.4, 1.0)
    pull_s, later = random.uniform(0.05, 0.4), random.uniform(0.4, 1.0)
    times = np.sort(random.uniform(PULL_S + 0.1, NORMAL_S, 4))
    loads = nominal * trigger * random.uniform(0.0, 1.0, 3)
    rise_s, pulse = random.choice([0.001, 0.02, 0.1]), bool(random.integers(2))
    load = [
        (0.0, loads[0]),
        (times[0], loads[0]),
        (times[0] + rise_s, loads[1]),
        (times[2] + 0.2, loads[1]),
        (times[2] + 0.2 + rise_s, loads[2]),
    ]
    travel = ((0.0, 0.0), (PULL_S, 0.0), (PULL_S + pull_s, trigger), (times[1] + pull_s, trigger), (times[1] + pull_s + 0.1, later))
    profile = Profile(travel=travel, load_nm=tuple((float(t), float(v)) for t, v in load))
    run = sil_run(
        drill_rig(gear, supply_v),
        mode=variant.mode,
        params=drill_params(gear, pulse=pulse),
        profile=profile,
        duration_s=NORMAL_S,
        seed=seed,
    )
    return {"reason": stop_reason(run), "faults": run.faults}


WORK = {"clutch": clutch_work, "lock": lock_work, SOUND: normal_work}


def jobs(chosen: Sequence[dict[str, Any]]) -> list[Job]:
    """Every chosen cell under the controller."""
    return [Job(WORK[cell["kind"]], CONTROLLER, cell) for cell in chosen]


def clutch_rows(rows: Sequence[Figures]) -> list[Figures]:
    """Each gear, setting and joint over all supplies."""
    found = []
    clutches = [r for r in rows if r["kind"] == "clutch"]
    for gear, clutch_nm, rise in sorted({(r["gear"], r["clutch_nm"], r["rise"]) for r in clutches}):
        chosen = [r for r in clutches if (r["gear"], r["clutch_nm"], r["rise"]) == (gear, clutch_nm, rise)]
        peak = np.array([r["peak_nm"] for r in chosen if r["reason"] == "clutch"])
        some = len(peak) > 1
        found.append(
            {
                "gear": gear,
                "clutch_nm": clutch_nm,
                "rise": rise,
                "runs": len(chosen),
                "stopped": len(peak),
                "mean_nm": float(peak.mean()) if some else None,
                "spread": float(peak.std() / peak.mean()) if some else None,
            }
        )
    return found


def lock_rows(rows: Sequence[Figures]) -> list[Figures]:
    """Each gear: the time from the lock's begin to the open bridge."""
    found = []
    for gear in GEARS:
        chosen = [r for r in rows if r["kind"] == "lock" and r["gear"] == gear]
        times = [r["open_ms"] for r in chosen if r["open_ms"] is not None and r["open_ms"] > 0.0]
        if chosen:
            found.append(
                {
                    "gear": gear,
                    "locks": len(chosen),
                    "opened": len(times),
                    "median_ms": float(np.median(times)) if times else None,
                    "most_ms": max(times, default=None),
                }
            )
    return found
