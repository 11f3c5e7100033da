"""Refuses a problem in which a column of the logs compares no sample."""

import numpy as np

from vgroove.errors import VgrooveError
from vgroove.gap.residual.problem import Problem


def refuse_uncompared(problem: Problem) -> None:
    """VgrooveError that names the columns of which no sample is compared on the judged blocks: a
    gap without them would look smaller than it is.
    """
    counted = np.isfinite(problem.squared(problem.residuals(problem.theta0)[0])) & problem.judged
    empty = [
        s.column for k, s in enumerate(problem.signals) if not counted[problem.signal == k].any()
    ]
    if empty:
        sources = ", ".join(str(log.source) for log in problem.logs)
        raise VgrooveError(
            f"{sources}: no sample of {' and '.join(empty)} can be compared with the simulation: "
            "the samples are missing, lie in holes of the log, or are too far apart; check time_s "
            "and the command, or leave the column out (--as-is, in Python as_is=True, ignores it)"
        )
