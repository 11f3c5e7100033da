"""The state of a search for effects, and the rules by which it compares two fits on held-out rows.

A Search is immutable but for its cache of fits. A larger set of effects replaces a smaller one only
if its held-out gain is significant under the block bootstrap and larger than a minimum effect size.
"""

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from vgroove.gap.catalogue import CONVENTIONS_AT_LOWER_BOUND, Effect
from vgroove.gap.cleaning.sensor_noise import NOISE_KEYS
from vgroove.gap.fitting.cross_validation import predict_held_out
from vgroove.gap.fitting.engine import Engine
from vgroove.gap.fitting.hypothesis import Fit, Hypothesis
from vgroove.gap.fitting.population import lowest_start
from vgroove.gap.residual.agreement import MIN_CLIP_SIGMAS
from vgroove.gap.residual.protocol import MeasuredProblem
from vgroove.gap.residual.restart_angles import RestartAngles
from vgroove.gap.selection.limits import STEPWISE
from vgroove.gap.selection.model_comparison import (
    MIN_POWER,
    Blocks,
    block_sums,
    clipped_squares,
    difference_interval,
    fixed_design_bound,
    make_blocks,
)
from vgroove.gap.selection.options import DiagnosisOptions


@dataclass(frozen=True)
class ComparisonLimits:
    """Thresholds by which the search compares fits. A gap is in units of the noise's RMS, a squared
    gap in units of its power; noise is that of the sensors, or sensors and model discrepancy
    together where discrepancy.rescale() has widened the standard deviation. Chosen on the tuning
    half of the blind set (docs/gap_bench.md) unless a source is stated.
    """

    clip_sigma: float = MIN_CLIP_SIGMAS  # residuals are clipped here when two fits are compared
    visible_gap: float = 0.1  # smallest gap above the noise (docs/spec/gap.md, section 5)
    # minimum effect size: squared gap that one more effect must close, as a share of the noise
    # power, plus a share of the squared gap above the noise
    min_gain: float = 0.05
    min_gain_share: float = 0.01
    min_general_gain: float = 0.03  # in place of min_gain, of a general effect over a special case
    # share of what a general effect closes that its special case must close, where the general one
    # is likely better and too few blocks show it to be significant
    min_special_share: float = 0.5
    significance: float = 0.99  # two-sided level of the interval by which a gain is significant
    likely: float = 0.8  # two-sided level of the interval that must exceed the minimum effect size
    # squared sigmas that one parameter gains by chance: 95 % quantile of chi^2 with 1 degree of
    # freedom
    chance_gain: float = 3.84
    large_gap: float = 0.5  # smallest large gap: squared, above the noise, in noise powers
    # share of a large gap that a set must close whichever block is left out
    nearly_all: float = 0.9
    min_scale_share: float = 0.5  # share of an edge clock's scale error that a set must explain
    # share of the squared reported gap left by retuning that a set closes, from which on it is not
    # partial (docs/spec/gap.md, section 5)
    min_closed: float = 0.7
    # squared gap that an established member gains, as a share of what retuning leaves above the
    # sensors' noise (docs/spec/gap.md, section 5)
    min_established_share: float = 0.1
    # the same while a set grows far from the noise: members that are found together gain more
    min_growth_of_left: float = 0.1
    min_gain_of_left: float = 0.5  # or as a share of what the set without it leaves above the noise
    bound_margin: float = 1.02  # a parameter below this multiple of its lower bound is at the bound
    near_best: float = 1.5  # squared gaps up to this multiple of the best are fitted to convergence
    max_rounds: int = 12  # Gauss-Newton rounds until convergence; most fits need four
    # 95 % quantile of the best fit's residuals in a signal, divided by that of noise, above which
    # rescale() widens the signal's standard deviation, so that the ratio becomes this one
    far_from_noise: float = 2.0
    # relative change of a signal's standard deviation that is none: its estimate errs by more
    same_discrepancy: float = 0.01
    block_correlation_times: float = 3.0  # length of a bootstrap block, in correlation times
    max_block_restarts: float = 2.0  # and its upper bound, in restart intervals

    @property
    def visible_excess(self) -> float:
        """Squared gap of the smallest visible gap above the noise, in noise powers."""
        return (1.0 + self.visible_gap) ** 2 - 1.0


