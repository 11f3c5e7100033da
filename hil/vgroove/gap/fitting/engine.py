"""Fits many hypotheses in lock step: damped Gauss-Newton (Nocedal and Wright 2006, section 10.3)
under Huber's loss, within bounds, with nuisance parameters under log-normal priors.

All parameter sets of one round (every hypothesis, every finite difference) are simulated in one
batch. A hypothesis is fitted on all training rows; the fit of each fold is one Newton step from it
with the same Jacobian (cross_validation.py).
"""

import copy
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vgroove.gap.catalogue import Effect, Scales
from vgroove.gap.cleaning.sensor_noise import MAD_TO_SIGMA
from vgroove.gap.fitting.coordinates import HypothesisBuilder
from vgroove.gap.fitting.hypothesis import Fit, Hypothesis
from vgroove.gap.fitting.normal_equations import FoldGroups
from vgroove.gap.fitting.steps import (
    needed_steps,
    newton_steps,
    points_along,
    predict_first_order,
)
from vgroove.gap.fitting.whitening import Whitening
from vgroove.gap.residual.batches import split_by_size
from vgroove.gap.residual.huber import huber_loss
from vgroove.gap.residual.protocol import MeasuredProblem

# Threshold of Huber's loss in robust standard deviations of the residuals: in the first round,
# whose start may be far from the minimum, and in all others. Chosen on the tuning half of the blind
# set (docs/gap_bench.md).
FIRST_HUBER_SIGMAS, FINAL_HUBER_SIGMAS = 20.0, 4.0
MAX_RESIDUAL = 1e5  # sigma; larger residuals, and those of failed simulations, are clipped here


@dataclass(frozen=True)
class DampingRules:
    """Damping factors (shares of the Gauss-Newton step) that are tried, and when a fit has
    converged; chosen on the tuning half of the blind set (docs/gap_bench.md).
    """

    short_step: float = 0.35  # second trial of a round, as a share of the first
    # change of the damping factor after a round that gained nothing although the Jacobian predicts
    # a gain, and after any other round
    reduction: float = 0.1
    growth: float = 3.0
    min_damping: float = 0.02  # smallest damping factor
    # a round that lowers the cost by less than both has converged: squared sigma, share of the cost
    min_gain: float = 1.0
    min_gain_share: float = 2e-4
    # ratio of Huber's threshold to that of the final residuals above which it is computed again
    huber_excess: float = 1.5


@dataclass(frozen=True)
class BatchLimits:
    """Residual vectors, and residuals, that are in memory at once for the Jacobians (64 MB)."""

    vectors: int = 192
    residuals: int = 8_000_000


DAMPING, BATCH = DampingRules(), BatchLimits()

Job = tuple[Hypothesis, np.ndarray]  # a hypothesis and coordinate vectors (B, p)


