"""Drill driver: repeatability of the electronic clutch, anti-kickback when the bit locks within
5 ms, and normal runs, which nothing may stop.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from typing import Any

import numpy as np

from vgroove import telemetry
from vgroove.control_bench.jobs import Figures, Job, Variant
from vgroove.control_bench.runs import PULL_S, Run, RunPlan, run_plan
from vgroove.control_bench.sets import half_of, seed_of
from vgroove.control_bench.torque import reason_of
from vgroove.lockstep import Profile
from vgroove.reference.rigs import reference_rig, with_load
from vgroove.rig import Rig

SUPPLIES_V = (16.0, 17.0, 18.0, 19.0, 20.5)
# Rotation of the chuck over which the torque rises from 0 to the clutch setting: hard to soft
# joint, VDI/VDE 2647
CLUTCH_DEG = (30.0, 90.0, 360.0)
CLUTCH_FROM_RAD = 3.0  # chuck angle at which the torque begins to rise
# Draws of each cell; of a normal run NORMAL_RUNS if --draws is above 1, else one
CLUTCH_RUNS, LOCK_RUNS, NORMAL_RUNS = 1, 6, 10
LOCK_S, LOCK_AT_S = 5e-3, 0.9  # duration of the rise to the locked load; earliest time
LOCK_SHARE = (1.0, 2.0)  # of the stall torque
PACK_OHM = 0.1
PACK_SHARE = 0.7  # of the largest normal load, with a pack of PACK_OHM
NORMAL_CELLS = 100
NORMAL_S = 2.2
CLUTCH_S = 3.5
STAND_RAD_S = 1.0  # below it the motor stands
CONTROLLER = Variant("drill", "drill")
GOALS = {"clutch": 0.05, "open_ms": 30.0}  # spread over mean; lock to open bridge
NORMAL = "normal run"


@dataclass(frozen=True)
class Gear:
    """A gear of the drill driver: its rig under rigs/, the clutch settings (within the reach of the
    current fold-back, 13.3 and 3.7 N m), the largest normal load, and the largest rise of a screw's
    torque up to that load (M6 seats with 7.6, M8 with 14 N m/rad).
    """

    rig_name: str
    clutch_nm: tuple[float, ...]
    normal_nm: float
    screw_nm_per_rad: float

    @cache  # noqa: B019 (two gears)
    def rig(self) -> Rig:
        """The rig of the gear."""
        return reference_rig(self.rig_name)

    @property
    def ratio(self) -> float:
        """Motor turns for a turn of the chuck."""
        return self.rig().gearbox["ratio"]


GEARS = {
    "low": Gear("drill_driver_low", (3.0, 5.0, 10.0, 13.0), 12.0, 13.0),
    "high": Gear("drill_driver_high", (1.0, 2.0, 3.5), 3.5, 2.0),
}


@dataclass(frozen=True)
class Screw:
    """A load at the chuck that rises with its angle from from_rad on, up to most_nm."""

    rise_nm_per_rad: float
    from_rad: float
    most_nm: float = 1e3


def cells(draws: int = 1) -> list[dict[str, Any]]:
    """Clutch stops, locks and normal runs, each in one of the halves."""
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
        for c, clutch_nm in enumerate(GEARS[gear].clutch_nm):
            half = half_of(s, r + c)
            cell = {
                "kind": "clutch",
                "gear": gear,
                "supply_v": supply_v,
                "clutch_nm": clutch_nm,
                "degrees": degrees,
            }
            found.append({"set": half, **cell, "seed": seed_of(half, n, g, s, c, r)})
    return found


def lock_cells(runs: int) -> list[dict[str, Any]]:
    """Locks in both gears at every supply; the seed draws load, trigger and direction before."""
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
                "seed": seed_of(half, n, 7, g, s),
            }
        )
    return found


def normal_cells(runs: int) -> list[dict[str, Any]]:
    """Normal runs, of which the seed draws everything but the gear."""
    found = []
    for number, n in product(range(NORMAL_CELLS), range(runs)):
        half = half_of(number, 0)
        found.append(
            {
                "set": half,
                "kind": NORMAL,
                "gear": list(GEARS)[number // 2 % 2],
                "seed": seed_of(half, number + NORMAL_CELLS * n, 11),
            }
        )
    return found


def drill_rig(gear: str, supply_v: float, screw: Screw | None = None, pack_ohm: float = 0.0) -> Rig:
    """The drill driver in a gear with an idle chuck, or on a screw."""
    base = GEARS[gear].rig()
    load = {**base.load, "torque_nm": 0.0, "from_s": 0.0, "to_s": 0.0}
    if screw:
        load |= {
            "rise_nm_per_rad": screw.rise_nm_per_rad,
            "rise_from_rad": screw.from_rad,
            "rise_most_nm": screw.most_nm,
        }
    supply = {"supply.voltage_v": supply_v, "supply.resistance_ohm": pack_ohm}
    return with_load(base, load, supply)


def drill_params(gear: str, clutch_nm: float = 0.0, pulse: bool = False) -> dict[str, float]:
    """The controller's parameters for a gear."""
    return {
        "drill_ratio": GEARS[gear].ratio,
        "drill_clutch_dnm": 10.0 * clutch_nm,
        "drill_pulse": float(pulse),
    }


