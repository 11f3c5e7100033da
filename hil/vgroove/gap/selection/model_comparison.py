"""Compares fits on held-out rows: sums of squared residuals per block of time, and confidence
intervals of their differences from the block bootstrap.

Residuals of a dynamic model are correlated in time. Therefore whole blocks of rows are resampled,
not rows: the block bootstrap (H. R. Kuensch, Annals of Statistics 17, 1989) with non-overlapping
blocks (E. Carlstein, Annals of Statistics 14, 1986).
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.special import ndtri, stdtrit

from vgroove.gap.fitting.whitening import autocovariance


@dataclass(frozen=True)
class BootstrapLimits:
    """Numbers of the block bootstrap; chosen on the tuning half of the blind set
    (docs/gap_bench.md) where no other origin is stated.
    """

    draws: int = 2000  # bootstrap samples: 10 of them lie above the 99.5 % quantile
    min_block_s: float = 0.05  # shortest block, s: 50 rows of a 1 kHz log
    min_rows: int = 50  # rows of a signal from which a correlation time is estimated
    uncorrelated: float = 0.05  # autocorrelation below which rows are taken as independent
    min_count: int = 3  # blocks below which a bootstrap variance is not used
    window_times: float = 3.0  # window of a sum of correlated rows, in correlation times
    max_lag_share: float = 0.25  # longest lag of an autocorrelation, as a share of a series
    unbounded: float = 1e6  # bound of an interval that too few blocks leave open, squared gap


BOOTSTRAP = BootstrapLimits()
MIN_POWER = 1e-300  # avoids 0 / 0 where two fits leave equal residuals


class TimedRows(Protocol):
    """Rows of residuals (n,): log index, signal index, time in s, and whether the sample is
    censored, an upper bound of a speed. The residual of a censored sample is 0 where the model
    respects the bound, and the row then does not count (docs/spec/gap.md, section 5).
    """

    log: np.ndarray
    signal: np.ndarray
    time_s: np.ndarray
    censored: np.ndarray


@dataclass(frozen=True)
class Blocks:
    """Blocks of rows for the bootstrap.

    cluster (n,): block of each row; series: rows of each signal of each log in the order of time;
    tested (n,): rows that count; draws (draws, blocks): how often each bootstrap sample takes each
    block; subsets (draws, blocks): random halves of the blocks, 0 or 1; rows (blocks,): rows of
    each block that count as samples; length_s: length in s.
    """

    cluster: np.ndarray
    series: tuple[np.ndarray, ...]
    tested: np.ndarray
    draws: np.ndarray
    subsets: np.ndarray
    rows: np.ndarray
    length_s: float

    @property
    def total(self) -> float:
        """Rows of all blocks that count as samples."""
        return float(self.rows.sum())

    @property
    def count(self) -> int:
        """Blocks that hold samples."""
        return int(np.count_nonzero(self.rows))


def correlation_time(
    residual: np.ndarray, time_s: np.ndarray, group: np.ndarray, restart_s: float
) -> float:
    """Longest integrated autocorrelation time in s over the groups (signals of a log).

    residual, time_s, group: (n,). The autocorrelation is summed up to the first lag at which it
    vanishes, at most over the time restart_s between two restarts of the model.
    """
    longest = 0.0
    for g in np.unique(group):
        rows = np.flatnonzero(group == g)
        r = residual[rows] - residual[rows].mean()
        if len(rows) < BOOTSTRAP.min_rows or not r.any():
            continue
        spacing = (time_s[rows][-1] - time_s[rows][0]) / max(1, len(rows) - 1)
        lags = min(len(r) // 4, max(2, int(restart_s / max(spacing, 1e-9))))
        longest = max(longest, spacing * correlated_rows(autocorrelation(r, lags)))
    return longest


def autocorrelation(value: np.ndarray, lags: int) -> np.ndarray:
    """Autocorrelation of a series about 0, from lag 0 to the first lag at which it vanishes, at
    most `lags` of them; of a series of zeros one value, 0.
    """
    covariance = autocovariance(value, max(1, lags))
    rho = covariance / max(float(covariance[0]), MIN_POWER)
    below = np.flatnonzero(rho < BOOTSTRAP.uncorrelated)
    return rho[: max(1, int(below[0])) if below.size else len(rho)]


def correlated_rows(rho: np.ndarray) -> float:
    """Correlation time in rows of an autocorrelation, integrated over both signs of the lag."""
    return 1.0 + 2.0 * float(rho[1:].sum())


def make_blocks(rows: TimedRows, tested: np.ndarray, length_s: float, seed: int) -> Blocks:
    """Cut the tested rows (n,) into blocks of length_s and draw bootstrap samples of the blocks.

    Censored rows add to the squared residuals of their block but are not counted as samples.
    """
    number = np.floor(rows.time_s / length_s).astype(np.int64)
    number -= number.min()  # times before a trigger are negative
    keys = rows.log.astype(np.int64) * (int(number.max()) + 1) + number
    _, cluster = np.unique(keys, return_inverse=True)
    samples = np.bincount(cluster, weights=(tested & ~rows.censored).astype(float))
    used = np.flatnonzero(samples)
    draws = np.zeros((BOOTSTRAP.draws, len(samples)))
    rng = np.random.default_rng(seed)
    draws[:, used] = rng.multinomial(
        len(used), np.full(len(used), 1.0 / len(used)), size=BOOTSTRAP.draws
    )
    subsets = np.zeros((BOOTSTRAP.draws, len(samples)))
    subsets[:, used] = rng.random((BOOTSTRAP.draws, len(used))) < 0.5
    subsets[np.ix_(~subsets.any(axis=1), used)] = 1.0
    return Blocks(cluster, series_of(rows), tested, draws, subsets, samples, length_s)


def series_of(rows: TimedRows) -> tuple[np.ndarray, ...]:
    """Rows of each signal of each log, in the order of time."""
    number = rows.log.astype(np.int64) * (int(rows.signal.max(initial=0)) + 1) + rows.signal
    order = np.lexsort((rows.time_s, number))
    return tuple(np.split(order, np.flatnonzero(np.diff(number[order])) + 1))


def block_sums(blocks: Blocks, squared: np.ndarray) -> np.ndarray:
    """Sum of squared residuals (n,) over the tested rows of each block (blocks,)."""
    return np.bincount(
        blocks.cluster, weights=np.where(blocks.tested, squared, 0.0), minlength=len(blocks.rows)
    )


def bootstrap_means(blocks: Blocks, sums: np.ndarray) -> np.ndarray:
    """Mean square (draws,) of each bootstrap sample, from sums per block (blocks,)."""
    return blocks.draws @ sums / (blocks.draws @ blocks.rows)


def difference_interval(
    blocks: Blocks, difference: np.ndarray, level: float = 0.95
) -> tuple[float, float]:
    """Confidence interval of a difference of squared gaps from its sums per block (blocks,).

    It is the intersection of the bootstrap's percentile interval, widened by
    small_sample_factor(), and of the interval of typical values.
    """
    means = bootstrap_means(blocks, difference)
    low, high = np.quantile(means, [(1.0 - level) / 2.0, (1.0 + level) / 2.0])
    middle, wider = difference.sum() / blocks.total, small_sample_factor(blocks.count, level)
    least, most = typical_value_interval(blocks, difference, level)
    return max(float(middle + wider * (low - middle)), least), min(
        float(middle + wider * (high - middle)), most
    )


def fixed_design_bound(
    blocks: Blocks, worse: np.ndarray, better: np.ndarray, level: float = 0.95
) -> float:
    """Lower confidence bound of the difference of two squared gaps for the run as it was.

    worse, better: held-out residuals (n,). The difference of the two models is taken as fixed by
    the run (fixed design); only the residual of the better model is random, and correlated within a
    block. The bound uses Student's t with the effective degrees of freedom of the blocks (F. E.
    Satterthwaite, Biometrics Bulletin 2, 1946) and at least the variance of white noise.
    """
    apart, left = np.where(blocks.tested, worse - better, 0.0), np.where(blocks.tested, better, 0.0)
    chance = 2.0 * np.bincount(blocks.cluster, weights=apart * left, minlength=len(blocks.rows))
    power, distance = chance**2, float(apart @ apart)
    freedom = max(1.0, float(power.sum() ** 2 / max(float((power**2).sum()), MIN_POWER)))
    white = 4.0 * distance * float(left @ left) / blocks.total
    scatter = np.sqrt(max(float(power.sum()), white))
    return (
        float(distance + chance.sum() - stdtrit(freedom, 0.5 * (1.0 + level)) * scatter)
        / blocks.total
    )


def weighted_sum_error(
    blocks: Blocks, weight: np.ndarray, residual: np.ndarray
) -> tuple[float, float]:
    """Standard deviation of the sum of residuals (n,) with fixed weights (n,), and its degrees of
    freedom, those of all variances together (F. E. Satterthwaite, Biometrics Bulletin 2, 1946).

    The residuals of a series are correlated in time. Its rows are counted, not its blocks: an
    effect that acts in one transient is thus measured by the correlation times that the transient
    lasts. Two variances are added for each series: one that holds where the power of the residual
    differs from row to row, and one that estimates the correlation from all rows.
    """
    parts = [
        f(weight[rows], residual[rows])
        for rows in blocks.series
        for f in (changing_variance, stationary_variance)
    ]
    power, freedom = np.array(parts).T
    together = float(power.sum() ** 2 / max(float(np.sum(power**2 / freedom)), MIN_POWER))
    return float(np.sqrt(power.sum())), max(1.0, together)


def changing_variance(weight: np.ndarray, residual: np.ndarray) -> tuple[float, float]:
    """Variance of the weighted sum of the residuals (m,) of a series whose power differs from row
    to row, and its degrees of freedom: the effective number of rows that have weight, per
    correlation time, less one.

    It is the mean square of the sums over all windows of a few correlation times (W. K. Newey and
    K. D. West, Econometrica 55, 1987, 703).
    """
    product, square = weight * residual, weight**2
    own = float(product @ product)
    if own <= MIN_POWER:
        return 0.0, 1.0
    correlated = correlated_rows(autocorrelation(product * np.sign(weight), longest_lag(product)))
    window = int(np.ceil(BOOTSTRAP.window_times * correlated))
    padded = np.concatenate([np.zeros(window), np.cumsum(product), np.full(window, product.sum())])
    sums = padded[window:] - padded[:-window]
    rows = float(square.sum()) ** 2 / max(float(square @ square), MIN_POWER)
    return max(own, float(sums @ sums) / window), max(1.0, rows / correlated - 1.0)


def stationary_variance(weight: np.ndarray, residual: np.ndarray) -> tuple[float, float]:
    """Variance of the weighted sum of the residuals (m,) of a stationary series, from their
    autocorrelation, and its degrees of freedom: the rows per correlation time, less one. The power
    is at least that of unit noise.
    """
    rho = autocorrelation(residual, longest_lag(residual))
    covariance = autocovariance(weight, len(rho))
    weights = max(2.0 * float(covariance @ rho) - covariance[0], covariance[0])
    power = max(1.0, float(np.mean(residual**2)))
    return power * weights, max(1.0, len(residual) / correlated_rows(rho) - 1.0)


def longest_lag(value: np.ndarray) -> int:
    """Longest lag of the autocorrelation of a series, in rows."""
    return max(1, int(BOOTSTRAP.max_lag_share * len(value)))


def typical_value_interval(
    blocks: Blocks, difference: np.ndarray, level: float
) -> tuple[float, float]:
    """Confidence interval from means over random subsets of the blocks, from sums (blocks,).

    It is exact for any symmetric distribution of a block's difference (J. A. Hartigan, JASA 64,
    1969, typical values). A few large gains among many small ones of equal sign widen an interval
    by Student's t until it contains 0; an interval of subset means stays on one side of 0.
    """
    if 0.5**blocks.count > (1.0 - level) / 2.0:
        return -BOOTSTRAP.unbounded, BOOTSTRAP.unbounded
    means = blocks.subsets @ difference / (blocks.subsets @ blocks.rows)
    low, high = np.quantile(means, [(1.0 - level) / 2.0, (1.0 + level) / 2.0])
    return float(low), float(high)


def small_sample_factor(count: int, level: float) -> float:
    """Factor on the width of a bootstrap interval over `count` blocks: Student's t for the normal
    quantile, and n - 1 for n in the variance.
    """
    if count < BOOTSTRAP.min_count:
        return BOOTSTRAP.unbounded
    quantile = 0.5 * (1.0 + level)
    return float(stdtrit(count - 1, quantile) / ndtri(quantile) * np.sqrt(count / (count - 1.0)))


def clipped_squares(residual: np.ndarray, clip_sigma: float) -> np.ndarray:
    """Squares of residuals (n,), each residual clipped at clip_sigma."""
    return np.minimum(np.abs(residual), clip_sigma) ** 2
