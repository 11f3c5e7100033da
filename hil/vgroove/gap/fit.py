"""Fits many hypotheses at once: damped Gauss-Newton in lock step, robust, bounded, with the tolerated rig keys under their priors.

All parameter sets that a step needs (every hypothesis, every finite difference) go to the simulator in one batch. A hypothesis is fitted
on all training rows first; the fits of the folds follow from the same Jacobian, one Newton step away.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Protocol

import numpy as np
from scipy.stats import t

from vgroove.gap.hypotheses import Effect, Scales
from vgroove.gap.normals import Groups, huber, huber_weight

WIDE, NARROW = 20.0, 4.0
KEY_BOUND = 3.0
STEP = 0.1
FARTHEST = 1e5  # residual beyond which a model has run away
LEAST_DAMPING = 0.02
DIFFERENCES, HELD = 192, 8_000_000  # residual vectors, and residuals, that are held at once to make Jacobians
SHORTER = 2  # times a fold's step is shortened that makes its own rows worse


class ProblemLike(Protocol):
    """What the fit needs of a problem (see problem.py)."""

    theta0: np.ndarray
    n: int
    folds: list[tuple[np.ndarray, np.ndarray]]

    def index(self, name: str) -> int: ...
    def residuals(self, theta: np.ndarray) -> np.ndarray: ...


@dataclass(frozen=True)
class Coordinate:
    """One fitted number x: theta[columns] = origin + factors * x, 0 where |x| < least. A cosine and the sine after it are an amplitude and
    its phase."""

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
        """Step of a difference at x: of a number that must stay above 0 (a stiffness, a time) at most a tenth."""
        return min(self.step, 0.1 * abs(x)) if self.low > 0.0 and x != 0.0 else self.step


@dataclass(frozen=True)
class Hypothesis:
    """A set of effects with one start; coordinates hold the effects' numbers first, the tolerated keys last."""

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
                    out[:, column] = c.origin + factor * np.where(np.abs(x[:, i]) < c.least, 0.0, x[:, i])
            elif c.role == "cosine":
                out[:, c.columns[0]] = c.factors[0] * np.hypot(x[:, i], x[:, i + 1])
                out[:, self.coordinates[i + 1].columns[0]] = np.arctan2(x[:, i + 1], x[:, i])
        return out


@dataclass
class Fit:
    """A fitted hypothesis: residuals and Jacobian at x on all rows; held is every row as predicted by a fit that did not see it.

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

    @property
    def ids(self) -> tuple[str, ...]:
        """Effects of the hypothesis."""
        return self.hypothesis.ids

    def theta(self, base: np.ndarray) -> np.ndarray:
        """Parameter vector (P,) on top of the rig's own (P,)."""
        return self.hypothesis.theta(base, self.x[None, :])[0]