def opened_s(run: Run, after_s: float) -> tuple[float | None, float]:
    """Time at which the bridge was first open after after_s (in pulse mode it may be open already),
    and time after which it remained open.
    """
    time_s, is_open = run.truth["time_s"], np.isnan(run.truth["duty"])
    first = np.flatnonzero(is_open & (time_s > after_s))
    return float(time_s[first[0]]) if len(first) else None, float(
        time_s[np.flatnonzero(~is_open)[-1]]
    )


def stall_nm(gear: str, supply_v: float, pack_ohm: float = 0.0) -> float:
    """Torque at the chuck in N m with the motor blocked at full duty."""
    motor = GEARS[gear].rig().motor
    k, resistance = motor["torque_constant_nm_per_a"], motor["resistance_ohm"]
    return k * GEARS[gear].ratio * supply_v / (resistance + pack_ohm)


def pulled(trigger: float) -> tuple[tuple[float, float], ...]:
    """Points (time, travel) of a trigger that is pulled and held."""
    return ((0.0, 0.0), (PULL_S, 0.0), (PULL_S + 0.02, trigger))


def clutch_work(variant: Variant, **cell: Any) -> Figures:
    """A joint whose torque rises with the angle: its torque when the bridge is open and the motor
    stands.
    """
    gear, clutch_nm, seed = cell["gear"], cell["clutch_nm"], cell["seed"]
    random = np.random.default_rng([seed, 2])
    rise, trigger = clutch_nm / np.radians(cell["degrees"]), random.uniform(0.5, 1.0)
    rig = drill_rig(gear, cell["supply_v"], Screw(float(rise), CLUTCH_FROM_RAD))

    def stands(tool: Any, progress: Any) -> bool:
        stopped = tool.time_s > PULL_S + 0.3 and tool.speed_rad_s < STAND_RAD_S
        return bool(progress.gates.coast and stopped)

    plan = RunPlan(
        Profile(travel=pulled(trigger)),
        variant.mode,
        drill_params(gear, clutch_nm),
        CLUTCH_S,
        seed,
        stop_when=stands,
    )
    run = run_plan(rig, plan)
    return {"peak_nm": float(run.tool.load_nm), "reason": reason_of(run), "faults": run.faults}


def lock_work(variant: Variant, *, gear: str, supply_v: float, seed: int, **_: Any) -> Figures:
    """The bit locks: the time from the begin of the lock to the open bridge."""
    random = np.random.default_rng([seed, 3])
    trigger, pack_ohm = random.uniform(0.2, 1.0), float(random.choice([0.0, PACK_OHM]))
    stall = stall_nm(gear, supply_v, pack_ohm)
    before, lock = random.uniform(0.0, 0.3) * trigger * stall, random.uniform(*LOCK_SHARE) * stall
    at_s, pulse = LOCK_AT_S + random.uniform(0.0, 0.1), bool(random.integers(2))
    load = ((0.0, 0.0), (0.5, 0.0), (0.6, before), (at_s, before), (at_s + LOCK_S, lock))
    reverse = bool(random.integers(2))
    profile = Profile(travel=pulled(trigger), reverse=((0.0, float(reverse)),), load_nm=load)
    rig, params = drill_rig(gear, supply_v, pack_ohm=pack_ohm), drill_params(gear, pulse=pulse)
    run = run_plan(rig, RunPlan(profile, variant.mode, params, 1.2, seed, truth_every=4))
    first_s, final_s = opened_s(run, at_s)
    opened = {
        "open_ms": None if first_s is None else 1e3 * (first_s - at_s),
        "good_ms": 1e3 * max(final_s - at_s, 0.0),
    }
    drawn = {"trigger": trigger, "before_nm": before, "pulse": pulse, "reverse": reverse}
    return {**opened, "reason": reason_of(run), "faults": run.faults, **drawn}


