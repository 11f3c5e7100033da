"""Whether an effect of a set has the same size wherever the logs show it (docs/spec/gap.md,
section 5): something outside the catalogue is imitated with values that change from part to part.

The size is a factor on the effect's leading parameter, 1 in the fit to all rows. It is estimated in
each part to first order, with the nuisance parameters fitted there under their priors. The scatter
between parts is the random-effects standard deviation (R. DerSimonian and N. Laird, Controlled
Clinical Trials 7 (1986) 177). Of an effect that closes the larger part of what the set without it
leaves, it may be weighted by the squared gap that the effect makes in each part.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from vgroove.gap.catalogue import BY_ID
from vgroove.gap.fitting.hypothesis import Coordinate, Fit
from vgroove.gap.fitting.steps import bounded_step
from vgroove.gap.selection.extension import slopes_of_subsystem
from vgroove.gap.selection.model_comparison import (
    Blocks,
    block_sums,
    clipped_squares,
    weighted_sum_error,
)
from vgroove.gap.selection.search_state import COMPARISON, ClosedShare, Search
from vgroove.gap.verdict.covariates import Covariates


@dataclass(frozen=True)
class ConsistencyLimits:
    """Thresholds of the consistency of an effect (docs/spec/gap.md, section 5)."""

    max_scatter: float = 0.5  # standard deviation of the size between parts, as a share of the mean
    # largest factor between the mean of the sizes in parts and the size in all rows; chosen on the
    # tuning half of the blind set (docs/gap_bench.md)
    max_mean_factor: float = 2.0
    max_lost: float = 0.1  # squared gap that some parts lose, as a share of what the others gain
    # largest further gain of the flexible correction of the effect's subsystem, and of the effect
    # with a size that depends smoothly on a measured quantity, as shares of the effect's gain
    max_subsystem_gain: float = 0.35
    max_varying_gain: float = 0.35
    # share of what the set without an effect leaves, over all signals or in one, that the effect
    # must close where no division has two parts that show it
    min_closed_undivided: float = 0.9
    # least cosine of the angle between the derivative by the size and what the whole effect
    # changes; chosen on the tuning half of the blind set, regime `measured`
    min_tangent_cosine: float = 0.5
    # standard deviation of the size in a part, above which the part does not show the effect
    max_part_sigma: float = 1.0
    # a part contradicts the sign, or loses squared gap, from so many standard deviations on
    sign_sigmas: float = 2.0
    # largest part of the information on the size (sum of inverse variances), or of the squared gap
    # that the effect makes, in the parts that contradict the sign
    max_contradicting: float = 0.05
    time_parts: int = 4  # largest number of contiguous parts of all logs together
    knots: int = 5  # of the piecewise linear functions over a covariate
    ridge: float = 1e-4  # penalty of a regression, as a share of each column's sum of squares


LIMITS = ConsistencyLimits()
TINY = 1e-12  # keeps a ratio finite
# covariates over which the size of an effect may vary smoothly
VARYING_OVER = ("speed", "current", "motor angle", "time since start")


@dataclass(frozen=True)
class SizeRegression:
    """A regression of residuals on the size of an effect and on other numbers of its fit.

    columns (n, 1 + k): change of the residuals for an added size of 1, and the other numbers'
    columns of the Jacobian; value (1 + k,): where the fit ended (0 for the added size); prior
    (1 + k,): inverse variance of the priors, which are centred at 0, the rig's values; low, high
    (1 + k,): bounds.
    """

    columns: np.ndarray
    value: np.ndarray
    prior: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @classmethod
    def of(cls, best: Fit, slope: np.ndarray, others: Sequence[int]) -> "SizeRegression":
        """That of the size with the derivative slope (n,) and of the numbers of a fit at the
        indices `others` (k,).
        """
        index, h = np.asarray(others, dtype=int), best.hypothesis
        return cls(
            np.column_stack([slope, best.jacobian[:, index]]),
            np.concatenate([[0.0], best.x[index]]),
            np.concatenate([[0.0], h.prior[index]]),
            np.concatenate([[-np.inf], h.low[index]]),
            np.concatenate([[np.inf], h.high[index]]),
        )

    def step(self, residual: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Step (1 + k,) of all numbers within their bounds by the residuals (n,) in `rows`, and the
        inverse (1 + k, 1 + k) of the normal matrix, 0 for numbers that end at a bound.
        """
        columns = self.columns[rows]
        normal = columns.T @ columns + np.diag(self.prior + TINY)
        gradient = columns.T @ residual[rows] + self.prior * self.value
        low, high = self.low - self.value, self.high - self.value
        step = bounded_step(normal, gradient, low, high)
        free = np.flatnonzero((low < step) & (step < high))
        inverse = np.zeros_like(normal)
        inverse[np.ix_(free, free)] = np.linalg.pinv(normal[np.ix_(free, free)])
        return step, inverse


