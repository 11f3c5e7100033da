"""Channel of an encoder: what of its angle is compared with the model. With a voltage or duty as
input these are mean speeds over spans of rows, with a current or force as input accelerations, and
the angle itself where its resolution is too coarse for either (angle_comparison.py).
"""

from dataclasses import dataclass, replace

import numpy as np

from vgroove.gap.cleaning.sensor_noise import divided_differences, driving_current_sigma
from vgroove.gap.residual.angle_comparison import (
    acceleration_sigma,
    angle_step_rad,
    is_visible,
)
from vgroove.gap.residual.channels import (
    ENCODER,
    AngleChannel,
    Channel,
    ChannelInfo,
    ForceChannel,
    InterpolationPoints,
    Samples,
    Spans,
    span_channel,
)
from vgroove.gap.residual.clean_log import CleanLog
from vgroove.gap.residual.coarse_angle import angle_samples


@dataclass(frozen=True)
class DifferenceRules:
    """Rows between the instants of a difference of angles; chosen on the tuning half of the blind
    set (docs/gap_bench.md).
    """

    min_force_rows: int = 2  # of a second difference
    max_span_s: float = 0.05  # longest span of a second difference
    min_spans: int = 6  # spans that the log must hold
    max_gap_spans: int = 5  # longest span with missing samples, in usual spans
    even_share: float = 1e-3  # by which the two halves of a second difference may differ


DIFFERENCES = DifferenceRules()


def position_channel(log: CleanLog) -> Channel:
    """The encoder's channel: the angle itself, the acceleration where the input is a current or
    force, otherwise the mean speed.
    """
    position = log.columns["position_rad"]
    sigma = log.noise["position_rad"].sigma
    known = np.flatnonzero(np.isfinite(position))
    if log.compares_angle:
        return _angle_channel(log, known, sigma)
    if log.kind == "current_a":
        return _force_channel(log, known, sigma)
    return _speed_channel(log, known, sigma)


def _speed_channel(log: CleanLog, known: np.ndarray, sigma: float) -> Channel:
    time_s, position = log.time_s, log.columns["position_rad"]
    rows = _span_rows(time_s[known], position[known], sigma, 1)
    first, last = known[:-rows:rows], known[rows::rows]
    close = last - first <= DIFFERENCES.max_gap_spans * rows
    first, last = first[close], last[close]
    length = time_s[last] - time_s[first]
    channel = span_channel(
        ChannelInfo("position_rad", "rad/s", note="compared through its derivative"),
        Samples(last, (position[last] - position[first]) / length, np.sqrt(2.0) * sigma / length),
        Spans(time_s, time_s[first], time_s[last]),
    )
    return replace(channel, sensor=ENCODER)


def _angle_channel(log: CleanLog, known: np.ndarray, sigma: float) -> AngleChannel:
    position = log.columns["position_rad"][known]
    seen = angle_samples(log.time_s[known], position, sigma, angle_step_rad(log))
    points = InterpolationPoints.of(log.time_s, seen.time_s)
    return AngleChannel(
        "position_rad",
        "rad",
        points.row,
        seen.time_s,
        seen.angle_rad,
        seen.sigma_rad,
        np.zeros(len(seen.row), dtype=bool),
        note="compared from restart to restart of the model",
        noise_is_known="position_lsb_rad" in log.rig.sensors and not seen.borders_scatter,
        points=points,
    )


def _force_channel(log: CleanLog, known: np.ndarray, sigma: float) -> ForceChannel:
    time_s, position = log.time_s, log.columns["position_rad"]
    rows = _span_rows(time_s[known], position[known], sigma, DIFFERENCES.min_force_rows)
    first, middle, last = _even_triples(time_s, known, rows)
    length = 0.5 * (time_s[last] - time_s[first])
    noise_a = driving_current_sigma(log.rig, log.columns["current_a"])
    sigma_of_input = acceleration_sigma(log, noise_a) * np.sqrt(2.0 / 3.0 / rows)
    points = (InterpolationPoints.of(time_s, time_s[at]) for at in (first, middle, last))
    return ForceChannel(
        "position_rad",
        "rad/s^2",
        last,
        time_s[middle],
        (position[last] - 2.0 * position[middle] + position[first]) / length**2,
        np.hypot(np.sqrt(6.0) * sigma / length**2, sigma_of_input),
        np.zeros(len(last), dtype=bool),
        note="compared through its second derivative",
        points=tuple(points),
        length_s=length,
    )


def _even_triples(
    time_s: np.ndarray, known: np.ndarray, rows: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """First, middle and last rows (k,) of second differences, those with halves of equal length."""
    first, middle, last = known[: -2 * rows : rows], known[rows:-rows:rows], known[2 * rows :: rows]
    count = min(len(first), len(middle), len(last))
    first, middle, last = first[:count], middle[:count], last[:count]
    length = 0.5 * (time_s[last] - time_s[first])
    even = np.abs((time_s[middle] - time_s[first]) / length - 1.0) < DIFFERENCES.even_share
    return first[even], middle[even], last[even]


def _span_rows(time_s: np.ndarray, position: np.ndarray, sigma: float, least: int) -> int:
    """Rows between the instants of a difference: `least`, doubled while the acceleration is hidden
    in the noise and the span is short enough.
    """
    rows, step = least, float(np.median(np.diff(time_s))) if len(time_s) > 1 else 0.0
    while 2 * rows * step <= DIFFERENCES.max_span_s and DIFFERENCES.min_spans * rows < len(
        position
    ):
        if is_visible(divided_differences(time_s, position, 2, rows), sigma):
            break
        rows *= 2
    return rows
