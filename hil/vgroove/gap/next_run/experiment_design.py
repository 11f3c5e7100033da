"""Chooses the run to record next: the one whose predicted logs differ most between the tied sets of
effects after the parameter values of both are fitted to the difference (experiment for
discriminating between models, A. C. Atkinson and V. V. Fedorov, Biometrika 62, 1975).
"""

import numpy as np

from vgroove import _core
from vgroove.gap.catalogue import SEPARATIONS
from vgroove.gap.fitting.hypothesis import Fit
from vgroove.gap.fitting.steps import difference_steps
from vgroove.gap.next_run.impact_predictions import impact_profiles, predicted_statistics
from vgroove.gap.next_run.menu import (
    MAX_INTERVAL_S,
    RunProfile,
    feasible_profiles,
    time_grid,
)
from vgroove.gap.residual.impact.problem import ImpactProblem
from vgroove.gap.residual.problem import Problem
from vgroove.gap.selection.search_state import Search
from vgroove.gap.verdict.decision import Finding
from vgroove.gap.verdict.schema import NextExperiment, ProfileSeparation
from vgroove.units import RPM_PER_RAD_S

MAX_RIVALS = 3  # tied sets that a run must separate from the best set; bounds the time
MAX_DIFFERENCE = 100.0  # sigma; differences of a sample are clipped here
MAX_SLOPE = 1e6  # sigma per scaled parameter; derivatives are clipped here
# a tool goes both ways where a command or speed is below 0 by this share of its largest magnitude,
# in at least this share of the samples
BACKWARD_SHARE, LEAST_BACKWARD = 0.05, 0.01
PRECISION = 1e-10  # relative: smaller singular values of the information matrix count as 0
# judged column -> simulated quantity and its factor; an angle is judged through its derivative, a
# coarse one in rad
SIMULATED = {
    "current_a": ("current_a", 1.0),
    "supply_v": ("supply_v", 1.0),
    "speed_rpm": ("speed_measured_rad_s", RPM_PER_RAD_S),
    "position_rad": ("speed_measured_rad_s", 1.0),
}
# covariate that a remainder follows -> run in which the covariate varies most
DEFAULT_RUN, DEFAULT_IMPACT_RUN = "staircase", "three supplies"
RUN_OF_COVARIATE = {
    "time since start": "hold at heat",
    "heat": "hold at heat",
    "current": "load steps",
    "load": "load steps",
    "sign of speed": "reversal",
    "rate of command": "fast ramps",
}


def propose(problem: Problem, search: Search, finding: Finding) -> NextExperiment | None:
    """The run that separates tied sets (verdict ambiguous), or the run in which the covariate of an
    unlisted gap varies most; None for the other verdicts.
    """
    if finding.verdict == "ambiguous":
        return most_separating_run(problem, search, finding)
    if finding.verdict == "unlisted":
        return repeating_run(problem, finding.remainder.best_correlate)
    return None


def repeating_run(problem: Problem, follows: str | None) -> NextExperiment:
    """The run in which the covariate that the remainder follows varies most."""
    runs = {c.name: c for c in runs_of(problem)}
    default = runs[DEFAULT_IMPACT_RUN if isinstance(problem, ImpactProblem) else DEFAULT_RUN]
    profile = runs.get(RUN_OF_COVARIATE.get(follows or "", ""), default)
    what = follows if follows else "none of the measured signals"
    why = f"what remains follows {what}; this run shows whether it repeats: {profile.content}"
    return NextExperiment(profile.name, why + faster_rows(problem), profile.points())


def most_separating_run(problem: Problem, search: Search, finding: Finding) -> NextExperiment:
    """The run in which the smallest difference between the best set and any rival is largest."""
    runs = {c.name: c for c in runs_of(problem)}
    least = {
        name: min(
            separation(problem, search, (finding.best, rival), profile)
            for rival in finding.rivals[:MAX_RIVALS]
        )
        for name, profile in runs.items()
    }
    name = max(least, key=lambda n: (round(least[n], 6), -list(runs).index(n)))
    ranked = sorted(least.items(), key=lambda item: (-item[1], item[0]))
    return NextExperiment(
        name,
        separation_reason(runs[name], finding, least[name]) + faster_rows(problem),
        runs[name].points(),
        [ProfileSeparation(n, sigma) for n, sigma in ranked],
    )


