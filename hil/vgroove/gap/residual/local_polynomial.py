"""Value and derivatives of a noisy signal at an instant by local polynomial regression: a robust
quadratic through the observations on both sides, which adds no delay.

Methods: Fan and Gijbels, Local Polynomial Modelling and Its Applications, 1996 (on even rows a
Savitzky-Golay filter, Analytical Chemistry 36 (1964) 1627); the width is chosen by the smallest
uncertainty. Robust weights: Huber 1964.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from vgroove.gap.residual.immutable import freeze_arrays

NEIGHBOURS = (4, 8, 16)  # observations on each side of an instant that a quadratic may go through
DEGREE = 2


@dataclass(frozen=True)
class LocalFitRules:
    """What a local quadratic is fitted to, and when it is trusted; chosen on the tuning half of the
    blind set (docs/gap_bench.md).
    """

    # observations further from an instant are not used: s, or rows of a slow logger
    max_distance_s: float = 0.06
    max_distance_rows: float = 4.5  # the narrowest quadratic goes through NEIGHBOURS[0] rows
    # uncertainty of a value, in sigmas of its sensor, up to which a model may restart from it
    max_sigmas: float = 2.5
    # a quadratic is adequate while the mean square of its residuals lies within so many of its
    # standard deviations above that of noise
    max_lack_of_fit: float = 1.0
    typical_quantile: float = 0.9  # of the observations' sigmas: sigma of a usual observation
    rounds: int = 3  # of iterative reweighting
    huber_sigmas: float = 3.0  # threshold of Huber's weights, in standard deviations of residuals
    spread_factor: float = 1.5  # standard deviation / median absolute residual (1.4826, rounded)
    # penalty for a slope, in s: of two instants of equal uncertainty that of lower slope is taken
    slope_penalty_s: float = 2e-4
    # observations of each pitch of the turn below which no pattern of the turn is fitted
    min_of_each_pitch: int = 2


LOCAL_FIT = LocalFitRules()
MIN_RESIDUAL = 1e-12  # keeps a weight finite
MIN_SQUARE = 1e-300  # keeps a ratio finite


@dataclass(frozen=True)
class KnownForce:
    """Acceleration by a known force: rates (rows,) in rad/s^2 over the intervals that end at time_s
    (rows,). Speed and angle follow from it up to a constant.
    """

    time_s: np.ndarray
    rate: np.ndarray

    @cached_property
    def _sums(self) -> tuple[np.ndarray, np.ndarray]:
        """Speed and angle (rows,) gained by each row."""
        step = np.diff(self.time_s, prepend=self.time_s[0])
        speed = np.cumsum(self.rate * step)
        return speed, np.cumsum((speed - 0.5 * self.rate * step) * step)

    def at(self, instants_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Speed and angle (m,) at instants (m,)."""
        row = np.clip(np.searchsorted(self.time_s, instants_s), 1, len(self.time_s) - 1)
        (speed, angle), before = self._sums, self.time_s[row] - instants_s
        mean = speed[row] - 0.5 * self.rate[row] * before
        return speed[row] - self.rate[row] * before, angle[row] - mean * before

    def means(self, start_s: np.ndarray, end_s: np.ndarray) -> np.ndarray:
        """Mean speeds (m,) over spans; over a span of length 0 the speed at that instant."""
        (speed, first), (_, last), length = self.at(start_s), self.at(end_s), end_s - start_s
        return np.where(length > 0.0, (last - first) / np.where(length > 0.0, length, 1.0), speed)


@dataclass(frozen=True)
class Observations:
    """A signal's means over spans [start_s, end_s] (m,) in order of time, with standard deviations;
    start = end: an instant.
    """

    start_s: np.ndarray
    end_s: np.ndarray
    value: np.ndarray
    sigma: np.ndarray
    known_force: KnownForce | None = None  # its part of the signal is subtracted before a fit
    pitch: np.ndarray | None = None  # (m,) number of the pitch of the turn that each span is
    pitches_per_rev: int = 1
    interval_s: float = 0.0  # between the rows of the log; 0: unknown

    @property
    def max_distance_s(self) -> float:
        """Distance in s from an instant up to which observations are used."""
        return max(LOCAL_FIT.max_distance_s, LOCAL_FIT.max_distance_rows * self.interval_s)

    def turn_pattern(self, part: slice) -> np.ndarray:
        """Regressors (part, pitches - 1) of a pattern that repeats every turn and has mean 0, as a
        share of the value.
        """
        which = np.equal(self.pitch[part, None], np.arange(self.pitches_per_rev)).astype(float)
        relative = (self.value[part] / np.mean(self.value[part]))[:, None]
        return (which[:, :-1] - which[:, -1:]) * relative

    def force_means(self, time_s: float, part: slice) -> np.ndarray:
        """What the known force adds to a part of the values from an instant on; zeros without a
        known force.
        """
        if self.known_force is None:
            return np.zeros(len(self.value[part]))
        means = self.known_force.means(self.start_s[part], self.end_s[part])
        return means - self.known_force.at(np.array([time_s]))[0]

    @cached_property
    def typical_sigma(self) -> float:
        """90 % quantile of the spans' sigmas: the unit of a state's uncertainty where the spans
        around the state are noisier than this.
        """
        return float(np.quantile(self.sigma, LOCAL_FIT.typical_quantile))


