"""Recovers the Hall edges behind a logged speed column: which rows close a new edge period, and
when that period began and ended.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from math import inf, isnan

import numpy as np
from scipy.ndimage import maximum_filter1d
from scipy.optimize import minimize_scalar

from vgroove.gap.hall_edges.edge_periods import MIN_COUNTING_PULSES, EdgePeriods
from vgroove.gap.hall_edges.hidden_edges import (
    BEND_SHARE,
    PLAIN,
    TICK_S,
    counted_lengths,
    track_hidden_edges,
)

CHANGING_S = 1e-5  # from edge to edge: no two periods that follow one another are alike then
WAIT_SLACK_S = 1e-5  # a falling row may miss the chain by this much; the row after it decides
# rows after one that must show the same wait, for which the steps up to its edge may be wrong
AGREE = 2
STRAIN_S = 1e-4  # a row's interval missed by more than this breaks the chain
NEAR_END_S = 5e-6  # an edge this close to a row's end may have been read by either row
# of a stretch that tells a scale for itself: an edge counted wrong spoils no more
STRETCH_EDGES = 64
# what a bound of a stretch may miss by, and the least time between edges that tell
STRETCH_SLACK_S, SHORTEST_S = 5e-6, 1e-3
MOST_STRETCH = 2e-3  # by which periods may all be too short where a chain still holds together
# bounds that contradict one another by more than this come from an edge too many or too few
SPLIT_S = 2e-5
# rounding errors of successive periods are independent: they add up to about this share of the
# worst case
ROUNDING_SHARE = 0.1
# an edge period below this share of a row's interval: the number of edges in the row cannot be told
COUNTED_SHARE = 0.8
# after more missing rows than this the number of edges in between is not certain any more
MISSING_ROWS_LIMIT = 3
BESIDE_HIDDEN = 150  # edges on both sides of rows that hide edges, which tell where these lie
# usual intervals from one row to the next, from which on a row in between was lost: uneven rows
# come earlier
LOST_ROWS = 1.7
# so many usual intervals without a row are a hole in the log, with the same consequence
HOLE_ROWS = 8.5


@dataclass
class _Chain:
    """Edges that follow one another without a gap: offsets from the first, and bounds on each
    edge's absolute time.
    """

    offset_s: list[float] = field(default_factory=list)
    growth_s: list[float] = field(default_factory=list)
    low_s: list[float] = field(default_factory=list)
    high_s: list[float] = field(default_factory=list)
    row: list[int] = field(default_factory=list)
    speed_rpm: list[float] = field(default_factory=list)
    period_s: list[float] = field(default_factory=list)
    # of the span that the row's speed is the mean of: one period, or several counted
    length_s: list[float] = field(default_factory=list)
    span: list[int] = field(default_factory=list)  # edges that the step from the edge before spans
    # time of the row read before the one that shows the edge
    before_s: list[float] = field(default_factory=list)
    # row, edge, speed, time of the row read before
    falls: list[tuple[int, int, float, float]] = field(default_factory=list)

    def part(self, first: int, last: int) -> "_Chain":
        """Edges first..last - 1."""
        lists = {
            f.name: getattr(self, f.name)[first:last] for f in fields(self) if f.name != "falls"
        }
        return _Chain(
            **lists,
            falls=[
                (row, edge - first, *rest)
                for row, edge, *rest in self.falls
                if first <= edge < last
            ],
        )

    def with_falls(self, among: np.ndarray, pulses: int) -> "_Chain":
        """The chain in which rows that seem to wait for an edge that is `among` (edges,) stand as
        entries of their own: without a step.
        """
        falls = [fall for fall in self.falls if among[fall[1]]]
        row, edge, speed, before_s = (
            (list(values) for values in zip(*falls, strict=True)) if falls else ([], [], [], [])
        )
        period = [60.0 / (pulses * abs(one)) for one in speed]
        more = {
            "offset_s": [self.offset_s[k] for k in edge],
            "growth_s": [0.0] * len(edge),
            "low_s": [self.low_s[k] for k in edge],
            "high_s": [self.high_s[k] for k in edge],
            "row": row,
            "speed_rpm": speed,
            "period_s": period,
            "length_s": period,
            "span": [0] * len(edge),
            "before_s": before_s,
        }
        after = np.array(edge, dtype=int) + 1
        merged = _Chain(
            **{
                name: np.insert(getattr(self, name), after, values).tolist()
                for name, values in more.items()
            }
        )
        place = {row: k for k, row in enumerate(merged.row)}
        merged.falls = [
            (row, place.get(row, place[self.row[edge]]), *rest) for row, edge, *rest in self.falls
        ]
        return merged

    def bounds(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Bounds on where the chain lies that each edge gives, and the rounding errors added up
        until there, all (edges,).
        """
        offset = np.asarray(self.offset_s)
        return (
            np.asarray(self.low_s) - offset,
            np.asarray(self.high_s) - offset,
            np.cumsum(self.growth_s),
        )

    def add(
        self,
        row: int,
        speed: float,
        period: float,
        counted: bool,
        step: tuple[float, int],
        growth: float,
        bounds: tuple[float, float],
        before_s: float,
    ) -> None:
        """Append an edge that lies `step` (seconds, edges) after the last one, within bounds of its
        absolute time.
        """
        self.before_s.append(before_s)
        self.offset_s.append((self.offset_s[-1] if self.offset_s else 0.0) + step[0])
        self.span.append(step[1])
        self.growth_s.append(growth)
        self.low_s.append(bounds[0])
        self.high_s.append(bounds[1])
        self.row.append(row)
        self.speed_rpm.append(speed)
        self.period_s.append(period)
        self.length_s.append(step[0] if counted and step[0] > 0.0 else period)