COMPARISON = ComparisonLimits()
# parameters that scale edge speeds against time stamps; the last one is the flag of the command's
# clock
SPEED_SCALE, CLOCK_SCALE, OF_COMMAND_CLOCK = (
    "effects.speed_gain.relative",
    "effects.clock_skew.relative",
    "effects.clock_skew.command_clock",
)


@dataclass(frozen=True)
class ClosedShare:
    """Share of the squared gap above the noise that an effect closes. pooled: of the sum over all
    columns of the log. by_column (columns,): of each column; 0 where the gap of the column, or the
    part of it that the effect closes, is not visible.
    """

    pooled: float
    by_column: np.ndarray

    @property
    def largest(self) -> float:
        """Over all columns, or of one column, whichever is larger."""
        return float(max(self.pooled, *self.by_column))


@dataclass
class SearchCache:
    """The one mutable part of a search: results that later steps use again.

    fits: the best converged fit of each set of effects that was tried, by key() of its ids.
    refitted_leaner: the last set whose subsets were fitted from its parameter values.
    added: the largest set whose extensions were differentiated, with the AddedEffect of each.
    extensions: the best first-order extensions of a set, by key() of its ids.
    gap_residuals: by id() of a fit, the fit and its held-out residuals in the forward simulation.
    """

    fits: dict[tuple[str, ...], Fit] = field(default_factory=dict)
    refitted_leaner: Fit | None = None
    added: tuple[Fit, list[Any]] | None = None
    extensions: dict[tuple[str, ...], Any] = field(default_factory=dict)
    gap_residuals: dict[int, tuple[Fit, np.ndarray]] = field(default_factory=dict)


