"""A remark on a fitted delay of one row: it may be the log's convention and not the tool's."""

from collections.abc import Mapping

import numpy as np

from vgroove.gap.residual.problem import Problem
from vgroove.gap.selection.parameter_estimate import ParameterEstimate

DELAY = "transport_delay"
# relative difference from one row of a delay whose interval was not computed (chosen)
TOLERANCE = 0.1


def row_interval_s(problem: Problem) -> float:
    """Median interval of the rows of all logs in s."""
    return float(np.median(np.concatenate([np.diff(log.time_s) for log in problem.logs])))


def is_one_row(delay: ParameterEstimate, interval_s: float) -> bool:
    """Whether one row lies within the 95 % interval of a fitted delay."""
    if delay.ci95 is None:
        return abs(delay.value - interval_s) <= TOLERANCE * interval_s
    return delay.ci95[0] <= interval_s <= delay.ci95[1]


def row_delay_remarks(
    fitted: Mapping[str, Mapping[str, ParameterEstimate]], interval_s: float, holds_after: bool
) -> list[str]:
    """The remark on a fitted delay of one row, where the rig's commands hold before their row;
    fitted: parameters by name of each selected effect.
    """
    delay = fitted.get(DELAY, {}).get("delay_s")
    if delay is None or holds_after or not is_one_row(delay, interval_s):
        return []
    return [
        f"{DELAY}: the fitted delay of {1e3 * delay.value:.3g} ms is one row "
        f"({1e3 * interval_s:.3g} ms) within its interval. Where each row of the log is an "
        "instant, with the command that holds from it on, this is the log's convention and no "
        'delay of the tool: put hold = "after" into [input] of the rig and diagnose again'
    ]