def row_starts(time_s: np.ndarray) -> np.ndarray:
    """When each row (n,) began: as the row before ended; where rows were lost, a usual interval
    before its own end.
    """
    usual = np.median(np.diff(time_s))
    length = np.diff(time_s, prepend=time_s[0] - usual)
    return time_s - np.where(length > LOST_ROWS * usual, usual, length)


def _same(one: float, other: float) -> bool:
    """Whether two rows report one period: equal up to arithmetic."""
    return abs(one - other) <= 1e-9 * abs(other)


class _Reader:
    """Walks down the rows, keeps the interval [low, high] in which the last edge lies, and sorts
    each row: repeat, fall, new edge, rest.
    """

    def __init__(
        self, time_s: np.ndarray, speed_rpm: np.ndarray, pulses: int, lsb_rpm: float
    ) -> None:
        # Python's floats: far faster one by one
        self.time, self.speed, self.pulses = time_s.tolist(), speed_rpm.tolist(), pulses
        self.half_lsb, self.counts, self.starts = (
            0.5 * lsb_rpm,
            pulses >= MIN_COUNTING_PULSES,
            row_starts(time_s).tolist(),
        )
        self.hole_s = HOLE_ROWS * float(np.median(np.diff(time_s)))
        self.chains: list[_Chain] = []
        self.chain: _Chain | None = None
        self.low = self.high = 0.0
        self.last_row = -1
        self.owed = 0.0  # edges that the speed has promised and that have not been counted yet

    def period(self, speed: float) -> tuple[float, float]:
        """Edge period of a reported speed and the error that the speed's rounding leaves in it,
        seconds.
        """
        period = 60.0 / (self.pulses * abs(speed))
        return period, period * self.half_lsb / abs(speed)

    def read(self) -> list[_Chain]:
        return list(self.torn_off())

    def torn_off(self) -> Iterator[_Chain]:
        """The chains, each as soon as the next one has begun."""
        given = 0
        for row, speed in enumerate(self.speed):
            if isnan(speed):
                continue
            if speed == 0.0:
                self.chain = None
            elif self.chain is None or speed * self.chain.speed_rpm[-1] < 0.0 or self.is_far(row):
                self.begin(row, speed)
            else:
                self.follow(row, speed)
            self.last_row = row
            if len(self.chains) > given + 1:
                yield self.chains[given]
                given += 1
        yield from self.chains[given:]

    def is_far(self, row: int) -> bool:
        """Whether too much is missing between the last row read and this one to go on counting."""
        return (
            row - self.last_row > MISSING_ROWS_LIMIT or self.time[row] - self.before() > self.hole_s
        )

    def before(self) -> float:
        """Time of the last row that was read before this one: a new value's edge came after it."""
        return self.time[self.last_row] if self.last_row >= 0 else -inf

    def begin(self, row: int, speed: float) -> None:
        """First edge of a new chain: it lies in the row's interval."""
        period, slack = self.period(speed)
        self.chain = _Chain()
        self.chains.append(self.chain)
        self.low, self.high = (
            max(self.time[row] - period, self.before()) - slack - TICK_S,
            self.time[row] + TICK_S,
        )
        self.chain.add(
            row, speed, period, self.counts, (0.0, 1), slack, (self.low, self.high), self.before()
        )

    def follow(self, row: int, speed: float) -> None:
        now, (period, rounding) = self.time[row], self.period(speed)
        slack = rounding + TICK_S
        if _same(speed, self.chain.speed_rpm[-1]) and self.high + period + 2.0 * slack > now:
            # else an equal period may just have ended: no bound follows
            if self.low + period > now + slack:
                self.narrow(now - period - slack, now + TICK_S)
        # a board may truncate where a pitch over the wait is a bound
        elif self.is_fall(row, speed, now, period, slack + rounding):
            self.wait(now - period - slack - rounding, now - period + slack + rounding)
            self.chain.falls.append((row, len(self.chain.row) - 1, speed, self.before()))
        elif not self.new_edge(row, speed, now, period, rounding):
            self.begin(row, speed)

    def narrow(self, low: float, high: float) -> None:
        """Add a bound on the last edge's time."""
        self.chain.low_s[-1], self.chain.high_s[-1] = (
            max(self.chain.low_s[-1], low),
            min(self.chain.high_s[-1], high),
        )
        if max(self.low, low) <= min(self.high, high):
            self.low, self.high = max(self.low, low), min(self.high, high)

    def wait(self, low: float, high: float) -> None:
        """Add what a wait says of the last edge's time: rows that agree on it know better than the
        steps up to that edge.
        """
        if max(low - self.high, self.low - high) > WAIT_SLACK_S:
            self.low, self.high = self.chain.low_s[-1], self.chain.high_s[-1] = low, high
        self.narrow(low, high)

    def is_fall(self, row: int, speed: float, now: float, period: float, slack: float) -> bool:
        """Whether the row shows the wait for an edge: one pitch over the time since the last edge."""
        spread = slack + (STRAIN_S if self.are_waits(row, now - period, slack) else WAIT_SLACK_S)
        if (
            abs(speed) >= abs(self.chain.speed_rpm[-1])
            or not self.low - spread <= now - period <= self.high + spread
        ):
            return False
        following = self.following(row)
        if following is None or self.speed[following] == 0.0:
            return True
        if _same(self.speed[following], speed) and self.time[following] - now > 4.0 * slack:
            return False
        then, spread = self.period(self.speed[following])
        if abs((self.time[following] - then) - (now - period)) <= slack + spread + TICK_S:
            return True
        return period > self.time[following] - now + spread

    def are_waits(self, row: int, edge_s: float, slack: float) -> bool:
        """Whether the next rows wait since the same edge as this one: new edges could not lie
        closer than the later one's period.
        """
        for _ in range(AGREE):
            row = self.following(row)
            if row is None or self.speed[row] == 0.0:
                return False
            period, rounding = self.period(self.speed[row])
            slack = max(slack, 2.0 * rounding + TICK_S)
            if abs(self.time[row] - period - edge_s) > 2.0 * slack:
                return False
        return True

    def following(self, row: int) -> int | None:
        """The next row that was read."""
        return next(
            (r for r in range(row + 1, min(row + 4, len(self.speed))) if not isnan(self.speed[r])),
            None,
        )

    def step(
        self, previous: float, period: float, count: int, rounding: float, row: int
    ) -> tuple[float, float, float]:
        """Time from the last edge to the count-th after it, its bound of error, and what of that
        adds up over a chain.

        Edges that no row shows lie as a steady acceleration puts them (evenly between, a run-up
        would add up to late ones). A counting sensor does not say how many edges it counted: where
        several fit into a row, the place of the last one is open within a period, row for row.
        """
        if self.counts:
            bound, rows_s = count * rounding, (self.before(), self.starts[row], self.time[row])
            open_place = period if period < COUNTED_SHARE * (rows_s[2] - rows_s[0]) else 0.0
            return (
                float(counted_lengths(previous, period, count, rows_s)[-1]),
                bound + open_place,
                ROUNDING_SHARE * bound + open_place,
            )
        first, last = 1.0 / (previous * previous), 1.0 / (period * period)
        rate = first + (last - first) * np.arange(1, count + 1) / count
        steps = 1.0 / np.sqrt(rate)
        # all one way while a motion bends: it adds up in full
        bend = BEND_SHARE * abs(period - previous) * (count - 1)
        return float(steps.sum()), bend + rounding * count, bend + ROUNDING_SHARE * rounding * count

    def counts_to_try(self, row: int, period: float, previous: float) -> range:
        """Edges that may have passed since the last; where a sensor counts several a row: as many
        as the speed gives in the long run.
        """
        now, since = self.time[row], self.starts[row]
        if not self.counts or period >= COUNTED_SHARE * (now - self.before()):
            self.owed = 0.0
            return range(1, int((now - self.low) / min(period, previous)) + 3)
        self.owed += (now - since) / period + 0.5 * (since - self.before()) * (
            1.0 / period + 1.0 / previous
        )
        count = max(1, round(self.owed))
        self.owed -= count
        return range(count, count + 1)

    def new_edge(self, row: int, speed: float, now: float, period: float, rounding: float) -> bool:
        """Append the row's last edge, with as many unseen edges before it as fit; False when none
        do.
        """
        # A row that repeats the value may close a period that ended in the rows before.
        since = -inf if _same(speed, self.chain.speed_rpm[-1]) else self.before()
        floor, ceiling = max(now - period, since) - rounding - TICK_S, now + rounding + TICK_S
        previous, best, widest = self.chain.period_s[-1], None, -inf
        still = self.not_before(row, speed, period, abs(period - previous)) - rounding
        for count in self.counts_to_try(row, period, previous):
            length, bound, drift = self.step(previous, period, count, rounding, row)
            low, high = (
                max(self.low + length - bound, floor),
                min(self.high + length + bound, ceiling),
            )
            width = high - low if high > still else min(high - low, 0.0)
            if width > widest:
                widest, best = width, ((length, count), drift, low, high)
        step, drift, low, high = best
        if low - high > STRAIN_S:
            if period > PLAIN * (now - self.before()):
                return False
            # the count was a guess: the chain goes on, `_pieces` or `places` tells how
            low, high = floor, ceiling
        self.chain.add(
            row, speed, period, self.counts, step, drift, (floor, ceiling), self.before()
        )
        self.low, self.high = min(low, high), max(low, high)
        return True

    def not_before(self, row: int, speed: float, period: float, change: float) -> float:
        """Time before which a row's last edge cannot lie if the next row repeats its value: as long
        as periods change, that row holds no edge. No bound where it must hold one.
        """
        following = self.following(row)
        if change < CHANGING_S or following is None or not _same(self.speed[following], speed):
            return -inf
        since = self.time[following] - period
        return since - change if since < self.time[row] else -inf