@dataclass(frozen=True)
class Search:
    """A search over sets of effects on one problem.

    effects: those that may be selected; without: ids that the user excluded; nominal: the model as
    the rig states it; retuned: the same with its tolerated keys refitted; seed: of the bootstrap;
    progress: receives a text at each stage; gap_problem: the problem of the forward simulation,
    whose residuals are the reported gap, where the engine fits another comparison (None: the
    engine's own); unwhitened: the search whose residuals whitened() has filtered.
    """

    engine: Engine
    effects: list[Effect]
    blocks: Blocks
    nominal: Fit
    retuned: Fit
    seed: int = 0
    without: frozenset[str] = frozenset()
    progress: Callable[[str], None] = lambda _: None
    cache: SearchCache = field(default_factory=SearchCache)
    gap_problem: MeasuredProblem | None = None
    unwhitened: "Search | None" = None

    @property
    def problem(self) -> MeasuredProblem:
        """The measured problem whose residuals are fitted and compared, as it was loaded."""
        return self.engine.problem

    @property
    def simulated(self) -> MeasuredProblem:
        """The problem of the forward simulation, whose residuals are the reported gap."""
        return self.problem if self.gap_problem is None else self.gap_problem

    def gap_residual(self, one: Fit) -> np.ndarray:
        """Held-out residuals (n,) of a fit in the forward simulation, in sigmas of the sensors."""
        if self.unwhitened is not None:
            same = self.unwhitened.fits.get(key(one.ids))
            if same is not None:
                return self.unwhitened.gap_residual(same)
        elif self.gap_problem is None:
            return one.out_of_fold * self.engine.discrepancy
        known = self.cache.gap_residuals.get(id(one))
        if known is None or known[0] is not one:
            known = one, held_out_simulation(self.engine, one, self.simulated)
            self.cache.gap_residuals[id(one)] = known
        return known[1]

    def reported_gap(self, one: Fit) -> float:
        """Gap of a fit's held-out residuals in the forward simulation, over the judged rows
        (docs/spec/gap.md, section 5).
        """
        problem = self.simulated
        return float(problem.gap(self.gap_residual(one), problem.judged))

    @property
    def fits(self) -> dict[tuple[str, ...], Fit]:
        """The best converged fit of each set of effects that was tried."""
        return self.cache.fits

    @property
    def floor(self) -> float:
        """Gap that noise alone leaves."""
        return self.problem.floor()

    def with_angles(self, angles: RestartAngles) -> "Search":
        """The same search with other motor angles at the restarts; fits known so far stay."""
        engine = copy.copy(self.engine)
        engine.angles = angles
        return replace(self, engine=engine)

    def block_losses(self, one: Fit) -> np.ndarray:
        """Sum of the clipped squared held-out residuals of each bootstrap block (blocks,)."""
        return block_sums(self.blocks, clipped_squares(one.out_of_fold, COMPARISON.clip_sigma))

    @cached_property
    def of_column(self) -> np.ndarray:
        """Index (n,) of the log's column to which each residual belongs. Several statistics of a
        hammering tool are made from one column.
        """
        names = [signal.column.split(".")[0] for signal in self.problem.signals]
        return np.array([self.columns.index(name) for name in names])[self.problem.signal]

    @cached_property
    def columns(self) -> list[str]:
        """Columns of the log that are compared."""
        return list(dict.fromkeys(s.column.split(".")[0] for s in self.problem.signals))

    @property
    def noise_is_known(self) -> np.ndarray:
        """Whether each column's standard deviation (columns,) is stated by the rig, or is an upper
        bound. One that is estimated from the scatter of a log contains a gap that is as fast.
        """
        sensors, by_name = self.problem.rig.sensors, {s.column: s for s in self.problem.signals}
        stated = [
            NOISE_KEYS.get(name) in sensors or (name in by_name and by_name[name].noise_is_known)
            for name in self.columns
        ]
        return np.array(stated) | self.problem.sigma_is_bound

    def by_column(self, weights: np.ndarray) -> np.ndarray:
        """Sums (columns,) of weights (n,) over the residuals of each column of the log."""
        return np.bincount(self.of_column, weights=weights, minlength=self.of_column.max() + 1)

    def loss_by_column(self, one: Fit) -> np.ndarray:
        """Part of each column of the log in the squared held-out gap (columns,)."""
        weights = np.where(
            self.blocks.tested, clipped_squares(one.out_of_fold, COMPARISON.clip_sigma), 0.0
        )
        return self.by_column(weights) / self.blocks.total

    def score(self, one: Fit) -> float:
        """Squared held-out gap over all blocks of the fitted comparison, in units of the noise
        power.
        """
        return float(self.block_losses(one).sum()) / self.blocks.total

    def fitted_score(self, one: Fit) -> float:
        """Squared gap of the fit to all rows over all blocks, in units of the noise power."""
        squares = clipped_squares(one.residual, COMPARISON.clip_sigma)
        return float(block_sums(self.blocks, squares).sum()) / self.blocks.total

    def reported_score(self, one: Fit) -> float:
        """Square of reported_gap()."""
        return self.reported_gap(one) ** 2

    def discrepancy(self, signal: int) -> float:
        """Factor by which rescale() has widened the standard deviation of a signal."""
        mine = self.engine.discrepancy[self.problem.signal == signal]
        return float(mine[0]) if len(mine) else 1.0

    @cached_property
    def sample_shares(self) -> np.ndarray:
        """Share of each column (columns,) in the samples that count."""
        counts = self.blocks.tested & ~self.problem.censored
        return self.by_column(counts) / max(self.blocks.total, 1.0)

    def is_substantial(
        self,
        part: np.ndarray,
        whole: np.ndarray | None = None,
        share: float = COMPARISON.min_established_share,
    ) -> bool:
        """Whether a part (columns,) of a squared gap is at least a share of `whole` (columns,),
        over all columns, or in one in which it is a visible gap by itself. By default whole is what
        retuning leaves above the sensors' noise in the fitted comparison, and share the one that an
        established member gains (docs/spec/gap.md, section 5).
        """
        if whole is None:
            whole = np.maximum(self.loss_by_column(self.retuned) - self.floor_by_column, 0.0)
        visible = part > COMPARISON.visible_excess * self.sample_shares
        return bool(
            np.sum(part) >= share * np.sum(whole) or np.any((part >= share * whole) & visible)
        )

    def gains_share(self, fuller: Fit, leaner: Fit) -> bool:
        """Whether a fit gains over another one what an established member gains: a substantial
        share of what retuning leaves, or the larger part of what the other fit leaves (on a machine
        with one dominant effect the second one is a small share of the whole gap).
        """
        with_it, more = (self.loss_by_column(f) for f in (fuller, leaner))
        left = max(float(np.sum(more)) - self.floor_power, 0.0)
        larger_part = np.sum(more - with_it) >= COMPARISON.min_gain_of_left * left
        return bool(larger_part) or self.is_substantial(more - with_it)

    def gains_over_form_error(self, fuller: Fit, leaner: Fit) -> bool:
        """Whether a fit gains over another one more than the error of form of the other one's
        effects, in the reported gap. True where one of both ends near the noise, and where another
        comparison than the forward simulation is judged: it shows the whole gap then.

        Far from the noise the clip of the fitted comparison hides how large the whole gap is, and
        the larger part of what an effect leaves is the error of its form.
        """
        if self.gap_problem is not None or not all(map(self.is_far_from_noise, (fuller, leaner))):
            return True
        return self._gain_exceeds_form_error(fuller, leaner)

    def leaves_far_gap_of(self, leaner: Fit, fuller: Fit) -> bool:
        """Whether a fit that ends far from the noise leaves more than another one, by more than the
        error of form of what it closes itself. A log of few events has too few blocks to show that
        as significant.
        """
        far = self.gap_problem is None and self.is_far_from_noise(leaner)
        leaves_more = far and self.reported_gap(leaner) > self.reported_gap(fuller)
        return leaves_more and self._gain_exceeds_form_error(fuller, leaner)

    def _gain_exceeds_form_error(self, fuller: Fit, leaner: Fit) -> bool:
        with_it, more, alone = (
            self.reported_loss_by_column(f) for f in (fuller, leaner, self.retuned)
        )
        closed = np.maximum(alone - more, 0.0)
        return self.is_substantial(more - with_it, closed, STEPWISE.max_form_share)

    def reported_loss_by_column(self, one: Fit) -> np.ndarray:
        """Part of each column of the log in the square of reported_gap() (columns,); for searches
        without a gap_problem.
        """
        square = self.problem.squared(self.gap_residual(one))
        counts = self.problem.judged & np.isfinite(square)
        return self.by_column(np.where(counts, square, 0.0)) / max(np.count_nonzero(counts), 1)

    @cached_property
    def reported_floor_by_column(self) -> np.ndarray:
        """What noise alone leaves of reported_loss_by_column() (columns,)."""
        counts = self.problem.judged & ~self.problem.censored
        return self.by_column(counts) / max(np.count_nonzero(counts), 1)

    def closed_share(self, fuller: Fit, leaner: Fit) -> ClosedShare:
        """Share that a fit closes of what another one leaves above the sensors' noise."""
        with_it, more = (self.loss_by_column(f) for f in (fuller, leaner))
        left, part = np.maximum(more - self.floor_by_column, MIN_POWER), more - with_it
        visible = np.minimum(left, part) > COMPARISON.visible_excess * self.sample_shares
        by_column = np.divide(part, left, out=np.zeros_like(part), where=visible)
        return ClosedShare(float(np.sum(part)) / float(np.sum(left)), by_column)

    @cached_property
    def floor_by_column(self) -> np.ndarray:
        """Part of each column (columns,) in floor_power."""
        counts = self.blocks.tested & ~self.problem.censored
        weights = np.where(counts, self.engine.discrepancy**-2.0, 0.0)
        return self.by_column(weights) / max(self.blocks.total, 1.0)

    @cached_property
    def floor_power(self) -> float:
        """Squared gap that a model without error leaves: the power of the sensors' noise, 1, or
        less where rescale() has widened the standard deviation of a signal.
        """
        counts = self.blocks.tested & ~self.problem.censored
        return float(np.mean(self.engine.discrepancy[counts] ** -2.0)) if counts.any() else 1.0

    def excess_power(self, one: Fit) -> float:
        """Squared gap that a set leaves above the noise."""
        return self.score(one) - 1.0

    def min_gain(self, leaner: Fit, share: float = COMPARISON.min_gain) -> float:
        """Minimum effect size: squared gap that a fuller set must close of what a leaner one
        leaves. share: of the noise power.
        """
        return share + COMPARISON.min_gain_share * max(0.0, self.score(leaner) - 1.0)

    def equal_up_to_chance(self, one: Fit, other: Fit) -> bool:
        """Whether the losses of two sets differ by no more than one parameter gains by chance."""
        difference = float(self.block_losses(one).sum() - self.block_losses(other).sum())
        return abs(difference) <= COMPARISON.chance_gain

    def equal_up_to_form_error(self, one: Fit, best: Fit) -> bool:
        """Whether the squared gap of a set exceeds that of the best by less than the minimum effect
        size, where the standard deviations include the model's discrepancy (rescale()).

        An error in the form of an effect repeats in every block. The bootstrap over blocks then
        takes even a small difference that it causes for significant.
        """
        lost = self.score(one) - self.score(best)
        return self.floor_power < 1.0 and lost <= self.min_gain(best)

    def is_tied(self, one: Fit, best: Fit) -> bool:
        """Whether a set predicts the held-out rows as well as the best: the 95 % interval of the
        difference contains 0 (docs/spec/gap.md, section 5), or chance or a form error explains the
        difference.

        Models may differ in few blocks only, which many bootstrap samples do not contain. Therefore
        a set is not tied if its loss on this very run (loss_bound()) exceeds the minimum effect
        size, nor if the best closes nearly all of a large gap that it leaves, nor if the scale of
        the Hall edges contradicts it but not the best, nor if it leaves most of a gap far from the
        noise that the best closes.
        """
        if self.contradicts_edge_scale(one) and not self.contradicts_edge_scale(best):
            return False
        if self.leaves_most_of_far_gap(one) and not self.leaves_most_of_far_gap(best):
            return False
        if self.equal_up_to_chance(one, best) or self.equal_up_to_form_error(one, best):
            return True
        if self.closes_large_gap(best, one):
            return False
        difference = self.block_losses(one) - self.block_losses(best)
        if difference_interval(self.blocks, difference)[0] > 0.0:
            return False
        return self.loss_bound(one, best) <= self.min_gain(best)

    def loss_bound(self, worse: Fit, better: Fit, level: float = 0.95) -> float:
        """Lower confidence bound of the squared gap that the worse fit loses on this very run."""
        clip = COMPARISON.clip_sigma
        return fixed_design_bound(
            self.blocks, *(np.clip(f.out_of_fold, -clip, clip) for f in (worse, better)), level
        )

    def contradicts_edge_scale(self, one: Fit) -> bool:
        """Whether the edge periods of a log are consecutive only on another time scale than that of
        its stamps (run.edge_scale), and no clock or gain of the set explains at least half of that
        scale error.

        The edges determine the scale far more precisely than the motion does.
        """
        problem = self.problem
        scales = [run.edge_scale for run in problem.runs if run.edge_scale != 1.0]
        if not scales:
            return False
        theta = one.theta(problem.theta0)
        gain, clock, of_command = (
            theta[problem.index(name)] for name in (SPEED_SCALE, CLOCK_SCALE, OF_COMMAND_CLOCK)
        )
        explained = (1.0 + gain) * (1.0 + (0.0 if of_command else clock))
        return any(
            abs(scale - explained) > COMPARISON.min_scale_share * abs(scale - 1.0)
            for scale in scales
        )

    def is_better(self, fuller: Fit, leaner: Fit, share: float = COMPARISON.min_gain) -> bool:
        """Whether a fuller set replaces a leaner one: it closes a large gap, or its gain likely
        exceeds the minimum effect size and is significant, by the block bootstrap or on this very
        run (loss_bound()).
        """
        if self.closes_large_gap(fuller, leaner):
            return True
        if not self.is_likely_better(fuller, leaner, share):
            return False
        gain = self.block_losses(leaner) - self.block_losses(fuller)
        return difference_interval(self.blocks, gain, COMPARISON.significance)[0] > 0.0 or (
            self.loss_bound(leaner, fuller, COMPARISON.significance) > self.min_gain(leaner, share)
        )

    def is_likely_better(
        self, fuller: Fit, leaner: Fit, share: float = COMPARISON.min_gain
    ) -> bool:
        """Whether the gain exceeds the minimum effect size in most bootstrap samples, so that it
        does not come from one block.
        """
        gain, least = (
            self.block_losses(leaner) - self.block_losses(fuller),
            self.min_gain(leaner, share),
        )
        return (
            float(gain.sum()) / self.blocks.total > least
            and difference_interval(self.blocks, gain, COMPARISON.likely)[0] > least
        )

    def outdoes_special_case(self, general: Fit, special: Fit) -> bool:
        """Whether a general effect must not be replaced by its special case, from the fits of a set
        with the one and with the other. The general effect must be significantly better, or likely
        better where the special case closes less than half of the gap that the general one closes:
        few blocks show the difference between cold grease and viscous friction, for example.
        """
        share = COMPARISON.min_general_gain
        if self.is_better(general, special, share):
            return True
        closed, whole = (self.score(self.retuned) - self.score(f) for f in (special, general))
        return closed < COMPARISON.min_special_share * whole and self.is_likely_better(
            general, special, share
        )

    def closes_large_gap(self, fuller: Fit, leaner: Fit) -> bool:
        """Whether the fuller set closes nearly all of a large gap whichever block is left out
        (jackknife); a short log has too few blocks for a significant bootstrap.
        """
        noise, more, left = (
            self.blocks.rows,
            self.block_losses(leaner),
            self.block_losses(fuller),
        )
        noise, above, gain = (float(x.sum()) - x for x in (noise, more - noise, more - left))
        return bool(
            np.all(above > COMPARISON.large_gap * noise)
            and np.all(gain > COMPARISON.nearly_all * above)
        )

    def closes_visible_gap(self, one: Fit) -> bool:
        """Whether a set closes a gap that is visible: above the noise, or above what the set leaves
        where that is less. No effect is named for a smaller gap.
        """
        noise, left = np.sqrt(self.floor_power), np.sqrt(self.score(one))
        before = np.sqrt(self.score(self.retuned))
        return bool(before - min(noise, left) >= COMPARISON.visible_gap * noise)

    @cached_property
    def may_have_gap(self) -> bool:
        """Whether there may be a gap: not where the noise of all columns of the log is known and
        retuning leaves a visible gap in none. A set that predicts better than the noise allows
        follows the noise, or one irregular trajectory by chance.
        """
        visible = (1.0 + COMPARISON.visible_excess) * self.floor_by_column
        is_visible = self.loss_by_column(self.retuned) > visible
        return bool(np.any(is_visible | ~self.noise_is_known))

    def leaves_gap(self, one: Fit) -> bool:
        """Whether a set leaves a visible gap."""
        return self.excess_power(one) >= COMPARISON.visible_excess

    def is_far_from_noise(self, one: Fit) -> bool:
        """Whether the reported gap of a set lies far above the sensors' noise: one event of the
        run, such as a run-up, is then enough to show it.
        """
        return self.reported_gap(one) >= COMPARISON.far_from_noise * self.floor

    def reported_share(self, one: Fit) -> float:
        """Share of the squared reported gap left by retuning that a set closes."""
        return self.closed_reported_share(one, self.retuned)

    def closed_reported_share(self, one: Fit, leaner: Fit) -> float:
        """Share that a set closes of the squared reported gap that a leaner one leaves. The clip of
        the reported gap grows with the nominal model's errors, so that large errors count.
        """
        floor = self.floor**2
        before, after = (self.reported_score(f) - floor for f in (leaner, one))
        return (before - after) / max(before, MIN_POWER)

    def closed_far_share(self, fuller: Fit, leaner: Fit) -> float:
        """Share that a set closes of the reported gap of a leaner one that ends far from the noise;
        0 of any other, and where another comparison than the forward simulation is judged.
        """
        other = self.gap_problem is not None or self.unwhitened is not None
        if other or not self.is_far_from_noise(leaner):
            return 0.0
        return self.closed_reported_share(fuller, leaner)

    def closes_far_gap(self, fuller: Fit, leaner: Fit) -> bool:
        """Whether a set closes nearly all that a leaner one leaves far from the noise. One event of
        a log may show that, of which its other parts, and a comparison that clips the errors of
        this event, say little.
        """
        return self.closed_far_share(fuller, leaner) >= COMPARISON.nearly_all

    def leaves_most_of_far_gap(self, one: Fit) -> bool:
        """Whether the reported gap of a set lies far above the sensors' noise, and the set closes
        too little of what retuning leaves to be its whole cause. The reported gap weighs single
        events, which the clip of the comparison cuts off.
        """
        return self.is_far_from_noise(one) and self.reported_share(one) < COMPARISON.min_closed

    def closes_reported_gap(self, one: Fit) -> bool:
        """Whether a set of effects reduces the reported gap enough to be named: by at least
        min_established_share of what retuning leaves above the noise, over all signals or in one
        alone. The statistics of an impact tool describe one motion that repeats itself, so that all
        count together, and parts of the log cannot show that a size is the same elsewhere: there a
        set must close min_closed, which divides the verdicts partial and effect. Where the sets are
        compared otherwise than by forward simulation, which may not show the effect, the reported
        gap need only not grow. A gap that is not visible need not be reduced.
        """
        if self.problem.sigma_is_bound:
            return self.reported_share(one) >= COMPARISON.min_closed
        before = self.reported_gap(self.retuned)
        if before - self.floor < COMPARISON.visible_gap * self.floor:
            return True
        if self.gap_problem is not None:
            return self.reported_gap(one) <= before
        left, kept = (self.reported_loss_by_column(f) for f in (self.retuned, one))
        closed, whole = left - kept, np.maximum(left - self.reported_floor_by_column, 0.0)
        return self.reported_gap(one) < before and self.is_substantial(closed, whole)

    def leaves_gap_in_most_draws(self, one: Fit) -> bool:
        """Whether a set leaves a visible gap in most bootstrap samples, so that the gap does not
        come from a few blocks in which one event happened.
        """
        noise = (1.0 + COMPARISON.visible_excess) * self.floor_power * self.blocks.rows
        above = self.block_losses(one) - noise
        return difference_interval(self.blocks, above, COMPARISON.likely)[0] > 0.0

    def fit_and_keep(self, hypotheses: Sequence[Hypothesis], iterations: int = 6) -> list[Fit]:
        """Fit hypotheses, bring those near the best to convergence, predict their held-out rows,
        and return the best fit known of each set.
        """
        fits = self.engine.fit(hypotheses, iterations)
        if fits:
            self.engine.continue_fits(
                self.near_best(fits), range(iterations, COMPARISON.max_rounds)
            )
            predict_held_out(self.engine, self.near_best(fits))
        for one in fits:
            known = self.fits.get(key(one.ids))
            if known is None or self.engine.closest([known, one])[0] is one:
                self.fits[key(one.ids)] = one
        return [self.fits[k] for k in dict.fromkeys(key(h.ids) for h in hypotheses)]

    def near_best(self, fits: Sequence[Fit]) -> list[Fit]:
        """Those of some fits whose squared gap, held out or of the fit to all rows, is at most
        near_best times the smallest held-out one: a held-out gap that is predicted to first order
        is far too large where the folds' steps are long.
        """
        limit = COMPARISON.near_best * min(map(self.score, fits))
        return [f for f in fits if min(self.score(f), self.fitted_score(f)) <= limit]

    def ranked(self, size: int | None = None) -> list[Fit]:
        """Fits of sets of one size, without one of all sets, best first; equal scores in the order
        of their ids.
        """
        mine = (f for k, f in self.fits.items() if size in (None, len(k)) and is_valid(f))
        return sorted(mine, key=lambda f: (round(self.score(f), 9), f.ids))