def random_trigger(random: np.random.Generator) -> tuple[tuple[float, float], ...]:
    """Points (time, travel) of a trigger that is pulled, moved and released at random."""
    points, time_s = [(0.0, 0.0), (PULL_S, 0.0)], PULL_S
    while time_s < NORMAL_S:
        travel = float(random.choice([random.uniform(0.2, 1.0), 1.0, 0.0], p=[0.6, 0.3, 0.1]))
        moved_s = time_s + float(random.choice([0.02, 0.1, 0.4]))
        time_s = moved_s + random.uniform(0.1, 0.8)
        points += [(moved_s, travel), (time_s, travel)]
    return tuple(points)


def random_load(random: np.random.Generator, most_nm: float) -> tuple[tuple[float, float], ...]:
    """Points (time, load) of random loads that rise within 0.1, 5 or 50 ms."""
    points, time_s = [(0.0, 0.0)], 0.6
    while time_s < NORMAL_S:
        taken_s = time_s + float(random.choice([1e-4, 5e-3, 0.05]))
        points += [(time_s, points[-1][1]), (taken_s, random.uniform(0.0, most_nm))]
        time_s = taken_s + random.uniform(0.05, 0.6)
    return tuple(points)


def normal_work(variant: Variant, *, gear: str, seed: int, **_: Any) -> Figures:
    """A normal run with drawn supply, pack, trigger, load (random, or a screw) and pulse mode: its
    stop reason.
    """
    random = np.random.default_rng([seed, 4])
    supply_v, pack_ohm, pulse = (
        random.uniform(16.0, 20.5),
        float(random.choice([0.0, PACK_OHM])),
        bool(random.integers(2)),
    )
    most_nm = GEARS[gear].normal_nm * (PACK_SHARE if pack_ohm else 1.0)
    on_screw, rise = bool(random.integers(2)), GEARS[gear].screw_nm_per_rad * random.uniform(0.1, 1)
    screw = Screw(rise, random.uniform(2.0, 30.0), most_nm)
    rig = drill_rig(gear, supply_v, screw if on_screw else None, pack_ohm)
    profile = Profile(
        travel=random_trigger(random),
        load_nm=((0.0, 0.0),) if on_screw else random_load(random, most_nm),
    )
    profile = replace(profile, reverse=((0.0, float(not on_screw and random.integers(2) == 1)),))
    params = drill_params(gear, pulse=pulse)
    run = run_plan(rig, RunPlan(profile, variant.mode, params, NORMAL_S, seed))
    return {
        "reason": "kickback" if "kickback" in reasons(run) else reason_of(run),
        "faults": run.faults,
    }


def reasons(run: Run) -> set[str]:
    """All stop reasons of the drives of a run."""
    names = telemetry.value_table("CONTROL", "stop_reason")
    return {names[int(code)] for code in np.unique(run.control["stop_reason"])}


WORK = {"clutch": clutch_work, "lock": lock_work, NORMAL: normal_work}


def jobs(chosen: Sequence[dict[str, Any]]) -> list[Job]:
    """Every chosen cell under the controller."""
    return [Job(WORK[cell["kind"]], CONTROLLER, cell) for cell in chosen]


def clutch_rows(rows: Sequence[Figures]) -> list[Figures]:
    """Mean and spread of the torque for each gear and setting, over all supplies and joints."""
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
        enough = len(peak) > 1
        found.append(
            {
                "gear": gear,
                "clutch_nm": clutch_nm,
                "runs": len(chosen),
                "stopped": len(peak),
                "mean_nm": float(peak.mean()) if enough else None,
                "spread": float(peak.std() / peak.mean()) if enough else None,
            }
        )
    return found


def lock_rows(rows: Sequence[Figures]) -> list[Figures]:
    """For each gear the time from the begin of the lock to the open bridge."""
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
