"""A bound of what control can do about vibration: a search, with full knowledge of the tool, for
the duty over the start and a harmonic in phase with the true blows.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vgroove import _core
from vgroove.control_bench import vibration
from vgroove.control_bench.jobs import Figures, Job, Variant
from vgroove.control_bench.runs import PULL_S, Run, reference
from vgroove.reference.blows import BLOW
from vgroove.rig import Rig

BOUND = Variant(vibration.BOUND)
TICK_S = 1e-3
SUBSTEPS = 8  # kept states of the plant in a tick
NODES_S = np.arange(0.0, 0.301, 0.025)  # after the pull; the duty is linear between the nodes
RAMP_PER_S = 6.0  # slew rate of the firmware's duty
# A shape is the duty at NODES_S, then the cosine and sine amplitudes of the harmonic.
START = np.r_[np.minimum(RAMP_PER_S * NODES_S, 1.0), 0.0, 0.0]  # the uncontrolled tool
PHASE_ERRORS = np.linspace(-0.5, 0.5, 17)  # in periods


@dataclass(frozen=True)
class Task:
    """A tool on its joint, the head angle that ends a run, and the seed of the plant: the same for
    the uncontrolled run and for every shape that is compared with it.
    """

    rig: Rig
    aim: float
    seed: int


@dataclass(frozen=True)
class Search:
    """Settings of the search for a shape, chosen by trial."""

    evaluations: int = 200
    time_limit: float = 1.05  # of the uncontrolled tool's time to the aim
    # relative increase of the cost, per excess over time_limit as a share of the same time
    time_cost: float = 20.0
    failed_cost: float = 100.0  # of a shape that does not reach the aim, N m
    give_up: float = 1.2  # of the uncontrolled tool's time: a run ends there
    least: float = -0.3  # of each number of a shape
    most: float = 1.2
    step: float = 0.2  # initial standard deviation of a change
    min_step: float = 0.05
    changed_share: float = 0.4  # probability that a number changes
    growth: float = 1.3  # of the step after a success
    shrinkage: float = 0.95  # of the step after a failure


SEARCH = Search()


def shaped_duty(shape: np.ndarray, time_s: float, phase: float | None) -> float:
    """Duty of a shape at a time after the pull, within 0..1; the harmonic is added where the phase
    (0..1 from blow to blow) is known.
    """
    duty = np.interp(time_s, NODES_S, shape[:-2])
    if phase is not None:
        duty += shape[-2] * np.cos(2 * np.pi * phase) + shape[-1] * np.sin(2 * np.pi * phase)
    return float(np.clip(duty, 0.0, 1.0))


class BlowPhase:
    """The phase of the cycle by the true blows: the time since the last blow over the last
    period.
    """

    def __init__(self) -> None:
        self._last_s, self._period_s = None, None

    def add(self, blows: np.ndarray) -> None:
        """Take the blows since the last call."""
        for time_s in blows["time_s"][blows["kind"] == BLOW]:
            if self._last_s is not None and time_s > self._last_s:
                self._period_s = time_s - self._last_s
            self._last_s = time_s

    def at(self, time_s: float) -> float | None:
        """The phase 0..1 at a time; None before the second blow."""
        return None if self._period_s is None else ((time_s - self._last_s) / self._period_s) % 1.0


def shaped_run(
    task: Task, shape: np.ndarray, *, phase_error: float = 0.0, give_up_s: float = 10.0
) -> Run:
    """A run of the plant without firmware, its duty given by a shape, until the head has passed the
    aim, and for give_up_s at most.

    `phase_error` in periods delays the harmonic against the true blows.
    """
    rig = task.rig
    tool = _core.ImpactPlant(
        rig.parameters(), load_kind=rig.load["kind"], seed=task.seed, hall_pulses_per_rev=0
    )
    cycle, rows, blows, reached = BlowPhase(), [], [], vibration.beyond(task.aim)
    for tick in range(round(vibration.SECONDS / TICK_S)):
        time_s = tick * TICK_S
        fresh = tool.blows()
        blows.append(fresh)
        cycle.add(fresh)
        phase = cycle.at(time_s + 0.5 * TICK_S)
        duty = shaped_duty(shape, time_s, None if phase is None else phase + phase_error)
        rows += [advanced(tool, duty) for _ in range(SUBSTEPS)]
        if reached(tool, None) or time_s > give_up_s:
            break
    struck = np.concatenate(blows)
    struck["time_s"] += PULL_S
    return Run(rig, tool, b"", tool.time_s + PULL_S, struck, np.array(rows))


def advanced(tool: Any, duty: float) -> tuple[float, ...]:
    """Advance the plant by a substep; the row of vgroove._core.TRUTH_COLUMNS at its end."""
    row = tool.advance(TICK_S / SUBSTEPS, duty)
    return (
        tool.time_s + PULL_S,
        row.current_a,
        row.speed_rad_s,
        row.hammer_mm,
        row.head_rad,
        row.anvil_torque_nm,
        row.housing_nm,
        duty,
    )


def shaped_figures(task: Task, shape: np.ndarray, **options: float) -> Figures:
    """Figures of vibration.run_figures of a run under a shape; options: those of shaped_run."""
    return vibration.run_figures(shaped_run(task, shape, **options), task.aim)


def cost(shape: np.ndarray, task: Task, plain_s: float) -> float:
    """Cost of a shape in N m: its RMS, raised where it takes longer than SEARCH.time_limit.

    `plain_s` is the time that the uncontrolled tool takes to the aim.
    """
    figures = shaped_figures(task, shape, give_up_s=SEARCH.give_up * plain_s)
    if figures["rms_nm"] is None:
        return SEARCH.failed_cost
    late = max(0.0, figures["time_s"] / plain_s - SEARCH.time_limit)
    return figures["rms_nm"] * (1.0 + SEARCH.time_cost * late)


def best_shape(task: Task, plain_s: float) -> np.ndarray:
    """The shape of least cost by a (1+1) evolution strategy whose step grows with each success and
    shrinks with each failure (Rechenberg 1973).
    """
    random = np.random.default_rng(task.seed)
    best, step = START, SEARCH.step
    least = cost(best, task, plain_s)
    for _ in range(SEARCH.evaluations):
        changed = random.standard_normal(len(best)) * (
            random.random(len(best)) < SEARCH.changed_share
        )
        child = np.clip(best + step * changed, SEARCH.least, SEARCH.most)
        found = cost(child, task, plain_s)
        if found < least:
            best, least, step = child, found, SEARCH.growth * step
        else:
            step = max(SEARCH.shrinkage * step, SEARCH.min_step)
    return best


def work(variant: Variant, **cell: Any) -> Figures:
    """The best shape of one cell beside the uncontrolled run that it is compared with (`plain`),
    and with `margin` the loss of its gain by an error of the phase.
    """
    del variant
    supply_v, load = cell["supply_v"], cell["load"]
    rig, aim = reference(load, supply_v=supply_v), vibration.aim_rad(supply_v, load)
    task = Task(rig, aim, cell["seed"])
    plain = shaped_figures(task, START)
    best = best_shape(task, plain["time_s"])
    found = {**shaped_figures(task, best), "shape": best.tolist(), "plain": plain}
    if cell["margin"]:
        found["margin"] = [phase_row(task, best, error, plain["rms_nm"]) for error in PHASE_ERRORS]
    return found


def phase_row(task: Task, shape: np.ndarray, error: float, plain_nm: float) -> Figures:
    """Relative change of the RMS where the phase of the harmonic is wrong by `error` periods."""
    figures = shaped_figures(task, shape, phase_error=error)
    return {
        "phase_error": float(error),
        "change": None if figures["rms_nm"] is None else figures["rms_nm"] / plain_nm - 1.0,
    }


def jobs(chosen: Sequence[dict[str, Any]]) -> list[Job]:
    """Every chosen cell; the first one with the margin of its phase."""
    return [Job(work, BOUND, {**cell, "margin": n == 0}) for n, cell in enumerate(chosen)]
