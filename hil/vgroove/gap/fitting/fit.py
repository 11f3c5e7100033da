"""Fits many hypotheses at once: damped Gauss-Newton in lock step, robust, bounded, with the
tolerated rig keys under their priors.

All parameter sets that a step needs (every hypothesis, every finite difference) go to the simulator
in one batch. A hypothesis is fitted on all training rows; the fits of the folds follow from the
same Jacobian, one Newton step away (folds.py).
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Protocol

import numpy as np
from scipy.stats import t

from vgroove.gap.catalogue import Effect, Scales
from vgroove.gap.fitting.normal_equations import Groups, huber, huber_weight
from vgroove.gap.residual.batches import portions

WIDE, NARROW = 20.0, 4.0
KEY_BOUND = 3.0
STEP = 0.1
FARTHEST = 1e5  # residual beyond which a model has run away
LEAST_DAMPING = 0.02
# residual vectors, and residuals, that are held at once to make Jacobians
DIFFERENCES, HELD = 192, 8_000_000
# of what all rows tell of a number, below which a fold's rows are taken not to tell it
UNTOLD = 1e-3


class ProblemLike(Protocol):
    """What the fit needs of a problem (see problem.py)."""

    theta0: np.ndarray
    n: int
    folds: list[tuple[np.ndarray, np.ndarray]]

    def index(self, name: str) -> int: ...
    def residuals(self, theta: np.ndarray) -> np.ndarray: ...


@dataclass(frozen=True)
class Coordinate:
    """One fitted number x: theta[columns] = origin + factors * x, 0 where |x| < least. A cosine and
    the sine after it are an amplitude and its phase.
    """

    name: str
    columns: tuple[int, ...]
    factors: tuple[float, ...]
    origin: float
    low: float
    high: float
    step: float = STEP
    least: float = 0.0
    prior: bool = False
    role: str = "plain"

    def step_at(self, x: float) -> float:
        """Step of a difference at x: of a number that must stay above 0 (a stiffness, a time) at
        most a tenth.
        """
        return min(self.step, 0.1 * abs(x)) if self.low > 0.0 and x != 0.0 else self.step


@dataclass(frozen=True)
class Hypothesis:
    """A set of effects with one start; coordinates hold the effects' numbers first, the tolerated
    keys last.
    """

    ids: tuple[str, ...]
    coordinates: tuple[Coordinate, ...]
    start: np.ndarray
    fixed: tuple[tuple[int, float], ...] = ()

    @property
    def count(self) -> int:
        """Numbers that belong to effects."""
        return sum(not c.prior for c in self.coordinates)

    @property
    def low(self) -> np.ndarray:
        """Lower bounds (p,)."""
        return np.array([c.low for c in self.coordinates])

    @property
    def high(self) -> np.ndarray:
        """Upper bounds (p,)."""
        return np.array([c.high for c in self.coordinates])

    @property
    def prior(self) -> np.ndarray:
        """1 for coordinates under a standard normal prior (p,)."""
        return np.array([float(c.prior) for c in self.coordinates])

    def theta(self, base: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Parameter vectors (B, P) of coordinate vectors (B, p)."""
        out = np.repeat(base[None, :], len(x), axis=0)
        for column, value in self.fixed:
            out[:, column] = value
        for i, c in enumerate(self.coordinates):
            if c.role == "plain":
                for column, factor in zip(c.columns, c.factors, strict=True):
                    out[:, column] = c.origin + factor * np.where(
                        np.abs(x[:, i]) < c.least, 0.0, x[:, i]
                    )
            elif c.role == "cosine":
                out[:, c.columns[0]] = c.factors[0] * np.hypot(x[:, i], x[:, i + 1])
                out[:, self.coordinates[i + 1].columns[0]] = np.arctan2(x[:, i + 1], x[:, i])
        return out


