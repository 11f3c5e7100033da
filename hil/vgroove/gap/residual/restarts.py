"""Measured states to restart the model from: local polynomials that do not lag, and where in a log
they can be trusted.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

NEIGHBOURS = (4, 8, 16)  # observations on each side of an instant
DEGREE = 2
REACH_S = 0.06  # observations further away than this say nothing about an instant
SEARCH_S, SEARCH_STEPS = 0.05, 11  # a restart may move this far, to the best of so many instants
# of two instants that are known equally well the quieter one is taken: this much of its
# acceleration counts as doubt
UNREST_S = 2e-4
# a mean square of the residual so many standard deviations above noise's tells of a motion that the
# polynomial misses
NOISE_ALONE = 1.0
TRUST = 2.5  # a restart needs a state known to within this many sigma of the sensor
# of a sensor's limit, beyond which it no longer shows the current: a soft one bends before it
CLIPPED = 0.9


@dataclass(frozen=True)
class KnownForce:
    """What a known force does to a speed, up to a constant: rates (rows,) in rad/s^2 over the
    intervals that end at time_s (rows,).
    """

    time_s: np.ndarray
    rate: np.ndarray

    @cached_property
    def _sums(self) -> tuple[np.ndarray, np.ndarray]:
        """Speed and angle (rows,) that have come about by each row."""
        step = np.diff(self.time_s, prepend=self.time_s[0])
        speed = np.cumsum(self.rate * step)
        return speed, np.cumsum((speed - 0.5 * self.rate * step) * step)

    def at(self, instants_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Speed and angle (m,) at instants (m,)."""
        row = np.clip(np.searchsorted(self.time_s, instants_s), 1, len(self.time_s) - 1)
        (speed, angle), before = self._sums, self.time_s[row] - instants_s
        return speed[row] - self.rate[row] * before, angle[row] - (
            speed[row] - 0.5 * self.rate[row] * before
        ) * before

    def means(self, start_s: np.ndarray, end_s: np.ndarray) -> np.ndarray:
        """Mean speeds (m,) over spans; an instant's is the speed there."""
        (speed, first), (_, last), length = self.at(start_s), self.at(end_s), end_s - start_s
        return np.where(length > 0.0, (last - first) / np.where(length > 0.0, length, 1.0), speed)


@dataclass(frozen=True)
class Observations:
    """A signal's means over spans [start_s, end_s] (m,) in order of time, with 1 sigma each; start
    = end: an instant.

    driven: what is known to move it; a polynomial then needs to follow the rest alone. place (m,):
    which of the `places` spans of a turn each is.
    """

    start_s: np.ndarray
    end_s: np.ndarray
    value: np.ndarray
    sigma: np.ndarray
    driven: KnownForce | None = None
    place: np.ndarray | None = None
    places: int = 1

    def of_a_turn(self, part: slice) -> np.ndarray:
        """What repeats every turn and has no mean, as a share of the value: columns (part, places -
        1).
        """
        which = np.equal(self.place[part, None], np.arange(self.places)).astype(float)
        return (which[:, :-1] - which[:, -1:]) * (self.value[part] / np.mean(self.value[part]))[
            :, None
        ]

    def driven_from(self, time_s: float, part: slice) -> np.ndarray:
        """What the known force adds to a part of the values from an instant on; zeros where none is
        known.
        """
        if self.driven is None:
            return np.zeros(len(self.value[part]))
        return (
            self.driven.means(self.start_s[part], self.end_s[part])
            - self.driven.at(np.array([time_s]))[0]
        )

    @cached_property
    def usual(self) -> float:
        """Sigma that nine tenths of the spans reach: a state that is known worse only by worse
        spans is not known well.
        """
        return float(np.quantile(self.sigma, 0.9))


@dataclass(frozen=True)
class Smoothing:
    """What a value at an instant was made of: spans (k,) in seconds from it, and the share of each
    span's mean in the value.
    """

    start_s: np.ndarray
    end_s: np.ndarray
    share: np.ndarray


NOT_SMOOTHED = Smoothing(np.zeros(0), np.zeros(0), np.zeros(0))


@dataclass(frozen=True)
class LocalFit:
    """A signal at an instant: value, first and second derivative, the value's 1 sigma, lack of fit
    included, its unrest in sigmas, whether what the polynomial leaves is no more than noise, and
    what the value was made of.
    """

    value: float
    slope: float
    bend: float
    doubt: float
    unrest: float
    fits: bool = True
    smoothing: Smoothing = field(default=NOT_SMOOTHED, compare=False)


NOWHERE = LocalFit(0.0, 0.0, 0.0, np.inf, np.inf, False)


