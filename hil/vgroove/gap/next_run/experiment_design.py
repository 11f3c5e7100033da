"""Which run to record next: the one of a menu whose predicted logs differ most between the
surviving rivals, whatever their numbers.
"""

from typing import Any

import numpy as np

from vgroove import _core
from vgroove.gap.catalogue import BY_ID
from vgroove.gap.fitting.fit import Fit
from vgroove.gap.next_run.menu import RunProfile, feasible_profiles, time_grid
from vgroove.gap.residual.channels import RAD_S_TO_RPM
from vgroove.gap.residual.problem import Problem
from vgroove.gap.selection.search_state import Search
from vgroove.gap.verdict.decision import Finding

RIVALS = 3
CLIP = 100.0  # sigmas of one sample
SHOWN = {
    "current_a": ("current_a", 1.0),
    "supply_v": ("supply_v", 1.0),
    "speed_rpm": ("speed_measured_rad_s", RAD_S_TO_RPM),
    # what a signal shows in a simulation, as it is judged
    "position_rad": ("speed_measured_rad_s", 1.0),
}
REPEATS = {
    "time since start": "hold at heat",
    "heat": "hold at heat",
    "current": "load steps",
    "load": "load steps",
    "sign of speed": "reversal",
    "rate of command": "fast ramps",
}

# Why the run that a simulation chooses parts a pair, where that is known.
PARTED = {
    frozenset({"brush_drop", "dead_time"}): (
        "staircase up to full duty",
        "dead time takes nothing at full duty, where nothing switches; brushes take as much as before",
    ),
    frozenset({"added_inertia", "clock_skew"}): (
        "coast-down",
        "with the bridge open inertia stretches the decay; a clock also shifts the edges of a steady speed against stamps: "
        "hold one for some seconds before",
    ),
    frozenset({"transport_delay", "speed_lag"}): (
        "fast ramps",
        "a delay shifts current and speed, a lag of the sensor the speed alone",
    ),
    frozenset({"coupler_compliance", "added_inertia"}): (
        "fast ramps",
        "a spring rings after steep edges, a rigid inertia does not",
    ),
    frozenset({"torque_constant", "speed_gain"}): (
        "stall pulse",
        "at standstill no speed sensor matters, the torque constant pulls",
    ),
}


def propose(problem: Problem, state: Search, finding: Finding) -> dict[str, Any] | None:
    """Profile and reason when the verdict is ambiguous (the run that parts the rivals) or unlisted
    (the run that shows more of the gap).
    """
    if finding.verdict == "ambiguous":
        return most_separating_run(problem, state, finding)
    if finding.verdict == "unlisted":
        follows = finding.left.best_correlate
        runs = {c.name: c for c in runs_of(problem)}
        course = runs.get(REPEATS.get(follows or "", ""), runs["staircase"])
        reason = (
            f"what remains follows {follows}"
            if follows
            else "what remains follows none of the measured signals"
        )
        return {
            "profile": course.name,
            "why": f"{reason}; {course.shows} tell whether it repeats",
            "points": course.points(),
        }
    return None


def most_separating_run(problem: Problem, state: Search, finding: Finding) -> dict[str, Any]:
    """The run in which the least of the differences between the selected set and its rivals is
    largest.
    """
    runs = {c.name: c for c in runs_of(problem)}
    apart = {
        name: min(
            separation(problem, state, finding.best, rival, course)
            for rival in finding.rivals[:RIVALS]
        )
        for name, course in runs.items()
    }
    name = max(apart, key=lambda n: (round(apart[n], 6), -list(runs).index(n)))
    rival = finding.rivals[0]
    known = PARTED.get(frozenset(set(finding.best.ids) ^ set(rival.ids)))
    why = known[1] if known and known[0].startswith(name) else runs[name].shows
    differ = f"there {words(finding.best.ids)} and {words(rival.ids)} differ by {apart[name]:.2g} sigma a sample, whatever their sizes"
    return {
        "profile": name,
        "why": f"{why}; {differ}",
        "points": runs[name].points(),
        "separation": [
            {"profile": n, "sigma": v}
            for n, v in sorted(apart.items(), key=lambda i: (-i[1], i[0]))
        ],
    }


def runs_of(problem: Problem) -> list[RunProfile]:
    """The menu for this tool: what its logs show that it can do."""
    kind = problem.rig.input["kind"]
    commands = np.concatenate([np.asarray(log.columns[kind], float) for log in problem.logs])
    loads = [np.nanmax(np.abs(log.columns.get("load_nm", [0.0]))) for log in problem.logs]
    loaded = problem.rig.load["kind"] == "torque" and max(loads) > 0.0
    return feasible_profiles(kind == "duty", loaded, bool(np.nanmin(commands) < 0.0))


