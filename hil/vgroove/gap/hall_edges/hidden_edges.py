"""Locates the Hall edges of a chain whose rows report only the last of several edges, with a
particle filter.

A row reports the period of its last edge; how many edges passed since the last edge of the row
before is hidden. At a steady speed any time of the last edge within one period agrees with the
rows. While the speed changes only one time makes the accelerations of successive rows agree.

The filter [1, 2] follows PARTICLES hypotheses of the last edge's time. Each stands for a short
interval of time [3] and passes the hidden edges at uniform acceleration; its cost (-2 log weight)
grows by the squared deviation of its speed from uniform acceleration. Resampling is deterministic.
Edge times are the weighted means over the particles' ancestors (fixed-lag smoothing [4]).

[1] Gordon, Salmond, Smith: Novel approach to nonlinear/non-Gaussian Bayesian state estimation,
    IEE Proc. F 140(2), 1993.
[2] Arulampalam et al.: A tutorial on particle filters, IEEE Trans. Signal Process. 50(2), 2002.
[3] Abdallah, Gning, Bonnifait: Box particle filtering, Automatica 44(3), 2008.
[4] Kitagawa: Monte Carlo filter and smoother, J. Comput. Graph. Stat. 5(1), 1996.
"""

from dataclasses import dataclass

import numpy as np

from vgroove.gap.hall_edges.chain import EdgeChain
from vgroove.gap.hall_edges.hidden_periods import TICK_S, first_hidden_period
from vgroove.gap.hall_edges.particle_step import propagate
from vgroove.gap.hall_edges.particles import (
    LIMITS,
    PARTICLES,
    Particles,
    RowPair,
    branch,
    first_particles,
    resample,
    restart,
)


@dataclass(frozen=True)
class SmoothingLimits:
    """Limits of the backward pass, chosen on the tuning half of the blind set."""

    edges: int = 100  # later edges that correct an edge's time: beyond, rounding errors accumulate
    contradiction: float = 1.0  # cost, sigma^2, above which the best particle contradicts a row
    contradicted_share: float = 0.05  # of the rows: above it an edge too many or too few is counted
    contradicted_rows: float = 2.0  # rows that may contradict a chain of any length


SMOOTHING = SmoothingLimits()


@dataclass(frozen=True)
class HiddenEdges:
    """Edges that the rows of a chain report (m,).

    end_s: time of the edge; slack_s: half width of the interval that it lies in; step: edges since
    the one before; timeout: True where the row's value is not the period that the edge ends but the
    time since the edge (a timeout sample).
    """

    end_s: np.ndarray
    slack_s: np.ndarray
    step: np.ndarray
    timeout: np.ndarray


@dataclass
class _Path:
    """History of the particles, edge by edge (m, PARTICLES): time of the edge, edges since the one
    before, whether the row is a timeout sample, cost of contradictions with the row, parent in the
    row before, distance from the parent's middle; half width of the widest particle (m,).
    """

    time_s: np.ndarray
    step: np.ndarray
    timeout: np.ndarray
    contradiction: np.ndarray
    parent: np.ndarray
    shift_s: np.ndarray
    half_s: np.ndarray

    @staticmethod
    def of(m: int, particles: Particles) -> "_Path":
        """History of m edges, filled for the first one."""
        zeros = np.zeros((m, PARTICLES))
        return _Path(
            np.tile(particles.time_s, (m, 1)),
            np.ones((m, PARTICLES), dtype=int),
            zeros.astype(bool),
            zeros.copy(),
            np.tile(np.arange(PARTICLES), (m, 1)),
            zeros.copy(),
            np.full(m, particles.half_s[0]),
        )


@dataclass(frozen=True)
class _Rows:
    """Arrays (m,) of a chain's rows; see RowPair."""

    before_s: np.ndarray
    start_s: np.ndarray
    now_s: np.ndarray
    speed_rpm: np.ndarray
    period_s: np.ndarray
    rounding_s: np.ndarray
    counts: bool

    def pair(self, i: int) -> RowPair:
        """Row i and the one before it."""
        return RowPair(
            self.now_s[i - 1],
            self.before_s[i],
            self.start_s[i],
            self.now_s[i],
            (self.speed_rpm[i - 1], self.speed_rpm[i]),
            (self.period_s[i - 1], self.period_s[i]),
            self.rounding_s[i],
            self.counts,
        )


def track_hidden_edges(
    now_s: np.ndarray, start_s: np.ndarray, chain: EdgeChain, half_lsb_rpm: float, counts: bool
) -> HiddenEdges | None:
    """Times of a chain's edges, one for each row from start_s to now_s (m,); None where the rows
    contradict one another.

    half_lsb_rpm: half the resolution of the speed; counts: the sensor reports the mean over all
    edges of a row.
    """
    speed, period, before = (
        np.asarray(x) for x in (chain.speed_rpm, chain.period_s, chain.before_s)
    )
    rounding = period * half_lsb_rpm / np.abs(speed)
    rows = _Rows(before, start_s, now_s, speed, period, rounding, counts)
    low_s = max(now_s[0] - period[0], before[0])
    particles = first_particles(low_s, now_s[0], period[0], speed[0])
    path = _Path.of(len(now_s), particles)
    for i in range(1, len(now_s)):
        _advance(particles, path, rows.pair(i), i)
    found = _backtrace(particles, path, rounding)
    return found if found is None or counts else _last_in_row(found, now_s, period)