def _pieces(low: np.ndarray, high: np.ndarray, drift: np.ndarray) -> list[slice]:
    """Cuts a chain where its bounds contradict one another: an edge too many or too few was counted
    there.
    """
    cuts, top, bottom = [0], -inf, inf
    growth = np.diff(drift, prepend=drift[:1]).tolist()
    for i, (least, most, grown) in enumerate(zip(low.tolist(), high.tolist(), growth, strict=True)):
        top, bottom = max(top - grown, least), min(bottom + grown, most)
        if top - bottom > SPLIT_S:
            cuts.append(i)
            top, bottom = least, most
    return [slice(a, b) for a, b in zip(cuts, [*cuts[1:], len(low)], strict=True)]


def _edge_times(chain: _Chain) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Absolute times of a chain's edges, their half widths, and the piece of the chain that each
    belongs to.
    """
    offset, (low, high, drift) = np.asarray(chain.offset_s), chain.bounds()
    middle, width, piece = np.empty_like(low), np.empty_like(low), np.empty(len(low), dtype=int)
    for number, part in enumerate(_pieces(low, high, drift)):
        middle[part], width[part] = _intersect(low[part], high[part], drift[part])
        piece[part] = number
    return offset + middle, width, piece


def _either(time_s: np.ndarray, chain: _Chain, end: np.ndarray, slack: np.ndarray) -> np.ndarray:
    """A period (edges,) where rows show the last of several edges and one of them lies so close to
    the row's end that it may belong to the next row; else 0.
    """
    row, period = np.asarray(chain.row), np.asarray(chain.period_s)
    interval = time_s[row] - time_s[np.maximum(row - 1, 0)]
    # since the edge; it is the last one if the next comes later than the row
    after = time_s[row] - end
    close = np.minimum(after, period - after) < slack + NEAR_END_S
    return np.where(close & (period < interval), period, 0.0)


def _intersect(
    low: np.ndarray, high: np.ndarray, drift: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Middle and half width of the interval that all bounds leave to each edge's offset.

    Set membership: a bound on one edge bounds every other through the offsets, less what the
    rounding of the periods in between can add.
    """
    forward_low = np.maximum.accumulate(low + drift) - drift
    forward_high = np.minimum.accumulate(high - drift) + drift
    back_low = np.maximum.accumulate((low - drift)[::-1])[::-1] + drift
    back_high = np.minimum.accumulate((high + drift)[::-1])[::-1] - drift
    low, high = np.maximum(forward_low, back_low), np.minimum(forward_high, back_high)
    return 0.5 * (low + high), 0.5 * np.abs(high - low)


