"""Particles of the filter that locates hidden Hall edges: their state, their limits, resampling
and branching.
"""

from dataclasses import dataclass

import numpy as np

from vgroove.gap.hall_edges.hidden_periods import (
    ONE_EDGE_ROWS,
    TICK_S,
    accelerated_edge_times,
    counted_edge_times,
)

PARTICLES = 64  # chosen on the tuning half of the blind set


@dataclass(frozen=True)
class ParticleLimits:
    """Limits of the particle filter; those without a derivation were chosen on the tuning half of
    the blind set.
    """

    # resampling
    filled: int = 48  # particles in use after resampling; the others are free for branches
    resample_edges: int = 8  # edges between two resamplings
    min_alive: int = 32  # with fewer particles alive (half of all) these are split at once
    reject_cost: float = 25.0  # cost above the best particle's at which one is rejected: 5 sigma
    free_cost: float = 50.0  # cost given to a free particle; above reject_cost
    row_cost: float = 16.0  # largest cost of one row's speed change (outliers): 4 sigma
    # branches to a timeout sample
    timeout_branches: int = 8  # most particles that branch at one row
    replace_cost: float = 4.0  # a branch replaces only particles that are worse than this: 2 sigma
    # noise of time and speed
    edge_jitter_s: float = 5e-7  # standard deviation of one edge's time stamp, s
    jump_factor: float = 3.0  # standard deviation of a speed jump, in units of the noise
    curve_share: float = 0.3  # of the speed change in a period, by which the next change may differ
    smoothing: float = 0.1  # weight of the newest value in exponential means
    min_step_s: float = 1e-6  # smallest time difference that is divided by, s
    # unknown motion between two reported periods
    kink_share: float = 0.25  # of a change of the periods' growth (kink): error of a hidden period
    kink_factor: float = 4.0  # usual changes of growth above which one is sudden (command step)
    # rows into which no edge falls
    timeout_share: float = 0.003  # of a period: largest mismatch of timeout sample and particle
    gap_periods: float = 3.0  # periods, besides one row, that pass at most without an edge


LIMITS = ParticleLimits()


@dataclass(frozen=True)
class RowPair:
    """One row of a chain and the row before it.

    shown_s: end of the row that reports the edge before; before_s: end of the last row read;
    start_s, now_s: start and end of this row; speed_rpm, period_s: reported values of both rows;
    rounding_s: error of period_s[1] from the speed's resolution; counts: the sensor counts edges.
    """

    shown_s: float
    before_s: float
    start_s: float
    now_s: float
    speed_rpm: tuple[float, float]
    period_s: tuple[float, float]
    rounding_s: float
    counts: bool

    @property
    def repeats(self) -> bool:
        """Whether both rows report the same value."""
        return self.speed_rpm[0] == self.speed_rpm[1]

    @property
    def missing_rows(self) -> bool:
        """Whether rows of a sensor that counts edges are missing before this one."""
        return self.counts and self.start_s > self.before_s

    @property
    def one_edge(self) -> bool:
        """Whether periods are so long that at most one edge falls into the row."""
        return min(self.period_s) > ONE_EDGE_ROWS * (self.now_s - self.before_s)

    def most_edges(self, since_s: float) -> int:
        """Bound on the number of edges from since_s to the row's end: two more than fit."""
        return int((self.now_s - since_s) / min(self.period_s)) + 2

    def edge_times(self, most: int) -> np.ndarray:
        """Times (most,), s, from the last edge to the edges after it."""
        if self.counts:
            rows_s = (self.before_s, self.start_s, self.now_s)
            return counted_edge_times(*self.period_s, most, rows_s)
        return accelerated_edge_times(*self.period_s, most)


