"""Chains of successive Hall edges of which none is missing: relative times from the edge periods,
bounds on the absolute times from the rows.
"""

from dataclasses import dataclass, field, fields
from math import inf
from typing import NamedTuple

import numpy as np

# s: where bounds contradict one another by more than this, an edge too many or too few was counted;
# larger than the rounding errors of time stamps and periods, smaller than the shortest period
# (chosen on the tuning half of the blind set)
SPLIT_S = 2e-5


class TimeoutSample(NamedTuple):
    """A row that reports the time since the last edge.

    row: its index; edge: index of that edge in the chain; speed_rpm: its value; before_s: time of
    the row read before.
    """

    row: int
    edge: int
    speed_rpm: float
    before_s: float


class ChainEdge(NamedTuple):
    """One edge of a chain: the lists of EdgeChain hold one entry of each field."""

    row: int  # row that reports the edge
    speed_rpm: float  # value of the row
    period_s: float  # one pitch divided by the value
    length_s: float  # span that the value is the mean of: one period, or several counted ones
    span: int  # edges since the edge before
    drift_s: float  # rounding error that the step from the edge before adds
    low_s: float  # bounds of the edge's absolute time, from the row alone
    high_s: float
    before_s: float  # time of the row read before


@dataclass
class EdgeChain:
    """Successive edges of which none is missing, as lists over the edges (see ChainEdge); offset_s:
    time since the first edge.
    """

    offset_s: list[float] = field(default_factory=list)
    drift_s: list[float] = field(default_factory=list)
    low_s: list[float] = field(default_factory=list)
    high_s: list[float] = field(default_factory=list)
    row: list[int] = field(default_factory=list)
    speed_rpm: list[float] = field(default_factory=list)
    period_s: list[float] = field(default_factory=list)
    length_s: list[float] = field(default_factory=list)
    span: list[int] = field(default_factory=list)
    before_s: list[float] = field(default_factory=list)
    timeouts: list[TimeoutSample] = field(default_factory=list)

    def add(self, edge: ChainEdge, step_s: float) -> None:
        """Append an edge that lies step_s after the last one."""
        self.offset_s.append((self.offset_s[-1] if self.offset_s else 0.0) + step_s)
        self.row.append(edge.row)
        self.speed_rpm.append(edge.speed_rpm)
        self.period_s.append(edge.period_s)
        self.length_s.append(edge.length_s)
        self.span.append(edge.span)
        self.drift_s.append(edge.drift_s)
        self.low_s.append(edge.low_s)
        self.high_s.append(edge.high_s)
        self.before_s.append(edge.before_s)

    def part(self, first: int, last: int) -> "EdgeChain":
        """Edges first..last - 1."""
        lists = {
            f.name: getattr(self, f.name)[first:last] for f in fields(self) if f.name != "timeouts"
        }
        timeouts = [
            sample._replace(edge=sample.edge - first)
            for sample in self.timeouts
            if first <= sample.edge < last
        ]
        return EdgeChain(**lists, timeouts=timeouts)

    def with_timeouts(self, among: np.ndarray, pulses: int) -> "EdgeChain":
        """The chain with further entries for the timeout samples of the edges in the mask `among`
        (edges,); each has the offset of its edge and span 0.
        """
        samples = [sample for sample in self.timeouts if among[sample.edge]]
        edge = [sample.edge for sample in samples]
        period = [60.0 / (pulses * abs(sample.speed_rpm)) for sample in samples]
        more = {
            "offset_s": [self.offset_s[k] for k in edge],
            "drift_s": [0.0] * len(edge),
            "low_s": [self.low_s[k] for k in edge],
            "high_s": [self.high_s[k] for k in edge],
            "row": [sample.row for sample in samples],
            "speed_rpm": [sample.speed_rpm for sample in samples],
            "period_s": period,
            "length_s": period,
            "span": [0] * len(edge),
            "before_s": [sample.before_s for sample in samples],
        }
        after = np.array(edge, dtype=int) + 1
        merged = EdgeChain(
            **{
                name: np.insert(getattr(self, name), after, values).tolist()
                for name, values in more.items()
            }
        )
        index = {row: k for k, row in enumerate(merged.row)}
        merged.timeouts = [
            sample._replace(edge=index.get(sample.row, index[self.row[sample.edge]]))
            for sample in self.timeouts
        ]
        return merged

    def bounds(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Lower and upper bound that each edge gives on the time of the first edge, and the sum of
        the rounding errors up to that edge, all (edges,), s.
        """
        offset = np.asarray(self.offset_s)
        return (
            np.asarray(self.low_s) - offset,
            np.asarray(self.high_s) - offset,
            np.cumsum(self.drift_s),
        )

    def hides_edges(self, time_s: np.ndarray, rows: float = 1.0) -> np.ndarray:
        """Whether several edges may fall into the row of each edge (edges,): its period is shorter
        than `rows` times the row's interval; the rows end at time_s (n,).
        """
        return np.asarray(self.period_s) < rows * (
            time_s[np.asarray(self.row)] - np.asarray(self.before_s)
        )


def consistent_pieces(low: np.ndarray, high: np.ndarray, drift: np.ndarray) -> list[slice]:
    """Cuts a chain where its bounds (edges,) contradict one another by more than SPLIT_S: one edge
    too many or too few was counted there. drift: rounding errors summed along the chain, s.
    """
    if len(low) < 2:
        return [slice(0, len(low))]
    cuts, top, bottom = [0], -inf, inf
    steps = np.diff(drift, prepend=drift[:1]).tolist()
    for i, (least, most, step) in enumerate(zip(low.tolist(), high.tolist(), steps, strict=True)):
        top, bottom = max(top - step, least), min(bottom + step, most)
        if top - bottom > SPLIT_S:
            cuts.append(i)
            top, bottom = least, most
    return [slice(a, b) for a, b in zip(cuts, [*cuts[1:], len(low)], strict=True)]


def intersect_bounds(
    low: np.ndarray, high: np.ndarray, drift: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Middle and half width (edges,), s, of the interval that all bounds leave to each edge's
    offset from its relative time.

    Set-membership estimation (Milanese, Vicino, Automatica 27(6), 1991): a bound on one edge bounds
    every other one through the relative times, widened by the rounding errors of the periods in
    between.
    """
    forward_low = np.maximum.accumulate(low + drift) - drift
    forward_high = np.minimum.accumulate(high - drift) + drift
    back_low = np.maximum.accumulate((low - drift)[::-1])[::-1] + drift
    back_high = np.minimum.accumulate((high + drift)[::-1])[::-1] - drift
    low, high = np.maximum(forward_low, back_low), np.minimum(forward_high, back_high)
    return 0.5 * (low + high), 0.5 * np.abs(high - low)


def edge_times(chain: EdgeChain) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Absolute times of a chain's edges, their half widths, both s, and the index of the consistent
    piece that each belongs to, all (edges,).
    """
    offset, (low, high, drift) = np.asarray(chain.offset_s), chain.bounds()
    middle, width, piece = np.empty_like(low), np.empty_like(low), np.empty(len(low), dtype=int)
    for number, part in enumerate(consistent_pieces(low, high, drift)):
        middle[part], width[part] = intersect_bounds(low[part], high[part], drift[part])
        piece[part] = number
    return offset + middle, width, piece
