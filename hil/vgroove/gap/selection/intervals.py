"""The numbers behind a fit, with intervals; and once more over long stretches, where the shaft
remembers longer than between two restarts.

The contract restarts the model every quarter of a second. A joint that coasts for a second tells
more of its friction in an undisturbed run than in eight pieces of it, each of which begins with a
measured state.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from vgroove.gap.catalogue import BY_ID, FLAGS_BEYOND_SPECIFICATION
from vgroove.gap.fitting.cross_validation import predict_held_out
from vgroove.gap.fitting.fit import Engine, Fit, half_widths
from vgroove.gap.residual import angle_alignment
from vgroove.gap.residual.problem import Problem, load_problem
from vgroove.gap.selection.search_state import CONVERGED, VISIBLE, Search, gap_of
from vgroove.rig import Rig

MEMORIES = 16.0  # length of a stretch, in time constants of the shaft
ROUNDS = 8
# largest gap, in noise, of a model that may run so long: one that lacks something drifts away
AT_NOISE = 1.1
LONG_S = 0.5
Z95 = 1.96
# of a number: by what a tool of nearly the catalogue's form moves it, at 95 % (`vgroove gap bench`:
# inside its interval)
FORM_ERROR = 0.03


@dataclass(frozen=True)
class Estimate:
    """A fit, the engine whose rows it is of, and clusters (n,) of those rows that may be wrong
    alike.
    """

    engine: Engine
    fit: Fit
    clusters: tuple[np.ndarray, ...]

    @cached_property
    def half(self) -> np.ndarray:
        """Half widths (p,) of the 95 % intervals of the fitted numbers."""
        return half_widths(self.engine, self.fit, self.clusters) if len(self.fit.x) else np.zeros(0)

    def parameters(self, effect_id: str) -> dict[str, dict[str, object]]:
        """Reported parameters of one effect of the fit, with clustered 95 % intervals."""
        if effect_id == "hall_dropout":
            return dropout_parameters(self.engine.problem)
        out, theta = {}, self.fit.theta(self.engine.problem.theta0)
        for parameter in (p for p in BY_ID[effect_id].parameters if p.reported):
            name = BY_ID[effect_id].name(parameter)
            value = float(theta[self.engine.problem.index(name)])
            out[parameter.name] = {
                "value": value,
                "ci95": interval_of(self.fit, name, value, self.half),
                "unit": parameter.unit,
            }
        return out

    def tolerated(self) -> dict[str, float]:
        """Values of the tolerated rig keys."""
        theta = self.fit.theta(self.engine.problem.theta0)
        return {c.name: float(theta[c.columns[0]]) for c in self.engine.keys}


def dropout_parameters(problem: Problem) -> dict[str, dict[str, object]]:
    """The share of missed edges is counted, not fitted: any probability above 0 makes the model
    show what was missed. Wilson's interval.
    """
    missed, edges = problem.missed_edges
    share, pull = missed / max(1.0, edges), Z95**2 / max(1.0, edges)
    middle = (share + 0.5 * pull) / (1.0 + pull)
    half = (
        Z95
        * np.sqrt(share * (1.0 - share) / max(1.0, edges) + 0.25 * (pull / Z95) ** 2)
        / (1.0 + pull)
    )
    return {
        "probability": {
            "value": share,
            "ci95": [float(middle - half), float(middle + half)],
            "unit": "1",
        }
    }


def interval_of(one: Fit, name: str, value: float, half: np.ndarray) -> list[float] | None:
    """95 % interval of a fitted flat parameter (the amplitude of a polar pair: the wider of its
    two), from the scatter of its fit and from what the form of a real effect moves it by.
    """
    for i, c in enumerate(one.hypothesis.coordinates):
        if c.name == name or (
            name.endswith("backward_nm") and c.name.endswith("forward_nm") and len(c.columns) == 2
        ):
            wide = float(max(half[i], half[i + 1]) if c.role == "cosine" else half[i]) * abs(
                c.factors[0]
            )
            wide = float(np.hypot(wide, FORM_ERROR * value))
            return [value - wide, value + wide]
    return None


def in_catalogue_form(search: Search, best: Fit) -> Fit:
    """The same effects in forms that every reader of a rig knows, unless those leave a visible gap
    more.
    """
    beyond = {search.engine.problem.index(name) for name in FLAGS_BEYOND_SPECIFICATION}
    fixed = tuple(
        (column, value) for column, value in best.hypothesis.fixed if column not in beyond
    )
    if fixed == best.hypothesis.fixed:
        return best
    again = search.engine.fit([replace(best.hypothesis, start=best.x, fixed=fixed)], CONVERGED)[0]
    predict_held_out(search.engine, [again])
    problem = search.engine.problem
    return again if gap_of(problem, again.held) - gap_of(problem, best.held) <= VISIBLE else best


def stretches_of(log: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """Stretches of LONG_S of each log (n,): about as long as a machine keeps doing one thing."""
    stretch = np.floor(time_s / LONG_S).astype(np.int64)
    return np.unique(
        log.astype(np.int64) * (int(stretch.max()) + 2) + stretch, return_inverse=True
    )[1]


def memory_s(rig: Rig) -> float:
    """Time constant of the shaft's speed: inertia over damping, the drive's own included where a
    voltage drives it.
    """
    motor = rig.motor
    drive = (
        0.0
        if rig.input["kind"] == "current_a"
        else motor["torque_constant_nm_per_a"] ** 2 / motor["resistance_ohm"]
    )
    damping = motor["viscous_nm_s_per_rad"] + drive
    return rig.shaft_inertia_kg_m2 / damping if damping > 0.0 else np.inf


def over_long_stretches(problem: Problem, engine: Engine, shown: Fit) -> Estimate | None:
    """The same effects and keys fitted over stretches of MEMORIES time constants; None where that
    tells no more than the restarts did, or the model does not stay at the noise for so long, or
    angles were set stretch by stretch.
    """
    memory = memory_s(problem.rig)
    if (
        not len(shown.x)
        or memory < problem.restart_s
        or angle_alignment.active_periodic_effects(problem, shown.theta(problem.theta0))
    ):
        return None
    length = float(
        min(MEMORIES * memory, max(log.time_s[-1] - log.time_s[0] for log in problem.logs))
    )
    longer = load_problem(problem.logs, problem.rig, length, problem.threads)
    apart = Engine(longer, engine.scales, problem.rig.tolerance, engine.present)
    fit = apart.fit([replace(shown.hypothesis, start=shown.x)], ROUNDS)[0]
    if longer.gap(fit.residual, longer.judged) > AT_NOISE * longer.floor():
        return None
    return Estimate(apart, fit, (stretches_of(longer.log, longer.time_s),))
