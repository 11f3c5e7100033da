"""Places in time the edges of a chain whose rows show only the last of several: how many came in
between no row says.

At a steady speed any place within a period fits the rows; while the speed changes only one does. So
places are carried along the chain as weighted cells: each goes on from edge to edge by the measured
periods, counts those that no row shows, and loses weight where the speeds would then jump.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

PARTICLES = 64
FILLED = 48  # of them, when they are replaced: the others are room for cells that go both ways
MEMORY = 100  # edges over which later ones tell where an edge was: periods drift
EVERY = 8  # edges after which cells that were given up are replaced
TICK_S = 2e-6  # slack of every bound: time stamps and edge stamps are rounded to about this much
EDGE_S = 5e-7  # jitter of an edge
# of the change between two periods, by which each unseen period between them may differ from a
# steady acceleration's
BEND_SHARE = 0.02
KINK_SHARE = 0.25  # of a change of that change, unless that is
SUDDEN = 4.0  # times the usual one
CURVED = 0.3  # of the change of speed in a period, by which it may differ from that before
DULL = 3.0  # times the noise, within which a jump of the speed tells nothing
# of a period, by which a wait that a row seems to show may miss a cell that is wider
NEARLY = 0.003
# periods, and a row, that pass at most without an edge; longer, a row that seemed to wait showed
# one
BETWEEN = 3.0
PLAIN = 1.5  # times a row's length, from which on a period shows in a row of its own
# cells that go on to a wait, at most, each in place of one that is so many squared sigmas worse
# than the best
WAITING, UNLIKELY = 8, 4.0
WORST = 16.0  # squared sigmas that one row costs at most
HOPELESS = 25.0  # squared sigmas worse than the best at which a cell is given up
CONTRADICTED = 0.05  # of the rows: beyond that the chain holds an edge too many or too few


@dataclass(frozen=True)
class HiddenEdges:
    """Of each edge that a row shows (m,): its time, the half width of what is known about it, edges
    since the one before, and whether the row's speed is not the period that it ends but the wait
    since.
    """

    end_s: np.ndarray
    slack_s: np.ndarray
    step: np.ndarray
    waited: np.ndarray


@dataclass
class _Particles:
    """Where the last edge may be: time, cost, slope of the speed and the speed there, middle of its
    period, half width of the cell, all (CELLS,); the last row's time, how fast speeds and periods
    changed in it, how much the latter changes, and how uneven the speeds are.
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
    kink: float = 0.0
    unrest: float = 0.0

    def widest_s(self) -> float:
        """Half width of the widest cell that is alive."""
        return float(self.half_s[self.cost < HOPELESS].max())


@dataclass
class _Path:
    """What became of the cells, edge by edge (m, CELLS): time, edges since the last, whether the
    row shows the wait since, contradictions, which cell each was part of before and how far from
    its middle; half width of the widest (m,).
    """

    time_s: np.ndarray
    step: np.ndarray
    waited: np.ndarray
    wrong: np.ndarray
    parent: np.ndarray
    shift_s: np.ndarray
    half_s: np.ndarray

    @staticmethod
    def of(m: int, start_s: np.ndarray, half_s: float) -> "_Path":
        """Room for m edges, the first at start_s (CELLS,)."""
        nothing = np.zeros((m, PARTICLES))
        return _Path(
            np.tile(start_s, (m, 1)),
            np.ones((m, PARTICLES), dtype=int),
            nothing.astype(bool),
            nothing.copy(),
            np.tile(np.arange(PARTICLES), (m, 1)),
            nothing.copy(),
            np.full(m, half_s),
        )


def counted_lengths(
    previous_s: float, period_s: float, most: int, rows_s: tuple[float, float, float]
) -> np.ndarray:
    """Time (most,) from an edge to the first, second, ... edge after it of a sensor that counts: a
    row states the mean over its own edges. Those of missing rows before it, between the ends of the
    row read before and of the last missing one, passed at the mean of both speeds.
    """
    number, (before, since, now) = np.arange(1, most + 1), rows_s
    if since <= before:
        return period_s * number
    missing_s = 2.0 / (1.0 / previous_s + 1.0 / period_s)
    return missing_s * number + (period_s - missing_s) * np.minimum(
        number, (now - since) / period_s
    )