@dataclass(frozen=True)
class Smoothing:
    """What a fitted value was computed from: spans (k,) in s from its instant, and the weight of
    each span's mean in the value.
    """

    start_s: np.ndarray
    end_s: np.ndarray
    weight: np.ndarray

    def __post_init__(self) -> None:
        freeze_arrays(self)


NOT_SMOOTHED = Smoothing(np.zeros(0), np.zeros(0), np.zeros(0))


@dataclass(frozen=True)
class LocalFit:
    """A signal at an instant: value, first and second derivative (slope, curvature). sigmas: the
    standard deviation of the value, lack of fit included, and slope_penalty, both in sigmas of the
    sensor. adequate: whether the residuals of the quadratic are no more than noise. smoothing: what
    the value was computed from. value_sigma, slope_sigma: standard deviations of value and slope,
    lack of fit included.
    """

    value: float
    slope: float
    curvature: float
    sigmas: float
    slope_penalty: float
    adequate: bool = True
    slope_sigma: float = np.inf
    value_sigma: float = np.inf
    smoothing: Smoothing = field(default=NOT_SMOOTHED, compare=False)


NO_FIT = LocalFit(0.0, 0.0, 0.0, np.inf, np.inf, False)


def local_fit(seen: Observations, time_s: float) -> LocalFit:
    """Value of a signal at an instant from the quadratic through the observations around it of the
    smallest uncertainty: through few of them where the motion bends, through many where noise
    dominates; the derivatives from that of the smallest uncertainty of the slope. Where none can be
    trusted a pattern that repeats every turn is fitted as well.
    """
    middle = int(np.searchsorted(0.5 * (seen.start_s + seen.end_s), time_s))
    narrow, *wider = (quadratic(seen, time_s, middle, count) for count in NEIGHBOURS)
    best = min((narrow, *_adequate(wider)), key=lambda found: found.sigmas)
    rates = min((narrow, *wider), key=lambda found: found.slope_sigma)
    best = replace(
        best, slope=rates.slope, curvature=rates.curvature, slope_sigma=rates.slope_sigma
    )
    if best.sigmas < LOCAL_FIT.max_sigmas or seen.pitch is None:
        return best
    with_pattern = (
        quadratic(seen, time_s, middle, count, True)
        for count in NEIGHBOURS
        if count >= seen.pitches_per_rev + DEGREE
    )
    return min((best, *_adequate(with_pattern)), key=lambda found: found.sigmas)


def _adequate(fits: Iterator[LocalFit] | list[LocalFit]) -> list[LocalFit]:
    return [one for one in fits if one.adequate]