@dataclass
class Particles:
    """State of all particles, arrays (PARTICLES,), and what they share.

    time_s: time of the last edge; cost: -2 log weight relative to the best particle, sigma^2;
    slope: last change of speed per time, rpm/s; speed: last speed, rpm; middle_s: middle of the
    last period; half_s: half width of the interval of edge times that the particle stands for.
    now_s: end of the last row; rate: change of speed in it, rpm/s; growth: change of the period in
    it, s/s; growth_change: exponential mean of |change of growth|; speed_jump: exponential mean of
    the best particle's deviation from uniform acceleration, rpm.
    """

    time_s: np.ndarray
    cost: np.ndarray
    slope: np.ndarray
    speed: np.ndarray
    middle_s: np.ndarray
    half_s: np.ndarray
    now_s: float
    rate: float = 0.0
    growth: float = 0.0
    growth_change: float = 0.0
    speed_jump: float = 0.0

    def alive(self) -> np.ndarray:
        """Particles (PARTICLES,) that are not rejected."""
        return self.cost < LIMITS.reject_cost

    def widest_s(self) -> float:
        """Half width of the widest particle that is alive, s."""
        return float(self.half_s[self.alive()].max())

    def growth_until(self, row: RowPair) -> float:
        """Change of the period over the row, s/s."""
        return (row.period_s[1] - row.period_s[0]) / max(row.now_s - self.now_s, LIMITS.min_step_s)


def first_particles(low_s: float, now_s: float, period_s: float, speed_rpm: float) -> Particles:
    """Particles that divide the time from low_s to the row's end now_s evenly."""
    half = 0.5 * (now_s - low_s) / PARTICLES
    start = low_s + half * (2.0 * np.arange(PARTICLES) + 1.0)
    return Particles(
        start,
        np.zeros(PARTICLES),
        np.full(PARTICLES, np.nan),
        np.full(PARTICLES, speed_rpm),
        start - 0.5 * period_s,
        np.full(PARTICLES, half),
        now_s,
    )


def restart(particles: Particles, row: RowPair) -> tuple[np.ndarray, np.ndarray]:
    """Spread the particles evenly over a row that reports an edge of its own; returns the parent of
    each and the edges since the one before, both (PARTICLES,).
    """
    parent = np.full(PARTICLES, int(np.argmin(particles.cost)))
    particles.half_s = np.full(PARTICLES, 0.5 * (row.now_s - row.before_s) / PARTICLES)
    particles.time_s = row.before_s + particles.half_s * (2.0 * np.arange(PARTICLES) + 1.0)
    particles.cost = np.zeros(PARTICLES)
    particles.slope = np.full(PARTICLES, np.nan)
    particles.speed = np.full(PARTICLES, row.speed_rpm[1])
    particles.middle_s = particles.time_s - 0.5 * row.period_s[1]
    return parent, np.ones(PARTICLES, dtype=int)