def unseen_lengths(previous_s: float, period_s: float, most: int) -> np.ndarray:
    """Time (most,) from an edge to the first, second, ... edge after it, if the last of them ends a
    period of period_s: unseen ones lie as a steady acceleration puts them.
    """
    number = np.arange(1, most + 1)
    share = np.tril(number[None, :] / number[:, None])
    rate = 1.0 / previous_s**2 + (1.0 / period_s**2 - 1.0 / previous_s**2) * share
    return np.tril(1.0 / np.sqrt(rate)).sum(axis=1)


class RowChain(Protocol):
    """Edges that follow one another, a row each: see edges.py."""

    row: list[int]
    before_s: list[float]
    speed_rpm: list[float]
    period_s: list[float]
    falls: list[tuple[int, int, float]]


def track_hidden_edges(
    now_s: np.ndarray, start_s: np.ndarray, chain: RowChain, half_lsb_rpm: float, counts: bool
) -> HiddenEdges | None:
    """Places of a chain's edges, which rows from start_s to now_s (m,) show, each later than the
    row read before; None where the rows contradict one another.
    """
    speed, period, before = (
        np.asarray(x) for x in (chain.speed_rpm, chain.period_s, chain.before_s)
    )
    rounding = period * half_lsb_rpm / np.abs(speed)
    m, low = len(now_s), max(now_s[0] - period[0], before[0])
    half = 0.5 * (now_s[0] - low) / PARTICLES
    start = low + half * (2.0 * np.arange(PARTICLES) + 1.0)
    cells = _Particles(
        start,
        np.zeros(PARTICLES),
        np.full(PARTICLES, np.nan),
        np.full(PARTICLES, speed[0]),
        start - 0.5 * period[0],
        np.full(PARTICLES, half),
        now_s[0],
    )
    path = _Path.of(m, start, half)
    for i in range(1, m):
        unseen_s = now_s[i] - np.max(cells.time_s[cells.cost < HOPELESS])
        before_that = path.parent[i - 1], path.shift_s[i - 1]
        fewer, unshown = np.zeros(PARTICLES, dtype=bool), np.full(PARTICLES, -1)
        if not counts:
            fewer = _branch(cells, before_that, (period[i - 1], period[i]), now_s[i])
            unshown = _branch_to_wait(
                cells, before_that, (before[i], now_s[i]), speed[i], period[i], rounding[i]
            )
        path.waited[i] = unshown > 0
        path.step[i], path.wrong[i] = _follow(
            cells,
            (now_s[i - 1], before[i], start_s[i], now_s[i]),
            (speed[i - 1], speed[i]),
            (period[i - 1], period[i]),
            rounding[i],
            counts,
            fewer,
            unshown,
        )
        interval_s = now_s[i] - before[i]
        plain = min(period[i - 1], period[i]) > PLAIN * interval_s
        if plain and _lost(cells, path.wrong[i]) or unseen_s > interval_s + BETWEEN * period[i]:
            path.parent[i], path.step[i] = _begin_again(
                cells, before[i], now_s[i], period[i], speed[i]
            )
            path.waited[i] = False
        path.time_s[i], path.half_s[i] = cells.time_s, cells.widest_s()
        if i % EVERY == 0 or np.count_nonzero(cells.cost < HOPELESS) < PARTICLES // 2:
            path.parent[i], path.shift_s[i] = _renew(cells, counts)
    found = _traced(cells, path, rounding)
    return found if found is None or counts else _last_in_row(found, now_s, period)


def _last_in_row(found: HiddenEdges, now_s: np.ndarray, period_s: np.ndarray) -> HiddenEdges:
    """Places of which each is that of the last edge before its row's end: when a row passed, its
    cell may have been too wide to tell.
    """
    end, step = found.end_s.copy(), found.step.copy()
    sooner, later = end > now_s + found.slack_s, end + period_s < now_s - found.slack_s
    for i in np.flatnonzero((sooner | later)[:-1] & (step[:-1] > 0) & ~found.waited[:-1]):
        more = 1 if later[i] else -1
        if step[i] + more > 0 and step[i + 1] - more > 0:
            end[i] += (
                period_s[i]
                if later[i]
                else -float(unseen_first(period_s[i], period_s[i + 1], step[i + 1] + 1))
            )
            step[i], step[i + 1] = step[i] + more, step[i + 1] - more
    return HiddenEdges(end, found.slack_s, step, found.waited)


