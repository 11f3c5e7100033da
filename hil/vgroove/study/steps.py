"""The drill driver's part of `vgroove study steps`: variable step, fixed steps against the
reference, execution time.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vgroove import _core
from vgroove.progress import Tick
from vgroove.study import drill
from vgroove.study.drill import DURATION_S, GRID_S, MODES, PARAMETER_STEPS, SOLVERS, Case
from vgroove.study.step_events import event_rows, event_summary, step_figures

DESIGN_STEPS_S = (70e-6, 40e-6, 35e-6)  # docs/spec/model.md, section 7
SWEEP_S = (10e-6, 100e-3)  # shortest and longest fixed step
MAX_SPEED_ERROR = 0.01  # of the no-load speed: a fixed step with a larger error is too long


def sweep_steps(points: int) -> np.ndarray:
    """Fixed steps (n,) of the sweep in s: multiples of the reference's grid, DESIGN_STEPS_S
    included.
    """
    wanted = np.concatenate([np.geomspace(*SWEEP_S, points), DESIGN_STEPS_S])
    # in this order of operations 35e-6 is met to the last bit
    return np.unique(np.rint(wanted / GRID_S)) * (GRID_S * 1e6) / 1e6


def history(case: Case, tolerance: float) -> dict[str, Any]:
    """The variable-step run: its accepted steps, and the event that ended each."""
    run = _core.simulate_drill(
        case.parameters,
        duration_s=DURATION_S,
        tolerance=tolerance,
        columns=["time_s", "current_a", "chuck_rad_s"],
    )
    return {
        "case": case,
        "time_s": run["steps"]["time_s"],
        "length_s": run["steps"]["length_s"],
        "mark": run["steps"]["mark"],
        "rejected": run["rejected"],
        "current_a": run["current_a"][1:],
        "chuck_rad_s": run["chuck_rad_s"][1:],
    }


def sweep_case(case: Case, steps_s: np.ndarray, tick: Tick) -> list[dict[str, Any]]:
    """Errors of every fixed-step solver at every step; `tick` is called once a solver."""
    best = drill.reference(case)
    rows = []
    for solver in SOLVERS:
        for step_s in steps_s:
            errors = drill.speed_errors(case, drill.fixed(case, solver, float(step_s)), best)
            rows.append(
                {
                    "mode": case.mode,
                    "parameter_step": case.parameter_step,
                    "solver": solver,
                    "step_s": float(step_s),
                    "speed_error": errors["speed_rad_s"],
                    "chuck_error": errors["chuck_rad_s"],
                }
            )
        tick(f"{case.title}: {SOLVERS[solver]}")
    return rows


def largest_below(rows: Sequence[dict[str, Any]], key: str) -> float | None:
    """The longest step up to which the error `key` of every shorter one is below MAX_SPEED_ERROR;
    None where the shortest step exceeds it.
    """
    longest = None
    for row in sorted(rows, key=lambda r: r["step_s"]):
        if row[key] is None or row[key] >= MAX_SPEED_ERROR:
            return longest
        longest = row["step_s"]
    return longest


def largest_steps(sweep: Sequence[dict[str, Any]], chosen: Sequence[Case]) -> list[dict[str, Any]]:
    """Largest step below MAX_SPEED_ERROR for each case and solver, and the limit of linear
    stability of the explicit solvers.
    """
    found = []
    for case in chosen:
        for solver in SOLVERS:
            rows = [
                r
                for r in sweep
                if (r["mode"], r["parameter_step"], r["solver"])
                == (case.mode, case.parameter_step, solver)
            ]
            theory = None if solver == "real_time" else drill.stability_limit_s(case, solver)
            found.append(
                {
                    "mode": case.mode,
                    "parameter_step": case.parameter_step,
                    "solver": solver,
                    "speed_s": largest_below(rows, "speed_error"),
                    "chuck_s": largest_below(rows, "chuck_error"),
                    "stability_limit_s": theory,
                }
            )
    return found


def execution(case: Case, repeats: int, tick: Tick) -> list[dict[str, Any]]:
    """Execution time per step in ns, for each solver and each of DESIGN_STEPS_S.

    The run is deterministic: the least time of a step over `repeats` runs is that without
    interruptions by the operating system.
    """
    rows = []
    for solver in SOLVERS:
        for step_s in DESIGN_STEPS_S:
            runs = np.array(
                [
                    drill.fixed(case, solver, step_s, timed=True)["execution_ns"]
                    for _ in range(repeats)
                ]
            )
            least = runs.min(axis=0)
            rows.append(
                {
                    "solver": solver,
                    "step_s": step_s,
                    "mean_ns": float(least.mean()),
                    "p999_ns": float(np.percentile(least, 99.9)),
                    "worst_ns": float(least.max()),
                    "worst_disturbed_ns": float(runs.max()),
                    "worst_share": float(least.max() * 1e-9 / step_s),
                }
            )
        tick(f"execution time: {SOLVERS[solver]}")
    return rows


@dataclass(frozen=True)
class DrillSteps:
    """Results of the study: step histories of the variable-step solver, and the JSON's content."""

    histories: list[dict[str, Any]]
    data: dict[str, Any]


@dataclass(frozen=True)
class Effort:
    """How much is computed: points of the sweep of fixed steps, relative tolerance of the
    variable-step solver, runs behind each execution time.
    """

    points: int
    tolerance: float
    repeats: int


def run_drill_steps(parameters: dict[str, float], effort: Effort, tick: Tick) -> DrillSteps:
    """Run the drill driver's part of the study; `tick` is called drill_ticks() times."""
    chosen = drill.cases(parameters)
    histories = []
    for case in chosen:
        histories.append(history(case, effort.tolerance))
        tick(f"{case.title}: variable step")
    steps_s = sweep_steps(effort.points)
    sweep = [row for case in chosen for row in sweep_case(case, steps_s, tick)]
    timed = next(c for c in chosen if c.mode == "pulse" and c.parameter_step == 1)
    data = {
        "parameters": parameters,
        "tolerance": effort.tolerance,
        "variable": [variable_row(h) for h in histories],
        "events": [row for h in histories for row in history_events(h)],
        "sweep": sweep,
        "largest": largest_steps(sweep, chosen),
        "execution": execution(timed, effort.repeats, tick),
    }
    return DrillSteps(histories, data)


def drill_ticks() -> int:
    """How often run_drill_steps() calls `tick`."""
    count = len(MODES) * len(PARAMETER_STEPS)
    return count + count * len(SOLVERS) + len(SOLVERS)


def variable_row(h: dict[str, Any]) -> dict[str, Any]:
    """Step sizes of one history."""
    case = {
        "mode": h["case"].mode,
        "parameter_step": h["case"].parameter_step,
        "rejected": h["rejected"],
    }
    return case | step_figures(h["length_s"], h["mark"])


def history_events(h: dict[str, Any]) -> list[dict[str, Any]]:
    """Events of one history, a row for each kind."""
    case = {"mode": h["case"].mode, "parameter_step": h["case"].parameter_step}
    rows = event_rows(h["time_s"], h["length_s"], h["mark"])
    return [case | row for row in event_summary(rows)]
