"""Moves the particles of the hidden-edge filter from one row to the next and updates their cost."""

from dataclasses import dataclass

import numpy as np

from vgroove.gap.hall_edges.hidden_periods import BEND_SHARE, TICK_S, first_hidden_period
from vgroove.gap.hall_edges.particles import LIMITS, Branches, Particles, RowPair


@dataclass(frozen=True)
class _Move:
    """Move of the particles (PARTICLES,) over a row: number of edges passed; whether it is 0
    (stays); the same number, at least 1, with which lengths are computed; time of the last edge,
    its error, and length of the first period passed, s.
    """

    edges: np.ndarray
    stays: np.ndarray
    number: np.ndarray
    time_s: np.ndarray
    error_s: np.ndarray
    first_s: np.ndarray | float


@dataclass(frozen=True)
class _SpeedChange:
    """Speed (PARTICLES,) in the last period, its change per time, the middle of the period, the
    deviation from uniform acceleration, its standard deviation; and the reported change per time.
    """

    speed: np.ndarray
    slope: np.ndarray
    middle_s: np.ndarray
    jump: np.ndarray
    sigma: np.ndarray
    rate: float


def propagate(
    particles: Particles, row: RowPair, branches: Branches
) -> tuple[np.ndarray, np.ndarray]:
    """Move every particle to the last edge before the row's end. Returns the number of edges passed
    and the cost of what contradicts the row, sigma^2, both (PARTICLES,).
    """
    move = _move(particles, row, branches)
    contradiction = _contradiction(particles, row, branches, move)
    change = _speed_change(particles, row, branches, move)
    jump_cost = np.minimum((change.jump / change.sigma) ** 2, LIMITS.row_cost)
    particles.cost = particles.cost + contradiction + jump_cost
    particles.cost -= particles.cost.min()
    _update(particles, row, move, change)
    _widen(particles, row, branches, move)
    return move.edges, contradiction


def _move(particles: Particles, row: RowPair, branches: Branches) -> _Move:
    """The last edge of each particle before the row's end."""
    most = row.most_edges(particles.time_s.min())
    length = row.edge_times(most)
    edges = _edges_in_row(particles, row, branches, length)
    stays = edges == 0
    number = np.maximum(edges, 1)
    time_s = np.where(
        stays, particles.time_s, particles.time_s + length[np.minimum(number, most) - 1]
    )
    time_s = np.where(branches.known, row.now_s - row.period_s[1], time_s)
    evenly_spaced = row.counts and not row.missing_rows
    error_s = row.rounding_s * number + (
        0.0 if evenly_spaced else spacing_error_s(particles, row, number)
    )
    first_s = length[0] if row.counts else first_hidden_period(*row.period_s, number)
    return _Move(edges, stays, number, time_s, error_s, first_s)


def _edges_in_row(
    particles: Particles, row: RowPair, branches: Branches, length: np.ndarray
) -> np.ndarray:
    """Number of edges (PARTICLES,) that each particle passes up to the row's end.

    A row may hold no edge of its own if it repeats a value, if it is a timeout sample, or if the
    sensor counts edges (it then reports the last period).
    """
    period, since_s = row.period_s[1], row.now_s - particles.time_s
    unsure = np.minimum(particles.half_s, LIMITS.timeout_share * period) + TICK_S + row.rounding_s
    timeout = (np.abs(since_s - period) < unsure) & (
        np.abs(row.speed_rpm[1]) < np.abs(particles.speed)
    )
    fewest = 0 if row.repeats or row.counts else 1
    edges = np.clip(np.searchsorted(length, since_s, side="right"), fewest, len(length))
    edges[branches.earlier] -= 1
    edges[timeout] = 0
    edges[branches.known] = branches.edges[branches.known]
    return edges


def spacing_error_s(particles: Particles, row: RowPair, number: np.ndarray) -> np.ndarray:
    """Bound (PARTICLES,), s, on the error of the last of `number` edges that are spaced as uniform
    acceleration puts them.

    Where the growth of the periods changes much more than before (a step of the command), the
    change may have happened in the first hidden period or in the last: its effect on the sum of
    periods is then uncertain by half of the number of periods times the change.
    """
    growth = particles.growth_until(row)
    kink = abs(growth - particles.growth)
    is_sudden = kink > LIMITS.kink_factor * particles.growth_change
    sudden = 0.5 * number * kink if is_sudden else 0.0
    return (
        row.period_s[1]
        * (BEND_SHARE * abs(growth) + np.maximum(LIMITS.kink_share * kink, sudden))
        * (number - 1)
    )