def _advance(particles: Particles, path: _Path, row: RowPair, i: int) -> None:
    """Move the particles over row i and record the result in the path. New particles are spread
    over the row if it contradicts all particles, or if no edge came for too long.
    """
    unseen_s = row.now_s - np.max(particles.time_s[particles.alive()])
    branches = branch(particles, (path.parent[i - 1], path.shift_s[i - 1]), row)
    path.timeout[i] = branches.timeout
    path.step[i], path.contradiction[i] = propagate(particles, row, branches)
    contradicted = row.one_edge and not np.any(
        particles.alive() & (path.contradiction[i] < LIMITS.row_cost)
    )
    longest_s = row.now_s - row.before_s + LIMITS.gap_periods * row.period_s[1]
    if contradicted or unseen_s > longest_s:
        path.parent[i], path.step[i] = restart(particles, row)
        path.timeout[i] = False
    path.time_s[i], path.half_s[i] = particles.time_s, particles.widest_s()
    few_alive = np.count_nonzero(particles.alive()) < LIMITS.min_alive
    if i % LIMITS.resample_edges == 0 or few_alive:
        path.parent[i], path.shift_s[i] = resample(particles, row.counts)


def _last_in_row(found: HiddenEdges, now_s: np.ndarray, period_s: np.ndarray) -> HiddenEdges:
    """Edges of which each is the last one before its row's end now_s (m,).

    When a row is read, a particle may be too wide to decide whether its edge lies before or after
    the row's end; the smoothed times decide it.
    """
    end, step = found.end_s.copy(), found.step.copy()
    sooner, later = end > now_s + found.slack_s, end + period_s < now_s - found.slack_s
    for i in np.flatnonzero((sooner | later)[:-1] & (step[:-1] > 0) & ~found.timeout[:-1]):
        more = 1 if later[i] else -1
        if step[i] + more > 0 and step[i + 1] - more > 0:
            end[i] += (
                period_s[i]
                if later[i]
                else -float(first_hidden_period(period_s[i], period_s[i + 1], step[i + 1] + 1))
            )
            step[i], step[i + 1] = step[i] + more, step[i + 1] - more
    return HiddenEdges(end, found.slack_s, step, found.timeout)


def _backtrace(particles: Particles, path: _Path, rounding_s: np.ndarray) -> HiddenEdges | None:
    """Weighted mean and spread of each edge's time (m,) over the particles' ancestors; None where
    the best particle contradicts too many rows.

    A particle's distance from its parent's middle also corrects the times of its ancestors, with a
    weight that decays exponentially over SMOOTHING.edges edges.
    """
    m, weight = len(path.time_s), np.exp(-0.5 * particles.cost)
    weight /= weight.sum()
    best = int(np.argmax(weight))
    at, moved, contradicted = np.arange(PARTICLES), np.zeros(PARTICLES), 0
    end, spread = np.empty(m), np.empty(m)
    step, timeout = np.ones(m, dtype=int), np.zeros(m, dtype=bool)
    for i in range(m - 1, -1, -1):
        moved = np.clip(
            (1.0 - 1.0 / SMOOTHING.edges) * moved + path.shift_s[i][at],
            -path.half_s[i],
            path.half_s[i],
        )
        at = path.parent[i][at]
        here = path.time_s[i][at] + moved
        end[i] = weight @ here
        spread[i] = np.sqrt(weight @ (here - end[i]) ** 2)
        step[i], timeout[i] = path.step[i][at[best]], path.timeout[i][at[best]]
        contradicted += path.contradiction[i][at[best]] > SMOOTHING.contradiction
    if contradicted > max(SMOOTHING.contradicted_rows, SMOOTHING.contradicted_share * m):
        return None
    half = _smallest_half_widths(path.half_s, particles.widest_s(), timeout)
    # a uniform distribution over +-half has the standard deviation half / sqrt(3)
    known = np.hypot(spread, half / np.sqrt(3.0))
    return HiddenEdges(end, np.sqrt(3.0) * known + rounding_s + TICK_S, step, timeout)


def _smallest_half_widths(
    half_s: np.ndarray, last_half_s: float, timeout: np.ndarray
) -> np.ndarray:
    """Least half width (m,), s, of the widest particle at each edge and the SMOOTHING.edges after
    it. A timeout sample bounds its own edge and those after it, none before.
    """
    half = np.append(half_s[1:], last_half_s)
    for part in np.split(np.arange(len(half)), np.flatnonzero(timeout)):
        padded = np.pad(half[part], (0, SMOOTHING.edges - 1), mode="edge")
        ahead = np.lib.stride_tricks.sliding_window_view(padded, SMOOTHING.edges)
        half[part] = np.minimum(half_s[part], ahead.min(axis=1))
    return half