def read_edge_periods(
    time_s: np.ndarray, speed_rpm: np.ndarray, pulses_per_rev: int, lsb_rpm: float
) -> EdgePeriods:
    """Edge periods behind a speed column (n,) of one pulse pitch over the last edge period.

    A row that repeats an edge counts once. The end of each period is chained from the periods
    before; where in its interval the chain lies follows from every row of the chain (gap contract,
    sections 1 and 5). Missing samples (nan) are passed over.
    """
    columns: list[tuple] = []
    number = count = 0
    reader = _Reader(time_s, speed_rpm, pulses_per_rev, lsb_rpm)
    starts = np.array(reader.starts)
    for chain in reader.read():
        chain, (end, slack, piece, span, length, waited) = _located(
            time_s, starts, chain, pulses_per_rev, lsb_rpm
        )
        piece = piece + number
        number = piece[-1] + 1
        for i in np.flatnonzero(span > 0):
            count += span[i] * (1 if chain.speed_rpm[i] > 0.0 else -1)
            if not waited[i]:
                columns.append(
                    (
                        chain.row[i],
                        end[i] - length[i],
                        end[i],
                        chain.speed_rpm[i],
                        slack[i],
                        False,
                        piece[i],
                        count,
                    )
                )
        for row, edge, speed, _ in chain.falls + [
            (chain.row[i], i, chain.speed_rpm[i], 0.0) for i in np.flatnonzero(waited)
        ]:
            wait = 60.0 / (pulses_per_rev * abs(speed))
            unsure = slack[edge] + wait * lsb_rpm / abs(speed) + WAIT_SLACK_S
            # else rows hid the edge that it waited since
            if abs(time_s[row] - wait - end[edge]) < unsure:
                columns.append(
                    (row, end[edge], time_s[row], speed, slack[edge], True, piece[edge], 0)
                )
    columns.sort()
    kinds = (int, float, float, float, float, bool, int, int)
    return EdgePeriods(
        *(np.array([c[k] for c in columns], dtype=kind) for k, kind in enumerate(kinds))
    )


