"""Channels of a speed column that is made from Hall edges: over the edge periods themselves, or,
where a filter has smoothed them, over the pitch before each row.
"""

from dataclasses import dataclass, replace

import numpy as np

from vgroove.gap.cleaning.missing_values import interpolate_missing
from vgroove.gap.cleaning.sensor_noise import MIN_SIGMA, UNIFORM_WIDTH_SIGMAS
from vgroove.gap.hall_edges.edge_periods import EdgePeriods, near_reversal
from vgroove.gap.hall_edges.jitter import sigma_with_missed_rpm
from vgroove.gap.hall_edges.missed_edges import estimate_missed_edges
from vgroove.gap.residual.channels import ChannelInfo, Samples, SpanChannel, Spans, span_channel
from vgroove.gap.residual.clean_log import CleanLog
from vgroove.gap.residual.moving_mean import moving_mean
from vgroove.units import RPM_PER_RAD_S

DEFAULT_TIMEOUT_S = 0.25  # of a Hall sensor whose rig names none: docs/spec/gap.md, section 2
S_PER_MIN = 60.0
MIN_PERIOD_S = 1e-9  # keeps a speed finite
MIN_SPEED_RPM = 1e-6  # keeps a period finite


@dataclass(frozen=True)
class FilteredSpeedRules:
    """Which samples of a filtered edge speed are compared; chosen on the tuning half of the blind
    set (docs/gap_bench.md).
    """

    # longest edge period, in s and as a share of the sensor's timeout: the instant to which a
    # filtered speed belongs is uncertain at longer ones
    max_pitch_s: float = 0.02
    max_timeout_share: float = 0.25
    # a row is compared with the pitch that ended half a pitch before it: beginning and end of that
    # pitch, in pitches before the row
    start_pitches: float = 1.5
    end_pitches: float = 0.5
    slope_rows: int = 5  # of the moving mean whose slope is the acceleration


FILTERED_SPEED = FilteredSpeedRules()
MIN_GAP_S = 1e-6  # a row that ends less than this after an edge holds that edge


def edge_speed_channel(log: CleanLog, edges: EdgePeriods) -> SpanChannel:
    """Mean speeds over the edge periods, and the rows without a new edge as censored samples: their
    speed is at most one pitch divided by the time since the last edge.
    """
    speed_rpm = log.columns["speed_rpm"]
    missed = estimate_missed_edges(edges)
    sigma = sigma_with_missed_rpm(log.rig, edges, missed)
    # the log does not hold the motion in a period that began before it
    begun = edges.start_s > log.time_s[0] - log.interval_s
    keep = ~edges.timeout & ~near_reversal(edges) & begun
    timeout_s = log.rig.sensors.get("hall_timeout_s", DEFAULT_TIMEOUT_S)
    bound_start, bound_row = _rows_without_edge(log.time_s, speed_rpm, edges, timeout_s)
    start = np.concatenate([edges.start_s[keep], bound_start])
    end = np.concatenate([edges.end_s[keep], log.time_s[bound_row]])
    row = np.concatenate([edges.row[keep], bound_row])
    censored = np.arange(len(row)) >= np.count_nonzero(keep)
    bound = S_PER_MIN / log.pulses_per_rev / np.maximum(end - start, MIN_PERIOD_S)
    speeds = np.concatenate([edges.speed_rpm[keep], np.zeros(len(bound_row))])
    measured = np.where(censored, bound, speeds)
    sigmas = np.concatenate([sigma[keep], _bound_sigma(log, sigma, len(bound_row))])
    following = np.searchsorted(edges.row[keep], bound_row)
    missed_of_next = np.concatenate([missed[keep], [0]])[following]
    missed = np.concatenate([missed[keep], missed_of_next])
    order = np.lexsort((censored, row))
    channel = span_channel(
        ChannelInfo("speed_rpm", "rpm", edges=True, note="compared over the measured edge periods"),
        Samples(row[order], measured[order], sigmas[order], censored[order]),
        Spans(log.time_s, start[order], end[order]),
        RPM_PER_RAD_S,
    )
    return replace(channel, missed=missed[order].astype(float))


def _bound_sigma(log: CleanLog, sigma: np.ndarray, count: int) -> np.ndarray:
    """Standard deviation (count,) of censored samples in rpm: that of a usual edge speed."""
    if len(sigma):
        return np.full(count, float(np.median(sigma)))
    rounding = log.rig.sensors.get("speed_lsb_rpm", 0.0) / UNIFORM_WIDTH_SIGMAS
    return np.full(count, max(rounding, MIN_SIGMA["speed_rpm"]))


def _rows_without_edge(
    time_s: np.ndarray, speed_rpm: np.ndarray, edges: EdgePeriods, timeout_s: float
) -> tuple[np.ndarray, np.ndarray]:
    """Instants (k,) in s since which no edge came, and the rows (k,) without a new edge that they
    belong to: the timeout samples, and the rows that read 0. For the latter the instant is that of
    the last edge, at most timeout_s before the row.
    """
    whole = ~edges.timeout
    last_end, first_start = edges.end_s[whole], edges.start_s[whole]
    row = np.flatnonzero(speed_rpm == 0.0)
    end = time_s[row]
    place = np.searchsorted(edges.row[whole], row)
    since = np.concatenate([[-np.inf], last_end])[place]
    next_start = np.concatenate([first_start, [np.inf]])[place]
    since = np.where(
        (next_start < end) & (next_start > since), next_start, np.maximum(since, end - timeout_s)
    )
    since = np.maximum(since, time_s[0])
    real = end - since > MIN_GAP_S
    start = np.concatenate([edges.start_s[edges.timeout], since[real]])
    rows = np.concatenate([edges.row[edges.timeout], row[real]])
    order = np.argsort(rows, kind="stable")
    return start[order], rows[order]


def filtered_speed_channel(log: CleanLog) -> SpanChannel:
    """A filtered edge speed: each row is compared with the pitch that ended half a pitch before it.
    The delay is uniformly distributed over a pitch, so that sigma includes the change of the speed
    over a pitch.
    """
    time_s, measured = log.time_s, log.columns["speed_rpm"]
    speed_rpm = interpolate_missing(time_s, measured)
    timeout_s = log.rig.sensors.get("hall_timeout_s", DEFAULT_TIMEOUT_S)
    period = S_PER_MIN / log.pulses_per_rev / np.maximum(np.abs(speed_rpm), MIN_SPEED_RPM)
    start = time_s - FILTERED_SPEED.start_pitches * period
    end = time_s - FILTERED_SPEED.end_pitches * period
    longest = min(FILTERED_SPEED.max_timeout_share * timeout_s, FILTERED_SPEED.max_pitch_s)
    usable = np.isfinite(measured) & (period < longest) & (start > time_s[0])
    middle = np.where(usable, start + end, -np.inf)
    latest_before = np.maximum.accumulate(np.concatenate([[-np.inf], middle[:-1]]))
    keep = np.flatnonzero(usable & (middle > latest_before))  # in order of time
    slope = np.abs(np.gradient(moving_mean(speed_rpm, FILTERED_SPEED.slope_rows), time_s))
    sigma = np.hypot(log.noise["speed_rpm"].sigma, slope * period / UNIFORM_WIDTH_SIGMAS)
    note = "filtered edge speed, compared over a pitch before each row"
    return span_channel(
        ChannelInfo("speed_rpm", "rpm", note=note),
        Samples(keep, measured[keep], sigma[keep]),
        Spans(time_s, start[keep], end[keep]),
        RPM_PER_RAD_S,
    )