@dataclass(frozen=True)
class PartSizes:
    """Sizes (k,) of an effect in the parts that show it, with their standard deviations (k,) and
    the squared gap (k,) that the effect causes in each beside the nuisance parameters.
    """

    value: np.ndarray
    sigma: np.ndarray
    power: np.ndarray

    def scatter_by_information(self) -> tuple[float, float]:
        """Weighted mean of the sizes, and their random-effects standard deviation."""
        weight = self.sigma**-2.0
        mean = float(np.average(self.value, weights=weight))
        excess = float(np.sum(weight * (self.value - mean) ** 2)) - (len(self.value) - 1)
        divisor = float(weight.sum() - (weight**2).sum() / weight.sum())
        between = max(0.0, excess / max(divisor, TINY))
        return float(np.average(self.value, weights=1.0 / (self.sigma**2 + between))), float(
            np.sqrt(between)
        )

    def scatter_by_power(self) -> tuple[float, float]:
        """Weighted mean of the sizes, and the standard deviation between parts that the errors of
        the sizes do not explain. The weight of a part is the squared gap that the effect causes in
        it.
        """
        mean = float(np.average(self.value, weights=self.power))
        excess = (self.value - mean) ** 2 - self.sigma**2
        between = max(0.0, float(np.average(excess, weights=self.power)))
        return mean, float(np.sqrt(between))

    def is_constant(self) -> bool:
        """Whether the size is the same in all parts, if each part counts by the inverse variance of
        its size.
        """
        return self._is_constant(self.sigma**-2.0, *self.scatter_by_information())

    def is_constant_by_power(self) -> bool:
        """Whether the size is the same in all parts, if each part counts by the squared gap that
        the effect causes in it.
        """
        return self._is_constant(self.power, *self.scatter_by_power())

    def _is_constant(self, weight: np.ndarray, mean: float, between: float) -> bool:
        """Whether hardly any part contradicts the sign, the mean is that of all rows, 1, up to
        max_mean_factor, and the scatter is at most max_scatter times the mean.
        """
        contradicts = self.value + LIMITS.sign_sigmas * self.sigma < 0.0
        if not 1.0 <= mean * LIMITS.max_mean_factor <= LIMITS.max_mean_factor**2:
            return False
        if weight[contradicts].sum() > LIMITS.max_contradicting * weight.sum():
            return False
        return between <= LIMITS.max_scatter * mean


def is_leading(coordinate: Coordinate, effect_id: str) -> bool:
    """Whether a fitted number scales an effect: its leading parameter, or the amplitudes of its
    cosine and sine.
    """
    if not coordinate.name.startswith(f"effects.{effect_id}."):
        return False
    return coordinate.role != "plain" or (
        coordinate.name == BY_ID[effect_id].name(BY_ID[effect_id].leading)
    )


def sensitivity(best: Fit, effect_id: str) -> np.ndarray:
    """Change of the residuals (n,) for an added size of 1, which doubles the effect, to first
    order.
    """
    out = np.zeros(len(best.residual))
    for k, coordinate in enumerate(best.hypothesis.coordinates):
        if is_leading(coordinate, effect_id):
            out += best.jacobian[:, k] * best.x[k]
    return out