def _contradiction(
    particles: Particles, row: RowPair, branches: Branches, move: _Move
) -> np.ndarray:
    """Cost (PARTICLES,), sigma^2, of three contradictions: the last edge lies after the row's end;
    the first edge passed lies before the end of the row that reported the edge before it; the row
    has a new value but neither an edge nor the value of a timeout sample.
    """
    sigma_s = TICK_S + move.error_s
    late = (np.maximum(move.time_s - row.now_s - particles.half_s, 0.0) / sigma_s) ** 2
    not_before = max(row.shown_s, row.before_s) if row.one_edge else row.shown_s
    first_early_s = not_before - particles.time_s - move.first_s - particles.half_s
    early = (np.maximum(first_early_s, 0.0) / sigma_s) ** 2
    off_timeout_s = np.abs(row.now_s - particles.time_s - row.period_s[1]) - particles.half_s
    unlike = (np.maximum(off_timeout_s, 0.0) / sigma_s) ** 2
    is_new_value = not row.repeats and not row.counts
    unlike = np.where(move.stays & ~branches.known & is_new_value, unlike, 0.0)
    limit = LIMITS.reject_cost
    misplaced = np.minimum(late, limit) + np.minimum(early, limit)
    return np.where(branches.timeout, 0.0, misplaced) + np.minimum(unlike, limit)


def _speed_change(
    particles: Particles, row: RowPair, branches: Branches, move: _Move
) -> _SpeedChange:
    """Speed of each particle in the last period, and the deviation of its change per time from the
    change before.
    """
    speed, period, timeout = row.speed_rpm[1], row.period_s[1], branches.timeout
    own = move.number
    if row.missing_rows:
        own = np.clip(np.ceil((move.time_s - row.start_s) / period), 1, move.number)
    span = np.where(timeout, move.time_s - particles.time_s, period * (own if row.counts else 1))
    middle = np.where(move.stays, particles.middle_s, move.time_s - 0.5 * span)
    seen = np.where(timeout, speed * period * move.number / np.where(timeout, span, 1.0), speed)
    dt = np.maximum(middle - particles.middle_s, LIMITS.min_step_s)
    slope = np.where(move.stays, particles.slope, (seen - particles.speed) / dt)
    jump = np.nan_to_num(np.abs(slope - particles.slope) * dt)
    rate = abs(speed - row.speed_rpm[0]) / max(row.now_s - particles.now_s, LIMITS.min_step_s)
    sigma = _jump_sigma(particles, row, move.number, rate)
    sigma = np.where(timeout, np.hypot(sigma, seen * particles.half_s / span), sigma)
    return _SpeedChange(seen, slope, middle, jump, sigma, rate)


def _jump_sigma(particles: Particles, row: RowPair, number: np.ndarray, rate: float) -> float:
    """Standard deviation, rpm, of the deviation from uniform acceleration: noise of the speed, and
    how much accelerations change.
    """
    speed, period = row.speed_rpm[1], row.period_s[1]
    edges = np.mean(number) if row.counts else 1.0
    noise = abs(speed) * (LIMITS.edge_jitter_s + row.rounding_s) / (period * edges)
    return np.hypot(
        LIMITS.jump_factor * max(noise, particles.speed_jump),
        LIMITS.curve_share * max(rate, particles.rate) * period,
    )


def _update(particles: Particles, row: RowPair, move: _Move, change: _SpeedChange) -> None:
    """Set the particles' state to that at the row's end."""
    new, kept = LIMITS.smoothing, 1.0 - LIMITS.smoothing
    growth = particles.growth_until(row)
    particles.growth_change = kept * particles.growth_change + new * abs(growth - particles.growth)
    particles.now_s, particles.rate, particles.growth = row.now_s, change.rate, growth
    best_jump = float(change.jump[np.argmin(particles.cost)])
    particles.speed_jump = kept * particles.speed_jump + new * best_jump
    particles.time_s = np.minimum(move.time_s, row.now_s + TICK_S)
    particles.slope, particles.middle_s = change.slope, change.middle_s
    particles.speed = np.where(move.stays, particles.speed, change.speed)


def _widen(particles: Particles, row: RowPair, branches: Branches, move: _Move) -> None:
    """Add the error of the passed periods to the particles' half widths: in full where the speed
    repeats, because equal values are rounded alike, else as independent errors.
    """
    error_s = float(move.error_s[particles.alive()].max()) if row.counts else move.error_s
    if row.repeats:
        wider_s = particles.half_s + error_s
    else:
        wider_s = np.hypot(particles.half_s, error_s)
    particles.half_s = np.where(branches.known, row.rounding_s + TICK_S, wider_s)