def count_chains(
    time_s: np.ndarray,
    speed_rpm: np.ndarray,
    pulses_per_rev: int,
    lsb_rpm: float,
    most: int | None = None,
) -> int:
    """Unbroken chains that the edge periods of a speed column fall into; counting ends beyond
    `most` of them.
    """
    reader, count = _Reader(time_s, speed_rpm, pulses_per_rev, lsb_rpm), 0
    for chain in reader.torn_off():
        count += len(_pieces(*chain.bounds()))
        if most is not None and count > most:
            break
    return count


def longest_chain(
    time_s: np.ndarray, speed_rpm: np.ndarray, pulses_per_rev: int, lsb_rpm: float
) -> tuple[float, float, int]:
    """Length in seconds of the longest chain of edge periods, the share by which all periods would
    have to be longer to lie best within the bounds that its rows give them, and how often any chain
    tears in spite of its counts.
    """
    chains = _Reader(time_s, speed_rpm, pulses_per_rev, lsb_rpm).read()
    longest = max(chains, key=lambda one: one.offset_s[-1])
    offset, (low, high, _) = np.asarray(longest.offset_s), longest.bounds()
    found = minimize_scalar(
        lambda share: np.max(low - share * offset) - np.min(high - share * offset),
        method="bounded",
        # the largest of straight lines: convex
        bounds=(-MOST_STRETCH, MOST_STRETCH),
        options={"xatol": 1e-7},
    )
    return (
        float(offset[-1]),
        float(found.x),
        sum(len(_pieces(*chain.bounds())) - 1 for chain in chains),
    )


