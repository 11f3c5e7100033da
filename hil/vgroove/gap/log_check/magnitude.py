"""A speed without its sign, as a sensor measures it that does not see the direction."""

import numpy as np

from vgroove.gap.log_check.finding import Finding
from vgroove.gap.log_check.nominal import Pair

MIN_ROWS = 20  # that turn backwards, and forwards, in the simulation
LEAST_SHARE = 0.02  # of the largest speed: a speed with sign goes below minus this
TURNS_SHARE = 0.2  # of the largest nominal speed, beyond which a row turns in any case
# median ratio to the nominal magnitude; the speed of a load that drives the tool lies outside
FOLLOWS = (0.5, 2.0)


def magnitude_findings(pairs: list[Pair]) -> list[Finding]:
    """The refusal of a speed that is never negative and follows the magnitude of a nominal speed
    that turns both ways. pairs: the columns of a log beside their nominal signals.
    """
    for pair in pairs:
        if pair.column == "speed_rpm" and (rows := _rows_of_magnitude(pair)):
            text = (
                f"column speed_rpm: never negative, also in {rows} rows in which the rig's "
                "simulation turns backwards: is it a speed without sign? Give it the sign of the "
                "motion, or leave the column out"
            )
            return [Finding(text, refuses=True)]
    return []


def _rows_of_magnitude(pair: Pair) -> int:
    """Number of rows of a column that hold the absolute value of a nominal signal that is negative
    there; 0 where the column has negative values of its own.
    """
    known = np.isfinite(pair.measured) & np.isfinite(pair.nominal)
    measured, nominal = pair.measured[known], pair.nominal[known]
    largest = np.abs(measured).max(initial=0.0)
    least = TURNS_SHARE * np.abs(nominal).max(initial=0.0)
    backwards, forwards = nominal < -least, nominal > least
    count = int(np.count_nonzero(backwards))
    if min(count, np.count_nonzero(forwards)) < MIN_ROWS or measured.min() < -LEAST_SHARE * largest:
        return 0
    ratio = float(np.median(measured[backwards] / -nominal[backwards]))
    return count if FOLLOWS[0] <= ratio <= FOLLOWS[1] else 0
