"""Values that mark missing samples, such as 65535 for a frame that a logger did not receive."""

from dataclasses import dataclass

import numpy as np

from vgroove.gap.log_check.finding import Finding
from vgroove.log import Log
from vgroove.rig import Rig
from vgroove.rig_keys import JUDGED_COLUMNS
from vgroove.units import RPM_PER_RAD_S


@dataclass(frozen=True)
class MarkRules:
    """When a value marks missing samples (values chosen; no log of tests/data comes near)."""

    min_rows: int = 3  # that hold exactly this value
    # what loggers write for a missing sample: limits of integers of 16 and 32 bits, and nines
    sizes: tuple[float, ...] = (32_767, 32_768, 65_535, 9999, 99_999, 2**31 - 1, 2**31, 2**32 - 1)
    # usual changes of the column (its quantile usual_quantile of all changes that are not 0), by
    # which such a value differs from the values before and after it; a shaft that passes the value
    # or rests at it comes near first
    step: float = 20.0
    usual_quantile: float = 0.9
    # times the largest magnitude of the other rows: of any other value, and of such a number in
    # consecutive rows, in which a sensor at its limit holds it too
    beyond: float = 5.0
    over_rig_for_number: float = 2.0  # the same: times the value that the rig's supply gives
    alone: float = 0.8  # share of its rows whose neighbours do not hold it
    # times the rig's value beyond which a sensor at its limit is none: 2 for a current that brakes
    # against the supply, 2 for a rig whose values are off
    over_rig: float = 4.0


MARK = MarkRules()
MEND = "if it marks missing samples, write them as empty cells or NaN"


def marked_findings(log: Log, rig: Rig | None) -> list[Finding]:
    """Findings on columns with a mark of missing samples, or with a sensor at its limit: a number
    that loggers write for a missing sample and that the column reaches by a step, or any other
    value, far beyond all others, in single rows.
    """
    found = []
    for name in (name for name in JUDGED_COLUMNS if name in log.columns):
        values = np.asarray(log.columns[name], float)
        found += _logger_marks(name, values, rig) or _far_values(name, values, rig)
    return found


def _logger_marks(name: str, values: np.ndarray, rig: Rig | None) -> list[Finding]:
    """A finding for each number of MARK.sizes that a column (rows,) reaches by a step and leaves by
    one: a refusal where it stands in single rows or far beyond all others, else a warning.
    """
    seen = values[np.isfinite(values)]
    is_mark = np.isin(np.abs(seen), MARK.sizes)
    far, found = _far_step(seen[~is_mark]), []
    others = float(np.abs(seen[~is_mark]).max(initial=0.0))
    most = min(MARK.beyond * others, MARK.over_rig_for_number * _largest_of_rig(name, rig))
    for mark in np.unique(seen[is_mark]) if far > 0.0 else ():
        rows, least = _rows_after_steps(seen, mark, far)
        if rows >= MARK.min_rows:
            certain = abs(mark) > most or _in_single_rows(seen == mark)
            text = (
                f"column {name}: reads exactly {mark:.6g} in {rows} rows, {least:.4g} or more away "
                "from the values beside them, and loggers write this number for a sample that they "
                f"lack: {MEND}"
            )
            found.append(Finding(text, refuses=certain, warns=not certain))
    return found


def _far_step(others: np.ndarray) -> float:
    """Change of a column from row to row that its other values (n,) do not explain: many usual
    changes, or more than from 0 or any other value to the farthest. inf without other values.
    """
    if not len(others):
        return np.inf
    span = float(max(others.max(), 0.0) - min(others.min(), 0.0))
    changes = np.abs(np.diff(others))
    changes = changes[changes > 0.0]
    if not len(changes):
        return span
    return min(span, MARK.step * float(np.quantile(changes, MARK.usual_quantile)))


def _rows_after_steps(seen: np.ndarray, mark: float, far: float) -> tuple[int, float]:
    """Number of values (n,) that are the mark, in runs which begin and end with a change of more
    than far, and the smallest of these changes. A run that begins or ends the column has one.
    """
    held = np.concatenate([[False], seen == mark, [False]])
    begin, end = np.flatnonzero(held[1:] & ~held[:-1]), np.flatnonzero(held[:-1] & ~held[1:])
    steps = np.abs(np.diff(seen, prepend=np.inf, append=np.inf))
    least = np.minimum(steps[begin], steps[end])
    reached = (least > far) & np.isfinite(least)
    return int((end - begin)[reached].sum()), float(least[reached].min(initial=np.inf))


def _far_values(name: str, values: np.ndarray, rig: Rig | None) -> list[Finding]:
    """A finding on the largest magnitude of a column (rows,), where it is far beyond all others and
    stands in single rows: a refusal for the mark of a missing sample, a warning for what may be the
    limit of a sensor.
    """
    size = np.abs(np.nan_to_num(values))
    top, marked = float(size.max(initial=0.0)), size == size.max(initial=0.0)
    others = float(size[~marked].max(initial=0.0))
    if others == 0.0 or top <= MARK.beyond * others or not _in_single_rows(marked):
        return []
    text = (
        f"column {name}: reads exactly {values[marked][0]:.6g} in {np.count_nonzero(marked)} "
        f"rows and {others:.4g} at most in the others: {MEND}"
    )
    certain = top in MARK.sizes or top > MARK.over_rig * _largest_of_rig(name, rig)
    return [Finding(text, refuses=certain, warns=not certain)]


def _in_single_rows(marked: np.ndarray) -> bool:
    """Whether most of the marked rows (rows,) have no marked row beside them."""
    beside = np.append(marked[1:], False) | np.append(False, marked[:-1])
    count = np.count_nonzero(marked)
    return count >= MARK.min_rows and np.count_nonzero(marked & ~beside) >= MARK.alone * count


def _largest_of_rig(column: str, rig: Rig | None) -> float:
    """The value that the rig's supply gives a column: at stall for the current, without a load for
    the speed; inf where it is not known.
    """
    supply = None if rig is None else rig.supply.get("voltage_v")
    if supply is None or column == "position_rad":
        return np.inf
    sizes = {
        "supply_v": supply,
        "current_a": rig.stall_current_a,
        "speed_rpm": supply / rig.motor["torque_constant_nm_per_a"] * RPM_PER_RAD_S,
    }
    return sizes[column]
