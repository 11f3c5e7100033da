"""Compares two logs: the first difference by time and column, and the gap of each column."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from vgroove.log.table import Log
from vgroove.log_compare.few_rows import few_rows_warning
from vgroove.log_compare.gaps import EQUAL, ColumnPair, SignalGap, differs, signal_gap
from vgroove.log_compare.limits import (
    BOARD_INPUTS,
    BOARD_OUTPUTS,
    BRIDGE_COMMAND,
    DISCRETE,
    LIMITS,
    Limits,
)
from vgroove.log_compare.pairing import Pairs, pair_rows, values_at
from vgroove.log_compare.time_map import TimeMap, fit_time_map


@dataclass(frozen=True)
class FirstDifference:
    """The first row in which the logs differ: its time, the columns that differ in it, and how the
    first of them (bridge command, inputs of the board, its other outputs) differs: by at most one
    step of its resolution (`quantisation`), by a value that the other log has in the next or the
    previous row (`timing`), or `other`.
    """

    time_s: float
    columns: tuple[str, ...]
    kind: str


@dataclass(frozen=True)
class Comparison:
    """Two logs compared. `rows`: of A and of B; `equal_rows`: rows before the first difference,
    equal bit for bit; `cause`: input, output or equal: whether an input of the board, or one of its
    outputs at equal inputs until then, differs first; `warnings`: sentences on why the comparison
    may mislead.
    """

    a: str
    b: str
    rows: tuple[int, int]
    pairs: Pairs
    time_map: TimeMap
    signals: tuple[SignalGap, ...]
    only_in: dict[str, str]
    first: FirstDifference | None
    equal_rows: int
    cause: str
    warnings: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """For the JSON file (schema vgroove.log_compare/1)."""
        return {
            "schema": "vgroove.log_compare/1",
            "a": self.a,
            "b": self.b,
            "rows": {
                "a": self.rows[0],
                "b": self.rows[1],
                "paired": len(self.pairs.time_s),
                "interpolated": self.pairs.interpolated,
                "only_a": self.pairs.only_a,
                "only_b": self.pairs.only_b,
                "equal_before_first_difference": self.equal_rows,
            },
            "warnings": list(self.warnings),
            "cause": self.cause,
            "first_difference": None if self.first is None else asdict(self.first),
            "clock": {
                "offset_s": self.time_map.offset_s,
                "drift_ppm": 1e6 * self.time_map.drift,
                "removed_share": self.time_map.share,
            },
            "columns": {gap.name: _without_nan(asdict(gap)) for gap in self.signals},
            "columns_of_one_log": self.only_in,
        }


def _without_nan(values: dict[str, Any]) -> dict[str, Any]:
    """Values by name, with None for each NaN (a missing sample), since JSON has no NaN."""
    return {name: None if value != value else value for name, value in values.items()}


def compare_logs(a: Log, b: Log, limits: Limits = LIMITS) -> Comparison:
    """Compare two logs; VgrooveError where they have no common column or time."""
    pairs = pair_rows(a, b, limits)
    continuous = [name for name in pairs.a if name not in DISCRETE]
    time_map = fit_time_map(a, b, continuous, limits)
    times_b = time_map.to_b(pairs.time_s)
    signals = tuple(
        signal_gap(
            ColumnPair(
                name,
                pairs.time_s,
                pairs.a[name],
                pairs.b[name],
                values_at(b, name, times_b) if time_map.share else None,
            ),
            limits,
        )
        for name in pairs.a
    )
    first = _first_difference(pairs, signals)
    only = {n: "A" for n in a.columns if n not in b} | {n: "B" for n in b.columns if n not in a}
    equal_rows = len(pairs.time_s)
    if first is not None:
        equal_rows = int(np.searchsorted(pairs.time_s, first.time_s))
    warning = few_rows_warning(a, b, pairs.compared, limits)
    return Comparison(
        a=a.source,
        b=b.source,
        rows=(len(a), len(b)),
        pairs=pairs,
        time_map=time_map,
        signals=signals,
        only_in=only,
        first=first,
        equal_rows=equal_rows,
        cause=_cause(first),
        warnings=(warning,) if warning else (),
    )


def _cause(first: FirstDifference | None) -> str:
    if first is None:
        return EQUAL
    if first.columns[0] in BOARD_OUTPUTS:
        return "output"
    return "input" if first.columns[0] in BOARD_INPUTS else "other"


def _first_difference(pairs: Pairs, signals: tuple[SignalGap, ...]) -> FirstDifference | None:
    rows = {g.name: g.first_s for g in signals if g.first_s is not None}
    if not rows:
        return None
    time_s = min(rows.values())
    causes = dict.fromkeys((*BRIDGE_COMMAND, *BOARD_INPUTS, *BOARD_OUTPUTS))
    order = {name: rank for rank, name in enumerate(causes)}
    names = sorted((n for n in rows if rows[n] == time_s), key=lambda n: order.get(n, len(order)))
    gap = next(g for g in signals if g.name == names[0])
    return FirstDifference(time_s, tuple(names), _kind_at(pairs, gap, time_s))


def _kind_at(pairs: Pairs, gap: SignalGap, time_s: float) -> str:
    """How a column differs in the row of its first difference."""
    row = int(np.searchsorted(pairs.time_s, time_s))
    a, b = pairs.a[gap.name], pairs.b[gap.name]
    small = abs(b[row] - a[row]) <= gap.resolution * (1.0 + 1e-6)
    if gap.name not in DISCRETE and small:
        return "quantisation"
    near = [k for k in (row - 1, row + 1) if 0 <= k < len(a)]
    moved = any(not differs(a[[k]], b[[row]])[0] or not differs(b[[k]], a[[row]])[0] for k in near)
    return "timing" if moved else "other"
