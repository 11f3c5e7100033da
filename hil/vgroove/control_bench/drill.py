"""Drill driver: repeatability of the electronic clutch, anti-kickback on a lock within 5 ms, and
normal runs that nothing stops.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from vgroove import telemetry
from vgroove.control_bench.jobs import Figures, Job, Variant
from vgroove.control_bench.runs import PULL_S, Run, sil_run
from vgroove.control_bench.sets import half_of, seed_of
from vgroove.control_bench.torque import reason_of
from vgroove.lockstep import Profile
from vgroove.rig import Rig, rig_from_dict
from vgroove.study.impact_runs import REFERENCE_RIG

# ratio, nominal load in N m: physics.md section 7
GEARS = {"low": (31.5, 6.0), "high": (8.75, 2.0)}
SUPPLIES_V = (16.0, 17.0, 18.0, 19.0, 20.5)
# within the fold-back's reach: 13.3 and 3.7 N m
CLUTCH_NM = {"low": (3.0, 5.0, 10.0, 13.0), "high": (1.0, 2.0, 3.5)}
# of the chuck from 0 to the setting: hard to soft joint, VDI/VDE 2647
CLUTCH_DEG = (30.0, 90.0, 360.0)
CLUTCH_FROM_RAD = 3.0
# of each cell; NORMAL_RUNS of a hundred normal cells
CLUTCH_RUNS, LOCK_RUNS, NORMAL_RUNS = 1, 6, 10
LOCK_S, LOCK_AT_S = 5e-3, 0.9
LOCK_SHARE = (1.0, 2.0)  # of the stall torque
# the largest ordinary load; with a pack of 0.1 ohm 70 % of it
NORMAL_NM = {"low": 12.0, "high": 3.5}
# N m/rad up to that load, where the screw turns through: M6 seats at 7.6, M8 at 14
SCREW_RISE = {"low": 13.0, "high": 2.0}
PACK_OHM = 0.1
NORMAL_CELLS = 100
NORMAL_S = 2.2
CLUTCH_S = 3.5
CONTROLLER = Variant("drill", "drill")
GOALS = {"clutch": 0.05, "open_ms": 30.0}
SOUND = "normal run"


def cells(draws: int = 1) -> list[dict[str, Any]]:
    """Clutch, locks and normal runs, each in one of the halves."""
    return [
        *clutch_cells(CLUTCH_RUNS * draws),
        *lock_cells(LOCK_RUNS * draws),
        *normal_cells(NORMAL_RUNS if draws > 1 else 1),
    ]


def clutch_cells(runs: int) -> list[dict[str, Any]]:
    """Every setting of both gears on soft and hard joints at every supply."""
    found = []
    for (g, gear), (s, supply_v), (r, degrees), n in product(
        enumerate(GEARS), enumerate(SUPPLIES_V), enumerate(CLUTCH_DEG), range(runs)
    ):
        for c, clutch_nm in enumerate(CLUTCH_NM[gear]):
            half = half_of(s, r + c)
            cell = {
                "kind": "clutch",
                "gear": gear,
                "supply_v": supply_v,
                "clutch_nm": clutch_nm,
                "degrees": degrees,
            }
            found.append({"set": half, **cell, "seed": seed_of(half, g, s, c, r, n)})
    return found


def lock_cells(runs: int) -> list[dict[str, Any]]:
    """A lock in both gears at every supply, from loads, triggers and directions that the seed
    draws.
    """
    found = []
    for (g, gear), (s, supply_v), n in product(
        enumerate(GEARS), enumerate(SUPPLIES_V), range(runs)
    ):
        half = half_of(g, s)
        found.append(
            {
                "set": half,
                "kind": "lock",
                "gear": gear,
                "supply_v": supply_v,
                "seed": seed_of(half, 7, g, s, n),
            }
        )
    return found


def normal_cells(runs: int) -> list[dict[str, Any]]:
    """Normal runs: everything is drawn by the seed."""
    found = []
    for number, n in product(range(NORMAL_CELLS), range(runs)):
        half = half_of(number, 0)
        found.append(
            {
                "set": half,
                "kind": SOUND,
                "gear": list(GEARS)[number // 2 % 2],
                "seed": seed_of(half, 11, number, n),
            }
        )
    return found


def drill_rig(
    gear: str,
    supply_v: float,
    rise: float = 0.0,
    from_rad: float = 0.0,
    pack_ohm: float = 0.0,
    most_nm: float = 1e3,
) -> Rig:
    """The drill driver of physics.md section 7 with an idle chuck, or one whose load rises with the
    angle from from_rad on.
    """
    load = {"kind": "chuck", "torque_nm": 0.0, "from_s": 0.0, "to_s": 0.0, "breakaway_rad_s": 0.1}
    if rise:
        load |= {"rise_nm_per_rad": rise, "rise_from_rad": from_rad, "rise_most_nm": most_nm}
    mechanism = {
        "kind": "drill_driver",
        "shaft_stiffness_nm_per_rad": 3000,
        "shaft_damping_nm_s_per_rad": 0.02,
        "clutch_nm": 30.0,
    }
    data = {
        "schema": "vgroove.rig/1",
        "name": f"drill driver, {gear} gear",
        "input": {"kind": "duty"},
        "supply": {"voltage_v": supply_v, "resistance_ohm": pack_ohm},
        "motor": REFERENCE_RIG["motor"],
        "gearbox": {"ratio": GEARS[gear][0], "output_inertia_kg_m2": 2e-4},
        "mechanism": mechanism,
        "load": load,
    }
    return rig_from_dict(data, "the drill driver")


def drill_params(gear: str, clutch_nm: float = 0.0, pulse: bool = False) -> dict[str, float]:
    """The controller's parameters for a gear."""
    return {
        "drill_ratio": GEARS[gear][0],
        "drill_clutch_dnm": 10.0 * clutch_nm,
        "drill_pulse": float(pulse),
    }


