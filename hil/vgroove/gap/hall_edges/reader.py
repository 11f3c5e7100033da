"""Finds the Hall edge periods that a logged speed column holds: which row reports which period, and
when it began and ended.
"""

from dataclasses import dataclass, fields

import numpy as np
import scipy  # its parts load when they are first used

from vgroove.gap.hall_edges.chain import EdgeChain, consistent_pieces, edge_times
from vgroove.gap.hall_edges.edge_periods import MIN_COUNTING_PULSES, EdgePeriods
from vgroove.gap.hall_edges.hidden_edges import track_hidden_edges
from vgroove.gap.hall_edges.hidden_periods import ONE_EDGE_ROWS
from vgroove.gap.hall_edges.row_reader import LIMITS as ROW_LIMITS
from vgroove.gap.hall_edges.row_reader import RowReader

# s: an edge this close to a row's end may have been reported by either row, above the sum of all
# roundings of time
NEAR_END_S = 5e-6
# number of edges before and after rows that hide edges that the particle filter processes as well,
# because it needs the motion there; chosen on the tuning half of the blind set
BESIDE_HIDDEN = 150


@dataclass(frozen=True)
class _SpeedColumn:
    """Start and end (n,) of the rows, s, edges per turn and resolution of a speed column."""

    start_s: np.ndarray
    time_s: np.ndarray
    pulses: int
    lsb_rpm: float

    @property
    def counts(self) -> bool:
        """Whether the sensor reports the mean over all edges of a row."""
        return self.pulses >= MIN_COUNTING_PULSES


@dataclass(frozen=True)
class _LocatedEdges:
    """Edges (edges,) of a chain: time, half width of its interval, consistent piece of the chain,
    edges since the one before (0: the row repeats that one or is a timeout sample), span that the
    row's speed is the mean of, and whether it is a timeout sample.
    """

    end_s: np.ndarray
    slack_s: np.ndarray
    piece: np.ndarray
    span: np.ndarray
    length_s: np.ndarray
    timeout: np.ndarray


# row, start_s, end_s, speed_rpm, slack_s, timeout, chain, count of EdgePeriods
_Record = tuple[int, float, float, float, float, bool, int, int]


def read_edge_periods(
    time_s: np.ndarray, speed_rpm: np.ndarray, pulses_per_rev: int, lsb_rpm: float
) -> EdgePeriods:
    """Edge periods of a speed column (n,), rpm, that holds one pulse pitch divided by the last
    edge period; rows end at time_s (n,), lsb_rpm is the column's resolution.

    A row that repeats an edge counts once. The end of each period is the sum of the periods before
    it; the rows of the whole chain bound where the chain lies in time (docs/spec/gap.md, sections 1
    and 5). Missing samples (nan) are skipped.
    """
    records: list[_Record] = []
    number = count = 0
    reader = RowReader(time_s, speed_rpm, pulses_per_rev, lsb_rpm)
    column = _SpeedColumn(np.array(reader.starts), time_s, pulses_per_rev, lsb_rpm)
    for chain in list(reader.chains_in_order()):
        chain, edges = _locate(column, chain)
        piece = edges.piece + number
        number = piece[-1] + 1
        for i in np.flatnonzero(edges.span > 0):
            count += edges.span[i] * (1 if chain.speed_rpm[i] > 0.0 else -1)
            if not edges.timeout[i]:
                records.append(_period_record(chain, edges, i, (piece[i], count)))
        records += _timeout_records(column, chain, edges, piece)
    records.sort()
    kinds = (int, float, float, float, float, bool, int, int)
    return EdgePeriods(
        *(np.array([r[k] for r in records], dtype=kind) for k, kind in enumerate(kinds))
    )


def _period_record(
    chain: EdgeChain, edges: _LocatedEdges, i: int, numbers: tuple[int, int]
) -> _Record:
    """Record of the period that ends with edge i; numbers: its chain and its count of edges."""
    end = edges.end_s[i]
    start = end - edges.length_s[i]
    return (chain.row[i], start, end, chain.speed_rpm[i], edges.slack_s[i], False, *numbers)


def _timeout_records(
    column: _SpeedColumn, chain: EdgeChain, edges: _LocatedEdges, piece: np.ndarray
) -> list[_Record]:
    """Records of a chain's timeout samples that agree with the time of their edge; the others
    report the time since a hidden edge.
    """
    samples = [(sample.row, sample.edge, sample.speed_rpm) for sample in chain.timeouts]
    samples += [(chain.row[i], i, chain.speed_rpm[i]) for i in np.flatnonzero(edges.timeout)]
    records = []
    for row, edge, speed in samples:
        since_s = 60.0 / (column.pulses * abs(speed))
        error_s = edges.slack_s[edge] + since_s * column.lsb_rpm / abs(speed)
        error_s = error_s + ROW_LIMITS.timeout_slack_s
        now, end = column.time_s[row], edges.end_s[edge]
        if abs(now - since_s - end) < error_s:
            records.append((row, end, now, speed, edges.slack_s[edge], True, piece[edge], 0))
    return records


