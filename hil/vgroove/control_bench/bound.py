"""What full knowledge could do about vibration: a ramp and two harmonics of the duty locked to the true blows, found by search."""

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
EVALUATIONS = 150
START = np.array([6.0, 1.0, 0.0, 0.0, 0.0, 0.0])  # the uncontrolled tool
SCALE = np.array([2.0, 0.2, 0.2, 0.2, 0.2, 0.2])
LEAST = np.array([0.5, 0.3, -1.0, -1.0, -1.0, -1.0])
MOST = np.array([6.0, 1.3, 1.0, 1.0, 1.0, 1.0])
PHASE_ERRORS = np.linspace(-0.5, 0.5, 17)  # of a period


def shaped_duty(shape: Sequence[float], phase: float) -> float:
    """Mean and two harmonics over the cycle from blow to blow, within what the bridge can do."""
    _, mean, cos_1, sin_1, cos_2, sin_2 = shape
    turn = 2 * np.pi * phase
    wave = cos_1 * np.cos(turn) + sin_1 * np.sin(turn) + cos_2 * np.cos(2 * turn) + sin_2 * np.sin(2 * turn)
    return float(np.clip(mean + wave, 0.0, 1.0))


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


def known_run(rig: Rig, shape: Sequence[float], aim: float, *, phase_error: float = 0.0, give_up_s: float = 10.0) -> Run:
    """The plant alone until the aim or give_up_s. shape: ramp per s, then mean and cos and sin of two harmonics, locked from the
    second blow on."""
    tool = _core.ImpactPlant(rig.parameters(), load_kind=rig.load["kind"], hall_pulses_per_rev=0)
    known, rows, blows = KnownPhase(), [], []
    for tick in range(round(vibration.SECONDS / TICK_S)):
        time_s = tick * TICK_S
        fresh = tool.blows()
        blows.append(fresh)
        known.see(fresh)
        phase = known.at(time_s + 0.5 * TICK_S)
        duty = min(1.0, shape[0] * time_s, 1.0 if phase is None else shaped_duty(shape, phase + phase_error))
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


def price(shape: Sequence[float], rig: Rig, aim: float, plain_s: float) -> float:
    """RMS, and a price on time beyond the limit; a shape that does not get there costs most."""
    figures = vibration.run_figures(known_run(rig, shape, aim, give_up_s=1.2 * plain_s), aim)
    if figures["rms_nm"] is None:
        return 100.0
    return figures["rms_nm"] * (1.0 + TIME_PRICE * max(0.0, figures["time_s"] / plain_s - TIME_LIMIT))


def best_shape(rig: Rig, aim: float, plain_s: float, seed: int) -> np.ndarray:
    """By an evolution strategy of one parent and one child, whose step grows with each success (Rechenberg's rule)."""
    random = np.random.default_rng(seed)
    best, step = START, 1.0
    least = price(best, rig, aim, plain_s)
    for _ in range(EVALUATIONS):
        child = np.clip(best + step * SCALE * random.standard_normal(len(best)), LEAST, MOST)
        cost = price(child, rig, aim, plain_s)
        if cost < least:
            best, least, step = child, cost, 1.3 * step
        else:
            step = max(0.94 * step, 0.1)
    return best


def work(variant: Variant, *, supply_v: float, load: str, seed: int, margin: bool = False, **_: Any) -> Figures:
    """The best shape of one cell, and how its gain goes with an error of the phase."""
    del variant
    rig, aim = reference(load, supply_v=supply_v), vibration.aim_rad(supply_v, load)
    plain = vibration.run_figures(known_run(rig, START, aim), aim)
    best = best_shape(rig, aim, plain["time_s"], seed)
    found = {**vibration.run_figures(known_run(rig, best, aim), aim), "shape": best.tolist(), "plain": plain}
    if margin:
        found["margin"] = [phase_row(rig, best, aim, error, plain["rms_nm"]) for error in PHASE_ERRORS]
    return found


def phase_row(rig: Rig, shape: Sequence[float], aim: float, error: float, plain_nm: float) -> Figures:
    """Change of RMS when the shape stands `error` of a period beside the blows."""
    figures = vibration.run_figures(known_run(rig, shape, aim, phase_error=error), aim)
    return {"phase_error": float(error), "change": None if figures["rms_nm"] is None else figures["rms_nm"] / plain_nm - 1.0}


def jobs(chosen: Sequence[dict[str, Any]]) -> list[Job]:
    """Every chosen cell; the first one with its margin."""
    return [Job(work, BOUND, {**cell, "margin": n == 0}) for n, cell in enumerate(chosen)]
