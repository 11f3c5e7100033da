"""Restarts of the model from measured states: where in a log a state is known well enough, and the
true states behind the measured ones for each parameter set's sensor errors.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from vgroove.gap.cleaning.logging_interval import logging_interval_s
from vgroove.gap.cleaning.long_logs import without_thinned
from vgroove.gap.residual.immutable import freeze_arrays
from vgroove.gap.residual.local_polynomial import (
    LOCAL_FIT,
    NEIGHBOURS,
    NO_FIT,
    NOT_SMOOTHED,
    LocalFit,
    Observations,
    Smoothing,
    local_fits,
)
from vgroove.gap.residual.sensors import SensorErrors


@dataclass(frozen=True)
class RestartRules:
    """Where restarts are looked for; chosen on the tuning half of the blind set
    (docs/gap_bench.md), those under a current on measured logs that are not part of the tests.
    """

    # reach: largest distance of a restart from its regular instant, for restarts every nominal_s
    search_s: float = 0.05
    nominal_s: float = 0.25
    # longest time between restarts of a speed under a measured current, and that time as a share of
    # the log
    longest_under_current_s: float = 1.0
    share_under_current: float = 0.25
    search_rows: float = 1.5  # the same in rows, of a slow logger
    candidates: int = 11  # instants within the reach that are compared
    # shortest interval between restarts, in rows of a slow logger: the longest delay that is looked
    # for (docs/spec/gap.md, section 5), since the measured state at a restart hides a longer one
    min_interval_rows: float = 32.0
    min_rows: int = 5  # between restarts, and to the end of the log
    resume_reach: float = 1.2  # distance of the search's centre from the end of a hole, in reaches
    min_last_share: float = 0.5  # shortest time from the last restart to the end, in intervals
    # share of the sensor's limit from which a current is taken as clipped: a soft limit deviates
    # before
    clipped_share: float = 0.9
    # value at a log's first row, on the line through its first observations, in its standard
    # deviations, above which the log begins in motion
    start_sigmas: float = 3.0


RESTART = RestartRules()
EQUAL_SIGMAS = 1e-9  # a smaller difference of two uncertainties is rounding


@dataclass(frozen=True)
class State:
    """Measured [current_a, speed_rad_s, angle_rad] at an instant; motion_a: the current in A that
    the speed and acceleration there require by the torque balance (nan: unknown); rates (2, 2):
    slope and curvature of current and speed; smoothing: what the speed was computed from;
    speed_sigma: standard deviation of the speed in rad/s.
    """

    value: np.ndarray
    motion_a: float = np.nan
    rates: np.ndarray = field(default_factory=lambda: np.zeros((2, 2)))
    smoothing: Smoothing = NOT_SMOOTHED
    speed_sigma: float = 0.0


@dataclass(frozen=True)
class StateObserver:
    """Computes states from a log. speed, current: observations in rad/s and A (None: not measured);
    angle_at: the angle at an instant; current_from: the current that a motion (instant, speed,
    acceleration) requires; from_angle: whether the speeds are differences of a measured angle over
    the log's times.
    """

    speed: Observations | None
    current: Observations | None
    angle_at: Callable[[float], float]
    current_from: Callable[[float, float, float], float]
    from_angle: bool = False

    def states(self, time_s: np.ndarray) -> list[tuple[State, float, float]]:
        """For each instant (n,) the measured state, its uncertainty in sigmas of the sensors, and
        the penalty for its slope.
        """
        unknown = [NO_FIT] * len(time_s)
        speeds = local_fits(self.speed, time_s) if self.speed is not None else unknown
        currents = local_fits(self.current, time_s) if self.current is not None else unknown
        return [
            self._state(float(instant), speed, current)
            for instant, speed, current in zip(time_s, speeds, currents, strict=True)
        ]

    def _state(
        self, time_s: float, speed: LocalFit, current: LocalFit
    ) -> tuple[State, float, float]:
        """As states() for one instant, from its speed and, where it is measured, its current."""
        if not np.isfinite(speed.sigmas):
            return State(np.zeros(3)), np.inf, np.inf
        motion_a = self.current_from(time_s, speed.value, speed.slope)
        if self.current is None:
            current = LocalFit(motion_a, 0.0, 0.0, 0.0, 0.0)
        value = np.array([current.value, speed.value, self.angle_at(time_s)])
        rates = np.array([[current.slope, current.curvature], [speed.slope, speed.curvature]])
        state = State(value, motion_a, rates, speed.smoothing, speed.value_sigma)
        return state, max(speed.sigmas, current.sigmas), speed.slope_penalty


@dataclass(frozen=True)
class Restarts:
    """Rows (S,) at whose end the model restarts, and the measured states there."""

    rows: np.ndarray
    measured: np.ndarray  # (S, 3) current in A, speed in rad/s, angle in rad
    slopes: np.ndarray  # (S, 2) of current and speed
    curvatures: np.ndarray  # (S, 2) second derivatives of current and speed
    from_angle: bool = False  # the speeds are differences of a measured angle
    smoothing: tuple[Smoothing, ...] = ()  # what each speed was computed from
    motion_a: np.ndarray | float = np.nan  # (S,) currents that the motion requires, A
    speed_sigma: np.ndarray | float = 0.0  # (S,) standard deviations of the speeds, rad/s

    def __post_init__(self) -> None:
        freeze_arrays(self)

    @property
    def angle_rad(self) -> np.ndarray:
        """Motor angles (S,)."""
        return self.measured[:, 2]

    def before(self, rows: np.ndarray) -> np.ndarray:
        """Number (m,) of the last restart before each row (m,) of the log; -1 where there is none.
        A row at whose end the model restarts belongs to the restart before.
        """
        return np.searchsorted(self.rows, rows, side="left") - 1

    def with_angle(self, angle_rad: np.ndarray) -> "Restarts":
        """The restarts at other motor angles (S,)."""
        measured = self.measured.copy()
        measured[:, 2] = angle_rad
        return replace(self, measured=measured)

    def states(self, errors: SensorErrors) -> np.ndarray:
        """True states (B, S, 3) behind the measured ones for the sensor errors of B parameter sets.

        Speeds that are differences of an angle have the logger's clock as their gain, and no lag.
        A clipped current is replaced by the current that the motion requires. A restart at the
        sensor's limit would cause an error of the torque that lasts for the winding's time
        constant; while the bridge is open, the error of the speed that results does not decay.
        """
        gain, lag_s = errors.gain, errors.lag_s
        if self.from_angle:
            gain, lag_s = np.column_stack([gain[:, 0], 1.0 / errors.clock]), lag_s * [1.0, 0.0]
        true = np.repeat(self.measured[None], len(gain), axis=0)
        true[:, :, :2] += lag_s[:, None] * self.slopes
        curved = np.array([0.0, 1.0 / 2.0, 1.0 / 3.0])[errors.form]  # of FILTER, DELAY, MEAN
        true[:, :, 1] += (curved * lag_s[:, 1] ** 2)[:, None] * self.curvatures[:, 1]
        true[:, :, :2] = (true[:, :, :2] - errors.offset[:, None]) / gain[:, None]
        limit_a = np.reshape(errors.limit_a, (-1, 1))
        clipped = np.abs(self.measured[:, 0]) > RESTART.clipped_share * limit_a
        true[:, :, 0] = np.where(clipped & np.isfinite(self.motion_a), self.motion_a, true[:, :, 0])
        return true


def usual_restart_s(drives_speed: bool, lasts_s: float) -> float:
    """Time in s between restarts of the model in a log of the length lasts_s; drives_speed: whether
    a measured current drives the motor and the speed is measured.

    The back EMF does not brake a motor whose current is given. What a missing effect changes in its
    speed then grows with the time since the restart, and the error of the start speed does not.
    """
    if not drives_speed:
        return RESTART.nominal_s
    wanted_s = min(RESTART.longest_under_current_s, RESTART.share_under_current * lasts_s)
    return max(RESTART.nominal_s, wanted_s)


def restart_interval_s(interval_s: float, restart_s: float) -> float:
    """Time between restarts of a log with rows every interval_s: restart_s, or longer where the
    logger is slow.
    """
    return max(restart_s, RESTART.min_interval_rows * interval_s)


def find_restarts(
    observer: StateObserver,
    time_s: np.ndarray,
    restart_s: float,
    resume: Sequence[int] = (),
    thinned: np.ndarray | None = None,
) -> Restarts:
    """Restarts of a log with rows at time_s (rows,). The first is row 0, at rest unless the log is
    in motion there.

    About every restart_s, and soon after each row of `resume` (ends of holes), the model restarts
    at the instant within reach whose state has the lowest uncertainty. Where the uncertainty of all
    is too large (standstill, the first edges, reversals, steps) it continues without a restart. No
    restart is at the rows of the mask `thinned` (rows,), where nothing is measured.
    """
    rows, found = [0], [_first_state(observer, time_s)]
    evenly_s = time_s if thinned is None else without_thinned(time_s, thinned)
    reach = max(
        RESTART.search_s * min(1.0, restart_s / RESTART.nominal_s),
        RESTART.search_rows * logging_interval_s(evenly_s),
    )
    count = int((time_s[-1] - time_s[0]) / restart_s - RESTART.min_last_share)
    regular = [time_s[0] + k * restart_s for k in range(1, count + 1)]
    after_holes = [time_s[row] + RESTART.resume_reach * reach for row in resume]
    for centre in sorted(regular + after_holes):
        shifts = reach * np.linspace(-1.0, 1.0, RESTART.candidates)
        candidates = sorted({int(np.searchsorted(time_s, centre + shift)) for shift in shifts})
        first, last = rows[-1] + RESTART.min_rows, len(time_s) - RESTART.min_rows
        allowed = [row for row in candidates if first < row < last]
        allowed = allowed if thinned is None else [row for row in allowed if not thinned[row]]
        nearest_first = sorted(allowed, key=lambda row: abs(time_s[row] - centre))
        best = _best_known(observer, time_s, nearest_first)
        if best is not None:
            rows.append(best[0])
            found.append(best[1])
    return _as_restarts(np.array(rows), found, observer.from_angle)


def _best_known(
    observer: StateObserver, time_s: np.ndarray, rows: Sequence[int]
) -> tuple[int, State] | None:
    """Row and state with the smallest sum of uncertainty and slope penalty among `rows`; the first
    of them where several sums are equal up to rounding errors. None if every uncertainty exceeds
    LOCAL_FIT.max_sigmas.
    """
    best, chosen = np.inf, None
    states = observer.states(time_s[list(rows)])
    for row, (state, sigmas, slope_penalty) in zip(rows, states, strict=True):
        if sigmas < LOCAL_FIT.max_sigmas and sigmas + slope_penalty < best - EQUAL_SIGMAS:
            best, chosen = sigmas + slope_penalty, (row, state)
    return chosen


def _as_restarts(rows: np.ndarray, states: list[State], from_angle: bool) -> Restarts:
    rates = np.array([state.rates for state in states])
    return Restarts(
        rows,
        np.array([state.value for state in states]),
        rates[:, :, 0],
        rates[:, :, 1],
        from_angle,
        tuple(state.smoothing for state in states),
        np.array([state.motion_a for state in states]),
        np.array([state.speed_sigma for state in states]),
    )


def _first_state(observer: StateObserver, time_s: np.ndarray) -> State:
    """State at the first row: at rest, or on the line through the first observations where they
    show motion.
    """
    state, count = np.array([0.0, 0.0, observer.angle_at(time_s[0])]), NEIGHBOURS[0]
    sigma = np.zeros(2)
    for k, seen in enumerate((observer.current, observer.speed)):
        if seen is None or len(seen.value) < count:
            continue
        if seen.end_s[0] > time_s[0] + seen.max_distance_s:
            continue
        elapsed = 0.5 * (seen.start_s + seen.end_s)[:count] - time_s[0]
        value, uncertain = _line_at_start(elapsed, seen.value[:count], seen.sigma[:count])
        if abs(value) > RESTART.start_sigmas * uncertain:
            state[k], sigma[k] = value, uncertain
    return State(state, speed_sigma=float(sigma[1]))


def _line_at_start(
    elapsed_s: np.ndarray, value: np.ndarray, sigma: np.ndarray
) -> tuple[float, float]:
    """Intercept at time 0 of the weighted least-squares line through values (n,) with standard
    deviations sigma (n,), and the standard deviation of the intercept, enlarged by the square root
    of the reduced chi-square where that exceeds 1 (the values then do not lie on a line).
    """
    line, covariance = np.polyfit(elapsed_s, value, 1, w=1.0 / sigma, cov="unscaled")
    misfit = float(np.sum(((value - np.polyval(line, elapsed_s)) / sigma) ** 2))
    scale = max(1.0, misfit / (len(value) - len(line)))
    return float(line[1]), float(np.sqrt(scale * covariance[1, 1]))