def drill_run(
    variant: Variant,
    rig: Rig,
    params: dict[str, float],
    profile: Profile,
    seconds: float,
    seed: int,
    **more: Any,
) -> Run:
    """A run in the controller's mode."""
    return sil_run(
        rig,
        mode=variant.mode,
        params=params,
        profile=profile,
        duration_s=seconds,
        seed=seed,
        **more,
    )


def opened_s(run: Run, after_s: float) -> tuple[float | None, float]:
    """When the bridge first stood open from after_s on (pulse mode may have it open then), and when
    it opened for good.
    """
    time_s, is_open = run.truth["time_s"], np.isnan(run.truth["duty"])
    first = np.flatnonzero(is_open & (time_s > after_s))
    return float(time_s[first[0]]) if len(first) else None, float(
        time_s[np.flatnonzero(~is_open)[-1]]
    )


def stall_nm(gear: str, supply_v: float, pack_ohm: float = 0.0) -> float:
    """Torque at the chuck with the motor held at full duty."""
    return 0.0109 * GEARS[gear][0] * supply_v / (0.19 + pack_ohm)


def pulled(trigger: float) -> tuple[tuple[float, float], ...]:
    """Points of a trigger that is pulled and held."""
    return ((0.0, 0.0), (PULL_S, 0.0), (PULL_S + 0.02, trigger))


def clutch_work(
    variant: Variant,
    *,
    gear: str,
    supply_v: float,
    clutch_nm: float,
    degrees: float,
    seed: int,
    **_: Any,
) -> Figures:
    """Drive into a joint whose torque rises with the angle and holds; the torque that it is left
    with.
    """
    random = np.random.default_rng([seed, 2])
    rise, trigger = clutch_nm / np.radians(degrees), random.uniform(0.5, 1.0)
    rig = drill_rig(gear, supply_v, float(rise), CLUTCH_FROM_RAD)

    def stands(tool: Any, progress: Any) -> bool:
        return bool(progress.gates.coast and tool.time_s > PULL_S + 0.3 and tool.speed_rad_s < 1.0)

    run = drill_run(
        variant,
        rig,
        drill_params(gear, clutch_nm),
        Profile(travel=pulled(trigger)),
        CLUTCH_S,
        seed,
        stop_when=stands,
    )
    return {"peak_nm": float(run.tool.load_nm), "reason": reason_of(run), "faults": run.faults}


def lock_work(variant: Variant, *, gear: str, supply_v: float, seed: int, **_: Any) -> Figures:
    """The bit jams; how long after the lock began the bridge opened."""
    random = np.random.default_rng([seed, 3])
    trigger, pack_ohm = random.uniform(0.2, 1.0), float(random.choice([0.0, PACK_OHM]))
    stall = stall_nm(gear, supply_v, pack_ohm)
    before, lock = random.uniform(0.0, 0.3) * trigger * stall, random.uniform(*LOCK_SHARE) * stall
    at_s, pulse = LOCK_AT_S + random.uniform(0.0, 0.1), bool(random.integers(2))
    load = ((0.0, 0.0), (0.5, 0.0), (0.6, before), (at_s, before), (at_s + LOCK_S, lock))
    reverse = bool(random.integers(2))
    profile = Profile(travel=pulled(trigger), reverse=((0.0, float(reverse)),), load_nm=load)
    rig, params = drill_rig(gear, supply_v, pack_ohm=pack_ohm), drill_params(gear, pulse=pulse)
    run = drill_run(variant, rig, params, profile, 1.2, seed, truth_every=4)
    first_s, good_s = opened_s(run, at_s)
    opened = {
        "open_ms": None if first_s is None else 1e3 * (first_s - at_s),
        "good_ms": 1e3 * max(good_s - at_s, 0.0),
    }
    drawn = {"trigger": trigger, "before_nm": before, "pulse": pulse, "reverse": reverse}
    return {**opened, "reason": reason_of(run), "faults": run.faults, **drawn}