def period_error_bounds(
    time_s: np.ndarray, speed_rpm: np.ndarray, pulses_per_rev: int, lsb_rpm: float
) -> np.ndarray:
    """Least and largest share (m, 2) by which all periods may be longer for each stretch of edges
    to lie within the bounds of its rows. Of a sensor that counts only stretches tell whose edges
    show in rows of their own.
    """
    counts, found = pulses_per_rev >= MIN_COUNTING_PULSES, []
    for chain in _Reader(time_s, speed_rpm, pulses_per_rev, lsb_rpm).read():
        hidden = _hides_edges(time_s, chain, PLAIN) & counts
        cuts = np.union1d(
            np.arange(0, len(hidden), STRETCH_EDGES), np.flatnonzero(np.diff(hidden)) + 1
        )
        for first, last in zip(cuts, [*cuts[1:], len(hidden)], strict=True):
            if not hidden[first]:
                found.append(_share_bounds(chain.part(first, last)))
    bounds = np.array(found).reshape(-1, 2)
    return bounds[np.isfinite(bounds).all(axis=1) & (bounds[:, 0] <= bounds[:, 1])]


def _share_bounds(chain: _Chain) -> tuple[float, float]:
    """As `share_bounds`, of one stretch: any two of its edges bound the time between them."""
    (low, high, drift), (one, other) = chain.bounds(), np.triu_indices(len(chain.row), 1)
    apart, slack = (
        np.diff(np.asarray(chain.offset_s)[[one, other]], axis=0)[0],
        drift[other] - drift[one] + STRETCH_SLACK_S,
    )
    one, other, apart, slack = (values[apart > SHORTEST_S] for values in (one, other, apart, slack))
    return (
        float(np.max((low[other] - high[one] - slack) / apart, initial=-inf)),
        float(np.min((high[other] - low[one] + slack) / apart, initial=inf)),
    )