def count_chains(
    time_s: np.ndarray,
    speed_rpm: np.ndarray,
    pulses_per_rev: int,
    lsb_rpm: float,
    most: int | None = None,
) -> int:
    """Number of consistent chains of edges in a speed column (n,); counting ends beyond `most`."""
    reader, count = RowReader(time_s, speed_rpm, pulses_per_rev, lsb_rpm), 0
    for chain in reader.chains_in_order():
        count += len(consistent_pieces(*chain.bounds())) if len(chain.row) > 1 else 1
        if most is not None and count > most:
            break
    return count


def _locate(column: _SpeedColumn, chain: EdgeChain) -> tuple[EdgeChain, _LocatedEdges]:
    """The chain, and the times of its edges.

    Where rows hide edges the particle filter locates them; timeout samples are separate entries
    there, because the chain's own bounds may assign them to a wrong edge. Elsewhere the time of an
    edge is the intersection of all bounds.
    """
    hidden = chain.hides_edges(column.time_s)
    if column.counts:
        hidden = np.full(len(hidden), hidden.any())
    elif hidden.any():
        hidden = scipy.ndimage.maximum_filter1d(hidden, 2 * BESIDE_HIDDEN + 1)
        several = chain.hides_edges(column.time_s, ONE_EDGE_ROWS)
        chain = chain.with_timeouts(hidden & several, column.pulses)
        hidden = scipy.ndimage.maximum_filter1d(
            chain.hides_edges(column.time_s), 2 * BESIDE_HIDDEN + 1
        )
    cuts = [0, *(np.flatnonzero(hidden[1:] != hidden[:-1]) + 1), len(hidden)]
    parts = [
        _locate_part(column, chain.part(a, b), bool(hidden[a]))
        for a, b in zip(cuts, cuts[1:], strict=False)
    ]
    if len(parts) == 1:
        return chain, parts[0]
    end, slack, piece, span, length, timeout = (
        np.concatenate([getattr(part, field.name) for part in parts])
        for field in fields(_LocatedEdges)
    )
    cut = np.concatenate([[0], piece[1:] > piece[:-1]])
    return chain, _LocatedEdges(end, slack, np.cumsum(cut), span, length, timeout)


def _locate_part(column: _SpeedColumn, chain: EdgeChain, hidden: bool) -> _LocatedEdges:
    """The edges of a part of a chain in which either all rows may hide edges (hidden) or none."""
    row, period, span, length = (
        np.asarray(x) for x in (chain.row, chain.period_s, chain.span, chain.length_s)
    )
    start, found = column.start_s[row], None
    if hidden:
        found = track_hidden_edges(
            column.time_s[row], start, chain, 0.5 * column.lsb_rpm, column.counts
        )
    if found is None:
        timeout = np.zeros(len(row), dtype=bool)
        end, slack, piece = edge_times(chain)
        slack = slack + _either_row(column.time_s, chain, end, slack)
    else:
        end, slack, span, timeout = found.end_s, found.slack_s, found.step, found.timeout
        piece = np.zeros(len(row), dtype=int)
        length = np.where(span > 0, span * period, period) if column.counts else length
    # after missing rows the row's speed is the mean over its own edges alone
    missing = (start > np.asarray(chain.before_s)) & column.counts
    own = np.minimum(np.maximum(np.ceil((end - start) / period), 1.0), np.maximum(span, 1))
    length = np.where(missing, own * period, length)
    return _LocatedEdges(end, slack, piece, span, length, timeout)


def _either_row(
    time_s: np.ndarray, chain: EdgeChain, end: np.ndarray, slack: np.ndarray
) -> np.ndarray:
    """One period (edges,), s, where rows report the last of several edges and one lies so close to
    the row's end that it may belong to the next row; else 0.
    """
    row, period = np.asarray(chain.row), np.asarray(chain.period_s)
    interval = time_s[row] - time_s[np.maximum(row - 1, 0)]
    # since the edge; it is the last one if the next comes later than the row
    after = time_s[row] - end
    close = np.minimum(after, period - after) < slack + NEAR_END_S
    return np.where(close & (period < interval), period, 0.0)
