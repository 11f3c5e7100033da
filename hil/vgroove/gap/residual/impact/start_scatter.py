"""How the statistics of a hammering log scatter over the start angle of the hammer: a part that
many statistics share, since one start moves a whole trajectory, and a part of each alone.
"""

from dataclasses import dataclass

import numpy as np

from vgroove.gap.residual.immutable import freeze_arrays


@dataclass(frozen=True)
class StartScatter:
    """Standard deviations (n,) of the statistics apart, and responses (n, M) of all statistics to
    one standard deviation of each of M independent causes.
    """

    apart: np.ndarray
    shared: np.ndarray

    def __post_init__(self) -> None:
        freeze_arrays(self)

    @classmethod
    def of(cls, statistics: np.ndarray) -> "StartScatter":
        """That of statistics (M, n) over M start angles: their covariance with the correlations
        shrunk by the share that sampling alone gives, so that M may be far below n.
        """
        deviation = np.nan_to_num(statistics - statistics.mean(axis=0))
        size = deviation.std(axis=0, ddof=1)
        unit = deviation[:, size > 0.0] / size[size > 0.0]
        share = shrinkage(unit)
        responses = np.sqrt((1.0 - share) / (len(statistics) - 1)) * deviation.T
        return cls(np.sqrt(share) * size, responses)


def shrinkage(unit: np.ndarray) -> float:
    """Share by which the correlations of samples (M, n) of mean 0 and variance 1 are shrunk: the
    sum of their sampling variances over that of their squares (J. Schaefer, K. Strimmer, Stat.
    Appl. Genet. Mol. Biol. 4 (2005) 32). 1 for fewer than two statistics.
    """
    count, n = unit.shape
    if n < 2:
        return 1.0
    product = unit.T @ unit
    scatter = (unit**2).T @ unit**2 - product**2 / count
    apart = ~np.eye(n, dtype=bool)
    variance = count / (count - 1.0) ** 3 * scatter[apart].sum()
    squares = np.sum((product[apart] / (count - 1.0)) ** 2)
    return float(np.clip(variance / max(squares, np.finfo(float).tiny), 0.0, 1.0))
