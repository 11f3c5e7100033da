"""Fitted numbers of catalogue effects on one problem: their columns in theta, scales, bounds and
starts.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from vgroove.gap.catalogue import Effect, Parameter, Scales
from vgroove.gap.fitting.hypothesis import (
    DIFFERENCE_STEP,
    MAX_NUISANCE_SIGMAS,
    Coordinate,
    Fit,
    Hypothesis,
    log_sigma,
)
from vgroove.gap.residual.protocol import MeasuredProblem

# start of amplitude cos(phase) and of amplitude sin(phase) of a periodic effect, in the effect's
# typical size
RIPPLE_START = 0.05
# bound of the asymmetry beside Coulomb friction, in the effect's typical size: practically none
UNBOUNDED = 1e6
WIDER = 4.0  # factor by which a bound of the search grows where a fit ends at it

Started = tuple[Coordinate, tuple[float, ...]]  # a coordinate and the values of its starts


@dataclass
class HypothesisBuilder:
    """Builds hypotheses for one problem. scales: of the tool; tolerance: relative standard
    deviations of the rig's values (nuisance parameters); present: effects that the rig contains
    already; known: by name, the fitted numbers of effects with many starts, from the fit of each
    effect alone; widening: by name, factors by which bounds of the search are widened.
    """

    problem: MeasuredProblem
    scales: Scales
    tolerance: dict[str, float]
    present: frozenset[str] = frozenset()
    known: dict[str, float] = field(default_factory=dict)
    widening: dict[str, float] = field(default_factory=dict)

    def widen(self, one: Fit) -> bool:
        """Widen the bounds of the search at which the numbers of a fit end; whether there are
        any.
        """
        found, coordinates = set(), one.hypothesis.coordinates
        for k, (c, x) in enumerate(zip(coordinates, one.x, strict=True)):
            if not c.prior and c.ends_at_search_bound(float(x)):
                # the amplitude of a periodic effect bounds its sine as well as its cosine
                found.add(coordinates[k - 1 if c.role == "sine" else k].name)
        for name in sorted(found):
            self.widening[name] = WIDER * self.widening.get(name, 1.0)
        return bool(found)

    def nuisance(self) -> tuple[Coordinate, ...]:
        """Coordinates of the rig's values with a tolerance, in standard deviations of their
        logarithms (all are positive: a log-normal prior, of the relative standard deviation that
        the rig states).
        """
        found = []
        for name, sigma in sorted(self.tolerance.items()):
            column = self.problem.index(name)
            value = float(self.problem.theta0[column])
            if sigma > 0.0 and value != 0.0:
                limit = MAX_NUISANCE_SIGMAS
                scale = (log_sigma(sigma),)
                found.append(
                    Coordinate(
                        name,
                        (column,),
                        scale,
                        value,
                        -limit,
                        limit,
                        self.problem.difference_factor * DIFFERENCE_STEP,
                        prior=True,
                        role="logarithm",
                    )
                )
        return tuple(found)

    def hypotheses(
        self,
        effects: Sequence[Effect],
        nuisance: tuple[Coordinate, ...],
        x_nuisance: np.ndarray,
        from_catalogue: Effect | None = None,
    ) -> list[Hypothesis]:
        """One hypothesis for each form and start of a set of effects: the product of the forms and
        starts of its members; without starts at which the logs cannot show a member, unless there
        are no others. from_catalogue: a member that starts from the catalogue's values even
        where `known` has its fitted ones.
        """
        ids = tuple(e.id for e in effects)
        started = [
            pair
            for e in effects
            for pair in self._of_effect(e, ids, {} if e is from_catalogue else self.known)
        ]
        starts = np.meshgrid(*[np.array(s) for _, s in started], indexing="ij")
        grid = np.stack([g.ravel() for g in starts], axis=1) if started else np.zeros((1, 0))
        coordinates = tuple(c for c, _ in started) + nuisance
        low, high = np.array([c.low for c in coordinates]), np.array([c.high for c in coordinates])
        found = [
            Hypothesis(
                ids, coordinates, np.clip(np.concatenate([row, x_nuisance]), low, high), form
            )
            for form in self._forms(effects)
            for row in grid
        ]
        return [h for h in found if self._is_resolved(h, effects)] or found

    def _is_resolved(self, h: Hypothesis, effects: Sequence[Effect]) -> bool:
        """Whether the logs are sampled often enough to show every effect at the start values of a
        hypothesis.
        """
        for effect in (e.of_tool(self.scales) for e in effects):
            if effect.is_resolved is None:
                continue
            theta = h.theta(self.problem.theta0, h.start[None])[0]
            values = {
                p.name: float(theta[self.problem.index(effect.column(p))])
                for p in effect.own_parameters
            }
            if not effect.is_resolved(values, self.scales):
                return False
        return True

    def _forms(self, effects: Sequence[Effect]) -> list[tuple[tuple[int, float], ...]]:
        return [
            tuple((self.problem.index(name), value) for form in forms for name, value in form)
            for forms in product(*[e.of_tool(self.scales).forms for e in effects])
        ]

    def _of_effect(
        self, effect: Effect, ids: tuple[str, ...], known: dict[str, float]
    ) -> list[Started]:
        effect = effect.of_tool(self.scales)
        if effect.constant_beside in ids:
            return [(self._constant_torque(effect), (0.0,))]
        pairs = [
            self._of_parameter(effect, parameter, known)
            for parameter in effect.beside({*ids, *self.present})
        ]
        return _as_sine_and_cosine(pairs) if effect.has_phase else pairs

    def _of_parameter(
        self, effect: Effect, parameter: Parameter, known: dict[str, float]
    ) -> Started:
        """The fitted number of a parameter and its start values. If the rig states the effect
        already, a size is fitted as the change from the stated one.
        """
        name, size = effect.name(parameter), parameter.size(self.scales)
        column = self.problem.index(effect.column(parameter))
        low, high = self._bounds(parameter, name, size)
        is_change = effect.id in self.present and parameter.neutral == 0.0 and not effect.has_phase
        of_rig = float(self.problem.theta0[column]) / size
        stated = of_rig if is_change else 0.0
        if is_change:
            low, high = min(low, stated), max(high, stated)
        coordinate = Coordinate(
            name,
            (column,),
            (size,),
            0.0,
            low - stated,
            high - stated,
            self.problem.difference_factor * parameter.step,
            parameter.zero_below,
            stated=stated,
            physical=_physical_bounds(parameter, low),
            local=parameter.local,
        )
        if name in known:
            return coordinate, (known[name],)
        if effect.id in self.present:
            return coordinate, (of_rig - stated,)
        return coordinate, tuple(dict.fromkeys(min(max(x, low), high) for x in parameter.starts))

    def _bounds(self, parameter: Parameter, name: str, size: float) -> tuple[float, float]:
        """Bounds of the search, in units of size."""
        low, high = parameter.low(self.scales) / size, parameter.high(self.scales) / size
        factor = self.widening.get(name, 1.0)
        if parameter.physical not in ("low", "both"):
            low = low * factor if low < 0.0 else low / factor
            low = max(low, parameter.widest_low(self.scales) / size)
        if parameter.physical not in ("high", "both"):
            high = min(high * factor, parameter.widest_high(self.scales) / size)
        return low, high

    def _constant_torque(self, effect: Effect) -> Coordinate:
        """The effect as a constant torque: its second parameter is minus its first one."""
        columns = tuple(self.problem.index(effect.name(p)) for p in effect.parameters)
        size = effect.parameters[0].size(self.scales)
        name = effect.name(effect.parameters[0])
        return Coordinate(name, columns, (size, -size), 0.0, -UNBOUNDED, UNBOUNDED)


def _physical_bounds(parameter: Parameter, low: float) -> str:
    """The bounds of a parameter that are limits of physics: "low", "high", "both" or "". A lower
    bound of 0 always is one.
    """
    if low != 0.0 or parameter.physical in ("low", "both"):
        return parameter.physical
    return "both" if parameter.physical else "low"


def _as_sine_and_cosine(pairs: list[Started]) -> list[Started]:
    """The coordinates of a periodic effect with amplitude (first) and phase (last) replaced by
    amplitude cos(phase), role "cosine", and amplitude sin(phase), role "sine": least squares in
    these has no singularity at amplitude 0.
    """
    amplitude, phase = pairs[0][0], pairs[-1][0]
    bound = max(abs(amplitude.high), 1.0)
    physical = "both" if amplitude.physical in ("high", "both") else ""
    cosine, sine = (
        replace(one, low=-bound, high=bound, role=role, physical=physical)
        for one, role in ((amplitude, "cosine"), (phase, "sine"))
    )
    return [*pairs[1:-1], (cosine, (RIPPLE_START,)), (sine, (RIPPLE_START,))]
