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

    beyond: float = 5.0  # times the largest magnitude of the other rows
    min_rows: int = 3  # that hold exactly this value
    alone: float = 0.8  # share of them whose neighbours do not hold it
    # times the rig's value beyond which a sensor at its limit is none: 2 for a current that brakes
    # against the supply, 2 for a rig whose values are off
    over_rig: float = 4.0
    # what loggers write for a missing sample: limits of integers of 16 and 32 bits, and nines
    sizes: tuple[float, ...] = (32_767, 32_768, 65_535, 9999, 99_999, 2**31 - 1, 2**31, 2**32 - 1)


MARK = MarkRules()


def marked_findings(log: Log, rig: Rig | None) -> list[Finding]:
    """Findings on columns in which one value, far beyond all others, stands in single rows: the
    mark of a missing sample, such as 65535, or the limit of a sensor.
    """
    found = []
    for name in (name for name in JUDGED_COLUMNS if name in log.columns):
        values = np.asarray(log.columns[name], float)
        size = np.abs(np.nan_to_num(values))
        top, marked = float(size.max(initial=0.0)), size == size.max(initial=0.0)
        others = float(size[~marked].max(initial=0.0))
        if others == 0.0 or top <= MARK.beyond * others or not _in_single_rows(marked):
            continue
        text = (
            f"column {name}: reads exactly {values[marked][0]:.6g} in {np.count_nonzero(marked)} "
            f"rows and {others:.4g} at most in the others: if it marks missing samples, write them "
            "as empty cells or NaN"
        )
        certain = top in MARK.sizes or top > MARK.over_rig * _largest_of_rig(name, rig)
        found.append(Finding(text, refuses=certain, warns=not certain))
    return found


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