class Engine:
    """Builds hypotheses for one problem and runs their fits.

    The problem stays as it was loaded; angles holds the motor angles at its restarts as estimated
    so far.
    """

    def __init__(
        self,
        problem: MeasuredProblem,
        scales: Scales,
        tolerance: dict[str, float],
        present: frozenset[str] = frozenset(),
    ) -> None:
        self.problem, self.scales, self.present = problem, scales, present
        self.angles = problem.angles
        self.builder = HypothesisBuilder(problem, scales, tolerance, present)
        self.nuisance = self.builder.nuisance()
        self.nuisance_columns: np.ndarray | None = None
        self.train = np.logical_or.reduce([train for train, _ in problem.folds])
        self.groups = FoldGroups(problem.folds)
        self.discrepancy = np.ones(problem.n)  # (n,), see with_discrepancy()
        self.whitening: Whitening | None = None  # see with_whitening()
        self.calls = 0  # parameter sets that were simulated
        self.on_work: Callable[[], None] = lambda: None  # called after each batch of simulations

    def with_discrepancy(self, discrepancy: np.ndarray) -> "Engine":
        """The engine with the standard deviation of each residual (n,) this many times that of the
        sensors: residuals and costs are in units of both together.
        """
        other = copy.copy(self)
        other.discrepancy = discrepancy
        if self.nuisance_columns is not None:
            ratio = (self.discrepancy / discrepancy).astype(np.float32)
            other.nuisance_columns = self.nuisance_columns * ratio[:, None]
        return other

    def with_whitening(self, whitening: Whitening) -> "Engine":
        """The engine whose residuals are filtered (generalised least squares), in units of the
        sensors' noise.
        """
        other = copy.copy(self)
        other.whitening, other.discrepancy = whitening, np.ones(self.problem.n)
        if self.nuisance_columns is not None:
            other.nuisance_columns = self.whitened_columns(whitening, self.nuisance_columns)
        return other

    def whitened_columns(self, whitening: Whitening, columns: np.ndarray) -> np.ndarray:
        """Columns (n, p) of this engine's Jacobians as those of with_whitening()."""
        return whitening.apply(columns.T * self.discrepancy).astype(np.float32).T

    def whitened_fit(self, whitening: Whitening, one: Fit) -> Fit:
        """A fit of this engine as one of with_whitening(), not converged there."""
        residual, out_of_fold = (
            whitening.apply(r * self.discrepancy) for r in (one.residual, one.out_of_fold)
        )
        other = replace(
            one,
            residual=residual,
            out_of_fold=out_of_fold,
            jacobian=self.whitened_columns(whitening, one.jacobian),
            delta=self._delta(residual, FINAL_HUBER_SIGMAS),
            exact=not len(one.x),
            improving=len(one.x) > 0,
            damping=1.0,
        )
        other.cost = self.cost(other, other.x, residual)
        return other

    def weighted(self, residuals: np.ndarray) -> np.ndarray:
        """Residuals (n,) or (B, n) of the problem as this engine fits them."""
        if self.whitening is not None:
            residuals = self.whitening.apply(residuals)
        if np.any(self.discrepancy != 1.0):
            residuals = residuals / self.discrepancy
        return residuals

    def rescale_fit(self, one: Fit, ratio: np.ndarray) -> None:
        """Multiply the residuals of a fit by ratio (n,), the change of the discrepancy, and compute
        its Huber threshold and cost again.
        """
        one.residual = one.residual * ratio
        one.out_of_fold = one.out_of_fold * ratio
        if len(one.jacobian):
            one.jacobian *= ratio.astype(np.float32)[:, None]
        one.delta = self._delta(one.residual, FINAL_HUBER_SIGMAS)
        one.cost = self.cost(one, one.x, one.residual)

    # --- hypotheses ---

    def remember(self, one: Fit) -> None:
        """Store the fitted numbers of a fit: fits of larger sets start its effects from these, not
        from their many starts.
        """
        self.builder.known |= {
            c.name: float(x)
            for c, x in zip(one.hypothesis.coordinates, one.x, strict=True)
            if not c.prior
        }

    def is_known(self, effect: Effect) -> bool:
        """Whether fits of larger sets start the effect from the values of its fit alone."""
        return any(effect.name(p) in self.builder.known for p in effect.parameters)

    def hypotheses(
        self,
        effects: Sequence[Effect],
        x_nuisance: np.ndarray | None = None,
        from_catalogue: Effect | None = None,
    ) -> list[Hypothesis]:
        """All forms and starts of a set of effects; nuisance parameters start at x_nuisance, the
        effect from_catalogue at the catalogue's starts even if its fitted numbers are stored.
        """
        x = np.zeros(len(self.nuisance)) if x_nuisance is None else x_nuisance
        return self.builder.hypotheses(effects, self.nuisance, x, from_catalogue)

    # --- residuals ---

    @property
    def max_vectors(self) -> int:
        """Parameter sets whose residuals are held at once."""
        return max(1, min(BATCH.vectors, BATCH.residuals // self.problem.n))

    def residuals(self, jobs: Sequence[Job]) -> list[np.ndarray]:
        """One vector of residuals (n,) for each coordinate vector of the jobs (B, p), in one batch;
        equal parameter sets are simulated, and stored, once.
        """
        theta = np.concatenate([h.theta(self.problem.theta0, np.atleast_2d(x)) for h, x in jobs])
        places: dict[bytes, int] = {}
        which = [places.setdefault(one.tobytes(), len(places)) for one in theta]
        theta = np.stack([np.frombuffer(one) for one in places])
        self.calls += len(theta)
        rows = self.weighted(self.problem.residuals(theta, self.angles))
        np.clip(rows, -MAX_RESIDUAL, MAX_RESIDUAL, out=rows)
        self.on_work()
        unique = list(rows)
        return [unique[k] for k in which]

    def residuals_of_jobs(self, jobs: Sequence[Job]) -> Iterator[list[np.ndarray]]:
        """Residuals of each job's points (B, p), as many jobs in a batch as memory holds."""
        for part in split_by_size([len(points) for _, points in jobs], self.max_vectors):
            rows = iter(self.residuals(jobs[part]))
            for _, points in jobs[part]:
                yield [next(rows) for _ in points]

    # --- fits ---

    def fit(self, hypotheses: Sequence[Hypothesis], rounds: int = 6) -> list[Fit]:
        """Fit all hypotheses on the training rows in at most so many rounds; their out-of-fold
        residuals are predicted to first order.
        """
        if not hypotheses:
            return []
        fits = self._begin(hypotheses, rounds > 0)
        self.continue_fits(fits, range(rounds))
        return fits

    def continue_fits(self, fits: Sequence[Fit], rounds: range) -> None:
        """Further rounds of the fits that have not converged; the out-of-fold residuals of all are
        predicted to first order.
        """
        for round_ in rounds:
            active = [one for one in fits if one.improving]
            if not active:
                break
            self.differentiate([one for one in active if not one.jacobian_is_at_x])
            ahead = self.problem.has_lanes and round_ + 1 < rounds.stop
            improving = self._advance(active, round_, ahead)
            for one, still in zip(active, improving, strict=True):
                one.improving = still
        for one in fits:
            steps = self.fold_steps(one)
            one.out_of_fold = self.predict_first_order(one, steps, np.zeros(len(one.x)))

    def _begin(self, hypotheses: Sequence[Hypothesis], with_slopes: bool) -> list[Fit]:
        """Fits at their starts, with Jacobians where a round follows."""
        fits = [self._unfitted(h) for h in hypotheses]
        steps = [needed_steps(one, one.x) if with_slopes else np.zeros(0) for one in fits]
        jobs = [
            (one.hypothesis, np.vstack([one.x, points_along(one.x, signed)]))
            for one, signed in zip(fits, steps, strict=True)
        ]
        found = self.residuals_of_jobs(jobs)
        for one, signed, (start, *moved) in zip(fits, steps, found, strict=True):
            one.residual, one.delta = start.copy(), self._delta(start, FIRST_HUBER_SIGMAS)
            one.cost = self.cost(one, one.x, start)
            if with_slopes:
                _set_jacobian(one, signed, moved)
        return fits

    def _unfitted(self, h: Hypothesis) -> Fit:
        jacobian = np.zeros((len(h.start), self.problem.n), np.float32).T
        one = Fit(h, h.start.copy(), np.zeros(0), jacobian, np.inf, np.inf)
        if self.nuisance_columns is not None and h.count:
            one.jacobian[:, h.count :], one.nuisance_slopes_known = self.nuisance_columns, True
        return one

    def _delta(self, r: np.ndarray, sigmas: float) -> float:
        """Threshold of Huber's loss for residuals (n,), at least that for residuals of 1 sigma."""
        return sigmas * max(1.0, float(MAD_TO_SIGMA * np.median(np.abs(self._trained(r)))))

    def _trained(self, r: np.ndarray) -> np.ndarray:
        return r if self.train.all() else r[self.train]

    def cost(
        self, one: Fit, x: np.ndarray, r: np.ndarray, train: np.ndarray | None = None
    ) -> float:
        """Huber's loss of residuals (n,) on rows (n,), by default those that any fold trains on,
        plus the priors of the nuisance parameters at x (p,).
        """
        loss = huber_loss(self._trained(r) if train is None else r[train], one.delta)
        return float(loss) + float(((x * one.hypothesis.prior) ** 2).sum())

    def costs(self, one: Fit, points: np.ndarray) -> list[float]:
        """Costs of a fit's hypothesis at other points (k, p), under the fit's Huber threshold."""
        rows = self.residuals_of_jobs([(one.hypothesis, x[None, :]) for x in points])
        return [self.cost(one, x, row) for x, (row,) in zip(points, rows, strict=True)]

    def costs_alike(self, fits: Sequence[Fit]) -> list[float]:
        """Costs of several fits under one Huber threshold, the smallest of theirs: those of
        different thresholds cannot be compared.
        """
        delta = min((one.delta for one in fits), default=np.inf)
        alike = (replace(one, delta=delta) for one in fits)
        return [self.cost(one, one.x, one.residual) for one in alike]

    def closest(self, fits: Sequence[Fit]) -> list[Fit]:
        """Fits in the order of their costs_alike(), equal ones in that of their ids."""
        costs = {id(one): cost for one, cost in zip(fits, self.costs_alike(fits), strict=True)}
        return sorted(fits, key=lambda one: (costs[id(one)], one.ids))

    def is_gain(self, one: Fit, cost: float) -> bool:
        """Whether a cost, under the Huber threshold of a fit, lies below that of the fit by more
        than what a converged fit may still gain.
        """
        return one.cost - cost > self.converged_gain(one)

    def gains_on(self, other: Fit, one: Fit) -> bool:
        """Whether the cost of another fit lies so far below that of a fit, both under one
        threshold.
        """
        cost, least = self.costs_alike([one, other])
        return cost - least > self.converged_gain(one)

    @staticmethod
    def converged_gain(one: Fit) -> float:
        """Gain of a round, in squared sigma, below which a fit has converged."""
        return max(DAMPING.min_gain, DAMPING.min_gain_share * one.cost)

    def differentiate(self, fits: Sequence[Fit], fresh: bool = False) -> None:
        """Jacobians by forward differences, of as many hypotheses in a batch as memory holds.

        The columns of the nuisance parameters hardly depend on the effects: those of the model
        without effects are used until a step fails, or `fresh` requires all columns.
        """
        steps = [needed_steps(one, one.x, fresh) for one in fits]
        jobs = [
            (one.hypothesis, points_along(one.x, signed))
            for one, signed in zip(fits, steps, strict=True)
        ]
        found = self.residuals_of_jobs(jobs)
        for one, signed, moved in zip(fits, steps, found, strict=True):
            _set_jacobian(one, signed, moved)

    def _advance(self, fits: Sequence[Fit], round_: int, ahead: bool) -> list[bool]:
        """One round of each fit; True for those that have not converged. ahead: the differences for
        the Jacobian after the whole step are simulated in the same batch, because the trials of one
        fit alone do not fill the plant's SIMD lanes.
        """
        shares = np.array([[1.0], [DAMPING.short_step]])
        trials = [one.x + one.damping * shares * self.steps(one)[0] for one in fits]
        steps = [
            needed_steps(one, trial[0]) if ahead else np.zeros(0)
            for one, trial in zip(fits, trials, strict=True)
        ]
        jobs = [
            (one.hypothesis, np.vstack([trial, points_along(trial[0], signed)]))
            for one, trial, signed in zip(fits, trials, steps, strict=True)
        ]
        improving, found = [], self.residuals_of_jobs(jobs)
        for one, trial, signed, (full, part, *moved) in zip(
            fits, trials, steps, found, strict=True
        ):
            improving.append(self._accept(one, trial, (full, part), round_))
            if ahead and improving[-1] and np.array_equal(one.x, trial[0]):
                _set_jacobian(one, signed, moved)
        return improving

    def _accept(self, one: Fit, trial: np.ndarray, rows: Sequence[np.ndarray], round_: int) -> bool:
        """Take the better of two trial points (2, p) if it gains anything, and adapt damping and
        Huber threshold; False for a fit that has converged.
        """
        costs = [self.cost(one, x, r) for x, r in zip(trial, rows, strict=True)]
        best = int(np.argmin(costs))
        gain, predicted = one.cost - costs[best], self._first_order_gain(one, trial[0])
        if gain > 0.0:
            one.x, one.residual, one.cost = trial[best], rows[best].copy(), costs[best]
            one.jacobian_is_at_x = False
        if (
            gain <= 0.0
            and predicted > self.converged_gain(one)
            and one.damping > DAMPING.min_damping
        ):
            # the cost is so curved along the step that no trial gains what the Jacobian predicts
            one.damping *= DAMPING.reduction
            one.nuisance_slopes_known = one.jacobian_is_at_x = False
            return True
        one.damping = min(1.0, DAMPING.growth * one.damping)
        final = self._delta(one.residual, FINAL_HUBER_SIGMAS)
        if round_ == 0 or one.delta > DAMPING.huber_excess * final:
            one.delta = final
            one.cost = self.cost(one, one.x, one.residual)
            return True
        return gain > self.converged_gain(one)

    def _first_order_gain(self, one: Fit, x: np.ndarray) -> float:
        """Gain of the cost at x (p,) as the Jacobian predicts it."""
        steps = np.tile(x - one.x, (self.groups.count, 1))
        return one.cost - self.cost(one, x, self.groups.moved(one.residual, one.jacobian, steps))

    # --- steps ---

    def steps(self, one: Fit) -> tuple[np.ndarray, np.ndarray]:
        """Gauss-Newton steps from a fit: of all training rows (p,), of each fold's (folds, p)."""
        return newton_steps(self.groups, one)

    def fold_steps(self, one: Fit) -> np.ndarray:
        """Steps (folds, p) from a converged fit: 0 for a fold that leaves nothing out."""
        return np.where(self.groups.leaves_out[:, None], self.steps(one)[1], 0.0)

    def taken_steps(self, one: Fit) -> np.ndarray:
        """Steps (folds, p) from a converged fit to the fit of each fold: those with which its
        held-out residuals were simulated, or fold_steps() where they are only first-order.
        """
        return one.fold_steps if one.exact and len(one.fold_steps) else self.fold_steps(one)

    def steps_without(self, one: Fit) -> np.ndarray:
        """The taken_steps() (k, p) of the folds that leave something out."""
        return self.taken_steps(one)[self.groups.leaves_out]

    def predict_first_order(
        self, one: Fit, by_fold: np.ndarray, untested: np.ndarray
    ) -> np.ndarray:
        """Residuals (n,) to first order: of each row after the step (folds, p) of the fold that
        tests it, of rows that no fold tests after the step untested (p,).
        """
        return predict_first_order(self.groups, one, by_fold, untested)


def _set_jacobian(one: Fit, signed: np.ndarray, moved: Sequence[np.ndarray]) -> None:
    """Columns of the Jacobian from residuals (n,) one signed step (k,) along each number."""
    for column, step, row in zip(one.jacobian.T, signed, moved, strict=False):
        column[:] = (row - one.residual) / step
    one.nuisance_slopes_known, one.jacobian_is_at_x = one.hypothesis.count > 0, True