def quadratic(
    seen: Observations, time_s: float, middle: int, neighbours: int, with_pattern: bool = False
) -> LocalFit:
    """Value of a signal at an instant from a quadratic through so many observations on each side of
    the place `middle`; with_pattern: beside a pattern that repeats every turn (an eccentric wheel,
    cogging: `speed_ripple.py` adds the shaft's part of it).

    The polynomial is fitted to the spans' means, not to their midpoints, so that long edge periods
    at low speed add no curvature; and to what a known force leaves of them, so that its steps and
    ripple add none either.
    """
    part = slice(middle - neighbours, middle + neighbours)
    if not _may_be_fitted(seen, time_s, part, neighbours):
        return NO_FIT
    start, end = seen.start_s[part] - time_s, seen.end_s[part] - time_s
    scale = max(-start[0], end[-1])
    basis = _mean_monomials(start / scale, end / scale)
    if with_pattern:
        counts = np.bincount(seen.pitch[part], minlength=seen.pitches_per_rev)
        if counts.min() < LOCAL_FIT.min_of_each_pitch:
            return NO_FIT
        basis = np.column_stack([basis, seen.turn_pattern(part)])
    force = seen.force_means(time_s, part)
    solution = _robust_solution(basis, seen.value[part], seen.sigma[part], force)
    one = min(float(np.median(seen.sigma[part])), seen.typical_sigma)
    covariance = np.linalg.inv((basis * solution.row_weight).T @ (basis * solution.row_weight))
    weight = covariance[0] @ basis.T * solution.row_weight[:, 0] ** 2
    freedom = len(start) - basis.shape[1]
    left = solution.weighted_square / freedom
    sigmas = np.sqrt(np.diag(covariance)[: DEGREE + 1] * max(1.0, left))
    fitted, forced = solution.coefficients[: DEGREE + 1].T
    _, slope, curvature = (shrunk(fitted, sigmas) + forced) / scale ** np.arange(DEGREE + 1)
    steepness = abs(float(fitted[1] + forced[1])) / scale
    return LocalFit(
        float(solution.coefficients[0, 0]),
        float(slope),
        2.0 * float(curvature),
        float(sigmas[0]) / one,
        steepness * LOCAL_FIT.slope_penalty_s / one,
        left < 1.0 + LOCAL_FIT.max_lack_of_fit * np.sqrt(2.0 / freedom),
        float(sigmas[1]) / scale,
        float(sigmas[0]),
        Smoothing(start, end, weight),
    )


def shrunk(values: np.ndarray, sigmas: np.ndarray) -> np.ndarray:
    """Values (n,) with standard deviations (n,), each shrunk towards 0 by the share of its square
    that noise explains (Breiman, Technometrics 37(4), 1995). A lag of the sensor multiplies slope
    and curvature, and with them their noise.
    """
    noise = sigmas**2 / np.maximum(values**2, MIN_SQUARE)
    return np.maximum(1.0 - noise, 0.0) * values


def _may_be_fitted(seen: Observations, time_s: float, part: slice, neighbours: int) -> bool:
    """Whether the part lies within the observations and within max_distance_s of the instant, and a
    part wider than the narrowest contains no reversal: friction and play bend a motion there.
    """
    if part.start < 0 or part.stop > len(seen.value):
        return False
    value = seen.value[part]
    before, after = time_s - seen.start_s[part.start], seen.end_s[part.stop - 1] - time_s
    if max(before, after) > seen.max_distance_s or not np.all(np.isfinite(value)):
        return False
    return neighbours == NEIGHBOURS[0] or abs(np.sum(np.sign(value))) >= len(value)


def _mean_monomials(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Means (m, 3) of 1, t and t^2 over spans from a (m,) to b (m,)."""
    return np.column_stack([np.ones_like(a), 0.5 * (a + b), (a * a + a * b + b * b) / 3.0])


@dataclass(frozen=True)
class _Solution:
    """Coefficients (p, 2): of the values without the known force, and of the force. row_weight
    (m, 1): weight over sigma of each row in the last round. weighted_square: sum of the weighted
    squared residuals.
    """

    coefficients: np.ndarray
    row_weight: np.ndarray
    weighted_square: float


def _robust_solution(
    basis: np.ndarray, value: np.ndarray, sigma: np.ndarray, force: np.ndarray
) -> _Solution:
    """Iteratively reweighted least squares of values (m,) in a basis (m, p)."""
    weight = np.ones_like(value)
    for _ in range(LOCAL_FIT.rounds):
        rows = (weight / sigma)[:, None]
        coefficients, *_ = np.linalg.lstsq(
            basis * rows, np.column_stack([value - force, force]) * rows, rcond=None
        )
        error = np.abs(value - force - basis @ coefficients[:, 0]) / sigma
        spread = max(1.0, LOCAL_FIT.spread_factor * float(np.median(error)))
        limit = LOCAL_FIT.huber_sigmas * spread
        weight = np.minimum(1.0, limit / np.maximum(error, MIN_RESIDUAL))
    return _Solution(coefficients, rows, float(np.sum((weight * error) ** 2)))


def row_means(
    time_s: np.ndarray, values: np.ndarray, sigma: float, interval_s: float
) -> Observations:
    """Observations of a column whose samples are means over the rows' intervals, of interval_s as a
    rule; missing samples are left out.
    """
    begin = np.concatenate([[2.0 * time_s[0] - time_s[1]], time_s[:-1]])
    known = np.isfinite(values)
    return Observations(
        begin[known],
        time_s[known],
        values[known],
        np.full(int(known.sum()), sigma),
        interval_s=interval_s,
    )
