"""Measured states to restart the model from: local polynomials that do not lag, and where in a log they can be trusted."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

NEIGHBOURS = 4  # observations on each side of an instant
DEGREE = 2
REACH_S = 0.06  # observations further away than this say nothing about an instant
SEARCH_S, SEARCH_STEPS = 0.05, 11  # a restart may move this far, to the best of so many instants
TRUST = 2.5  # a restart needs a state known to within this many sigma of the sensor


@dataclass(frozen=True)
class Observations:
    """A signal's means over spans [start_s, end_s] (m,) in order of time, with 1 sigma each; start = end: an instant."""

    start_s: np.ndarray
    end_s: np.ndarray
    value: np.ndarray
    sigma: np.ndarray


@dataclass(frozen=True)
class Local:
    """A signal at an instant: value, slope per second, and the value's 1 sigma, lack of fit included, in sensor sigmas."""

    value: float
    slope: float
    doubt: float


NOWHERE = Local(0.0, 0.0, np.inf)


def local_fit(seen: Observations, time_s: float) -> Local:
    """Value of a signal at an instant from a quadratic through the spans around it, robust against single wrong ones.

    The polynomial is fitted to the spans' means, not to their midpoints: long edge periods at low speed bend nothing.
    """
    middle = np.searchsorted(0.5 * (seen.start_s + seen.end_s), time_s)
    first, last = middle - NEIGHBOURS, middle + NEIGHBOURS
    if first < 0 or last > len(seen.value):
        return NOWHERE
    start, end = seen.start_s[first:last] - time_s, seen.end_s[first:last] - time_s
    value, sigma = seen.value[first:last], seen.sigma[first:last]
    if max(-start[0], end[-1]) > REACH_S or not np.all(np.isfinite(value)):
        return NOWHERE
    scale = max(-start[0], end[-1])
    a, b = start / scale, end / scale
    basis = np.column_stack([np.ones_like(a), 0.5 * (a + b), (a * a + a * b + b * b) / 3.0])
    weight = np.ones_like(a)
    for _ in range(3):
        rows = (weight / sigma)[:, None]
        answer, *_ = np.linalg.lstsq(basis * rows, value * rows[:, 0], rcond=None)
        error = np.abs(value - basis @ answer) / sigma
        spread = max(1.0, 1.5 * float(np.median(error)))
        weight = np.minimum(1.0, 3.0 * spread / np.maximum(error, 1e-12))
    covariance = np.linalg.inv((basis * rows).T @ (basis * rows))
    misfit = np.sqrt(max(1.0, float(np.sum((weight * error) ** 2)) / (len(a) - DEGREE - 1)))
    return Local(float(answer[0]), float(answer[1] / scale), float(np.sqrt(covariance[0, 0])) * misfit / float(np.median(sigma)))


def row_means(time_s: np.ndarray, values: np.ndarray, sigma: float) -> Observations:
    """Observations of a column whose samples are means over the rows' intervals; missing samples are left out."""
    begin = np.concatenate([[2.0 * time_s[0] - time_s[1]], time_s[:-1]])
    known = np.isfinite(values)
    return Observations(begin[known], time_s[known], values[known], np.full(int(known.sum()), sigma))


@dataclass(frozen=True)
class Sight:
    """What of a log shows the states: speed_rad_s and current_a observations (None: not measured), the angle at any time, torque to current."""

    speed: Observations | None
    current: Observations | None
    angle_at: Callable[[float], float]
    current_from: Callable[[float, float, float], float]

    def state(self, time_s: float) -> tuple[np.ndarray, float]:
        """State [current_a, speed_rad_s, angle_rad] at an instant and its doubt, in sensor sigmas."""
        if self.speed is None:
            return np.zeros(3), np.inf
        speed = local_fit(self.speed, time_s)
        if not np.isfinite(speed.doubt):
            return np.zeros(3), np.inf
        if self.current is None:
            current = Local(self.current_from(time_s, speed.value, speed.slope), 0.0, 0.0)
        else:
            current = local_fit(self.current, time_s)
        return np.array([current.value, speed.value, self.angle_at(time_s)]), max(speed.doubt, current.doubt)


def restarts(sight: Sight, time_s: np.ndarray, restart_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Rows (S,) that the model restarts at and their states (S, 3); the first is row 0, at rest.

    About every restart_s the instant within reach whose state is known best; none where no state is known well enough (standstill, the first
    edges, reversals, steps): the model runs through.
    """
    starts, states = [0], [np.array([0.0, 0.0, sight.angle_at(time_s[0])])]
    count = int((time_s[-1] - time_s[0]) / restart_s)
    for k in range(1, count + 1):
        centre = time_s[0] + k * restart_s
        if time_s[-1] - centre < 0.5 * restart_s:
            break
        best, row, state = TRUST, 0, None
        for shift in SEARCH_S * np.linspace(-1.0, 1.0, SEARCH_STEPS):
            index = int(np.searchsorted(time_s, centre + min(1.0, restart_s / 0.25) * shift))
            if not starts[-1] + 5 < index < len(time_s) - 5:
                continue
            candidate, doubt = sight.state(float(time_s[index - 1]))
            if doubt * (1.0 + abs(shift)) < best:
                best, row, state = doubt, index, candidate
        if state is not None:
            starts.append(row)
            states.append(state)
    return np.array(starts), np.array(states)
