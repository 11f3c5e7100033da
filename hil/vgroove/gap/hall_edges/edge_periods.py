"""The periods between successive Hall edges that a logged speed column holds, as arrays in order of
time.
"""

from dataclasses import dataclass, fields

import numpy as np

# pulses per turn from which a sensor reports the mean speed over all edges since the row before;
# below, the speed over the last edge period alone (docs/spec/gap.md, section 1)
MIN_COUNTING_PULSES = 16
# s: periods that end or begin closer than this to a change of sign may be wrong, since the shaft
# may pass one edge twice where it reverses; chosen on the tuning half of the blind set
REVERSAL_S = 0.1


@dataclass(frozen=True)
class EdgePeriods:
    """Edge periods of a speed column in order of time; every array has the same length (m,).

    row: index of the log row that reports the period.
    start_s, end_s: the span over which the row's speed is a mean.
    speed_rpm: the row's value as logged: one pitch divided by the span, times `scale`.
    slack_s: half width of the interval of all values of end_s that the rows allow.
    timeout: True for a timeout sample, a row that reports the time since the last edge: one pitch
    divided by that time is an upper bound of the speed, and no edge lies at end_s.
    chain: index of the uninterrupted sequence of edges that the period belongs to.
    count: signed number of edges passed at end_s since the first of all (0 for timeout samples).
    expected_rpm: mean speed of the nominal model over each span, where it was computed.
    missed: number of edges in each span that the sensor missed, where it is known from the rows.
    scale: logged speed over one pitch per span, measured in the time of the log.
    """

    row: np.ndarray
    start_s: np.ndarray
    end_s: np.ndarray
    speed_rpm: np.ndarray
    slack_s: np.ndarray
    timeout: np.ndarray
    chain: np.ndarray
    count: np.ndarray
    expected_rpm: np.ndarray | None = None
    missed: np.ndarray | None = None
    scale: float = 1.0

    def without_timeouts(self) -> "EdgePeriods":
        """The periods alone, without the timeout samples."""
        arrays = {f.name: getattr(self, f.name) for f in fields(self)}
        return EdgePeriods(
            **{
                name: value[~self.timeout] if isinstance(value, np.ndarray) else value
                for name, value in arrays.items()
            }
        )


def near_reversal(edges: EdgePeriods) -> np.ndarray:
    """Periods (m,) within REVERSAL_S of a change of sign, where one edge may have been counted
    twice.
    """
    sign = np.sign(edges.speed_rpm)
    turned = (sign[1:] != sign[:-1]) & (edges.start_s[1:] - edges.end_s[:-1] < REVERSAL_S)
    return np.concatenate([[False], turned]) | np.concatenate([turned, [False]])
