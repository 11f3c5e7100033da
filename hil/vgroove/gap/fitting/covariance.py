"""Confidence intervals of fitted numbers: sandwich covariance with clustered rows, and the
jackknife over folds.

Sources: White, Econometrica 48 (1980) 817 (sandwich); Liang and Zeger, Biometrika 73 (1986) 13
(clusters); Efron and Tibshirani, An Introduction to the Bootstrap, 1993, chapter 11 (jackknife);
Satterthwaite, Biometrics Bulletin 2 (1946) 110 (degrees of freedom of a sum of variances).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtri, ndtri, stdtrit

from vgroove.gap.fitting.engine import Engine
from vgroove.gap.fitting.hypothesis import Fit
from vgroove.gap.residual.huber import huber_weight

UPPER_QUANTILE = 0.975  # of a two-sided 95 % interval
MIN_JACKKNIFE_FOLDS = 3  # fewer estimates do not determine their scatter
# limits of a share and of degrees of freedom that keep a quantile of Student's t finite
MIN_SHARE, MAX_FREEDOM = 1e-6, 1e6


@dataclass(frozen=True)
class Covariance:
    """Covariance (p, p) of fitted numbers. scattered: the part that is estimated from a scatter;
    freedom: the degrees of freedom of that estimate; known: the part of the stated priors of the
    nuisance parameters.
    """

    scattered: np.ndarray
    known: np.ndarray
    freedom: int

    @property
    def total(self) -> np.ndarray:
        """Covariance (p, p) of the numbers."""
        return self.scattered + self.known

    @property
    def half_widths(self) -> np.ndarray:
        """Half widths (p,) of the 95 % intervals of the numbers."""
        freedom = np.array([self.freedom_of([k]) for k in range(len(self.total))])
        return np.sqrt(np.maximum(np.diag(self.total), 0.0)) * stdtrit(freedom, UPPER_QUANTILE)

    def freedom_of(self, places: Sequence[int]) -> float:
        """Effective degrees of freedom of the covariance of the numbers at these places, by the
        Welch-Satterthwaite equation: the known part of the variance has no uncertainty of its own.
        Of all directions the one in which the scattered part has the largest share decides; numbers
        without any variance do not count.
        """
        size = np.sqrt(np.maximum(np.diag(self.total)[list(places)], 0.0))
        vary = [place for place, one in zip(places, size, strict=True) if one > 0.0]
        if not vary:
            return float(self.freedom)
        at, size = np.ix_(vary, vary), size[size > 0.0]
        total, scattered = (
            part[at] / size[:, None] / size[None, :] for part in (self.total, self.scattered)
        )
        share = float(np.max(np.linalg.eigvals(np.linalg.pinv(total) @ scattered).real))
        return min(self.freedom / max(share, MIN_SHARE) ** 2, MAX_FREEDOM)


def sandwich_covariance(one: Fit, mask: np.ndarray, cluster: np.ndarray) -> Covariance:
    """Sandwich covariance of the fitted numbers from the rows that a mask (n,) selects. Rows with
    the same number in `cluster` (n,) may be correlated with one another in any way.
    """
    weighted = one.jacobian * (huber_weight(one.residual, one.delta) * mask)[:, None]
    prior = np.diag(one.hypothesis.prior)
    bread = np.linalg.pinv(weighted.T @ one.jacobian + prior)
    score = weighted * one.residual[:, None]
    sums = np.stack(
        [np.bincount(cluster, weights=score[:, j]) for j in range(score.shape[1])], axis=1
    )
    count = len(np.unique(cluster[mask]))
    groups = max(2, count)
    meat = sums.T @ sums * groups / (groups - 1)
    return Covariance(bread @ meat @ bread, bread @ prior @ bread, max(1, count - 1))


def interval_half_widths(engine: Engine, one: Fit, clusters: Sequence[np.ndarray]) -> np.ndarray:
    """Half widths (p,) of 95 % intervals of the fitted numbers: the widest of the intervals by the
    sandwich over each clustering (n,) of the rows, and by the jackknife over the folds.

    Intervals from white noise alone are too narrow: a model of a slightly different functional form
    errs in the same direction over whole strokes. The scatter over long clusters and between folds
    includes that. Both use Student's t for their few degrees of freedom.
    """
    widths = [covariance.half_widths for covariance in _covariances(engine, one, clusters)]
    return np.max([np.zeros(len(one.x)), *widths], axis=0)


def region_excludes_zero(
    engine: Engine, one: Fit, clusters: Sequence[np.ndarray], *groups: Sequence[int]
) -> bool:
    """Whether the joint 95 % confidence region of at least one group of fitted numbers, given by
    their places in x (p,), excludes 0 with each of the covariances of interval_half_widths().

    Of one number the region is its interval. Of numbers that the rows determine together only, such
    as two resistances of a battery with a long time constant, each interval may contain 0 although
    the region does not. Hotelling's T^2 (T. W. Anderson, An Introduction to Multivariate
    Statistical Analysis, 2003, chapter 5).
    """
    covariances = _covariances(engine, one, clusters)
    return any(
        all(
            _t_squared(one.x[list(group)], covariance.total[np.ix_(group, group)])
            > _hotelling_quantile(len(group), covariance.freedom_of(group))
            for covariance in covariances
        )
        for group in groups
    )


def _covariances(engine: Engine, one: Fit, clusters: Sequence[np.ndarray]) -> list[Covariance]:
    """Covariances of the fitted numbers: the sandwich over each clustering (n,) of the rows, and
    the jackknife where there are folds enough.
    """
    found = [sandwich_covariance(one, engine.train, cluster) for cluster in clusters]
    steps = engine.steps_without(one)
    if len(steps) >= MIN_JACKKNIFE_FOLDS:
        scattered = _jackknife_covariance(steps)
        found.append(Covariance(scattered, np.zeros_like(scattered), len(steps) - 1))
    return found


def _t_squared(x: np.ndarray, covariance: np.ndarray) -> float:
    """Hotelling's T^2 of numbers x (k,) with a covariance (k, k). A number without any variance,
    such as one that every fold leaves at its physical limit, makes it very large.
    """
    variance, directions = np.linalg.eigh(covariance)
    least = np.finfo(float).eps * max(float(x @ x), np.finfo(float).tiny)
    return float(np.sum((directions.T @ x) ** 2 / np.maximum(variance, least)))


def _hotelling_quantile(dimension: int, freedom: float) -> float:
    """95 % quantile of T^2; infinite where the covariance has too few degrees of freedom."""
    rest = freedom - dimension + 1
    if rest < 1:
        return np.inf
    scale = dimension * freedom / rest
    return scale * float(fdtri(dimension, rest, 2.0 * UPPER_QUANTILE - 1.0))


def white_noise_half_widths(engine: Engine, one: Fit) -> np.ndarray:
    """Half widths (p,) of 95 % intervals of the fitted numbers if the residuals were white noise of
    unit power; infinite for a number that the rows do not determine.
    """
    rows = one.jacobian[engine.train]
    normal = rows.T @ rows + np.diag(one.hypothesis.prior)
    values, vectors = np.linalg.eigh(normal)
    with np.errstate(divide="ignore"):
        variance = (vectors**2 / np.maximum(values, 0.0)).sum(axis=1)
    return ndtri(UPPER_QUANTILE) * np.sqrt(variance)


def _jackknife_covariance(steps: np.ndarray) -> np.ndarray:
    """Jackknife covariance (p, p) of the fitted numbers. steps (folds, p): difference of the
    estimate without each fold and the estimate from all rows.
    """
    apart = steps - steps.mean(axis=0)
    return (len(steps) - 1) / len(steps) * apart.T @ apart