def resample(particles: Particles, counts: bool) -> tuple[np.ndarray, np.ndarray]:
    """Split the particles that are alive so that they take the place of those rejected; returns the
    parent of each new particle and its distance from the parent's middle, s, both (PARTICLES,).

    Resampling is deterministic: an interval is cut into equal parts, in place of drawing copies at
    random. Where most particles are alive none is split.
    """
    alive = np.flatnonzero(particles.alive())
    count, number = len(alive), np.arange(PARTICLES)
    filled = PARTICLES if counts else LIMITS.filled
    if count > LIMITS.min_alive:
        return number, np.zeros(PARTICLES)
    parent = alive[np.minimum(number, filled - 1) * count // filled]
    parts = np.bincount(parent[:filled], minlength=PARTICLES)[parent]
    part = np.minimum(number - np.searchsorted(parent, parent), parts - 1)
    shift = particles.half_s[parent] * ((2.0 * part + 1.0) / parts - 1.0)
    particles.half_s = particles.half_s[parent] * (count / PARTICLES if counts else 1.0 / parts)
    particles.time_s = particles.time_s[parent] + shift
    particles.cost = particles.cost[parent] + np.where(number < filled, 0.0, LIMITS.free_cost)
    particles.slope, particles.speed = particles.slope[parent], particles.speed[parent]
    particles.middle_s = particles.middle_s[parent] + shift
    return parent, shift


@dataclass
class Branches:
    """Particles (PARTICLES,) that take one of several readings of a row.

    earlier: True where the row reports the edge before the last one that fits. edges: number of
    edges since the last one where the row is a timeout sample, -1 where the number is open.
    """

    earlier: np.ndarray
    edges: np.ndarray

    @property
    def known(self) -> np.ndarray:
        """Particles whose number of edges is fixed."""
        return self.edges >= 0

    @property
    def timeout(self) -> np.ndarray:
        """Particles for which the row reports the time since an edge of its own."""
        return self.edges > 0


Ancestry = tuple[np.ndarray, np.ndarray]  # parents and shifts (PARTICLES,) of the row before


def branch(particles: Particles, ancestry: Ancestry, row: RowPair) -> Branches:
    """Copy particles for which a row can be read in two ways, so that one copy continues with each
    reading. A row of a sensor that counts edges has one reading.
    """
    branches = Branches(np.zeros(PARTICLES, dtype=bool), np.full(PARTICLES, -1))
    if row.counts:
        return branches
    branches.earlier = _branch_to_earlier_edge(particles, ancestry, row)
    branches.edges = _branch_to_timeout(particles, ancestry, row)
    return branches


def _branch_to_earlier_edge(particles: Particles, ancestry: Ancestry, row: RowPair) -> np.ndarray:
    """Particles (PARTICLES,) for which the row reports the edge before the last one that fits.

    While the shaft slows down the next edge may come after the row's end. The copies take the place
    of rejected particles.
    """
    length = accelerated_edge_times(*row.period_s, max(row.most_edges(particles.time_s.min()), 2))
    step = np.searchsorted(length, row.now_s - particles.time_s, side="right")
    fewer = np.clip(step - 1, 1, len(length))
    slowing = (row.period_s[1] / row.period_s[0]) ** (1.0 / fewer)
    coming = particles.time_s + length[fewer - 1] + row.period_s[1] * slowing
    alive = particles.alive()
    both = np.flatnonzero(alive & (step > 1) & (coming > row.now_s))
    free = np.flatnonzero(~alive)
    both = both[np.argsort(particles.cost[both], kind="stable")][: len(free)]
    copies = free[: len(both)]
    _copy(particles, ancestry, both, copies)
    earlier = np.zeros(PARTICLES, dtype=bool)
    earlier[copies] = True
    return earlier


def _branch_to_timeout(particles: Particles, ancestry: Ancestry, row: RowPair) -> np.ndarray:
    """Number of edges since the last one (PARTICLES,) for particles that read the row as a timeout
    sample; -1 for all others.

    The row reports the time since the last edge, or since an edge of its own if that time is longer
    than the period which ended there, as while a shaft slows down fast. The copies take the place
    of particles that are far less likely.
    """
    edges = np.full(PARTICLES, -1)
    number, possible = _timeout_readings(particles, row)
    able = np.flatnonzero(particles.alive() & possible)
    able = able[np.argsort(particles.cost[able], kind="stable")][: LIMITS.timeout_branches]
    other = np.argsort(-particles.cost, kind="stable")[: len(able)]
    keep = (particles.cost[other] > LIMITS.replace_cost) & ~np.isin(other, able)
    able, other = able[: np.count_nonzero(keep)], other[keep]
    _copy(particles, ancestry, able, other)
    edges[other] = number[able]
    return edges


def _timeout_readings(particles: Particles, row: RowPair) -> tuple[np.ndarray, np.ndarray]:
    """Edges (PARTICLES,) from each particle's last edge to the one since which the row would report
    the time, and whether that reading is possible.
    """
    # edge_s: the edge since which the row would report the time, at `number` pitches after the
    # particle's last edge; shows: mean speed in between, with the relative error `unsure`
    speed, edge_s = abs(row.speed_rpm[1]), row.now_s - row.period_s[1]
    pitch, apart = speed * row.period_s[1], edge_s - particles.time_s
    number = np.maximum(np.round(np.abs(particles.speed) * apart / pitch), 1.0)
    shows = number * pitch / np.maximum(apart, TICK_S)
    unsure = particles.half_s / np.maximum(apart, TICK_S)
    own = (
        (edge_s > row.before_s)
        & (shows * (1.0 - unsure) > speed)
        & (shows * (1.0 - unsure) <= np.abs(particles.speed))
    )
    near = np.abs(apart) < particles.half_s + row.rounding_s + TICK_S
    is_slower = speed < np.abs(particles.speed)
    none = (edge_s <= row.before_s + row.rounding_s + TICK_S) & near & is_slower
    return np.where(none, 0, number).astype(int), own | none


def _copy(particles: Particles, ancestry: Ancestry, one: np.ndarray, other: np.ndarray) -> None:
    """Overwrite the particles `other` (k,) with the particles `one` (k,)."""
    for values in (
        particles.time_s,
        particles.cost,
        particles.slope,
        particles.speed,
        particles.middle_s,
        particles.half_s,
        *ancestry,
    ):
        values[other] = values[one]
