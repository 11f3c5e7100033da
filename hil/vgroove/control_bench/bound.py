"""What full knowledge could do about vibration: the duty over the start and a harmonic locked to
the true blows, found by search.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from vgroove import _core
from vgroove.control_bench import vibration
from vgroove.control_bench.jobs import Figures, Job, Variant
from vgroove.control_bench.runs import PULL_S, Run, reference
from vgroove.rig import Rig

BOUND = Variant(vibration.BOUND)
TICK_S = 1e-3
SUBSTEPS = 8  # rows of the truth in a tick
TIME_LIMIT, TIME_PRICE = 1.05, 20.0  # of the uncontrolled tool's time; price of what is beyond it
EVALUATIONS = 200
NODES_S = np.arange(0.0, 0.301, 0.025)  # of the duty's course at the start
RAMP_PER_S = 6.0  # of the firmware's duty
START = np.r_[np.minimum(RAMP_PER_S * NODES_S, 1.0), 0.0, 0.0]  # the uncontrolled tool
LEAST, MOST = -0.3, 1.2
# of the search: standard deviation, and how many of the numbers change at once
STEP, STEP_LEAST, SHARE = 0.2, 0.05, 0.4
PHASE_ERRORS = np.linspace(-0.5, 0.5, 17)  # of a period


def shaped_duty(shape: np.ndarray, time_s: float, phase: float | None) -> float:
    """The course over time and, where the phase is known, cos and sin of the cycle from blow to
    blow; within what the bridge can do.
    """
    duty = np.interp(time_s, NODES_S, shape[:-2])
    if phase is not None:
        duty += shape[-2] * np.cos(2 * np.pi * phase) + shape[-1] * np.sin(2 * np.pi * phase)
    return float(np.clip(duty, 0.0, 1.0))


class KnownPhase:
    """The cycle's phase from the true blows: time since the last, over the last period."""

    def __init__(self) -> None:
        self._last_s, self._period_s = None, None

    def see(self, blows: np.ndarray) -> None:
        """Blows since the last call."""
        for time_s in blows["time_s"][blows["kind"] == 0]:
            if self._last_s is not None and time_s > self._last_s:
                self._period_s = time_s - self._last_s
            self._last_s = time_s

    def at(self, time_s: float) -> float | None:
        """0..1, None before the second blow."""
        return None if self._period_s is None else ((time_s - self._last_s) / self._period_s) % 1.0


def known_run(
    rig: Rig, shape: np.ndarray, aim: float, *, phase_error: float = 0.0, give_up_s: float = 10.0
) -> Run:
    """The plant alone under a shape until the aim or give_up_s: the duty at NODES_S, then cos and
    sin locked to the true blows.
    """
    tool = _core.ImpactPlant(rig.parameters(), load_kind=rig.load["kind"], hall_pulses_per_rev=0)
    known, rows, blows = KnownPhase(), [], []
    for tick in range(round(vibration.SECONDS / TICK_S)):
        time_s = tick * TICK_S
        fresh = tool.blows()
        blows.append(fresh)
        known.see(fresh)
        phase = known.at(time_s + 0.5 * TICK_S)
        duty = shaped_duty(shape, time_s, None if phase is None else phase + phase_error)
        for _ in range(SUBSTEPS):
            now = tool.advance(TICK_S / SUBSTEPS, duty)
            rows.append(
                (
                    tool.time_s + PULL_S,
                    now.current_a,
                    now.speed_rad_s,
                    now.hammer_mm,
                    now.head_rad,
                    now.anvil_torque_nm,
                    now.housing_nm,
                    duty,
                )
            )
        if tool.head_rad > 1.02 * aim + 0.05 or time_s > give_up_s:
            break
    struck = np.concatenate(blows)
    struck["time_s"] += PULL_S
    return Run(rig, tool, b"", tool.time_s + PULL_S, struck, np.array(rows))


def price(shape: np.ndarray, rig: Rig, aim: float, plain_s: float) -> float:
    """RMS, and a price on time beyond the limit; a shape that does not get there costs most."""
    figures = vibration.run_figures(known_run(rig, shape, aim, give_up_s=1.2 * plain_s), aim)
    if figures["rms_nm"] is None:
        return 100.0
    return figures["rms_nm"] * (
        1.0 + TIME_PRICE * max(0.0, figures["time_s"] / plain_s - TIME_LIMIT)
    )


def best_shape(rig: Rig, aim: float, plain_s: float, seed: int) -> np.ndarray:
    """By an evolution strategy of one parent and one child, whose step grows with each success
    (Rechenberg's rule).
    """
    random = np.random.default_rng(seed)
    best, step = START, STEP
    least = price(best, rig, aim, plain_s)
    for _ in range(EVALUATIONS):
        change = random.standard_normal(len(best)) * (random.random(len(best)) < SHARE)
        child = np.clip(best + step * change, LEAST, MOST)
        cost = price(child, rig, aim, plain_s)
        if cost < least:
            best, least, step = child, cost, 1.3 * step
        else:
            step = max(0.95 * step, STEP_LEAST)
    return best


def work(
    variant: Variant, *, supply_v: float, load: str, seed: int, margin: bool = False, **_: Any
) -> Figures:
    """The best shape of one cell, and how its gain goes with an error of the phase."""
    del variant
    rig, aim = reference(load, supply_v=supply_v), vibration.aim_rad(supply_v, load)
    plain = vibration.run_figures(known_run(rig, START, aim), aim)
    best = best_shape(rig, aim, plain["time_s"], seed)
    found = {
        **vibration.run_figures(known_run(rig, best, aim), aim),
        "shape": best.tolist(),
        "plain": plain,
    }
    if margin:
        found["margin"] = [
            phase_row(rig, best, aim, error, plain["rms_nm"]) for error in PHASE_ERRORS
        ]
    return found


def phase_row(rig: Rig, shape: np.ndarray, aim: float, error: float, plain_nm: float) -> Figures:
    """Change of RMS when the shape stands `error` of a period beside the blows."""
    figures = vibration.run_figures(known_run(rig, shape, aim, phase_error=error), aim)
    return {
        "phase_error": float(error),
        "change": None if figures["rms_nm"] is None else figures["rms_nm"] / plain_nm - 1.0,
    }


def jobs(chosen: Sequence[dict[str, Any]]) -> list[Job]:
    """Every chosen cell; the first one with its margin."""
    return [Job(work, BOUND, {**cell, "margin": n == 0}) for n, cell in enumerate(chosen)]
