"""Weighs fits against one another on held-out rows: squared gaps per block, bootstrapped over
blocks because residuals are coloured.
"""

from dataclasses import dataclass

import numpy as np
from scipy.stats import norm, t

from vgroove.gap.fitting.fit import Fit

DRAWS = 2000
SHORTEST_S = 0.05
TINY = 1e-300
HOPELESS = 1e6  # an interval from one or two blocks says nothing


@dataclass(frozen=True)
class Blocks:
    """Blocks of rows: the block of each row, rows tested, how often each bootstrap draw takes each
    (DRAWS, blocks), random subsets.
    """

    cluster: np.ndarray
    tested: np.ndarray
    draws: np.ndarray
    subsets: np.ndarray
    rows: np.ndarray
    length_s: float

    @property
    def total(self) -> float:
        """Judged rows of all blocks."""
        return float(self.rows.sum())


def correlation_time(
    residual: np.ndarray, time_s: np.ndarray, group: np.ndarray, restart_s: float
) -> float:
    """Integrated autocorrelation time in s of the worst group (signal of a log), read from its
    first zero crossing on.
    """
    worst = 0.0
    for g in np.unique(group):
        rows = np.flatnonzero(group == g)
        r = residual[rows] - residual[rows].mean()
        if len(rows) < 50 or not r.any():
            continue
        spacing = (time_s[rows][-1] - time_s[rows][0]) / max(1, len(rows) - 1)
        lags = min(len(r) // 4, max(2, int(restart_s / max(spacing, 1e-9))))
        power = np.abs(np.fft.rfft(r, 2 * len(r))) ** 2
        rho = np.fft.irfft(power)[:lags] / np.dot(r, r)
        below = np.flatnonzero(rho < 0.05)
        end = int(below[0]) if below.size else lags
        worst = max(worst, spacing * (1.0 + 2.0 * float(rho[1:end].sum())))
    return worst


def make_blocks(
    log: np.ndarray,
    time_s: np.ndarray,
    tested: np.ndarray,
    length_s: float,
    seed: int,
    conditional: np.ndarray,
    draws: int = DRAWS,
) -> Blocks:
    """Cut the tested rows into blocks of length_s and draw bootstrap samples of them; conditional
    rows may cost, but are no samples.
    """
    number = np.floor(time_s / length_s).astype(int)
    keys = log.astype(np.int64) * (int(number.max()) + 2) + number
    _, cluster = np.unique(keys, return_inverse=True)
    rows = np.bincount(cluster, weights=(tested & ~conditional).astype(float))
    used = np.flatnonzero(rows)
    counts = np.zeros((draws, len(rows)))
    rng = np.random.default_rng(seed)
    counts[:, used] = rng.multinomial(len(used), np.full(len(used), 1.0 / len(used)), size=draws)
    subsets = np.zeros((draws, len(rows)))
    subsets[:, used] = rng.random((draws, len(used))) < 0.5
    subsets[np.ix_(~subsets.any(axis=1), used)] = 1.0
    return Blocks(cluster, tested, counts, subsets, rows, length_s)


def block_sums(blocks: Blocks, squared: np.ndarray) -> np.ndarray:
    """Sum of squared residuals (n,) over the tested rows of each block (blocks,)."""
    return np.bincount(
        blocks.cluster, weights=np.where(blocks.tested, squared, 0.0), minlength=len(blocks.rows)
    )


def draw_means(blocks: Blocks, sums: np.ndarray) -> np.ndarray:
    """Mean square of each draw (DRAWS,) of per-block sums."""
    return blocks.draws @ sums / (blocks.draws @ blocks.rows)


def interval(blocks: Blocks, difference: np.ndarray, level: float = 0.95) -> tuple[float, float]:
    """Interval of a difference of squared gaps given per-block sums: where both hold, that of the
    bootstrap, widened where there are few blocks, and that of subsets.
    """
    means = draw_means(blocks, difference)
    low, high = np.quantile(means, [(1.0 - level) / 2.0, (1.0 + level) / 2.0])
    middle, wider = (
        difference.sum() / blocks.total,
        few_blocks(int(np.count_nonzero(blocks.rows)), level),
    )
    least, most = typical_interval(blocks, difference, level)
    return max(float(middle + wider * (low - middle)), least), min(
        float(middle + wider * (high - middle)), most
    )


def least_loss(blocks: Blocks, worse: np.ndarray, better: np.ndarray, level: float = 0.95) -> float:
    """Lower end of the interval of the difference of two squared gaps on the run as it was, given
    held-out residuals (n,).

    Where and by how much two models differ is the run's doing; chance is only in what the better
    one leaves there, alike over a block's rows. Student's t for as many degrees of freedom as
    blocks matter (Satterthwaite 1946); no less scatter than white noise has.
    """
    apart, left = np.where(blocks.tested, worse - better, 0.0), np.where(blocks.tested, better, 0.0)
    chance = 2.0 * np.bincount(blocks.cluster, weights=apart * left, minlength=len(blocks.rows))
    power, distance = chance**2, float(apart @ apart)
    freedom = max(1.0, float(power.sum() ** 2 / max(float((power**2).sum()), TINY)))
    white = 4.0 * distance * float(left @ left) / blocks.total
    scatter = np.sqrt(max(float(power.sum()), white))
    return (
        float(distance + chance.sum() - t.ppf(0.5 * (1.0 + level), freedom) * scatter)
        / blocks.total
    )


def typical_interval(blocks: Blocks, difference: np.ndarray, level: float) -> tuple[float, float]:
    """Interval from means over random subsets of the blocks, exact for any symmetric law of a
    block's difference (Hartigan 1969, typical values). Student's t takes a few large gains among
    many small ones of the same sign for scatter; subsets see that all agree.
    """
    count = int(np.count_nonzero(blocks.rows))
    if 0.5**count > (1.0 - level) / 2.0:
        return -HOPELESS, HOPELESS
    means = blocks.subsets @ difference / (blocks.subsets @ blocks.rows)
    low, high = np.quantile(means, [(1.0 - level) / 2.0, (1.0 + level) / 2.0])
    return float(low), float(high)


def few_blocks(count: int, level: float) -> float:
    """How much wider a bootstrap interval over `count` blocks must be: Student's t for the normal
    quantile, n - 1 for n in the variance.
    """
    if count < 3:
        return HOPELESS
    quantile = 0.5 * (1.0 + level)
    return float(t.ppf(quantile, count - 1) / norm.ppf(quantile) * np.sqrt(count / (count - 1.0)))


def squared(one: Fit, clip: float) -> np.ndarray:
    """Clipped squares of the held-out residuals (n,)."""
    return np.minimum(np.abs(one.held), clip) ** 2
