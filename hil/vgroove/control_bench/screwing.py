"""Precise screwing: three lag screws in softer and harder wood; impact rate, turn past the seat,
stripped and early stops, time.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from vgroove.control_bench.jobs import PLAIN, Figures, Job, Variant
from vgroove.control_bench.runs import (
    PULL_S,
    Run,
    RunPlan,
    passing_s,
    pull,
    reference,
    run_plan,
    sil_run,
)
from vgroove.control_bench.sets import half_of, seed_of
from vgroove.reference.joints import REFERENCE_JOINTS
from vgroove.rig import Rig
from vgroove.units import TURN_RAD

SIZES = ("m6", "m8", "m10")
SUPPLIES_V = (16.0, 18.5, 20.5)
WOODS = (0.75, 1.0, 1.25)  # of the nominal torques
TRIGGERS = (0.5, 0.65, 0.8, 1.0)
KNOTS = (False, True)
SCATTER = 0.15  # 1 sigma of start and end torque, by the pilot hole
SCATTER_LIMITS = (0.5, 1.5)
KNOT_SHARE = 0.5  # of the end torque: a knot adds it over KNOT_TURNS
KNOT_TURNS = 1.0
KNOT_PLACE = (1 / 3, 2 / 3)  # drawn: start of the knot, of the way to the seat
TURNS_LEFT = (4.0, 12.0)  # drawn: turns from the start of the run to the seat
RELEASE_S = 0.2  # after the seat: reaction time of the operator without control
MAX_SECONDS = 45.0
LONGEST_S = MAX_SECONDS - PULL_S  # from the pull to the end of a run
STRIPPED_MORE_RAD = 20.0  # past the end of the seating ramp: a run ends there
REST_S = 0.15  # with the bridge open for so long a drive is over
TRUTH_EVERY = 31  # PWM periods: about 1 ms
VARIANTS = (PLAIN, Variant("screwing", "screwing"))
# Change of the impact rate of small and soft screws, turn past the seat, share of early stops,
# ratio of the times to the seat: the project's goals (docs/controllers/screwing.md).
GOALS = {"rate": -0.33, "turn_deg": 45.0, "early": 0.01, "time": 2.5}
CELL_KEYS = ("size", "supply_v", "wood", "trigger", "knot", "seed")


def cells(repeats: int = 1) -> list[dict[str, Any]]:
    """All cells, each in one of the halves; each repeat draws another screw."""
    found = []
    combinations = product(
        enumerate(SIZES),
        enumerate(SUPPLIES_V),
        enumerate(WOODS),
        enumerate(TRIGGERS),
        KNOTS,
        range(repeats),
    )
    for (n, size), (s, supply_v), (w, wood), (t, trigger), knot, repeat in combinations:
        half = half_of(n + w, s + t)
        seed = seed_of(half, repeat, n, s, w, t, int(knot))
        found.append(
            {
                "set": half,
                "size": size,
                "supply_v": supply_v,
                "wood": wood,
                "trigger": trigger,
                "knot": knot,
                "seed": seed,
            }
        )
    return found


def screw(size: str, supply_v: float, wood: float, knot: bool, seed: int) -> Rig:
    """The tool on one screw: start and end torque are drawn, all torques scale with the wood."""
    random = np.random.default_rng([seed, 9])
    scatter = np.clip(1.0 + SCATTER * random.standard_normal(2), *SCATTER_LIMITS)
    load = REFERENCE_JOINTS[size].load
    changed = {
        **load,
        "start_nm": load["start_nm"] * wood * scatter[0],
        "end_nm": load["end_nm"] * wood * scatter[1],
        "seat_nm": load["seat_nm"] * wood,
        "from_turns": load["turns"] - random.uniform(*TURNS_LEFT),
    }
    rig = reference(changed, supply_v=supply_v)
    if not knot:
        return rig
    begin = TURN_RAD * (load["turns"] - changed["from_turns"]) * random.uniform(*KNOT_PLACE)
    torque = {
        "torque_nm": KNOT_SHARE * changed["end_nm"],
        "from_rad": begin,
        "to_rad": begin + TURN_RAD * KNOT_TURNS,
    }
    return rig.with_effects({"wood_knot": torque})


class DriveEnd:
    """Stop condition of a run: the bridge has been open for REST_S after the drive, or the screw
    has turned STRIPPED_MORE_RAD past `stripped_rad`.
    """

    def __init__(self, stripped_rad: float) -> None:
        self._stripped_rad, self._open_since, self._driven = stripped_rad, None, False

    def __call__(self, tool: Any, progress: Any) -> bool:
        """Whether the run ends; called after each 16 ms."""
        if not progress.gates.coast:
            self._driven, self._open_since = True, None
        elif self._driven and self._open_since is None:
            self._open_since = progress.time_s
        resting = self._open_since is not None and progress.time_s - self._open_since > REST_S
        return resting or tool.head_rad > self._stripped_rad + STRIPPED_MORE_RAD


def ramp_end_rad(rig: Rig) -> float:
    """Head angle from the run's start at which the seating ramp ends and the screw begins to
    strip.
    """
    return TURN_RAD * (rig.load["turns"] - rig.load["from_turns"]) + np.radians(
        rig.load["seat_deg"]
    )


def plain_run(rig: Rig, trigger: float, seed: int) -> Run:
    """Without control: the operator releases the trigger RELEASE_S after the seat, whose time a
    first run finds.
    """
    plan = RunPlan(
        pull(trigger),
        duration_s=MAX_SECONDS,
        seed=seed,
        truth_every=TRUTH_EVERY,
        stop_when=lambda tool, _: tool.head_rad > ramp_end_rad(rig),
    )
    probe = run_plan(rig, plan)
    seated_s = passing_s(probe, probe.seat_rad)
    if seated_s is None:
        return probe
    released = pull(trigger, release_s=seated_s + RELEASE_S)
    return run_plan(rig, replace(plan, profile=released, stop_when=DriveEnd(ramp_end_rad(rig))))


def work(variant: Variant, **cell: Any) -> Figures:
    """One screw."""
    trigger, seed = cell["trigger"], cell["seed"]
    rig = screw(cell["size"], cell["supply_v"], cell["wood"], cell["knot"], seed)
    return drive(variant, rig, trigger, seed)


def drive(variant: Variant, rig: Rig, trigger: float, seed: int) -> Figures:
    """One drive of a tool on a screw; without control the operator ends it."""
    if variant.name == PLAIN.name:
        return screw_figures(plain_run(rig, trigger, seed))
    run = sil_run(
        rig,
        mode=variant.mode,
        params=variant.params,
        profile=pull(trigger),
        duration_s=MAX_SECONDS,
        seed=seed,
        truth_every=TRUTH_EVERY,
        stop_when=DriveEnd(ramp_end_rad(rig)),
    )
    return screw_figures(run)


def screw_figures(run: Run) -> Figures:
    """Figures of one screw; `past_deg` is the largest turn past the seat."""
    head = float(run.truth["head_rad"].max())
    seated_s = passing_s(run, run.seat_rad)
    blows = run.struck_s
    ended = run.duration_s < MAX_SECONDS - 0.1
    return {
        "rate_per_s": float(1.0 / np.diff(blows).mean()) if len(blows) > 3 else None,
        "blows": len(blows),
        "past_deg": float(np.degrees(head - run.seat_rad)),
        "blow_deg": blow_turn_deg(run, blows),
        "stripped": bool(head > ramp_end_rad(run.rig)),
        "early": bool(ended and head < run.seat_rad),
        "never": not ended,
        "seat_s": None if seated_s is None else seated_s - PULL_S,
        "reason": int(run.control["stop_reason"][-1]) if len(run.control["time_s"]) else None,
        "faults": run.faults,
    }


def blow_turn_deg(run: Run, blows: np.ndarray) -> float:
    """Turn in degrees by the last blow before the seat; 0 where there is none."""
    heads = np.interp(blows, run.truth["time_s"], run.truth["head_rad"])
    before = np.flatnonzero(heads < run.seat_rad)
    if not len(before) or before[-1] + 1 >= len(heads):
        return 0.0
    return float(np.degrees(heads[before[-1] + 1] - heads[before[-1]]))


def jobs(chosen: Sequence[dict[str, Any]], variants: Sequence[Variant] = VARIANTS) -> list[Job]:
    """Every chosen cell under every variant."""
    return [Job(work, variant, cell) for variant in variants for cell in chosen]


def cell_key(row: Figures) -> tuple[Any, ...]:
    """The keys that identify a screw."""
    return tuple(row[key] for key in CELL_KEYS)


def is_soft(row: Figures) -> bool:
    """Whether a row is of the smallest screw or of soft wood."""
    return row["size"] == "m6" or row["wood"] < 1.0


def time_ratios(pairs: Sequence[tuple[Figures, Figures]]) -> list[float]:
    """Ratios of the times to the seat over pairs (without, with control) of the same screw.

    A screw that control does not seat within MAX_SECONDS counts with that time, which is less than
    it needs. One that control stops before the seat has no such time, and is counted as `early`.
    """
    return [
        (b["seat_s"] or LONGEST_S) / a["seat_s"]
        for a, b in pairs
        if a["seat_s"] and (b["never"] or b["seat_s"])
    ]


def totals(rows: Sequence[Figures]) -> Figures:
    """Counts, medians and extremes of one variant on some screws; the turn past the seat over the
    screws that reach it.

    The limit of the turn past the seat is the goal's, or the turn by a single blow where that is
    larger.
    """
    seated = [r["seat_s"] for r in rows if r["seat_s"] is not None]
    past = np.array([r["past_deg"] for r in rows if r["seat_s"] is not None])
    limits = np.array([max(GOALS["turn_deg"], r["blow_deg"]) for r in rows])
    return {
        "screws": len(rows),
        "past_deg_median": float(np.median(past)) if len(past) else None,
        "past_deg_most": float(past.max()) if len(past) else None,
        "limit_deg_median": float(np.median(limits)),
        "stripped": sum(r["stripped"] for r in rows),
        "early": sum(r["early"] for r in rows),
        "never": sum(r["never"] for r in rows),
        "seat_s_median": float(np.median(seated)) if seated else None,
    }


def compare(rows: Sequence[Figures], variant: str, size: str | None = None) -> Figures:
    """A variant against no control over the same screws, of one size or all."""
    plain = {cell_key(r): r for r in rows if r["variant"] == PLAIN.name}
    chosen = [r for r in rows if r["variant"] == variant and size in (None, r["size"])]
    pairs = [(plain[cell_key(r)], r) for r in chosen]
    rates = [
        b["rate_per_s"] / a["rate_per_s"] - 1.0
        for a, b in pairs
        if is_soft(b) and a["rate_per_s"] and b["rate_per_s"]
    ]
    times = time_ratios(pairs)
    return {
        "variant": variant,
        "size": size or "all",
        **totals(chosen),
        "rate_change_soft": float(np.mean(rates)) if rates else None,
        "timed": len(times),
        "time_ratio": float(np.mean(times)) if times else None,
        "time_ratio_most": float(np.max(times)) if times else None,
    }
