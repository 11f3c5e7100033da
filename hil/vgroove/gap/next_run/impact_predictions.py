"""Statistics of the impact cycles that parameter sets predict for a run of the menu."""

from dataclasses import replace

import numpy as np

from vgroove import _core
from vgroove.errors import VgrooveError
from vgroove.gap.catalogue import JOINTS
from vgroove.gap.next_run.menu import IMPACT_MENU, RunProfile, time_grid
from vgroove.gap.residual.clean_log import clean_log
from vgroove.gap.residual.impact.impact_run import prepare_impact_run
from vgroove.gap.residual.impact.problem import ImpactProblem
from vgroove.gap.residual.impact.roll_outs import (
    MODE,
    model_columns,
    simulate_statistics,
)
from vgroove.log import Log
from vgroove.rig import Rig

ROW_S = 1e-3
FAILED = np.nan


def impact_profiles(problem: ImpactProblem) -> list[RunProfile]:
    """The runs that a hammering tool can perform: a duty that drives it, and of the channels of a
    test bench those that the logs lack.
    """
    logged = {s.column.split(".")[0] for s in problem.signals}
    joint = problem.rig.load["kind"] in JOINTS
    return [
        profile
        for profile in IMPACT_MENU
        if not logged.intersection(profile.channels) and (joint or profile.joint != "locked")
    ]


def predicted_statistics(
    problem: ImpactProblem, profile: RunProfile, theta: np.ndarray
) -> np.ndarray:
    """Statistics (B, n) of a run in their standard deviations, for theta (B, P); the first set
    gives the windows and the deviations. nan where the tool cannot perform the run.
    """
    rig, time_s = _rig_of_run(problem.rig, profile), time_grid(ROW_S)
    plant = problem.of_log(0, theta)
    log = Log(time_s, {problem.rig.input["kind"]: profile.command(time_s)}, profile.name)
    try:
        recorded = clean_log(_recorded(problem, rig, log, profile, plant[:1]), rig)
        run = prepare_impact_run(recorded)
    except (RuntimeError, ValueError, VgrooveError):
        return np.full((len(theta), 1), FAILED)
    return (simulate_statistics(run, plant) / run.sigma)[:, run.judged]


def _rig_of_run(rig: Rig, profile: RunProfile) -> Rig:
    """The rig with the joint of a run; a locked joint keeps the twist of the rig's."""
    if not profile.joint:
        return rig
    twist = ("stiffness_nm_per_rad", "damping_nm_s_per_rad") if profile.joint == "locked" else ()
    load = {"kind": profile.joint} | {key: rig.load[key] for key in twist}
    kept = {k: v for k, v in rig.tolerance.items() if not k.startswith("load.")}
    return replace(rig, load=load, tolerance=kept)


def _recorded(
    problem: ImpactProblem, rig: Rig, log: Log, profile: RunProfile, theta: np.ndarray
) -> Log:
    """The log that one parameter set (1, P) would record of a run, without noise."""
    run = problem.runs[0]
    drive = _core.LogInput(
        log.time_s, rig.input["kind"], log.columns[rig.input["kind"]], load_kind=rig.load["kind"]
    )
    rows = _core.simulate_impact(drive, theta, mode=MODE)
    shown = model_columns(replace(run, log=log, fills={}), rows)
    columns = {name: values[0] for name, values in shown.items()}
    columns |= {name: rows[name][0] for name in profile.channels}
    return replace(log, columns=log.columns | columns)
