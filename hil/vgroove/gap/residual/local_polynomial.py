"""Value and derivatives of a noisy signal at an instant by local polynomial regression: a robust
quadratic through the observations on both sides, which adds no delay.

Methods: Fan and Gijbels, Local Polynomial Modelling and Its Applications, 1996 (on even rows a
Savitzky-Golay filter, Analytical Chemistry 36 (1964) 1627); the width is chosen by the smallest
uncertainty. Robust weights: Huber 1964.
"""

from collections.abc import Sequence
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
        """Speed and angle at instants, arrays of one shape."""
        row = np.clip(np.searchsorted(self.time_s, instants_s), 1, len(self.time_s) - 1)
        (speed, angle), before = self._sums, self.time_s[row] - instants_s
        mean = speed[row] - 0.5 * self.rate[row] * before
        return speed[row] - self.rate[row] * before, angle[row] - mean * before

    def means(self, start_s: np.ndarray, end_s: np.ndarray) -> np.ndarray:
        """Mean speeds over spans, arrays of one shape; over one of length 0 the speed there."""
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

    def turn_pattern(self, part: np.ndarray) -> np.ndarray:
        """Columns (..., m, pitches - 1) of a design matrix for observations with the indices `part`
        (..., m): a deviation, as a share of the value, that depends on the pitch alone and is 0 on
        average over a turn.
        """
        which = np.equal(self.pitch[part, None], np.arange(self.pitches_per_rev)).astype(float)
        relative = self.value[part] / np.mean(self.value[part], axis=-1, keepdims=True)
        return (which[..., :-1] - which[..., -1:]) * relative[..., None]

    def force_means(self, time_s: np.ndarray, part: np.ndarray) -> np.ndarray:
        """What the known force adds to the values with the indices `part` (n, m), in comparison
        with the instants (n,); zeros without a known force.
        """
        if self.known_force is None:
            return np.zeros(part.shape)
        means = self.known_force.means(self.start_s[part], self.end_s[part])
        return means - self.known_force.at(time_s)[0][:, None]

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


def local_fits(seen: Observations, time_s: np.ndarray) -> list[LocalFit]:
    """Value of a signal at each instant (n,) from the quadratic through the observations around it
    of the smallest uncertainty: through few of them where the motion bends, through many where
    noise dominates; the derivatives from that of the smallest uncertainty of the slope. Where none
    can be trusted a pattern that repeats every turn is fitted as well.
    """
    middle = np.searchsorted(0.5 * (seen.start_s + seen.end_s), time_s)
    of_each_width = zip(
        *(_quadratics(seen, time_s, middle, count) for count in NEIGHBOURS), strict=True
    )
    return [
        _best_fit(seen, time_s[k : k + 1], middle[k : k + 1], fits)
        for k, fits in enumerate(of_each_width)
    ]


def _best_fit(
    seen: Observations, time_s: np.ndarray, middle: np.ndarray, fits: Sequence[LocalFit]
) -> LocalFit:
    """The value at one instant (1,) from its quadratics, in order of their width."""
    narrow, *wider = fits
    best = min((narrow, *_adequate(wider)), key=lambda found: found.sigmas)
    rates = min(fits, key=lambda found: found.slope_sigma)
    best = replace(
        best, slope=rates.slope, curvature=rates.curvature, slope_sigma=rates.slope_sigma
    )
    if best.sigmas < LOCAL_FIT.max_sigmas or seen.pitch is None:
        return best
    with_pattern = [
        _quadratics(seen, time_s, middle, count, True)[0]
        for count in NEIGHBOURS
        if count >= seen.pitches_per_rev + DEGREE
    ]
    return min((best, *_adequate(with_pattern)), key=lambda found: found.sigmas)


def _adequate(fits: Sequence[LocalFit]) -> list[LocalFit]:
    return [one for one in fits if one.adequate]


def _quadratics(
    seen: Observations,
    time_s: np.ndarray,
    middle: np.ndarray,
    neighbours: int,
    with_pattern: bool = False,
) -> list[LocalFit]:
    """Value of a signal at each instant (n,) from a quadratic through so many observations on each
    side of its place `middle` (n,); with_pattern: beside a pattern that repeats every turn (an
    eccentric wheel, cogging: `speed_ripple.py` adds the shaft's part of it). NO_FIT where the
    observations do not allow it.

    The polynomials are fitted to the spans' means, not to their midpoints, so that long edge
    periods at low speed add no curvature; and to what a known force leaves of them, so that its
    steps and ripple add none either.
    """
    fits = [NO_FIT] * len(time_s)
    inside = np.flatnonzero((middle >= neighbours) & (middle + neighbours <= len(seen.value)))
    part = middle[inside, None] + np.arange(-neighbours, neighbours)
    allowed = _may_be_fitted(seen, time_s[inside], part)
    if with_pattern:
        allowed &= _holds_each_pitch(seen, part)
    if not allowed.any():
        return fits
    part, which = part[allowed], inside[allowed]
    found = _fit_quadratics(seen, time_s[which], part, with_pattern)
    for k, fit in zip(which, found, strict=True):
        fits[k] = fit
    return fits