def _located(
    time_s: np.ndarray, starts: np.ndarray, chain: _Chain, pulses: int, lsb_rpm: float
) -> tuple[_Chain, tuple[np.ndarray, ...]]:
    """Of each edge of a chain, whose rows last from starts to time_s (n,): time, half width, piece
    of the chain, edges since the one before (0: its row repeats that one, or waits), length of the
    span that its row's speed is the mean of, and whether that is the wait since the edge. Where
    rows hide edges, rows that seem to wait are entries too: only there the chain's own bounds may
    be wrong about them.
    """
    hidden, counts = _hides_edges(time_s, chain), pulses >= MIN_COUNTING_PULSES
    hidden = (
        np.full(len(hidden), hidden.any())
        if counts
        else maximum_filter1d(hidden, 2 * BESIDE_HIDDEN + 1)
    )
    if not counts and hidden.any():
        chain = chain.with_falls(hidden & _hides_edges(time_s, chain, PLAIN), pulses)
        hidden = maximum_filter1d(_hides_edges(time_s, chain), 2 * BESIDE_HIDDEN + 1)
    cuts = [0, *(np.flatnonzero(np.diff(hidden)) + 1), len(hidden)]
    parts = [
        _part_located(time_s, starts, chain.part(a, b), counts, 0.5 * lsb_rpm, bool(hidden[a]))
        for a, b in zip(cuts, cuts[1:], strict=False)
    ]
    end, slack, piece, span, length, waited = (
        np.concatenate(columns) for columns in zip(*parts, strict=True)
    )
    torn = np.concatenate([[0], np.diff(piece) > 0])
    return chain, (end, slack, np.cumsum(torn), span, length, waited)


def _part_located(
    time_s: np.ndarray,
    starts: np.ndarray,
    chain: _Chain,
    counts: bool,
    half_lsb_rpm: float,
    hidden: bool,
) -> tuple[np.ndarray, ...]:
    """As `_located`, of a part of a chain whose rows hide edges, or one whose rows hide none."""
    row, period, span, length = (
        np.asarray(x) for x in (chain.row, chain.period_s, chain.span, chain.length_s)
    )
    start = starts[row]
    found, waited = (
        track_hidden_edges(time_s[row], start, chain, half_lsb_rpm, counts) if hidden else None,
        np.zeros(len(row), dtype=bool),
    )
    if found is None:
        end, slack, piece = _edge_times(chain)
        slack = slack + _either(time_s, chain, end, slack)
    else:
        end, slack, piece, span, waited = (
            found.end_s,
            found.slack_s,
            np.zeros(len(row), dtype=int),
            found.step,
            found.waited,
        )
        length = np.where(span > 0, span * period, period) if counts else length
    # the row's speed is the mean over its own edges alone
    missing = (start > np.asarray(chain.before_s)) & counts
    own = np.minimum(np.maximum(np.ceil((end - start) / period), 1.0), np.maximum(span, 1))
    return end, slack, piece, span, np.where(missing, own * period, length), waited


def _hides_edges(time_s: np.ndarray, chain: _Chain, rows: float = 1.0) -> np.ndarray:
    """Whether each edge's row (edges,), or so many rows, may show only the last of several."""
    return np.asarray(chain.period_s) < rows * (
        time_s[np.asarray(chain.row)] - np.asarray(chain.before_s)
    )
