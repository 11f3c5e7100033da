"""Thresholds of the comparison, and what kind of quantity each column of a log is."""

from dataclasses import dataclass

# What the board senses and what it answers. The bridge command of a row acted during that row: it
# follows from the rows before it; all other outputs follow from the row's own inputs too.
BRIDGE_COMMAND = ("duty", "coast")
BOARD_INPUTS = ("trigger", "mode", "supply_v", "current_a", "speed_rpm")
BOARD_OUTPUTS = (
    *BRIDGE_COMMAND,
    "state",
    "control_state",
    "stop_reason",
    "blow_count",
    "blow_period_ms",
    "estimate",
)
# Numbers of states and counts: between two of their values there is no third one.
DISCRETE = ("coast", "state", "mode", "control_state", "stop_reason", "blow_count")


@dataclass(frozen=True)
class Limits:
    """Thresholds of the comparison (chosen, not fitted)."""

    same_time_s: float = 1e-6  # rows are of one instant: rounding of times in a text file
    paired_share: float = 0.5  # of the shorter log's rows: below it, log B is interpolated
    max_shift_s: float = 0.1  # range in which a time offset is searched
    timing_share: float = 0.9  # of a column's squared gap that the time map removes: timing
    # The same: timing in part; also the least share for using a time map. Interpolation between
    # two rows averages them, which alone removes half of the squared gap of white noise.
    partly_share: float = 0.75
    # Of the samples with a value in both logs, those that a time offset must keep.
    overlap_share: float = 0.5
    # Least number of different values that show a resolution: a column of few levels has a step
    # too, by which two logs may differ. A column that is no command shows one by fewer values
    # where they are near each other: their step is at most this share of the largest value.
    least_values: int = 8
    near_share: float = 0.01
    grid_tolerance: float = 0.05  # of a step: values are multiples of one resolution
    # Of the rows of the shorter log: below it, the compared rows describe a small part of the logs.
    few_share: float = 0.1
    unit_tolerance: float = 0.05  # of a ratio of two units of time, for the logs' median intervals
    fit_rows: int = 20_000  # of a long log, for the search of the offset


LIMITS = Limits()