def held_out_simulation(engine: Engine, one: Fit, problem: MeasuredProblem) -> np.ndarray:
    """Residuals (n,) of another problem on the same logs; the rows of each fold are simulated with
    the fit to the other folds, those of a fold that the engine's problem has no rows of with the
    fit to all.
    """
    numbers = np.unique(problem.fold)
    points = np.tile(one.x, (len(numbers), 1))
    if len(one.x):
        for number, step in zip(
            np.unique(engine.problem.fold), engine.taken_steps(one), strict=True
        ):
            points[numbers == number] += step
    low, high = one.hypothesis.low, one.hypothesis.high
    theta = one.hypothesis.theta(problem.theta0, np.clip(points, low, high))
    rows = problem.residuals(theta, engine.angles if problem is engine.problem else None)
    out = rows[0].copy()
    for number, row in zip(numbers, rows, strict=True):
        test = problem.fold == number
        out[test] = row[test]
    return out


def is_valid(one: Fit) -> bool:
    """False for a fit with a parameter at a lower bound at which it describes nothing, or with a
    number at a bound of the search: its best value lies beyond (docs/spec/gap.md, section 5).
    """
    at_bound = (
        c.low > 0.0 and x < COMPARISON.bound_margin * c.low
        for c, x in zip(one.hypothesis.coordinates, one.x, strict=True)
        if c.name in CONVENTIONS_AT_LOWER_BOUND
    )
    return not any(at_bound) and not any(ends_at_bound(one, i) for i in one.ids)