def wandering_trigger(random: np.random.Generator) -> tuple[tuple[float, float], ...]:
    """Pulled, moved and let go at random: points of a travel."""
    points, time_s = [(0.0, 0.0), (PULL_S, 0.0)], PULL_S
    while time_s < NORMAL_S:
        travel = float(random.choice([random.uniform(0.2, 1.0), 1.0, 0.0], p=[0.6, 0.3, 0.1]))
        moved_s = time_s + float(random.choice([0.02, 0.1, 0.4]))
        time_s = moved_s + random.uniform(0.1, 0.8)
        points += [(moved_s, travel), (time_s, travel)]
    return tuple(points)


def wandering_load(random: np.random.Generator, most_nm: float) -> tuple[tuple[float, float], ...]:
    """Loads at random, which come at once, within 5 ms or within 50."""
    points, time_s = [(0.0, 0.0)], 0.6
    while time_s < NORMAL_S:
        taken_s = time_s + float(random.choice([1e-4, 5e-3, 0.05]))
        points += [(time_s, points[-1][1]), (taken_s, random.uniform(0.0, most_nm))]
        time_s = taken_s + random.uniform(0.05, 0.6)
    return tuple(points)


def normal_work(variant: Variant, *, gear: str, seed: int, **_: Any) -> Figures:
    """An ordinary run: supply, pack, trigger and its moves, loads that jump or a screw, pulse mode,
    all drawn; nothing may stop it.
    """
    random = np.random.default_rng([seed, 4])
    supply_v, pack_ohm, pulse = (
        random.uniform(16.0, 20.5),
        float(random.choice([0.0, PACK_OHM])),
        bool(random.integers(2)),
    )
    most_nm = NORMAL_NM[gear] * (0.7 if pack_ohm else 1.0)
    screw, rise = bool(random.integers(2)), SCREW_RISE[gear] * random.uniform(0.1, 1.0)
    rig = drill_rig(
        gear, supply_v, rise if screw else 0.0, random.uniform(2.0, 30.0), pack_ohm, most_nm
    )
    profile = Profile(
        travel=wandering_trigger(random),
        load_nm=((0.0, 0.0),) if screw else wandering_load(random, most_nm),
    )
    profile = replace(profile, reverse=((0.0, float(not screw and random.integers(2) == 1)),))
    run = drill_run(variant, rig, drill_params(gear, pulse=pulse), profile, NORMAL_S, seed)
    return {
        "reason": "kickback" if "kickback" in reasons(run) else reason_of(run),
        "faults": run.faults,
    }


def reasons(run: Run) -> set[str]:
    """Every reason that a drive of the run ended for."""
    names = telemetry.value_table("CONTROL", "stop_reason")
    return {names[int(code)] for code in np.unique(run.control["stop_reason"])}


WORK = {"clutch": clutch_work, "lock": lock_work, SOUND: normal_work}


def jobs(chosen: Sequence[dict[str, Any]]) -> list[Job]:
    """Every chosen cell under the controller."""
    return [Job(WORK[cell["kind"]], CONTROLLER, cell) for cell in chosen]


def clutch_rows(rows: Sequence[Figures]) -> list[Figures]:
    """Each gear and setting over all supplies and joints."""
    found = []
    for gear, clutch_nm in sorted(
        {(r["gear"], r["clutch_nm"]) for r in rows if r["kind"] == "clutch"}
    ):
        chosen = [
            r
            for r in rows
            if r["kind"] == "clutch" and (r["gear"], r["clutch_nm"]) == (gear, clutch_nm)
        ]
        peak = np.array([r["peak_nm"] for r in chosen if r["reason"] == "clutch"])
        some = len(peak) > 1
        found.append(
            {
                "gear": gear,
                "clutch_nm": clutch_nm,
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
                    "reverse": sum(r["reverse"] for r in chosen),
                    "opened": len(times),
                    "median_ms": float(np.median(times)) if times else None,
                    "most_ms": max(times, default=None),
                    "good_ms": max((r["good_ms"] for r in chosen), default=None),
                    "tripped": sum(r["reason"] != "kickback" for r in chosen),
                }
            )
    return found