def local_fit(seen: Observations, time_s: float) -> LocalFit:
    """Value of a signal at an instant from the quadratic through the spans around it that leaves
    the least doubt: through few of them where the motion bends, through many where it is noise that
    matters. Where none can be trusted a ripple of the turn is taken away as well.
    """
    middle = int(np.searchsorted(0.5 * (seen.start_s + seen.end_s), time_s))
    narrow, *wider = (quadratic(seen, time_s, middle, count) for count in NEIGHBOURS)
    best = min((narrow, *(one for one in wider if one.fits)), key=lambda found: found.doubt)
    if best.doubt < TRUST or seen.place is None:
        return best
    rippled = (
        quadratic(seen, time_s, middle, count, True)
        for count in NEIGHBOURS
        if count >= seen.places + DEGREE
    )
    return min((best, *(one for one in rippled if one.fits)), key=lambda found: found.doubt)


def quadratic(
    seen: Observations, time_s: float, middle: int, neighbours: int, ripples: bool = False
) -> LocalFit:
    """Value of a signal at an instant from a quadratic through the spans around it, robust against
    single wrong ones; beside a pattern that repeats every turn, where asked for (an eccentric
    wheel, cogging: `ripples.py` adds what the shaft has of it).

    The polynomial is fitted to the spans' means, not to their midpoints: long edge periods at low
    speed bend nothing; and to what a known force leaves of them, so that its steps and ripple bend
    nothing either.
    """
    first, last = middle - neighbours, middle + neighbours
    if first < 0 or last > len(seen.value):
        return NOWHERE
    start, end = seen.start_s[first:last] - time_s, seen.end_s[first:last] - time_s
    value, sigma = seen.value[first:last], seen.sigma[first:last]
    if max(-start[0], end[-1]) > REACH_S or not np.all(np.isfinite(value)):
        return NOWHERE
    if neighbours > NEIGHBOURS[0] and abs(np.sum(np.sign(value))) < len(value):
        # friction and play bend a motion where it turns round: no smooth piece reaches across
        return NOWHERE
    scale = max(-start[0], end[-1])
    a, b = start / scale, end / scale
    basis = np.column_stack([np.ones_like(a), 0.5 * (a + b), (a * a + a * b + b * b) / 3.0])
    if ripples:
        if np.bincount(seen.place[first:last], minlength=seen.places).min() < 2:
            return NOWHERE
        basis = np.column_stack([basis, seen.of_a_turn(slice(first, last))])
    driven = seen.driven_from(time_s, slice(first, last))
    weight = np.ones_like(a)
    for _ in range(3):
        rows = (weight / sigma)[:, None]
        both, *_ = np.linalg.lstsq(
            basis * rows, np.column_stack([value - driven, driven]) * rows, rcond=None
        )
        error = np.abs(value - driven - basis @ both[:, 0]) / sigma
        spread = max(1.0, 1.5 * float(np.median(error)))
        weight = np.minimum(1.0, 3.0 * spread / np.maximum(error, 1e-12))
    covariance = np.linalg.inv((basis * rows).T @ (basis * rows))
    freedom = len(a) - basis.shape[1]
    left = float(np.sum((weight * error) ** 2)) / freedom
    misfit = np.sqrt(max(1.0, left))
    _, slope, bend = both[: DEGREE + 1].sum(axis=1) / scale ** np.arange(3)
    one = min(float(np.median(sigma)), seen.usual)
    share = covariance[0] @ basis.T * rows[:, 0] ** 2
    doubt = float(np.sqrt(covariance[0, 0])) * misfit / one
    return LocalFit(
        float(both[0, 0]),
        float(slope),
        2.0 * float(bend),
        doubt,
        abs(float(slope)) * UNREST_S / one,
        left < 1.0 + NOISE_ALONE * np.sqrt(2.0 / freedom),
        Smoothing(start, end, share),
    )


def row_means(time_s: np.ndarray, values: np.ndarray, sigma: float) -> Observations:
    """Observations of a column whose samples are means over the rows' intervals; missing samples
    are left out.
    """
    begin = np.concatenate([[2.0 * time_s[0] - time_s[1]], time_s[:-1]])
    known = np.isfinite(values)
    return Observations(
        begin[known], time_s[known], values[known], np.full(int(known.sum()), sigma)
    )


@dataclass(frozen=True)
class State:
    """Measured [current_a, speed_rad_s, angle_rad] at an instant, the current that the motion there
    asks for (nan: not known), slope and bend of the first two, and what the speed was made of.
    """

    value: np.ndarray
    motion_a: float = np.nan
    rates: np.ndarray = field(default_factory=lambda: np.zeros((2, 2)))
    smoothing: Smoothing = NOT_SMOOTHED


@dataclass(frozen=True)
class StateObserver:
    """What shows the states: observations of speed_rad_s and current_a (None: not measured), the
    angle, the current behind a motion; whether the speeds are differences of a measured angle over
    the log's times.
    """

    speed: Observations | None
    current: Observations | None
    angle_at: Callable[[float], float]
    current_from: Callable[[float, float, float], float]
    from_angle: bool = False

    def state(self, time_s: float) -> tuple[State, float, float]:
        """Measured state at an instant, doubt and unrest."""
        speed = local_fit(self.speed, time_s) if self.speed is not None else NOWHERE
        if not np.isfinite(speed.doubt):
            return State(np.zeros(3)), np.inf, np.inf
        motion_a = self.current_from(time_s, speed.value, speed.slope)
        current = (
            LocalFit(motion_a, 0.0, 0.0, 0.0, 0.0)
            if self.current is None
            else local_fit(self.current, time_s)
        )
        state = np.array([current.value, speed.value, self.angle_at(time_s)])
        rates = np.array([[current.slope, current.bend], [speed.slope, speed.bend]])
        return (
            State(state, motion_a, rates, speed.smoothing),
            max(speed.doubt, current.doubt),
            speed.unrest,
        )


