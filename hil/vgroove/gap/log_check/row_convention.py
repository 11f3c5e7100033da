"""Whether the command of a row acts before the row or after it, estimated from the response of the
measured columns to changes of the command.

The row differences of a column are a linear combination, by least squares, of those of the nominal
signal with rows as intervals and of those of the change that rows as instants make to it: the
second coefficient over the first is the shift of the response in rows, 0 for intervals and 1 for
instants. Its standard error is a delete-one jackknife over blocks (B. Efron, "The jackknife, the
bootstrap and other resampling plans", SIAM, 1982). Row differences remove what changes slowly: the
errors of a rig's friction, inertia and supply.
"""

from dataclasses import dataclass, replace

import numpy as np

from vgroove.gap.log_check.facts import LogFacts
from vgroove.gap.log_check.finding import Finding
from vgroove.gap.log_check.nominal import Pair, first_rows, is_simulated, nominal_pairs
from vgroove.log import Log
from vgroove.rig import Rig

# Columns that show the shift. A speed made from Hall edges is older than its row.
COLUMNS = ("current_a", "position_rad")


@dataclass(frozen=True)
class ConventionRules:
    """Limits within which a shift determines the convention. Their values were checked on cases of
    the blind set (docs/gap_bench.md), whose rows are intervals, and on the same cases with the
    command shifted by a row, so that the rows are instants.
    """

    blocks: int = 20  # of the jackknife
    sigmas: float = 3.0  # by which a shift must lie on one side of half a row
    max_off: float = 0.4  # rows from 0 or 1, beyond which it is a delay or lag of the tool
    min_gain: float = 0.5  # of the column over its nominal signal; its inverse is the largest


RULES = ConventionRules()


@dataclass(frozen=True)
class Shift:
    """Shift of a column's response in rows, its standard error, and the gain of the column. beyond:
    the shift beyond that of instants, in rows, from a simulation that is one row later.
    """

    column: str
    rows: float
    error: float
    gain: float
    beyond: float = 0.0

    @property
    def side(self) -> str:
        """Convention to which the shift is nearer: interval or instant; empty where it is not
        significant.
        """
        fits = RULES.min_gain <= self.gain <= 1.0 / RULES.min_gain
        if not fits or not abs(self.rows - 0.5) > RULES.sigmas * self.error:
            return ""
        return "interval" if self.rows < 0.5 else "instant"

    @property
    def is_near(self) -> bool:
        """Whether the shift is about that of its side, and no delay or lag of the tool."""
        off = abs(self.rows - (self.side == "instant"))
        return off <= RULES.max_off and (self.side == "interval" or self.beyond < 0.5)

    def __str__(self) -> str:
        return f"{self.column} {self.rows:.2f} +- {self.error:.2f} rows"


def convention_of(log: Log, rig: Rig) -> tuple[str, str]:
    """Convention of the command (interval, instant or unknown) and the reason in words."""
    if not is_simulated(rig):
        return "unknown", "the plant is not driven by a log of this rig"
    shifts = shifts_of(first_rows(log, rig), rig)
    if not shifts:
        return "unknown", f"neither {' nor '.join(COLUMNS)} shows when the command acts"
    reason = (
        f"response later than with rows as intervals: {', '.join(map(str, shifts))}; instants: 1"
    )
    clear = [shift for shift in shifts if shift.side]
    sides = {shift.side for shift in clear}
    if len(sides) != 1 or not any(shift.is_near for shift in clear):
        return "unknown", f"{reason}: that does not decide"
    return sides.pop(), reason


def shifts_of(log: Log, rig: Rig) -> list[Shift]:
    """The shift of each column that the convention changes."""
    before, after = (
        {pair.column: pair for pair in nominal_pairs(log, _with_hold(rig, hold))}
        for hold in ("before", "after")
    )
    found = []
    for column in (c for c in COLUMNS if c in before):
        shift = shift_of(before[column], after[column])
        beyond = shift_of(after[column], one_row_later(after[column]))
        if shift is not None:
            found.append(replace(shift, beyond=beyond.rows if beyond else 0.0))
    return found


def one_row_later(pair: Pair) -> Pair:
    """The pair with its nominal signal one row later."""
    return replace(pair, nominal=np.concatenate([pair.nominal[:1], pair.nominal[:-1]]))


def _with_hold(rig: Rig, hold: str) -> Rig:
    return replace(rig, input={**rig.input, "hold": hold})


def shift_of(before: Pair, after: Pair) -> Shift | None:
    """The shift of a column from its nominal signals with both conventions; None where these do not
    differ.
    """
    measured, nominal = np.diff(before.measured), np.diff(before.nominal)
    change = np.diff(after.nominal - before.nominal)
    known = np.isfinite(measured) & np.isfinite(nominal) & np.isfinite(change)
    regressors, measured = np.stack([nominal, change], 1)[known], measured[known]
    if len(measured) < RULES.blocks or not change[known].any():
        return None
    parts = np.array_split(np.arange(len(measured)), RULES.blocks)
    square = np.array([regressors[k].T @ regressors[k] for k in parts])
    product = np.array([regressors[k].T @ measured[k] for k in parts])
    try:
        gain, scaled = np.linalg.solve(square.sum(0), product.sum(0))
        left = np.linalg.solve(square.sum(0) - square, (product.sum(0) - product)[..., None])
    except np.linalg.LinAlgError:
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        rows, apart = scaled / gain, left[:, 1, 0] / left[:, 0, 0]
        error = np.sqrt((RULES.blocks - 1) * np.mean((apart - apart.mean()) ** 2))
    return Shift(before.column, float(rows), float(error), float(gain))


def with_convention(facts: LogFacts, log: Log, rig: Rig) -> tuple[LogFacts, list[Finding]]:
    """The facts with the convention of the command, and a remark where it is not the rig's."""
    rows, reason = convention_of(log, rig)
    facts = replace(facts, command_rows=rows, command_rows_reason=reason)
    stated = "instant" if rig.command_holds_after else "interval"
    if rows in ("unknown", stated):
        return facts, []
    hold = "after" if rows == "instant" else "before"
    text = (
        f"the rows look like {rows}s ({reason}): if the logger writes so, put "
        f'hold = "{hold}" into [input] of the rig'
    )
    return facts, [Finding(text)]