def separation_reason(profile: RunProfile, finding: Finding, sigma: float) -> str:
    """Why a run separates the best set from its first rival, and by how much, in a sentence."""
    rival = finding.rivals[0]
    known = SEPARATIONS.get(frozenset(set(finding.best.ids) ^ set(rival.ids)))
    why = known.reason if known and known.run.startswith(profile.name) else profile.content
    best, other = (" with ".join(one.ids) for one in (finding.best, rival))
    return (
        f"{why}; in this run {best} and {other} differ by at least {sigma:.2g} sigma a sample,"
        " whatever the sizes of their effects"
    )


def faster_rows(problem: Problem) -> str:
    """The part of a sentence that asks for faster rows than those of the logs; empty where a run
    shows with theirs.
    """
    interval_s = row_interval_s(problem)
    if interval_s <= MAX_INTERVAL_S:
        return ""
    return (
        f"; record it with rows {MAX_INTERVAL_S:g} s apart at most: those of the logs are "
        f"{interval_s:.3g} s apart"
    )


def runs_of(problem: Problem) -> list[RunProfile]:
    """The runs of the menu that the logs show the tool to be capable of."""
    if isinstance(problem, ImpactProblem):
        return impact_profiles(problem)
    kind = problem.rig.input["kind"]
    commands = np.concatenate([np.asarray(log.columns[kind], float) for log in problem.logs])
    loads = [np.nanmax(np.abs(log.columns.get("load_nm", [0.0]))) for log in problem.logs]
    loaded = problem.rig.load["kind"] == "torque" and max(loads) > 0.0
    # a current that brakes is negative although the tool turns one way
    speeds = [log.columns["speed_rpm"] for log in problem.logs if "speed_rpm" in log.columns]
    turns = np.concatenate(speeds) if kind == "current_a" and speeds else commands
    return feasible_profiles(kind == "duty", loaded, goes_both_ways(turns))


def goes_both_ways(values: np.ndarray) -> bool:
    """Whether commands or speeds (n,) are below 0 by more than noise (BACKWARD_SHARE) for more than
    an event (LEAST_BACKWARD).
    """
    known = values[np.isfinite(values)]
    backward = known < -BACKWARD_SHARE * np.max(np.abs(known), initial=0.0)
    return bool(len(known)) and float(np.mean(backward)) >= LEAST_BACKWARD


def simulation_input(problem: Problem, profile: RunProfile) -> _core.LogInput:
    """A run as input of the plant, at the logs' row interval (time_grid) and up to the largest
    command and load in them (a duty: up to 1).
    """
    rig, kind = problem.rig, problem.rig.input["kind"]
    time_s = time_grid(row_interval_s(problem))
    top = 1.0 if kind == "duty" else max_magnitude(problem, kind)
    share, more = profile.command(time_s), {}
    if "slew_per_s" in rig.input:
        more["slew_per_s"] = rig.input["slew_per_s"]
        share = slew_limited(share, np.diff(time_s, prepend=0.0) * rig.input["slew_per_s"] / top)
    if rig.bus_is_measured and kind == "duty":
        more["supply_v"] = np.full(len(time_s), rig.supply["voltage_v"])
    if profile.opens_bridge:
        more["coast"] = ((share == 0.0) & profile.bridge_open(time_s)).astype(float)
    load = "none" if rig.load["kind"] == "torque" else rig.load["kind"]
    if profile.load:
        most, load = max_magnitude(problem, "load_nm"), "torque"
        more["load_nm"] = most * np.interp(time_s, *np.array(profile.load).T)
    return _core.LogInput(time_s, kind, top * share, load_kind=load, **more)


def max_magnitude(problem: Problem, column: str) -> float:
    """Largest magnitude of a column over all logs that have it, in its unit."""
    return max(
        float(np.nanmax(np.abs(log.columns[column])))
        for log in problem.logs
        if column in log.columns
    )


def row_interval_s(problem: Problem) -> float:
    """Median interval between rows of the logs, s."""
    intervals = [np.diff(np.asarray(log.time_s, float)) for log in problem.logs]
    return float(np.median(np.concatenate(intervals)))