class Engine:
    """Builds hypotheses for one problem and runs their fits."""

    def __init__(self, problem: ProblemLike, scales: Scales, tolerance: dict[str, float], present: frozenset[str] = frozenset()) -> None:
        self.problem, self.scales, self.present = problem, scales, present
        self.keys = self._keys(tolerance)
        self.train = np.logical_or.reduce([train for train, _ in problem.folds])
        self.groups = Groups(problem.folds)
        self.calls = 0
        self.known: dict[str, float] = {}
        self.key_columns: np.ndarray | None = None

    def remember(self, one: Fit) -> None:
        """Larger sets start an effect of many starts where it ended alone."""
        self.known |= {c.name: float(x) for c, x in zip(one.hypothesis.coordinates, one.x, strict=True) if not c.prior}

    def _keys(self, tolerance: dict[str, float]) -> tuple[Coordinate, ...]:
        found = []
        for name, sigma in sorted(tolerance.items()):
            column = self.problem.index(name)
            value = float(self.problem.theta0[column])
            if sigma > 0.0 and value != 0.0:
                found.append(Coordinate(name, (column,), (sigma * value,), value, -KEY_BOUND, KEY_BOUND, prior=True))
        return tuple(found)

    def is_known(self, effect: Effect) -> bool:
        """Whether larger sets start the effect where it ended alone."""
        return any(effect.name(p) in self.known for p in effect.parameters)

    def hypotheses(self, effects: Sequence[Effect], x_keys: np.ndarray | None = None, anew: Effect | None = None) -> list[Hypothesis]:
        """All starts of a set of effects (the product of their parameters' starts), one of them, anew, wherever it ended alone; keys start
        at x_keys."""
        ids = tuple(e.id for e in effects)
        numbers = [pair for e in effects for pair in self._effect(e, ids, {} if e is anew else self.known)]
        keys = np.zeros(len(self.keys)) if x_keys is None else x_keys
        starts = np.meshgrid(*[np.array(s) for _, s in numbers], indexing="ij")
        grid = np.stack([g.ravel() for g in starts], axis=1) if numbers else np.zeros((1, 0))
        coordinates = tuple(c for c, _ in numbers) + self.keys
        forms = [tuple((self.problem.index(n), v) for form in forms for n, v in form) for forms in product(*[e.forms for e in effects])]
        low, high = np.array([c.low for c in coordinates]), np.array([c.high for c in coordinates])
        return [Hypothesis(ids, coordinates, np.clip(np.concatenate([row, keys]), low, high), form) for form in forms for row in grid]

    def _effect(self, effect: Effect, ids: tuple[str, ...], known: dict[str, float]) -> list[tuple[Coordinate, tuple[float, ...]]]:
        if effect.id == "asymmetric_friction" and "coulomb_friction" in ids:
            return [(self._offset(effect), (0.0,))]
        pairs = []
        for parameter in effect.parameters:
            size = parameter.size(self.scales)
            column = self.problem.index(effect.name(parameter))
            low, high = parameter.low(self.scales) / size, parameter.high(self.scales) / size
            starts = parameter.starts if effect.id not in self.present else (float(self.problem.theta0[column]) / size,)
            starts = (known[effect.name(parameter)],) if effect.name(parameter) in known else starts
            pairs.append((Coordinate(effect.name(parameter), (column,), (size,), 0.0, low, high, parameter.step, parameter.least), starts))
        return self._polar(pairs) if effect.phase else pairs

    def _offset(self, effect: Effect) -> Coordinate:
        """Beside Coulomb friction the asymmetry is a constant torque: forward_nm = -backward_nm."""
        columns = tuple(self.problem.index(effect.name(p)) for p in effect.parameters)
        size = effect.parameters[0].size(self.scales)
        return Coordinate(effect.name(effect.parameters[0]), columns, (size, -size), 0.0, -1e6, 1e6)

    @staticmethod
    def _polar(pairs: list[tuple[Coordinate, tuple[float, ...]]]) -> list[tuple[Coordinate, tuple[float, ...]]]:
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
        """Residuals (n,), row by row, of hypotheses at coordinate vectors (B, p) in one batch; equal ones run, and are held, once."""
        theta = np.concatenate([h.theta(self.problem.theta0, np.atleast_2d(x)) for h, x in jobs])
        places: dict[bytes, int] = {}
        which = [places.setdefault(one.tobytes(), len(places)) for one in theta]
        theta = np.stack([np.frombuffer(one) for one in places])
        self.calls += len(theta)
        rows = self.problem.residuals(theta)
        np.clip(rows, -FARTHEST, FARTHEST, out=rows)
        held = list(rows)
        return [held[k] for k in which]

    def fit(self, hypotheses: Sequence[Hypothesis], iterations: int = 6, tell: Callable[[int], None] | None = None) -> list[Fit]:
        """Fit all hypotheses on the training rows, wide loss first, then narrow; their held-out rows are predicted to first order."""
        if not hypotheses:
            return []
        fits = self._begin(hypotheses)
        active = list(range(len(fits)))
        for round_ in range(iterations):
            if not active:
                break
            self._differentiate([fits[i] for i in active])
            active = [i for i, moved in zip(active, self._advance([fits[i] for i in active], round_), strict=True) if moved]
            if tell:
                tell(len(active))
        for one in fits:
            one.held = self._held_linear(one)
        return fits

    def _begin(self, hypotheses: Sequence[Hypothesis]) -> list[Fit]:
        rows = self.residuals([(h, h.start) for h in hypotheses])
        fits = []
        for h, r in zip(hypotheses, rows, strict=True):
            one = Fit(h, h.start.copy(), r.copy(), np.zeros((len(h.start), len(r)), np.float32).T, np.inf, self._delta(r, WIDE))
            one.cost = self._cost(one, one.x, r)
            if self.key_columns is not None and h.count:
                one.jacobian[:, h.count:], one.keys_known = self.key_columns, True
            fits.append(one)
        return fits

    def _delta(self, r: np.ndarray, width: float) -> float:
        return width * max(1.0, float(1.4826 * np.median(np.abs(self._trained(r)))))

    def _trained(self, r: np.ndarray) -> np.ndarray:
        return r if self.train.all() else r[self.train]

    def _cost(self, one: Fit, x: np.ndarray, r: np.ndarray) -> float:
        return huber(self._trained(r), one.delta) + float(((x * one.hypothesis.prior) ** 2).sum())

    def _differentiate(self, fits: Sequence[Fit], fresh: bool = False) -> None:
        """Forward differences, away from an upper bound, of as many hypotheses in a batch as memory holds.

        What the tolerated keys do hardly hangs on the effects: the columns of the model without effects serve until a step fails, and are
        made anew where they are wanted fresh.
        """
        steps = [self._signed_steps(one, fresh) for one in fits]
        for part in portions([len(s) for s in steps], self.at_once):
            mine = list(zip(fits[part], steps[part], strict=True))
            jobs = [(one.hypothesis, one.x + np.eye(len(signed), len(one.x)) * signed[:, None]) for one, signed in mine]
            rows = iter(self.residuals(jobs))
            for one, signed in mine:
                for column, step in zip(one.jacobian.T, signed, strict=False):
                    column[:] = (next(rows) - one.residual) / step
                one.keys_known = one.hypothesis.count > 0

    @staticmethod
    def _signed_steps(one: Fit, fresh: bool) -> np.ndarray:
        """Step of each difference that is wanted (k,)."""
        fitted = one.hypothesis.count if one.keys_known and not fresh else len(one.x)
        steps_up = np.array([c.step_at(float(x)) for c, x in zip(one.hypothesis.coordinates, one.x, strict=True)])
        return np.where(one.x + steps_up > one.hypothesis.high, -steps_up, steps_up)[:fitted]

    def _advance(self, fits: Sequence[Fit], round_: int) -> list[bool]:
        """One damped step each; True for those that should go on."""
        trials = []
        for one in fits:
            full = self.steps(one)[0]
            trials.append(one.x + one.damping * np.array([[1.0], [0.35]]) * full)
        rows, moved = self.residuals([(f.hypothesis, t) for f, t in zip(fits, trials, strict=True)]), []
        for i, (one, trial) in enumerate(zip(fits, trials, strict=True)):
            moved.append(self._accept(one, trial, rows[2 * i:2 * i + 2], round_))
        return moved

    def _accept(self, one: Fit, trial: np.ndarray, rows: Sequence[np.ndarray], round_: int) -> bool:
        costs = [self._cost(one, x, r) for x, r in zip(trial, rows, strict=True)]
        best = int(np.argmin(costs))
        gain = one.cost - costs[best]
        promised = one.cost - self._cost(one, trial[0], self.groups.moved(one.residual, one.jacobian, self._alike(trial[0] - one.x)))
        if gain > 0.0:
            one.x, one.residual, one.cost = trial[best], rows[best].copy(), costs[best]
        if gain <= 0.0 and promised > self._enough(one) and one.damping > LEAST_DAMPING:
            one.damping *= 0.1  # a curved valley: the straight step promises much and holds nothing
            one.keys_known = False
            return True
        one.damping = min(1.0, 3.0 * one.damping)
        if round_ == 0 or one.delta > 1.5 * self._delta(one.residual, NARROW):
            one.delta = self._delta(one.residual, NARROW)
            one.cost = self._cost(one, one.x, one.residual)
            return True
        return gain > self._enough(one)

    @staticmethod
    def _enough(one: Fit) -> float:
        """Gain of a round below which a fit has converged."""
        return max(1.0, 2e-4 * one.cost)

    def steps(self, one: Fit) -> tuple[np.ndarray, np.ndarray]:
        """Gauss-Newton steps of the robust cost inside the bounds: over all training rows (p,), and over each fold's (folds, p)."""
        sums = self.groups.sums(one.jacobian, one.residual, one.delta)
        whole = self._step(one, sums.sum(axis=0, where=self.groups.trains.any(axis=0)[:, None, None]))
        pairs = zip(self.groups.trains, self._leaves_out, strict=True)
        return whole, np.array([self._step(one, sums[use].sum(axis=0)) if less else whole for use, less in pairs])

    @property
    def _leaves_out(self) -> np.ndarray:
        """Whether each fold (folds,) trains on less than all folds together."""
        trains = self.groups.trains
        return (trains != trains.any(axis=0)).any(axis=1)

    @staticmethod
    def _step(one: Fit, sums: np.ndarray) -> np.ndarray:
        h, p = one.hypothesis, len(one.x)
        return bounded_step(sums[:, :p] + np.diag(h.prior), sums[:, p] + h.prior * one.x, h.low - one.x, h.high - one.x)

    def _alike(self, step: np.ndarray) -> np.ndarray:
        """The same step for every group of rows (groups, p)."""
        return np.tile(step, (self.groups.count, 1))

    def foretold(self, one: Fit, apart: np.ndarray, otherwise: np.ndarray) -> np.ndarray:
        """Every row to first order as its own fold's step (folds, p) moves it; `otherwise` (p,) where no fold tests it."""
        steps = np.vstack([apart, otherwise])[self.groups.tested_by]
        return self.groups.moved(one.residual, one.jacobian, steps)

    def _held_linear(self, one: Fit) -> np.ndarray:
        return self.foretold(one, self._fold_steps(one), np.zeros(len(one.x)))

    def _fold_steps(self, one: Fit) -> np.ndarray:
        """Steps (folds, p) from a converged fit: none for a fold that leaves nothing out."""
        return np.where(self._leaves_out[:, None], self.steps(one)[1], 0.0)

    def steps_without(self, one: Fit) -> np.ndarray:
        """Steps (folds, p) of the folds that leave something out."""
        return self.steps(one)[1][self._leaves_out]

    def settle(self, fits: Sequence[Fit]) -> None:
        """Replace first-order held-out predictions by simulated ones, fold by fold, and refresh the Jacobians."""
        todo = [f for f in fits if not f.exact]
        if not todo:
            return
        self._differentiate(todo, fresh=True)
        folds = self.problem.folds
        open_ = [(one, k, step) for one in todo for k, step in enumerate(self._fold_steps(one))]
        for _ in range(1 + SHORTER):
            rows = self.residuals([(one.hypothesis, one.x + step) for one, _, step in open_])
            for (one, k, _), row in zip(open_, rows, strict=True):
                one.held[folds[k][1]] = row[folds[k][1]]
            failed = [self._is_worse(one, folds[k][0], row) for (one, k, _), row in zip(open_, rows, strict=True)]
            open_ = [(one, k, 0.3 * step) for (one, k, step), worse in zip(open_, failed, strict=True) if worse]
            if not open_:
                break
        for one in todo:
            one.exact = True

    def _is_worse(self, one: Fit, train: np.ndarray, row: np.ndarray) -> bool:
        """Whether a fold's step, of which the Jacobian promised a gain, makes its own training rows worse: there the model bends."""
        return bool(huber(row[train], one.delta) > huber(one.residual[train], one.delta) + self._enough(one))