def drive_of(problem: Problem, course: RunProfile) -> _core.LogInput:
    """A run as input of the plant, at the logs' own rate, up to the largest command and load that
    they hold (a duty: up to 1).
    """
    rig, kind = problem.rig, problem.rig.input["kind"]
    time_s = time_grid_of(problem)
    top = (
        1.0
        if kind == "duty"
        else max(float(np.nanmax(np.abs(log.columns[kind]))) for log in problem.logs)
    )
    share, more = course.command(time_s), {}
    if "slew_per_s" in rig.input:
        more["slew_per_s"] = rig.input["slew_per_s"]
        share = slewed(share, np.diff(time_s, prepend=0.0) * rig.input["slew_per_s"] / top)
    if rig.bus_is_measured and kind == "duty":
        more["supply_v"] = np.full(len(time_s), rig.supply["voltage_v"])
    if course.coasts:
        more["coast"] = ((share == 0.0) & course.opens(time_s)).astype(float)
    load = "none" if rig.load["kind"] == "torque" else rig.load["kind"]
    if course.load:
        most, load = (
            max(
                float(np.nanmax(np.abs(log.columns["load_nm"])))
                for log in problem.logs
                if "load_nm" in log.columns
            ),
            "torque",
        )
        more["load_nm"] = most * np.interp(time_s, *np.array(course.load).T)
    return _core.LogInput(time_s, kind, top * share, load_kind=load, **more)


def time_grid_of(problem: Problem) -> np.ndarray:
    """Row times of a run, recorded as the logs were."""
    return time_grid(
        float(
            np.median(
                np.concatenate([np.diff(np.asarray(log.time_s, float)) for log in problem.logs])
            )
        )
    )


def slewed(share: np.ndarray, most: np.ndarray) -> np.ndarray:
    """Shares (n,) that run after the wanted ones by at most so much a row."""
    out, now = np.empty_like(share), 0.0
    for n, wanted in enumerate(share):
        now += float(np.clip(wanted - now, -most[n], most[n]))
        out[n] = now
    return out


def separation(problem: Problem, state: Search, best: Fit, rival: Fit, course: RunProfile) -> float:
    """RMS difference, in sigma a sample, of what two fits predict for a run, less what other
    numbers within their doubt make of it.
    """
    parts = [moved(problem, one) for one in (best, rival)]
    shown = predictions(problem, course, np.vstack(parts))
    if not np.all(np.isfinite(shown)):
        return 0.0
    first, second = shown[: len(parts[0])], shown[len(parts[0]) :]
    difference = np.clip(first[0] - second[0], -CLIP, CLIP)
    columns = np.vstack([slopes(first, best), -slopes(second, rival)]).T
    known = np.zeros((columns.shape[1],) * 2)
    for at, one in ((0, best), (len(best.x), rival)):
        known[at : at + len(one.x), at : at + len(one.x)] = information(state, one)
    gradient = columns.T @ difference
    spent = gradient @ np.linalg.lstsq(known + columns.T @ columns, gradient, rcond=1e-10)[0]
    return float(np.sqrt(max(0.0, difference @ difference - spent) / len(difference)))


def moved(problem: Problem, one: Fit) -> np.ndarray:
    """Parameter vectors (1 + p, P) of a fit and of one step along each of its numbers."""
    h = one.hypothesis
    return h.theta(problem.theta0, np.vstack([one.x, one.x + np.diag(_steps(one))]))


def _steps(one: Fit) -> np.ndarray:
    size = np.array(
        [c.step_at(float(x)) for c, x in zip(one.hypothesis.coordinates, one.x, strict=True)]
    )
    return np.where(one.x + size > one.hypothesis.high, -size, size)


def slopes(shown: np.ndarray, one: Fit) -> np.ndarray:
    """Derivatives (p, n) of what is shown (1 + p, n) along a fit's numbers."""
    return (
        np.clip((shown[1:] - shown[0]) / _steps(one)[:, None], -1e6, 1e6)
        if len(one.x)
        else np.zeros((0, shown.shape[1]))
    )


def information(state: Search, one: Fit) -> np.ndarray:
    """What the logs at hand say about a fit's numbers (p, p), their priors included; rows that are
    wrong together count once.
    """
    weighted = one.jacobian * (state.engine.train / max(1.0, state.score(one)))[:, None]
    return weighted.T @ one.jacobian + np.diag(one.hypothesis.prior)


def predictions(problem: Problem, course: RunProfile, theta: np.ndarray) -> np.ndarray:
    """What the judged signals show in a run from rest, (B, signals * rows), in their sigmas."""
    rows = _core.simulate_log(
        drive_of(problem, course),
        np.ascontiguousarray(theta),
        np.array([0]),
        np.zeros((1, 3)),
        threads=problem.threads,
        unfinished="nan",
    )
    dt = time_grid_of(problem)
    parts = []
    for s in (s for s in problem.signals if s.column in SHOWN):
        shown = rows[SHOWN[s.column][0]] * SHOWN[s.column][1]
        parts.append((np.gradient(shown, dt, axis=1) if s.unit == "rad/s^2" else shown) / s.sigma)
    return np.hstack(parts)


def words(ids: tuple[str, ...]) -> str:
    """Names of effects in a sentence."""
    return " with ".join(BY_ID[i].id for i in ids)
