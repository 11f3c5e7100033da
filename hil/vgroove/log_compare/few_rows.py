"""The warning of a comparison in which few rows take part, as where a time column is in another
unit.
"""

import numpy as np

from vgroove.log.table import Log
from vgroove.log_compare.limits import Limits
from vgroove.units import TIME_UNITS

UNIT_RATIOS = [max(factor, 1.0 / factor) for factor in TIME_UNITS]


def few_rows_warning(a: Log, b: Log, compared: int, limits: Limits) -> str:
    """A sentence where the compared rows are few beside the rows of both logs, and whether the
    median intervals between rows suggest a wrong unit of time; empty where they are not few.
    """
    if compared >= limits.few_share * min(len(a), len(b)):
        return ""
    few = (
        f"Only {compared} rows take part, of {len(a)} in A and {len(b)} in B: the findings hold "
        "for this small part of the logs."
    )
    return f"{few} {unit_sentence(a, b, limits)}".strip()


def unit_sentence(a: Log, b: Log, limits: Limits) -> str:
    """Which median intervals the rows of two logs have, where their ratio is that of two units of
    time; else empty.
    """
    interval_a, interval_b = (float(np.median(np.diff(log.time_s))) for log in (a, b))
    ratio = max(interval_a, interval_b) / min(interval_a, interval_b)
    near = [r for r in UNIT_RATIOS if abs(ratio / r - 1.0) <= limits.unit_tolerance]
    if not near:
        return ""
    return (
        f"The median interval between rows is {interval_a:.4g} s in A and {interval_b:.4g} s in B, "
        f"a ratio near {near[0]:.10g}: one of the time columns seems not to be in s. Give this "
        "column a name of its own, such as Time, and state its unit: --map Time:ms=time_s."
    )
