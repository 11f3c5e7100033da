"""Reads the rows of a Hall speed column one after another and classifies each: a repeated value, a
timeout sample, a new edge, or standstill.

Between rows the reader keeps the interval [low, high] of times at which the last edge may lie (set
membership: Milanese, Vicino, Automatica 27(6), 1991). Each row narrows it; a row that leaves it
empty begins a new chain.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import inf, isnan
from typing import NamedTuple

import numpy as np

from vgroove.gap.hall_edges.chain import ChainEdge, EdgeChain, TimeoutSample
from vgroove.gap.hall_edges.edge_periods import MIN_COUNTING_PULSES
from vgroove.gap.hall_edges.hidden_periods import (
    BEND_SHARE,
    ONE_EDGE_ROWS,
    TICK_S,
    counted_edge_times,
    span_s,
)


@dataclass(frozen=True)
class RowReaderLimits:
    """Limits of the row reader; those without a derivation were chosen on the tuning half of the
    blind set.
    """

    equal_share: float = 1e-9  # two speeds closer than this are equal: arithmetic alone differs
    changing_s: float = 1e-5  # s: if periods change by more, two equal values are one period
    # s: where the edge predicted from the chain lies outside the row's own interval by more than
    # this, the number of edges in the row is wrong or uncertain
    max_mismatch_s: float = 1e-4
    timeout_slack_s: float = 1e-5  # s: largest mismatch of one timeout sample and the chain
    timeout_agreeing: int = 2  # rows after a timeout sample that must give the same edge time
    repeat_errors: float = 4.0  # errors of time: an equal value after longer is no timeout sample
    next_rows: int = 4  # rows within which the next one that holds a value is looked for
    rounding_share: float = 0.1  # of the worst case: sum of independent rounding errors of a chain
    # of a row's interval: with shorter periods the number of counted edges in the row is uncertain
    counted_share: float = 0.8
    missing_rows: int = 3  # most missing rows across which edges are counted
    lost_rows: float = 1.7  # usual intervals between rows above which a row in between was lost
    hole_rows: float = 8.5  # usual intervals without a row above which the chain ends


LIMITS = RowReaderLimits()


class RowReading(NamedTuple):
    """One row: index, speed, end, period (one pitch divided by the speed), error of that period
    from the speed's resolution (0.5 LSB).
    """

    row: int
    speed_rpm: float
    now_s: float
    period_s: float
    rounding_s: float


class _EdgeFit(NamedTuple):
    """One number of edges that a row may hold: time and edges since the last one, summed error, and
    the interval [low, high] that it leaves to the new edge.
    """

    step_s: float
    count: int
    drift_s: float
    low_s: float
    high_s: float


def row_starts(time_s: np.ndarray) -> np.ndarray:
    """Start (n,), s, of each row that ends at time_s (n,): the end of the row before, or one usual
    interval before its own end where rows were lost.
    """
    usual = np.median(np.diff(time_s))
    length = np.diff(time_s, prepend=time_s[0] - usual)
    return time_s - np.where(length > LIMITS.lost_rows * usual, usual, length)


def _equal(one_rpm: float, other_rpm: float) -> bool:
    """Whether two rows report the same period: equal up to arithmetic."""
    return abs(one_rpm - other_rpm) <= LIMITS.equal_share * abs(other_rpm)


class RowReader:
    """Reader of one speed column (n,), rpm, of `pulses` edges a turn with resolution lsb_rpm; rows
    end at time_s (n,).
    """

    def __init__(
        self, time_s: np.ndarray, speed_rpm: np.ndarray, pulses: int, lsb_rpm: float
    ) -> None:
        # lists: a Python float is several times faster to read than an element of an array
        self.time, self.speed, self.pulses = time_s.tolist(), speed_rpm.tolist(), pulses
        self.starts = row_starts(time_s).tolist()
        self.half_lsb, self.counts = 0.5 * lsb_rpm, pulses >= MIN_COUNTING_PULSES
        self.hole_s = LIMITS.hole_rows * float(np.median(np.diff(time_s)))
        self.chains: list[EdgeChain] = []
        self.chain: EdgeChain | None = None
        self.low = self.high = 0.0
        self.last_row = -1
        self.uncounted = 0.0  # edges by the mean speed minus edges counted, a fraction

    def reading(self, row: int, speed_rpm: float) -> RowReading:
        """The row with its period, one pitch divided by its speed, and that period's error."""
        period = 60.0 / (self.pulses * abs(speed_rpm))
        rounding = period * self.half_lsb / abs(speed_rpm)
        return RowReading(row, speed_rpm, self.time[row], period, rounding)

    def chains_in_order(self) -> Iterator[EdgeChain]:
        """The chains, each as soon as the next one has begun."""
        given = 0
        for row, speed in enumerate(self.speed):
            if isnan(speed):
                continue
            self._read_row(row, speed)
            if len(self.chains) > given + 1:
                yield self.chains[given]
                given += 1
        yield from self.chains[given:]

    def _read_row(self, row: int, speed: float) -> None:
        """End the chain at standstill, begin one after a reversal or a hole, else continue it."""
        if speed == 0.0:
            self.chain = None
        elif (
            self.chain is None or speed * self.chain.speed_rpm[-1] < 0.0 or self._is_after_hole(row)
        ):
            self.begin(self.reading(row, speed))
        else:
            self.follow(self.reading(row, speed))
        self.last_row = row

    def _is_after_hole(self, row: int) -> bool:
        """Whether too many rows are missing since the last one to go on counting edges."""
        return (
            row - self.last_row > LIMITS.missing_rows
            or self.time[row] - self._before() > self.hole_s
        )

    def _before(self) -> float:
        """End of the last row read: a new value's edge comes after it."""
        return self.time[self.last_row] if self.last_row >= 0 else -inf

    def begin(self, r: RowReading) -> None:
        """Begin a chain with an edge in the row's interval."""
        self.chain = EdgeChain()
        self.chains.append(self.chain)
        self.low = max(r.now_s - r.period_s, self._before()) - r.rounding_s - TICK_S
        self.high = r.now_s + TICK_S
        fit = _EdgeFit(0.0, 1, r.rounding_s, self.low, self.high)
        self._add(r, fit, self.low, self.high)

    def _add(self, r: RowReading, fit: _EdgeFit, low_s: float, high_s: float) -> None:
        """Append the row's last edge to the chain; low_s, high_s: its bounds from the row alone."""
        length = fit.step_s if self.counts and fit.step_s > 0.0 else r.period_s
        edge = ChainEdge(
            r.row,
            r.speed_rpm,
            r.period_s,
            length,
            fit.count,
            fit.drift_s,
            low_s,
            high_s,
            self._before(),
        )
        self.chain.add(edge, fit.step_s)

    def follow(self, r: RowReading) -> None:
        """Classify a row that continues the chain, or begin a new chain where its value agrees with
        no number of edges.
        """
        error_s = r.rounding_s + TICK_S
        edge_s = r.now_s - r.period_s
        # an equal value repeats the last period, or is a further period of the same length where
        # one fits before the row's end; it bounds the last edge only if none fits
        if (
            _equal(r.speed_rpm, self.chain.speed_rpm[-1])
            and self.high + r.period_s + 2.0 * error_s > r.now_s
        ):
            if self.low + r.period_s > r.now_s + error_s:
                self._narrow(edge_s - error_s, r.now_s + TICK_S)
            return
        # twice the rounding: a board may truncate the speed, one pitch / time since the edge
        if self._is_timeout(r, error_s + r.rounding_s):
            self._add_timeout_bound(
                edge_s - error_s - r.rounding_s, edge_s + error_s + r.rounding_s
            )
            self.chain.timeouts.append(
                TimeoutSample(r.row, len(self.chain.row) - 1, r.speed_rpm, self._before())
            )
        elif not self._add_edge(r):
            self.begin(r)

    def _narrow(self, low: float, high: float) -> None:
        """Add a bound on the last edge's time."""
        chain = self.chain
        chain.low_s[-1], chain.high_s[-1] = max(chain.low_s[-1], low), min(chain.high_s[-1], high)
        if max(self.low, low) <= min(self.high, high):
            self.low, self.high = max(self.low, low), min(self.high, high)

    def _add_timeout_bound(self, low: float, high: float) -> None:
        """Add the bound that a timeout sample gives to the last edge's time. Where the
        bound contradicts the interval it replaces the interval: timeout samples that agree with one
        another are more precise than summed periods.
        """
        if max(low - self.high, self.low - high) > LIMITS.timeout_slack_s:
            self.low, self.high = low, high
            self.chain.low_s[-1], self.chain.high_s[-1] = low, high
        self._narrow(low, high)

    def _is_timeout(self, r: RowReading, error_s: float) -> bool:
        """Whether the row reports one pitch divided by the time since the last edge."""
        edge_s = r.now_s - r.period_s
        outside_s = max(self.low - edge_s, edge_s - self.high) - error_s
        if abs(r.speed_rpm) >= abs(self.chain.speed_rpm[-1]) or outside_s > LIMITS.max_mismatch_s:
            return False
        if outside_s > LIMITS.timeout_slack_s and not self._following_agree(r.row, edge_s, error_s):
            return False
        following = self._next_row(r.row)
        if following is None or self.speed[following] == 0.0:
            return True
        after = self.reading(following, self.speed[following])
        apart_s = after.now_s - r.now_s
        if _equal(after.speed_rpm, r.speed_rpm) and apart_s > LIMITS.repeat_errors * error_s:
            return False
        same_edge = abs((after.now_s - after.period_s) - edge_s)
        if same_edge <= error_s + after.rounding_s + TICK_S:
            return True
        return r.period_s > apart_s + after.rounding_s

    def _following_agree(self, row: int, edge_s: float, error_s: float) -> bool:
        """Whether the next rows report the time since the same edge as this one: new edges could
        not lie closer than the later one's period.
        """
        for _ in range(LIMITS.timeout_agreeing):
            row = self._next_row(row)
            if row is None or self.speed[row] == 0.0:
                return False
            after = self.reading(row, self.speed[row])
            error_s = max(error_s, 2.0 * after.rounding_s + TICK_S)
            if abs(after.now_s - after.period_s - edge_s) > 2.0 * error_s:
                return False
        return True

    def _next_row(self, row: int) -> int | None:
        """The next row that holds a value, if it comes soon."""
        end = min(row + LIMITS.next_rows, len(self.speed))
        return next((k for k in range(row + 1, end) if not isnan(self.speed[k])), None)

    def step(self, previous_s: float, r: RowReading, count: int) -> tuple[float, float, float]:
        """Time from the last edge to the count-th after it, its worst-case error, and the part of
        that error that accumulates over a chain, all s; previous_s: the period before.

        Hidden edges are spaced at uniform acceleration (with even spacing the edges of a run-up
        would become later and later). A sensor that counts does not report how many edges it
        counted: where several fit into a row the last edge is uncertain by one period,
        independently from row to row.
        """
        if self.counts:
            return self._counted_step(previous_s, r, count)
        length = span_s(previous_s, r.period_s, count)
        # the error has one sign while the acceleration changes: it accumulates in full
        bend = BEND_SHARE * abs(r.period_s - previous_s) * (count - 1)
        worst = r.rounding_s * count
        drift = bend + LIMITS.rounding_share * r.rounding_s * count
        return length, bend + worst, drift

    def _counted_step(
        self, previous_s: float, r: RowReading, count: int
    ) -> tuple[float, float, float]:
        """As step, of a sensor that counts the edges between rows."""
        bound, rows_s = count * r.rounding_s, (self._before(), self.starts[r.row], r.now_s)
        several = r.period_s < LIMITS.counted_share * (rows_s[2] - rows_s[0])
        uncertain = r.period_s if several else 0.0
        length = float(counted_edge_times(previous_s, r.period_s, count, rows_s)[-1])
        return length, bound + uncertain, LIMITS.rounding_share * bound + uncertain

    def _counts_to_try(self, r: RowReading, previous_s: float) -> range:
        """Numbers of edges that may have passed since the last one; where a sensor counts several
        in a row: the number that the mean speed gives in the long run.
        """
        since, before = self.starts[r.row], self._before()
        if not self.counts or r.period_s >= LIMITS.counted_share * (r.now_s - before):
            self.uncounted = 0.0
            # two more than fit, since both periods and the interval's ends are rounded
            return range(1, int((r.now_s - self.low) / min(r.period_s, previous_s)) + 3)
        self.uncounted += (r.now_s - since) / r.period_s + 0.5 * (since - before) * (
            1.0 / r.period_s + 1.0 / previous_s
        )
        count = max(1, round(self.uncounted))
        self.uncounted -= count
        return range(count, count + 1)

    def _add_edge(self, r: RowReading) -> bool:
        """Append the row's last edge, with as many hidden edges before it as leave it the widest
        interval; False where no number fits.
        """
        # a row that repeats the value may report a period that ended in the rows before
        since = -inf if _equal(r.speed_rpm, self.chain.speed_rpm[-1]) else self._before()
        floor = max(r.now_s - r.period_s, since) - r.rounding_s - TICK_S
        ceiling = r.now_s + r.rounding_s + TICK_S
        best = self._widest_fit(r, floor, ceiling)
        if best is None:
            return False
        low, high = best.low_s, best.high_s
        if low - high > LIMITS.max_mismatch_s:
            if r.period_s > ONE_EDGE_ROWS * (r.now_s - self._before()):
                return False
            # the number of edges is uncertain: the chain continues, and consistent_pieces or
            # track_hidden_edges corrects it
            low, high = floor, ceiling
        self._add(r, best, floor, ceiling)
        self.low, self.high = min(low, high), max(low, high)
        return True

    def _widest_fit(self, r: RowReading, floor: float, ceiling: float) -> _EdgeFit | None:
        """The number of edges that leaves the widest interval between floor and ceiling; None if
        with every number the last edge would lie after the end of the row.
        """
        previous, best, widest = self.chain.period_s[-1], None, -inf
        earliest = self._earliest(r, abs(r.period_s - previous)) - r.rounding_s
        for count in self._counts_to_try(r, previous):
            length, bound, drift = self.step(previous, r, count)
            low = max(self.low + length - bound, floor)
            high = min(self.high + length + bound, ceiling)
            width = high - low if high > earliest else min(high - low, 0.0)
            if width > widest:
                widest, best = width, _EdgeFit(length, count, drift, low, high)
        return best

    def _earliest(self, r: RowReading, change_s: float) -> float:
        """Time before which the row's last edge cannot lie if the next row repeats its value: while
        periods change, that row holds no edge. -inf where it must hold one.
        """
        following = self._next_row(r.row)
        if change_s < LIMITS.changing_s or following is None:
            return -inf
        if not _equal(self.speed[following], r.speed_rpm):
            return -inf
        since = self.time[following] - r.period_s
        return since - change_s if since < self.time[r.row] else -inf