def _fit_quadratics(
    seen: Observations, time_s: np.ndarray, part: np.ndarray, with_pattern: bool
) -> list[LocalFit]:
    """Parabolas in time by least squares, one for each instant in time_s (n,), from which its time
    is counted; row i of `part` (n, m) holds the indices of the observations that the i-th one fits.
    """
    start, end = seen.start_s[part] - time_s[:, None], seen.end_s[part] - time_s[:, None]
    scale = np.maximum(-start[:, 0], end[:, -1])
    basis = _mean_monomials(start / scale[:, None], end / scale[:, None])
    if with_pattern:
        basis = np.concatenate([basis, seen.turn_pattern(part)], axis=-1)
    force, sigma = seen.force_means(time_s, part), seen.sigma[part]
    solution = _robust_solution(basis, seen.value[part], sigma, force)
    one = np.minimum(np.median(sigma, axis=1), seen.typical_sigma)
    weighted = basis * solution.row_weight
    covariance = np.linalg.inv(weighted.swapaxes(1, 2) @ weighted)
    weight = (covariance[:, :1] @ basis.swapaxes(1, 2))[:, 0] * solution.row_weight[..., 0] ** 2
    freedom = part.shape[1] - basis.shape[2]
    left = solution.weighted_square / freedom
    variance = np.diagonal(covariance, axis1=1, axis2=2)[:, : DEGREE + 1]
    sigmas = np.sqrt(variance * np.maximum(1.0, left)[:, None])
    fitted, forced = np.moveaxis(solution.coefficients[:, : DEGREE + 1], 2, 0)
    rates = (shrunk(fitted, sigmas) + forced) / scale[:, None] ** np.arange(DEGREE + 1)
    steepness = np.abs(fitted[:, 1] + forced[:, 1]) / scale
    adequate = left < 1.0 + LOCAL_FIT.max_lack_of_fit * np.sqrt(2.0 / freedom)
    return [
        LocalFit(
            float(fitted[k, 0]),
            float(rates[k, 1]),
            2.0 * float(rates[k, 2]),
            float(sigmas[k, 0] / one[k]),
            float(steepness[k] * LOCAL_FIT.slope_penalty_s / one[k]),
            bool(adequate[k]),
            float(sigmas[k, 1] / scale[k]),
            float(sigmas[k, 0]),
            Smoothing(start[k], end[k], weight[k]),
        )
        for k in range(len(time_s))
    ]


def shrunk(values: np.ndarray, sigmas: np.ndarray) -> np.ndarray:
    """Values with standard deviations of the same shape, each shrunk towards 0 by the share of its
    square that noise explains (Breiman, Technometrics 37(4), 1995). A lag of the sensor multiplies
    slope and curvature, and with them their noise.
    """
    noise = sigmas**2 / np.maximum(values**2, MIN_SQUARE)
    return np.maximum(1.0 - noise, 0.0) * values


def _may_be_fitted(seen: Observations, time_s: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Whether a quadratic at each instant (n,) may be fitted to the observations with the indices
    `part` (n, m): they are finite and lie within max_distance_s of the instant, and of those of the
    wider fits all have one sign, since friction and play bend a motion where it reverses.
    """
    value = seen.value[part]
    before, after = time_s - seen.start_s[part[:, 0]], seen.end_s[part[:, -1]] - time_s
    allowed = np.maximum(before, after) <= seen.max_distance_s
    allowed &= np.all(np.isfinite(value), axis=1)
    if part.shape[1] > 2 * NEIGHBOURS[0]:
        allowed &= np.abs(np.sum(np.sign(value), axis=1)) >= part.shape[1]
    return allowed


def _holds_each_pitch(seen: Observations, part: np.ndarray) -> np.ndarray:
    """Whether the observations with the indices `part` (n, m) hold every pitch of the turn at least
    LOCAL_FIT.min_of_each_pitch times, for each of the n fits.
    """
    which = np.equal(seen.pitch[part, None], np.arange(seen.pitches_per_rev))
    return which.sum(axis=1).min(axis=1) >= LOCAL_FIT.min_of_each_pitch


def _mean_monomials(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Mean values (..., 3) of 1, t and t^2 over the intervals from t = a to t = b (...)."""
    return np.stack([np.ones_like(a), 0.5 * (a + b), (a * a + a * b + b * b) / 3.0], axis=-1)


@dataclass(frozen=True)
class _Solution:
    """Coefficients (n, p, 2): of the values without the known force, and of the force. row_weight
    (n, m, 1): weight over sigma of each row in the last round. weighted_square (n,): sum of the
    weighted squared residuals.
    """

    coefficients: np.ndarray
    row_weight: np.ndarray
    weighted_square: np.ndarray


def _robust_solution(
    basis: np.ndarray, value: np.ndarray, sigma: np.ndarray, force: np.ndarray
) -> _Solution:
    """Iteratively reweighted least squares of n problems with values (n, m) in bases (n, m, p). The
    equation of a value is multiplied by Huber's weight, so that the influence of values beyond the
    limit falls with their distance.
    """
    weight, both = np.ones_like(value), np.stack([value - force, force], axis=-1)
    for _ in range(LOCAL_FIT.rounds):
        rows = (weight / sigma)[..., None]
        q, r = np.linalg.qr(basis * rows)
        coefficients = np.linalg.solve(r, q.swapaxes(1, 2) @ (both * rows))
        error = np.abs(both[..., 0] - (basis @ coefficients[..., :1])[..., 0]) / sigma
        spread = np.maximum(1.0, LOCAL_FIT.spread_factor * np.median(error, axis=1))
        limit = LOCAL_FIT.huber_sigmas * spread[:, None]
        weight = np.minimum(1.0, limit / np.maximum(error, MIN_RESIDUAL))
    return _Solution(coefficients, rows, np.sum((weight * error) ** 2, axis=1))


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