def size_response(search: Search, best: Fit, effect_id: str) -> np.ndarray:
    """Change of the residuals (n,) for an added size of 1: the derivative (sensitivity()), or,
    where this is not what the effect changes, the difference to the model without it (its secant).
    The derivative by the width of a backlash, for example, is large only where its contacts shift
    in time. A regression on it returns the size of all rows in every part, whatever the log.
    """
    tangent = sensitivity(best, effect_id)
    column = search.problem.index(BY_ID[effect_id].name(BY_ID[effect_id].leading))
    theta = best.theta(search.problem.theta0)
    theta[column] = search.problem.theta0[column]
    engine = search.engine
    without = engine.weighted(search.problem.residuals(theta[None, :], engine.angles)[0])
    secant = best.residual - without
    rows, first = search.blocks.tested, best.hypothesis.count
    both = np.column_stack([tangent, secant])[rows]
    slope, change = _beside(both, best.jacobian[rows, first:]).T
    least = LIMITS.min_tangent_cosine * np.linalg.norm(slope) * np.linalg.norm(change)
    return tangent if abs(slope @ change) >= least else secant


def _beside(columns: np.ndarray, nuisance: np.ndarray) -> np.ndarray:
    """What nuisance parameters (m, k) with priors of variance 1 leave of columns (m, c)."""
    normal = nuisance.T @ nuisance + np.eye(nuisance.shape[1])
    return columns - nuisance @ np.linalg.solve(normal, nuisance.T @ columns)


def partitions(search: Search) -> Iterator[np.ndarray]:
    """Divisions of the rows, as the number (n,) of each row's part: contiguous parts of time,
    regimes of motion, logs.
    """
    problem = search.problem
    blocks = problem.log * (int(problem.block.max()) + 1) + problem.block
    order = np.unique(blocks, return_inverse=True)[1]
    count = max(1, int(order.max()) + 1)
    yield (order * min(LIMITS.time_parts, count)) // count
    yield problem.regime
    yield problem.log


def part_sizes(search: Search, best: Fit, slope: np.ndarray, part: np.ndarray) -> PartSizes:
    """Sizes of an effect in those parts that show it. slope (n,): its size_response(); part: number
    (n,) of each row's part.
    """
    nuisance = range(best.hypothesis.count, len(best.x))
    regression = SizeRegression.of(best, slope, nuisance)
    residual, found = _clipped(best.residual), []
    for number in np.unique(part):
        rows = np.flatnonzero((part == number) & search.blocks.tested)
        found.append(_size_in_part(regression, residual, rows, search.blocks.cluster))
    value, sigma, power = np.array(found).T
    shown = sigma < LIMITS.max_part_sigma
    return PartSizes(value[shown], sigma[shown], power[shown])


def _size_in_part(
    regression: SizeRegression, residual: np.ndarray, rows: np.ndarray, cluster: np.ndarray
) -> tuple[float, float, float]:
    """Size of an effect in the rows (m,) of a part, its standard deviation by the sandwich over
    clusters (n,), at least that of white noise of the residual's power, and the squared gap that
    the effect makes there. residual (n,).
    """
    columns = regression.columns[rows]
    if columns[:, 0] @ columns[:, 0] <= 10.0 * TINY:
        return 0.0, np.inf, 0.0
    step, inverse = regression.step(residual, rows)
    left = residual[rows] + columns @ step
    score = columns * left[:, None]
    places = np.unique(cluster[rows], return_inverse=True)[1]
    sums = np.stack([np.bincount(places, weights=s) for s in score.T], axis=1)
    groups = len(sums)
    robust = inverse @ (sums.T @ sums) @ inverse * (groups / max(1, groups - 1))
    white = inverse * max(1.0, float(np.mean(left**2)))
    sigma = float(np.sqrt(max(robust[0, 0], white[0, 0])))
    return 1.0 + float(step[0]), sigma, 1.0 / float(inverse[0, 0])


