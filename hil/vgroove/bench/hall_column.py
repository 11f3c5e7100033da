"""The Hall speed column of a run as the diagnosis compares it: the mean speed over the last edge
period of each row.
"""

import numpy as np
import numpy.typing as npt

from vgroove.gap.residual.channels import ChannelInfo, Samples, SpanChannel, Spans, span_channel

Floats = npt.NDArray[np.float64]

PULSES_PER_TURN = 4
NEWTON_STEPS = 4


def edge_times(time_s: Floats, angle_rad: Floats, speed_rad_s: Floats) -> Floats:
    """Times (m,) at which a growing angle passes a multiple of the pitch, by the cubic through
    angles and speeds at the rows.
    """
    pitch = 2.0 * np.pi / PULSES_PER_TURN
    target = pitch * np.arange(1, int(angle_rad[-1] / pitch) + 1)
    row = np.searchsorted(angle_rad, target)
    length, before, after = time_s[row] - time_s[row - 1], angle_rad[row - 1], angle_rad[row]
    start, end = speed_rad_s[row - 1] * length, speed_rad_s[row] * length
    square, cube = 3.0 * (after - before) - 2.0 * start - end, 2.0 * (before - after) + start + end
    f = (target - before) / (after - before)
    for _ in range(NEWTON_STEPS):
        f -= (before + f * (start + f * (square + f * cube)) - target) / (
            start + f * (2.0 * square + f * 3.0 * cube)
        )
    return time_s[row - 1] + f * length


def hall_channel(time_s: Floats, edges_s: Floats) -> SpanChannel:
    """The channel of a log with these edges: `measured` is the Hall column in rad/s, `row` are the
    rows from the second edge on.
    """
    last = np.searchsorted(edges_s, time_s, side="right") - 1
    row = np.flatnonzero(last >= 1)
    start, end = edges_s[last[row] - 1], edges_s[last[row]]
    measured = 2.0 * np.pi / PULSES_PER_TURN / (end - start)
    info = ChannelInfo("speed_rpm", "rad/s", edges=True)
    samples = Samples(row, measured, np.zeros(row.size))
    return span_channel(info, samples, Spans(time_s, start, end))
