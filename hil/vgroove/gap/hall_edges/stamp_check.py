"""Checks time stamps against the Hall edges: edge periods follow one another without contradiction
only if the times are those at which the rows ended.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from vgroove.gap.hall_edges.edge_periods import MIN_COUNTING_PULSES
from vgroove.gap.hall_edges.reader import count_chains
from vgroove.log import Log
from vgroove.rig import Rig


def stamp_contradictions(log: Log, rig: Rig) -> Callable[[np.ndarray], int] | None:
    """Function of row times (n,), s, that counts the consistent chains of edge periods in the log's
    speed column: more chains, more contradictions. None where the log holds no single edges.
    """
    pulses = rig.sensors.get("hall_pulses_per_rev", 0)
    if not 0 < pulses < MIN_COUNTING_PULSES or "speed_rpm" not in log.columns:
        return None
    speed_rpm = np.asarray(log.columns["speed_rpm"], dtype=float)
    lsb_rpm = rig.sensors.get("speed_lsb_rpm", 0.0)
    return partial(count_chains, speed_rpm=speed_rpm, pulses_per_rev=pulses, lsb_rpm=lsb_rpm)