def slew_limited(share: np.ndarray, most: np.ndarray) -> np.ndarray:
    """A command (n,) that follows a wanted one and changes by at most `most` (n,) in each row."""
    out, level = np.empty_like(share), 0.0
    for n, wanted in enumerate(share):
        level += float(np.clip(wanted - level, -most[n], most[n]))
        out[n] = level
    return out


def separation(
    problem: Problem, search: Search, pair: tuple[Fit, Fit], profile: RunProfile
) -> float:
    """RMS difference, in sigma a sample, of what two fits predict of a run, less the part
    that other parameter values within their uncertainty explain; 0 where a simulation fails.
    """
    parts = [parameter_sets(problem, one) for one in pair]
    shown = predictions(problem, profile, np.vstack(parts))
    if not np.all(np.isfinite(shown)):
        return 0.0
    first, second = shown[: len(parts[0])], shown[len(parts[0]) :]
    difference = np.clip(first[0] - second[0], -MAX_DIFFERENCE, MAX_DIFFERENCE)
    columns = np.vstack([slopes(first, pair[0]), -slopes(second, pair[1])]).T
    known = np.zeros((columns.shape[1],) * 2)
    for at, one in ((0, pair[0]), (len(pair[0].x), pair[1])):
        known[at : at + len(one.x), at : at + len(one.x)] = information(search, one)
    # least squares of the difference, with what the recorded logs state on the parameters as prior
    gradient = columns.T @ difference
    solution = np.linalg.lstsq(known + columns.T @ columns, gradient, rcond=PRECISION)[0]
    explained = gradient @ solution
    return float(np.sqrt(max(0.0, difference @ difference - explained) / len(difference)))


def parameter_sets(problem: Problem, one: Fit) -> np.ndarray:
    """Parameter vectors (1 + p, P) of a fit and of one step along each of its parameters."""
    points = np.vstack([one.x, one.x + np.diag(difference_steps(one.hypothesis, one.x))])
    return one.hypothesis.theta(problem.theta0, points)


def slopes(shown: np.ndarray, one: Fit) -> np.ndarray:
    """Derivatives (p, n) along a fit's parameters of predictions (1 + p, n)."""
    if not len(one.x):
        return np.zeros((0, shown.shape[1]))
    found = (shown[1:] - shown[0]) / difference_steps(one.hypothesis, one.x)[:, None]
    return np.clip(found, -MAX_SLOPE, MAX_SLOPE)


def information(search: Search, one: Fit) -> np.ndarray:
    """Fisher information (p, p) of the recorded logs on a fit's parameters, with their priors;
    weighted down by the squared gap where the fit is far from the noise.
    """
    weighted = one.jacobian * (search.engine.train / max(1.0, search.score(one)))[:, None]
    return weighted.T @ one.jacobian + np.diag(one.hypothesis.prior)


def predictions(problem: Problem, profile: RunProfile, theta: np.ndarray) -> np.ndarray:
    """Judged signals in a run from rest, (B, signals * rows) in their sigmas, for theta (B, P); of
    a hammering tool the statistics of its impact cycles.
    """
    if isinstance(problem, ImpactProblem):
        return predicted_statistics(problem, profile, theta)
    rows = _core.simulate_log(
        simulation_input(problem, profile),
        np.ascontiguousarray(theta),
        np.array([0]),
        np.zeros((1, 3)),
        threads=problem.threads,
        unfinished="nan",
    )
    time_s, parts = time_grid(row_interval_s(problem)), []
    for s in (s for s in problem.signals if s.column in SIMULATED):
        name, factor = SIMULATED[s.column]
        shown = rows[name] * factor
        if s.unit == "rad/s^2":
            shown = np.gradient(shown, time_s, axis=1)
        elif s.unit == "rad":
            shown = angle_gained(rows["angle_measured_rad"], time_s, problem.restart_s)
        parts.append(shown / s.sigma)
    return np.hstack(parts)


def angle_gained(angle: np.ndarray, time_s: np.ndarray, restart_s: float) -> np.ndarray:
    """Change of angles (B, rows) over the last restart_s seconds before each row, or since the
    start of the run. A directly compared angle counts from the last restart of the model.
    """
    since = np.searchsorted(time_s, time_s - restart_s)
    return angle - angle[:, since]