def keeps_its_size(
    search: Search, best: Fit, effect_id: str, closed: ClosedShare, closed_reported: float = 0.0
) -> bool:
    """Whether the effect's size is the same in all parts of every division in which at least two
    parts show it. Without such a division the effect must close nearly all; closed_reported is the
    share that it closes of the reported gap.

    An effect that closes at least half of the gap may differ in a part in which it causes little of
    the gap: other model errors dominate there. If it closes half in one column of the log alone, it
    must also have the same size in the blocks of the bootstrap.
    """
    slope = size_response(search, best, effect_id)
    found = [part_sizes(search, best, slope, part) for part in partitions(search)]
    divided = [sizes for sizes in found if len(sizes.value) > 1]
    if not divided:
        return max(closed.largest, closed_reported) >= LIMITS.min_closed_undivided
    if all(sizes.is_constant() for sizes in divided):
        return True
    least = COMPARISON.min_gain_of_left
    if closed.largest < least or not all(sizes.is_constant_by_power() for sizes in divided):
        return False
    if closed.pooled >= least:
        return True
    blocks = part_sizes(search, best, slope, search.blocks.cluster)
    return len(blocks.value) > 1 and blocks.is_constant_by_power()


def significance(search: Search, effect_id: str) -> float:
    """Two-sided level at which an effect is significant: 99 %. Where its number of periods is
    fitted, the best one of many was selected: the probability of an error is divided by the count
    of those up to the largest start that the logs tell apart, one for each turn of the shaft
    (Bonferroni correction).
    """
    effect = BY_ID[effect_id]
    if effect.periodic is None or not effect.periodic.is_fitted:
        return COMPARISON.significance
    scales = search.engine.scales
    (periods,) = (p for p in effect.parameters if p.name == effect.periodic.periods)
    largest = min(periods.high(scales), max(periods.starts) * periods.size(scales))
    count = scales.turns * (largest - periods.low(scales))
    return 1.0 - (1.0 - COMPARISON.significance) / max(1.0, count)


def is_significant_size(search: Search, best: Fit, effect_id: str) -> bool:
    """Whether the size of an effect differs from 0 significantly: by the jackknife over the blocks
    of the bootstrap, or, where the effect acts in few blocks, by the correlated rows in which it
    acts.
    """
    tested = search.blocks.tested
    other = [k for k, c in enumerate(best.hypothesis.coordinates) if not is_leading(c, effect_id)]
    regression = SizeRegression.of(best, sensitivity(best, effect_id), other)
    columns = regression.columns * tested[:, None]
    if not columns[:, 0].any():
        return False
    residual = np.where(tested, _clipped(best.residual), 0.0)
    step, inverse = regression.step(residual, np.flatnonzero(tested))
    influence, left = columns @ inverse[:, 0], residual + columns @ step
    size, quantile = 1.0 + float(step[0]), 0.5 * (1.0 + significance(search, effect_id))
    return any(
        size > float(stdtrit(freedom, quantile)) * error
        for error, freedom in (
            _error_by_blocks(search.blocks, influence, left),
            weighted_sum_error(search.blocks, influence, left),
        )
    )


def _error_by_blocks(
    blocks: Blocks, influence: np.ndarray, left: np.ndarray
) -> tuple[float, float]:
    """Standard deviation of a size by the jackknife over blocks, and its degrees of freedom by
    their effective number (J. G. MacKinnon, M. O. Nielsen, M. D. Webb, Journal of Econometrics 232
    (2023) 272; A. V. Carter, K. T. Schnepel, D. G. Steigerwald, Review of Economics and Statistics
    99 (2017) 698). influence, left (n,): of each residual on the size, and what the fit leaves.
    """
    share = np.bincount(blocks.cluster, weights=influence**2)
    share /= share.sum()
    shift = np.bincount(blocks.cluster, weights=influence * left)
    error = float(np.sqrt(np.sum((shift / np.maximum(1.0 - share, TINY)) ** 2)))
    return error, max(1.0 / float(np.sum(share**2)) - 1.0, TINY)


def _clipped(residual: np.ndarray) -> np.ndarray:
    return np.clip(residual, -COMPARISON.clip_sigma, COMPARISON.clip_sigma)