@dataclass
class Fit:
    """A fitted hypothesis: residuals and Jacobian at x on all rows; held is every row as predicted
    by a fit that did not see it.

    Jacobians are many and large: they are in single precision.
    """

    hypothesis: Hypothesis
    x: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray
    cost: float
    delta: float
    damping: float = 1.0
    held: np.ndarray = field(default_factory=lambda: np.zeros(0))
    exact: bool = False
    keys_known: bool = False
    sloped: bool = False  # the Jacobian is that of x
    moving: bool = True  # the last round gained

    @property
    def ids(self) -> tuple[str, ...]:
        """Effects of the hypothesis."""
        return self.hypothesis.ids

    def theta(self, base: np.ndarray) -> np.ndarray:
        """Parameter vector (P,) on top of the rig's own (P,)."""
        return self.hypothesis.theta(base, self.x[None, :])[0]


class Engine:
    """Builds hypotheses for one problem and runs their fits."""

    def __init__(
        self,
        problem: ProblemLike,
        scales: Scales,
        tolerance: dict[str, float],
        present: frozenset[str] = frozenset(),
    ) -> None:
        self.problem, self.scales, self.present = problem, scales, present
        self.keys = self._keys(tolerance)
        self.train = np.logical_or.reduce([train for train, _ in problem.folds])
        self.groups = Groups(problem.folds)
        self.calls = 0
        self.known: dict[str, float] = {}
        self.key_columns: np.ndarray | None = None

    def remember(self, one: Fit) -> None:
        """Larger sets start an effect of many starts where it ended alone."""
        self.known |= {
            c.name: float(x)
            for c, x in zip(one.hypothesis.coordinates, one.x, strict=True)
            if not c.prior
        }

    def _keys(self, tolerance: dict[str, float]) -> tuple[Coordinate, ...]:
        found = []
        for name, sigma in sorted(tolerance.items()):
            column = self.problem.index(name)
            value = float(self.problem.theta0[column])
            if sigma > 0.0 and value != 0.0:
                found.append(
                    Coordinate(
                        name, (column,), (sigma * value,), value, -KEY_BOUND, KEY_BOUND, prior=True
                    )
                )
        return tuple(found)

    def is_known(self, effect: Effect) -> bool:
        """Whether larger sets start the effect where it ended alone."""
        return any(effect.name(p) in self.known for p in effect.parameters)

    def hypotheses(
        self,
        effects: Sequence[Effect],
        x_keys: np.ndarray | None = None,
        anew: Effect | None = None,
    ) -> list[Hypothesis]:
        """All starts of a set of effects (the product of their parameters' starts), one of them,
        anew, wherever it ended alone; keys start at x_keys.
        """
        ids = tuple(e.id for e in effects)
        numbers = [
            pair for e in effects for pair in self._effect(e, ids, {} if e is anew else self.known)
        ]
        keys = np.zeros(len(self.keys)) if x_keys is None else x_keys
        starts = np.meshgrid(*[np.array(s) for _, s in numbers], indexing="ij")
        grid = np.stack([g.ravel() for g in starts], axis=1) if numbers else np.zeros((1, 0))
        coordinates = tuple(c for c, _ in numbers) + self.keys
        forms = [
            tuple((self.problem.index(n), v) for form in forms for n, v in form)
            for forms in product(*[e.forms for e in effects])
        ]
        low, high = np.array([c.low for c in coordinates]), np.array([c.high for c in coordinates])
        return [
            Hypothesis(ids, coordinates, np.clip(np.concatenate([row, keys]), low, high), form)
            for form in forms
            for row in grid
        ]

    def _effect(
        self, effect: Effect, ids: tuple[str, ...], known: dict[str, float]
    ) -> list[tuple[Coordinate, tuple[float, ...]]]:
        if effect.id == "asymmetric_friction" and "coulomb_friction" in ids:
            return [(self._offset(effect), (0.0,))]
        pairs = []
        for parameter in effect.beside({*ids, *self.present}):
            size = parameter.size(self.scales)
            column = self.problem.index(effect.column(parameter))
            low, high = parameter.low(self.scales) / size, parameter.high(self.scales) / size
            starts = (
                parameter.starts
                if effect.id not in self.present
                else (float(self.problem.theta0[column]) / size,)
            )
            starts = (known[effect.name(parameter)],) if effect.name(parameter) in known else starts
            pairs.append(
                (
                    Coordinate(
                        effect.name(parameter),
                        (column,),
                        (size,),
                        0.0,
                        low,
                        high,
                        parameter.step,
                        parameter.least,
                    ),
                    starts,
                )
            )
        return self._polar(pairs) if effect.phase else pairs

    def _offset(self, effect: Effect) -> Coordinate:
        """Beside Coulomb friction the asymmetry is a constant torque: forward_nm = -backward_nm."""
        columns = tuple(self.problem.index(effect.name(p)) for p in effect.parameters)
        size = effect.parameters[0].size(self.scales)
        return Coordinate(effect.name(effect.parameters[0]), columns, (size, -size), 0.0, -1e6, 1e6)

    @staticmethod
    def _polar(
        pairs: list[tuple[Coordinate, tuple[float, ...]]],
    ) -> list[tuple[Coordinate, tuple[float, ...]]]:
        amplitude, phase = pairs[0][0], pairs[-1][0]
        bound = max(abs(amplitude.high), 1.0)
        first = replace(amplitude, low=-bound, high=bound, role="cosine")
        second = replace(phase, low=-bound, high=bound, role="sine")
        return [*pairs[1:-1], (first, (0.05,)), (second, (0.05,))]

    @property
    def at_once(self) -> int:
        """Parameter sets whose residuals are held at once."""
        return max(1, min(DIFFERENCES, HELD // self.problem.n))

    def residuals(self, jobs: Sequence[tuple[Hypothesis, np.ndarray]]) -> list[np.ndarray]:
        """Residuals (n,), row by row, of hypotheses at coordinate vectors (B, p) in one batch;
        equal ones run, and are held, once.
        """
        theta = np.concatenate([h.theta(self.problem.theta0, np.atleast_2d(x)) for h, x in jobs])
        places: dict[bytes, int] = {}
        which = [places.setdefault(one.tobytes(), len(places)) for one in theta]
        theta = np.stack([np.frombuffer(one) for one in places])
        self.calls += len(theta)
        rows = self.problem.residuals(theta)
        np.clip(rows, -FARTHEST, FARTHEST, out=rows)
        held = list(rows)
        return [held[k] for k in which]

    def shown(self, jobs: Sequence[tuple[Hypothesis, np.ndarray]]) -> Iterator[list[np.ndarray]]:
        """Residuals of each job's points (B, p), as many jobs in a batch as memory holds."""
        for part in portions([len(points) for _, points in jobs], self.at_once):
            rows = iter(self.residuals(jobs[part]))
            for _, points in jobs[part]:
                yield [next(rows) for _ in points]

    def fit(
        self,
        hypotheses: Sequence[Hypothesis],
        iterations: int = 6,
        tell: Callable[[int], None] | None = None,
    ) -> list[Fit]:
        """Fit all hypotheses on the training rows, wide loss first, then narrow; their held-out
        rows are predicted to first order.
        """
        if not hypotheses:
            return []
        fits = self._begin(hypotheses, iterations > 0)
        self.go_on(fits, range(iterations), tell)
        return fits

    def go_on(
        self, fits: Sequence[Fit], rounds: range, tell: Callable[[int], None] | None = None
    ) -> None:
        """Further rounds of the fits that have not converged; the held-out rows of all are
        predicted to first order.
        """
        for round_ in rounds:
            active = [one for one in fits if one.moving]
            if not active:
                break
            self.differentiate([one for one in active if not one.sloped])
            for one, moved in zip(
                active, self._advance(active, round_, round_ + 1 < rounds.stop), strict=True
            ):
                one.moving = moved
            if tell:
                tell(sum(one.moving for one in active))
        for one in fits:
            one.held = self._held_linear(one)

    def _begin(self, hypotheses: Sequence[Hypothesis], ahead: bool) -> list[Fit]:
        fits = [self._unfitted(h) for h in hypotheses]
        steps = [self._signed_steps(one, one.x) if ahead else np.zeros(0) for one in fits]
        jobs = [
            (one.hypothesis, np.vstack([one.x, around(one.x, signed)]))
            for one, signed in zip(fits, steps, strict=True)
        ]
        for one, signed, (start, *moved) in zip(fits, steps, self.shown(jobs), strict=True):
            one.residual, one.delta = start.copy(), self._delta(start, WIDE)
            one.cost = self.cost(one, one.x, start)
            if ahead:
                self._set_slopes(one, signed, moved)
        return fits

    def _unfitted(self, h: Hypothesis) -> Fit:
        one = Fit(
            h,
            h.start.copy(),
            np.zeros(0),
            np.zeros((len(h.start), self.problem.n), np.float32).T,
            np.inf,
            np.inf,
        )
        if self.key_columns is not None and h.count:
            one.jacobian[:, h.count :], one.keys_known = self.key_columns, True
        return one

    def _delta(self, r: np.ndarray, width: float) -> float:
        return width * max(1.0, float(1.4826 * np.median(np.abs(self._trained(r)))))

    def _trained(self, r: np.ndarray) -> np.ndarray:
        return r if self.train.all() else r[self.train]

    def cost(
        self, one: Fit, x: np.ndarray, r: np.ndarray, train: np.ndarray | None = None
    ) -> float:
        """Robust cost of residuals (n,) on rows (n,), by default those that any fold trains on, and
        of the keys' priors at x (p,).
        """
        return huber(self._trained(r) if train is None else r[train], one.delta) + float(
            ((x * one.hypothesis.prior) ** 2).sum()
        )

    def costs(self, one: Fit, points: np.ndarray) -> list[float]:
        """Robust costs of a fit's hypothesis at other points (k, p), as the fit's own is counted."""
        rows = self.shown([(one.hypothesis, x[None, :]) for x in points])
        return [self.cost(one, x, row) for x, (row,) in zip(points, rows, strict=True)]

    def is_gain(self, one: Fit, cost: float) -> bool:
        """Whether a cost lies below a fit's by more than what a converged fit may still gain."""
        return one.cost - cost > self.enough(one)

    def differentiate(self, fits: Sequence[Fit], fresh: bool = False) -> None:
        """Forward differences, away from an upper bound, of as many hypotheses in a batch as memory
        holds.

        What the tolerated keys do hardly hangs on the effects: the columns of the model without
        effects serve until a step fails, and are made anew where they are wanted fresh.
        """
        steps = [self._signed_steps(one, one.x, fresh) for one in fits]
        jobs = [
            (one.hypothesis, around(one.x, signed)) for one, signed in zip(fits, steps, strict=True)
        ]
        for one, signed, moved in zip(fits, steps, self.shown(jobs), strict=True):
            self._set_slopes(one, signed, moved)

    @staticmethod
    def _set_slopes(one: Fit, signed: np.ndarray, moved: Sequence[np.ndarray]) -> None:
        """Columns of the Jacobian from residuals one step on."""
        for column, step, row in zip(one.jacobian.T, signed, moved, strict=False):
            column[:] = (row - one.residual) / step
        one.keys_known, one.sloped = one.hypothesis.count > 0, True

    @staticmethod
    def _signed_steps(one: Fit, x: np.ndarray, fresh: bool = False) -> np.ndarray:
        """Step of each difference that is wanted at x (k,)."""
        fitted = one.hypothesis.count if one.keys_known and not fresh else len(x)
        steps_up = np.array(
            [c.step_at(float(v)) for c, v in zip(one.hypothesis.coordinates, x, strict=True)]
        )
        return np.where(x + steps_up > one.hypothesis.high, -steps_up, steps_up)[:fitted]

    def _advance(self, fits: Sequence[Fit], round_: int, ahead: bool) -> list[bool]:
        """One damped step each; True for those that should go on. With them run, ahead, the
        differences that the whole step will need: the plant's lanes are hardly filled by one fit's
        trials.
        """
        trials = [
            one.x + one.damping * np.array([[1.0], [0.35]]) * self.steps(one)[0] for one in fits
        ]
        steps = [
            self._signed_steps(one, trial[0]) if ahead else np.zeros(0)
            for one, trial in zip(fits, trials, strict=True)
        ]
        points = [
            np.vstack([trial, around(trial[0], signed)])
            for trial, signed in zip(trials, steps, strict=True)
        ]
        jobs, going = [(one.hypothesis, x) for one, x in zip(fits, points, strict=True)], []
        for one, trial, signed, (full, part, *moved) in zip(
            fits, trials, steps, self.shown(jobs), strict=True
        ):
            going.append(self._accept(one, trial, (full, part), round_))
            if ahead and going[-1] and np.array_equal(one.x, trial[0]):
                self._set_slopes(one, signed, moved)
        return going

    def _accept(self, one: Fit, trial: np.ndarray, rows: Sequence[np.ndarray], round_: int) -> bool:
        costs = [self.cost(one, x, r) for x, r in zip(trial, rows, strict=True)]
        best = int(np.argmin(costs))
        gain = one.cost - costs[best]
        promised = one.cost - self.cost(
            one,
            trial[0],
            self.groups.moved(one.residual, one.jacobian, self._alike(trial[0] - one.x)),
        )
        if gain > 0.0:
            one.x, one.residual, one.cost, one.sloped = (
                trial[best],
                rows[best].copy(),
                costs[best],
                False,
            )
        if gain <= 0.0 and promised > self.enough(one) and one.damping > LEAST_DAMPING:
            one.damping *= 0.1  # a curved valley: the straight step promises much and holds nothing
            one.keys_known = one.sloped = False
            return True
        one.damping = min(1.0, 3.0 * one.damping)
        if round_ == 0 or one.delta > 1.5 * self._delta(one.residual, NARROW):
            one.delta = self._delta(one.residual, NARROW)
            one.cost = self.cost(one, one.x, one.residual)
            return True
        return gain > self.enough(one)

    @staticmethod
    def enough(one: Fit) -> float:
        """Gain below which a fit has converged."""
        return max(1.0, 2e-4 * one.cost)

    def steps(self, one: Fit) -> tuple[np.ndarray, np.ndarray]:
        """Gauss-Newton steps of the robust cost inside the bounds: over all training rows (p,), and
        over each fold's (folds, p). What a fold's rows do not tell stays where all rows put it.
        """
        sums = self.groups.sums(one.jacobian, one.residual, one.delta)
        total = sums.sum(axis=0, where=self.groups.trains.any(axis=0)[:, None, None])
        whole = self._step(one, total)
        curvature = UNTOLD * total[:, :-1]
        kept = np.column_stack([curvature, -curvature @ whole])
        pairs = zip(self.groups.trains, self._leaves_out, strict=True)
        return whole, np.array(
            [
                self._step(one, sums[use].sum(axis=0) + kept) if less else whole
                for use, less in pairs
            ]
        )

    @property
    def _leaves_out(self) -> np.ndarray:
        """Whether each fold (folds,) trains on less than all folds together."""
        trains = self.groups.trains
        return (trains != trains.any(axis=0)).any(axis=1)

    @staticmethod
    def _step(one: Fit, sums: np.ndarray) -> np.ndarray:
        h, p = one.hypothesis, len(one.x)
        return bounded_step(
            sums[:, :p] + np.diag(h.prior),
            sums[:, p] + h.prior * one.x,
            h.low - one.x,
            h.high - one.x,
        )

    def _alike(self, step: np.ndarray) -> np.ndarray:
        """The same step for every group of rows (groups, p)."""
        return np.tile(step, (self.groups.count, 1))

    def foretold(self, one: Fit, apart: np.ndarray, otherwise: np.ndarray) -> np.ndarray:
        """Every row to first order as its own fold's step (folds, p) moves it; `otherwise` (p,)
        where no fold tests it.
        """
        steps = np.vstack([apart, otherwise])[self.groups.tested_by]
        return self.groups.moved(one.residual, one.jacobian, steps)

    def _held_linear(self, one: Fit) -> np.ndarray:
        return self.foretold(one, self.fold_steps(one), np.zeros(len(one.x)))

    def fold_steps(self, one: Fit) -> np.ndarray:
        """Steps (folds, p) from a converged fit: none for a fold that leaves nothing out."""
        return np.where(self._leaves_out[:, None], self.steps(one)[1], 0.0)

    def steps_without(self, one: Fit) -> np.ndarray:
        """Steps (folds, p) of the folds that leave something out."""
        return self.steps(one)[1][self._leaves_out]


def around(x: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Points (k, p) one step (k,) from x (p,) along each of its first k numbers."""
    return x + np.eye(len(steps), len(x)) * steps[:, None]


def bounded_step(
    normal: np.ndarray, gradient: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Minimise d' normal d / 2 + gradient' d within low <= d <= high by fixing violated coordinates
    one after another.
    """
    p = len(gradient)
    ridge = normal + np.diag(1e-9 * np.diag(normal) + 1e-12)
    step, free = -np.linalg.solve(ridge, gradient), np.ones(p, bool)
    if np.all((low <= step) & (step <= high)):
        return step
    for _ in range(p + 1):
        if not free.any():
            break
        rest = gradient[free] + ridge[np.ix_(free, ~free)] @ step[~free]
        step[free] = -np.linalg.solve(ridge[np.ix_(free, free)], rest)
        over = np.where(free, np.maximum(low - step, step - high), -1.0)
        worst = int(np.argmax(over))
        if over[worst] <= 1e-12:
            break
        step[worst] = np.clip(step[worst], low[worst], high[worst])
        free[worst] = False
    return step


def covariance(one: Fit, mask: np.ndarray, cluster: np.ndarray) -> np.ndarray:
    """Sandwich covariance (p, p) of the fitted numbers; rows of one cluster may be correlated in
    any way.
    """
    weighted = one.jacobian * (huber_weight(one.residual, one.delta) * mask)[:, None]
    prior = np.diag(one.hypothesis.prior)
    bread = np.linalg.pinv(weighted.T @ one.jacobian + prior)
    score = weighted * one.residual[:, None]
    sums = np.stack(
        [np.bincount(cluster, weights=score[:, j]) for j in range(score.shape[1])], axis=1
    )
    groups = max(2, len(np.unique(cluster[mask])))
    meat = sums.T @ sums * groups / (groups - 1) + prior
    return bread @ meat @ bread


def half_widths(engine: Engine, one: Fit, clusters: Sequence[np.ndarray]) -> np.ndarray:
    """Half widths (p,) of 95 % intervals of the fitted numbers: the widest that any clustering of
    the rows, or the folds, ask for.

    Noise asks for little. A model of slightly other form is wrong alike over whole strokes: longer
    clusters show it, and estimates that differ when a fold is left out (jackknife). Both have
    Student's t for their few degrees of freedom.
    """
    found = [np.zeros(len(one.x))]
    for cluster in clusters:
        groups = len(np.unique(cluster[engine.train]))
        spread = np.sqrt(np.maximum(np.diag(covariance(one, engine.train, cluster)), 0.0))
        found.append(spread * t.ppf(0.975, max(1, groups - 1)))
    moved = engine.steps_without(one)
    if len(moved) >= 3:
        variance = (len(moved) - 1) / len(moved) * ((moved - moved.mean(axis=0)) ** 2).sum(axis=0)
        found.append(np.sqrt(variance) * t.ppf(0.975, len(moved) - 1))
    return np.max(found, axis=0)