def ends_at_bound(one: Fit, effect_id: str) -> bool:
    """Whether a number of an effect ends at a bound that only limits the search."""
    return any(
        c.ends_at_search_bound(float(x))
        for c, x in zip(one.hypothesis.coordinates, one.x, strict=True)
        if c.name.startswith(f"effects.{effect_id}.")
    )


def key(ids: Sequence[str]) -> tuple[str, ...]:
    """Identifier of a set of effects, independent of their order."""
    return tuple(sorted(ids))


def begin(
    engine: Engine,
    effects: list[Effect],
    options: DiagnosisOptions,
    gap_problem: MeasuredProblem | None = None,
) -> Search:
    """A search with the nominal and the retuned fit and its bootstrap blocks. gap_problem: the
    problem of the reported gap, where it is not the engine's.
    """
    options.progress("fitting the rig's tolerated values")
    empty, problem = Hypothesis((), (), np.zeros(0)), engine.problem
    nominal = engine.fit([empty], 0)[0]
    nominal.exact = True
    retuned = nominal
    if engine.nuisance:
        (plain,) = engine.hypotheses([])
        if problem.sigma_is_bound:  # the motion is not smooth in its parameters
            plain = lowest_start(engine, plain, options.seed)
        retuned = engine.fit([plain])[0]
        predict_held_out(engine, [retuned])
        engine.nuisance_columns = retuned.jacobian
    tested = np.logical_or.reduce([test for _, test in problem.folds])
    blocks = make_blocks(problem, tested, problem.restart_s, options.seed)
    return Search(
        engine,
        effects,
        blocks,
        nominal,
        retuned,
        seed=options.seed,
        without=frozenset(options.without),
        progress=options.progress,
        cache=SearchCache({(): retuned}),
        gap_problem=gap_problem,
    )