def loses_little(search: Search, with_it: Fit, without: Fit) -> bool:
    """Whether the parts of time in which the effect clearly raises the squared gap lose at most a
    share of what the others gain. Clearly: by sign_sigmas of the scatter between the part's blocks.
    """
    part, tested = next(partitions(search)), search.blocks.tested
    gain = np.subtract(
        *(clipped_squares(f.out_of_fold, COMPARISON.clip_sigma) for f in (without, with_it))
    )
    sums, errors = zip(
        *(
            _sum_and_error(gain[rows], search.blocks.cluster[rows])
            for rows in (np.flatnonzero((part == k) & tested) for k in np.unique(part))
        ),
        strict=True,
    )
    total, error = np.array(sums), np.array(errors)
    lost = total[total + LIMITS.sign_sigmas * error < 0.0]
    return float(-lost.sum()) <= LIMITS.max_lost * float(total[total > 0.0].sum())


def _sum_and_error(values: np.ndarray, cluster: np.ndarray) -> tuple[float, float]:
    """Sum of values (m,) and its standard deviation from the scatter between clusters (m,); 0 where
    there is one cluster.
    """
    blocks = np.bincount(np.unique(cluster, return_inverse=True)[1], weights=values)
    error = np.sqrt(len(blocks)) * np.std(blocks, ddof=1) if len(blocks) > 1 else 0.0
    return float(blocks.sum()), float(error)


def subsystem_gain(search: Search, best: Fit, effect_id: str) -> float:
    """Further squared gap that the flexible correction of the effect's subsystem closes, held
    out.
    """
    columns = slopes_of_subsystem(search, best, BY_ID[effect_id].subsystem)
    return further_gain(search, best, np.hstack(columns)) if columns else 0.0


def varying_gain(search: Search, best: Fit, effect_id: str, covariates: Covariates) -> float:
    """Largest further squared gap, held out, of the effect with a size that depends smoothly on one
    covariate.
    """
    slope, gains = sensitivity(best, effect_id), [0.0]
    for name in VARYING_OVER:
        if name in covariates:
            columns = slope[:, None] * hat_functions(covariates[name])
            gains.append(further_gain(search, best, columns))
    return max(gains)


def hat_functions(value: np.ndarray) -> np.ndarray:
    """Piecewise linear functions (n, knots - 1) over the quantiles of a covariate (n,); with a
    constant they span all such functions. 0 where the covariate is unknown.
    """
    known = np.isfinite(value)
    knots = np.unique(np.quantile(value[known], np.linspace(0.0, 1.0, LIMITS.knots)))
    if len(knots) < 2:
        return np.zeros((len(value), 0))
    filled = np.where(known, value, knots[0])
    columns = [np.interp(filled, knots, row) for row in np.eye(len(knots))[1:]]
    return np.stack(columns, axis=1) * known[:, None]


def further_gain(search: Search, best: Fit, columns: np.ndarray) -> float:
    """Squared gap that further columns (n, m) close beside all numbers of a fit, held out, to first
    order.
    """
    power = np.sqrt((columns**2).mean(axis=0))
    used = power > TINY
    before = _held_out(search, best, columns[:, :0])
    after = _held_out(search, best, columns[:, used] / power[used])
    gain = block_sums(search.blocks, before).sum() - block_sums(search.blocks, after).sum()
    return float(gain) / search.blocks.total


def _held_out(search: Search, best: Fit, added: np.ndarray) -> np.ndarray:
    """Clipped squared residuals (n,) of each fold after a ridge regression on the other folds, on
    the numbers of a fit within their bounds and on added columns (n, m).
    """
    h, free = best.hypothesis, np.full(added.shape[1], np.inf)
    columns = np.hstack([best.jacobian, added])
    prior, value = (np.concatenate([x, 0.0 * added[0]]) for x in (h.prior, best.x))
    low, high = np.concatenate([h.low - best.x, -free]), np.concatenate([h.high - best.x, free])
    target = _clipped(best.residual)
    out = target.copy()
    for train, test in search.problem.folds:
        rows = columns[train]
        normal = rows.T @ rows
        normal[np.diag_indices_from(normal)] += LIMITS.ridge * np.diag(normal) + prior + TINY
        gradient = rows.T @ target[train] + prior * value
        out[test] += columns[test] @ bounded_step(normal, gradient, low, high)
    return clipped_squares(out, COMPARISON.clip_sigma)