def _follow(
    cells: _Particles,
    rows: tuple[float, float, float, float],
    speed: tuple[float, float],
    period: tuple[float, float],
    rounding: float,
    counts: bool,
    fewer: np.ndarray,
    unshown: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Move every cell to the last edge up to now; the steps (CELLS,), and what contradicts the
    rows: that of the edge before, the last one that seems to show no other edge, the start of the
    new one, and now.

    No edge of its own has, perhaps, a row that repeats a value, one that shows the wait for the
    next edge, and one of a sensor that counts (it states the last period then).
    """
    (shown, before, since, now), plain = rows, min(period) > PLAIN * (rows[3] - rows[1])
    missing = counts and since > before
    most = int((now - cells.time_s.min()) / min(period)) + 2
    length = counted_lengths(*period, most, rows[1:]) if counts else unseen_lengths(*period, most)
    repeats = speed[0] == speed[1]
    unsure = np.minimum(cells.half_s, NEARLY * period[1]) + TICK_S + rounding
    waits = (np.abs(now - cells.time_s - period[1]) < unsure) & (
        np.abs(speed[1]) < np.abs(cells.speed)
    )
    step = np.clip(
        np.searchsorted(length, now - cells.time_s, side="right"),
        0 if repeats or counts else 1,
        most,
    )
    step[fewer] -= 1
    step[waits] = 0
    known, waited = unshown >= 0, unshown > 0
    step[known] = unshown[known]
    stays = step == 0
    number = np.maximum(step, 1)
    first = length[0] if counts else unseen_first(period[0], period[1], number)
    new = np.where(stays, cells.time_s, cells.time_s + length[np.minimum(number, most) - 1])
    new = np.where(known, now - period[1], new)
    drift = rounding * number + (
        0.0 if counts and not missing else _bend(cells, period, now, number)
    )
    slack = TICK_S + drift
    late = (np.maximum(new - now - cells.half_s, 0.0) / slack) ** 2
    early = (
        np.maximum(
            (max(shown, before) if plain else shown) - cells.time_s - first - cells.half_s, 0.0
        )
        / slack
    ) ** 2
    # a new value without an edge is a wait
    unlike = (np.maximum(np.abs(now - cells.time_s - period[1]) - cells.half_s, 0.0) / slack) ** 2
    unlike = np.where(stays & ~known & (not repeats and not counts), unlike, 0.0)
    wrong = np.where(
        waited, 0.0, np.minimum(late, HOPELESS) + np.minimum(early, HOPELESS)
    ) + np.minimum(unlike, HOPELESS)
    own = np.clip(np.ceil((new - since) / period[1]), 1, number) if missing else number
    span = np.where(waited, new - cells.time_s, period[1] * (own if counts else 1))
    middle = np.where(stays, cells.middle_s, new - 0.5 * span)
    seen = np.where(waited, speed[1] * period[1] * number / np.where(waited, span, 1.0), speed[1])
    dt = np.maximum(middle - cells.middle_s, 1e-6)
    slope = np.where(stays, cells.slope, (seen - cells.speed) / dt)
    jump = np.nan_to_num(np.abs(slope - cells.slope) * dt)
    noise = abs(speed[1]) * (EDGE_S + rounding) / (period[1] * (np.mean(number) if counts else 1.0))
    rate = abs(speed[1] - speed[0]) / max(now - cells.now_s, 1e-6)
    scale = np.hypot(DULL * max(noise, cells.unrest), CURVED * max(rate, cells.rate) * period[1])
    scale = np.where(waited, np.hypot(scale, seen * cells.half_s / span), scale)
    cells.cost = cells.cost + wrong + np.minimum((jump / scale) ** 2, WORST)
    cells.cost -= cells.cost.min()
    growth = _growth(cells, period, now)
    cells.kink = 0.9 * cells.kink + 0.1 * abs(growth - cells.growth)
    cells.now_s, cells.rate, cells.growth = now, rate, growth
    cells.unrest = 0.9 * cells.unrest + 0.1 * float(jump[np.argmin(cells.cost)])
    cells.time_s, cells.slope, cells.middle_s = np.minimum(new, now + TICK_S), slope, middle
    cells.speed = np.where(stays, cells.speed, seen)
    drift = float(drift[cells.cost < HOPELESS].max()) if counts else drift
    # a speed that repeats is rounded alike every time
    wider_s = cells.half_s + drift if repeats else np.hypot(cells.half_s, drift)
    cells.half_s = np.where(known, rounding + TICK_S, wider_s)
    return step, wrong


def _growth(cells: _Particles, period: tuple[float, float], now: float) -> float:
    """Change of the period over the last row, per second."""
    return (period[1] - period[0]) / max(now - cells.now_s, 1e-6)


def _bend(
    cells: _Particles, period: tuple[float, float], now: float, number: np.ndarray
) -> np.ndarray:
    """Time (CELLS,) by which the last of so many edges may lie beside where a steady acceleration
    puts it. Where the growth of the periods changes as it never did (a command that steps) it may
    have done so in the first of them, and in the last.
    """
    growth = _growth(cells, period, now)
    kink = abs(growth - cells.growth)
    sudden = 0.5 * number * kink if kink > SUDDEN * cells.kink else 0.0
    return (
        period[1]
        * (BEND_SHARE * abs(growth) + np.maximum(KINK_SHARE * kink, sudden))
        * (number - 1)
    )


def _branch(
    cells: _Particles,
    before: tuple[np.ndarray, np.ndarray],
    period: tuple[float, float],
    now: float,
) -> np.ndarray:
    """Cells (CELLS,) that hold a row to show the edge before the last one that fits. While the
    shaft slows down a row may as well: such cells go both ways, the other one in place of a cell
    that was given up. before: parents and shifts (CELLS,) of the row before.
    """
    length = unseen_lengths(*period, max(int((now - cells.time_s.min()) / min(period)) + 2, 2))
    step = np.searchsorted(length, now - cells.time_s, side="right")
    fewer = np.clip(step - 1, 1, len(length))
    coming = cells.time_s + length[fewer - 1] + period[1] * (period[1] / period[0]) ** (1.0 / fewer)
    alive = cells.cost < HOPELESS
    torn, free = np.flatnonzero(alive & (step > 1) & (coming > now)), np.flatnonzero(~alive)
    torn = torn[np.argsort(cells.cost[torn], kind="stable")][: len(free)]
    other = free[: len(torn)]
    _copy(cells, before, torn, other)
    fewer = np.zeros(PARTICLES, dtype=bool)
    fewer[other] = True
    return fewer


def _branch_to_wait(
    cells: _Particles,
    before: tuple[np.ndarray, np.ndarray],
    row_s: tuple[float, float],
    speed: float,
    period: float,
    rounding: float,
) -> np.ndarray:
    """Edges since the last one (CELLS,) of cells that hold the row to show the wait since an edge:
    since the last one, or since one of the row's own where the wait is longer than the period that
    ended there, as while a shaft slows down fast. They take the place of cells that are far less
    likely; -1 for all others.
    """
    (since, now), unshown, pitch = row_s, np.full(PARTICLES, -1), abs(speed) * period
    apart = now - period - cells.time_s
    number = np.maximum(np.round(np.abs(cells.speed) * apart / pitch), 1.0)
    shows, unsure = (
        number * pitch / np.maximum(apart, TICK_S),
        cells.half_s / np.maximum(apart, TICK_S),
    )
    own = (
        (now - period > since)
        & (shows * (1.0 - unsure) > abs(speed))
        & (shows * (1.0 - unsure) <= np.abs(cells.speed))
    )
    near, falls = np.abs(apart) < cells.half_s + rounding + TICK_S, abs(speed) < np.abs(cells.speed)
    none = (now - period <= since + rounding + TICK_S) & near & falls
    number = np.where(none, 0, number).astype(int)
    able = np.flatnonzero((cells.cost < HOPELESS) & (own | none))
    able = able[np.argsort(cells.cost[able], kind="stable")][:WAITING]
    other = np.argsort(-cells.cost, kind="stable")[: len(able)]
    keep = (cells.cost[other] > UNLIKELY) & ~np.isin(other, able)
    able, other = able[: np.count_nonzero(keep)], other[keep]
    _copy(cells, before, able, other)
    unshown[other] = number[able]
    return unshown


def _copy(
    cells: _Particles, before: tuple[np.ndarray, np.ndarray], one: np.ndarray, other: np.ndarray
) -> None:
    """Put cells in the place of others; before: parents and shifts (CELLS,) of the row before."""
    for values in (
        cells.time_s,
        cells.cost,
        cells.slope,
        cells.speed,
        cells.middle_s,
        cells.half_s,
        *before,
    ):
        values[other] = values[one]


def _lost(cells: _Particles, wrong: np.ndarray) -> bool:
    """Whether the row contradicts every cell that is alive; wrong (CELLS,) in squared sigmas."""
    return not np.any((cells.cost < HOPELESS) & (wrong < WORST))


def _begin_again(
    cells: _Particles, before: float, now: float, period: float, speed: float
) -> tuple[np.ndarray, np.ndarray]:
    """Cells all over a row that shows an edge of its own; (parents, steps) of them."""
    parent = np.full(PARTICLES, int(np.argmin(cells.cost)))
    cells.half_s = np.full(PARTICLES, 0.5 * (now - before) / PARTICLES)
    cells.time_s = before + cells.half_s * (2.0 * np.arange(PARTICLES) + 1.0)
    cells.cost, cells.slope, cells.speed = (
        np.zeros(PARTICLES),
        np.full(PARTICLES, np.nan),
        np.full(PARTICLES, speed),
    )
    cells.middle_s = cells.time_s - 0.5 * period
    return parent, np.ones(PARTICLES, dtype=int)


def unseen_first(previous_s: float, period_s: float, step: np.ndarray) -> np.ndarray:
    """Length (cells,) of the first of `step` periods."""
    return 1.0 / np.sqrt(1.0 / previous_s**2 + (1.0 / period_s**2 - 1.0 / previous_s**2) / step)


def _renew(cells: _Particles, counts: bool) -> tuple[np.ndarray, np.ndarray]:
    """Split the cells that are alive into more; (parents, shifts) of the new ones."""
    alive = np.flatnonzero(cells.cost < HOPELESS)
    count, number, filled = len(alive), np.arange(PARTICLES), PARTICLES if counts else FILLED
    if count > PARTICLES // 2:
        return number, np.zeros(PARTICLES)
    parent = alive[np.minimum(number, filled - 1) * count // filled]
    parts = np.bincount(parent[:filled], minlength=PARTICLES)[parent]
    shift = cells.half_s[parent] * (
        (2.0 * np.minimum(number - np.searchsorted(parent, parent), parts - 1) + 1.0) / parts - 1.0
    )
    cells.half_s = cells.half_s[parent] * (count / PARTICLES if counts else 1.0 / parts)
    cells.time_s, cells.cost = (
        cells.time_s[parent] + shift,
        cells.cost[parent] + np.where(number < filled, 0.0, 2.0 * HOPELESS),
    )
    cells.slope, cells.speed, cells.middle_s = (
        cells.slope[parent],
        cells.speed[parent],
        cells.middle_s[parent] + shift,
    )
    return parent, shift


def _traced(cells: _Particles, path: _Path, rounding_s: np.ndarray) -> HiddenEdges | None:
    """Mean and spread over the cells of each edge's time, each cell's path followed back: what
    moved a cell moves its past.
    """
    m, weight = len(path.time_s), np.exp(-0.5 * cells.cost)
    weight /= weight.sum()
    best = int(np.argmax(weight))
    at, moved = np.arange(PARTICLES), np.zeros(PARTICLES)
    end, spread, step, waited, contradicted = (
        np.empty(m),
        np.empty(m),
        np.ones(m, dtype=int),
        np.zeros(m, dtype=bool),
        0,
    )
    for i in range(m - 1, -1, -1):
        moved = np.clip(
            (1.0 - 1.0 / MEMORY) * moved + path.shift_s[i][at], -path.half_s[i], path.half_s[i]
        )
        at = path.parent[i][at]
        here = path.time_s[i][at] + moved
        end[i] = weight @ here
        spread[i] = np.sqrt(weight @ (here - end[i]) ** 2)
        step[i], waited[i] = path.step[i][at[best]], path.waited[i][at[best]]
        contradicted += path.wrong[i][at[best]] > 1.0
    if contradicted > max(2.0, CONTRADICTED * m):
        return None
    half = np.append(path.half_s[1:], cells.widest_s())
    # what a wait tells of an edge it tells of none before
    for part in np.split(np.arange(m), np.flatnonzero(waited)):
        ahead = np.lib.stride_tricks.sliding_window_view(
            np.pad(half[part], (0, MEMORY - 1), mode="edge"), MEMORY
        )
        half[part] = np.minimum(path.half_s[part], ahead.min(axis=1)) if len(part) else half[part]
    known = np.hypot(spread, half / np.sqrt(3.0))
    return HiddenEdges(end, np.sqrt(3.0) * known + rounding_s + TICK_S, step, waited)