@dataclass(frozen=True)
class Restarts:
    """Rows (S,) at whose end the model starts anew, the measured states there (S, 3), slopes and
    bends (S, 2) of current and speed; whether the speeds are differences of a measured angle, what
    each speed was made of, and the currents (S,) that the motion asks for.
    """

    rows: np.ndarray
    measured: np.ndarray
    slopes: np.ndarray
    bends: np.ndarray
    from_angle: bool = False
    smoothing: tuple[Smoothing, ...] = ()
    motion_a: np.ndarray | float = np.nan

    def states(
        self,
        gain: np.ndarray,
        offset: np.ndarray,
        lag_s: np.ndarray,
        delayed: np.ndarray,
        clock: np.ndarray,
        limit_a: np.ndarray | float = np.inf,
    ) -> np.ndarray:
        """True states (B, S, 3) behind the measured ones for sensors of gain, offset and lag (B, 2)
        for current and speed.

        limit_a (B,): what a current is clipped at. Behind a clipped one is what the motion asks
        for: a start from the limit would lack, or add, an impulse of torque as long as the
        winding's time constant, and where the bridge opens nothing takes it away again.

        delayed (B,): the speed sensor is a delay, else a filter y' = (x - y) / lag. clock (B,):
        seconds of the logger in a second of the tool; a speed that is a difference of angles is one
        over the logger's time, and no speed sensor's.
        """
        if self.from_angle:
            gain, lag_s = np.column_stack([gain[:, 0], 1.0 / clock]), lag_s * [1.0, 0.0]
        true = np.repeat(self.measured[None], len(gain), axis=0)
        true[:, :, :2] += lag_s[:, None] * self.slopes
        true[:, :, 1] += 0.5 * (delayed * lag_s[:, 1] ** 2)[:, None] * self.bends[:, 1]
        true[:, :, :2] = (true[:, :, :2] - offset[:, None]) / gain[:, None]
        clipped = np.abs(self.measured[:, 0]) > CLIPPED * np.reshape(limit_a, (-1, 1))
        true[:, :, 0] = np.where(clipped & np.isfinite(self.motion_a), self.motion_a, true[:, :, 0])
        return true


def find_restarts(
    sight: StateObserver, time_s: np.ndarray, restart_s: float, resume: Sequence[int] = ()
) -> Restarts:
    """Where the model restarts; the first is row 0, at rest unless the log is in motion there.

    About every restart_s, and soon after each row of `resume` (ends of holes), the instant within
    reach whose state is known best; none where no state is known well enough (standstill, the first
    edges, reversals, steps): the model runs through.
    """
    rows, found = [0], [_first_state(sight, time_s)]
    reach = SEARCH_S * min(1.0, restart_s / 0.25)
    regular = [
        time_s[0] + k * restart_s
        for k in range(1, int((time_s[-1] - time_s[0]) / restart_s - 0.5) + 1)
    ]
    for centre in sorted(regular + [time_s[row] + 1.2 * reach for row in resume]):
        best, chosen = np.inf, None
        for shift in reach * np.linspace(-1.0, 1.0, SEARCH_STEPS):
            row = int(np.searchsorted(time_s, centre + shift))
            if not rows[-1] + 5 < row < len(time_s) - 5:
                continue
            state, doubt, unrest = sight.state(float(time_s[row]))
            if doubt < TRUST and doubt + unrest < best:
                best, chosen = doubt + unrest, (row, state)
        if chosen is not None:
            rows.append(chosen[0])
            found.append(chosen[1])
    rates = np.array([state.rates for state in found])
    return Restarts(
        np.array(rows),
        np.array([state.value for state in found]),
        rates[:, :, 0],
        rates[:, :, 1],
        sight.from_angle,
        tuple(state.smoothing for state in found),
        np.array([state.motion_a for state in found]),
    )


def _first_state(sight: StateObserver, time_s: np.ndarray) -> State:
    """State at the first row: at rest, or what the first observations say when they show motion."""
    state = np.array([0.0, 0.0, sight.angle_at(time_s[0])])
    for k, seen in enumerate((sight.current, sight.speed)):
        if seen is None or len(seen.value) < NEIGHBOURS[0] or seen.end_s[0] > time_s[0] + REACH_S:
            continue
        middle = 0.5 * (seen.start_s + seen.end_s)[: NEIGHBOURS[0]]
        line = np.polyfit(middle - time_s[0], seen.value[: NEIGHBOURS[0]], 1)
        if abs(np.mean(seen.value[: NEIGHBOURS[0]])) > 3.0 * seen.sigma[0]:
            state[k] = line[1]
    return State(state)