def portions(sizes: Sequence[int], most: int) -> Iterator[slice]:
    """Slices over consecutive items whose sizes add up to `most` or less; an item larger than that is alone."""
    first, total = 0, 0
    for at, size in enumerate(sizes):
        if total and total + size > most:
            yield slice(first, at)
            first, total = at, 0
        total += size
    if sizes:
        yield slice(first, len(sizes))


def bounded_step(normal: np.ndarray, gradient: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Minimise d' normal d / 2 + gradient' d within low <= d <= high by fixing violated coordinates one after another."""
    p = len(gradient)
    ridge = normal + np.diag(1e-9 * np.diag(normal) + 1e-12)
    step, free = np.zeros(p), np.ones(p, bool)
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
    """Sandwich covariance (p, p) of the fitted numbers; rows of one cluster may be correlated in any way."""
    weighted = one.jacobian * (huber_weight(one.residual, one.delta) * mask)[:, None]
    prior = np.diag(one.hypothesis.prior)
    bread = np.linalg.pinv(weighted.T @ one.jacobian + prior)
    score = weighted * one.residual[:, None]
    sums = np.stack([np.bincount(cluster, weights=score[:, j]) for j in range(score.shape[1])], axis=1)
    groups = max(2, len(np.unique(cluster[mask])))
    meat = sums.T @ sums * groups / (groups - 1) + prior
    return bread @ meat @ bread


def half_widths(engine: Engine, one: Fit, clusters: Sequence[np.ndarray]) -> np.ndarray:
    """Half widths (p,) of 95 % intervals of the fitted numbers: the widest that any clustering of the rows, or the folds, ask for.

    Noise asks for little. A model of slightly other form is wrong alike over whole strokes: longer clusters show it, and estimates
    that differ when a fold is left out (jackknife). Both have Student's t for their few degrees of freedom.
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
