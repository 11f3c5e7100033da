"""Missed edges where rows show only the last of several: found, placed, and never seen in a log
that misses none.
"""

import numpy as np
import pytest

from made_log import edge_times, hall_column
from vgroove.gap.hall_edges.missed_edge_rows import (
    MIN_LONG_PERIODS,
    classify_rows,
    read_edges_with_missed,
)

FINE = np.arange(0, 40001) * 1e-4
ROWS = FINE[20::20]
PULSES = 8
SPEED = 900.0 + 500.0 * np.sin(2.0 * np.pi * 0.6 * FINE)  # rad/s: one to four edges a row
ANGLE = np.concatenate([[0.0], np.cumsum(0.5 * (SPEED[1:] + SPEED[:-1]) * np.diff(FINE))])


def column(share: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All edges, those that were seen, and the speed column that they make."""
    edges = edge_times(FINE, ANGLE, PULSES)
    seen = edges[np.random.default_rng(2).random(len(edges)) >= share]
    return edges, seen, hall_column(ROWS, seen, PULSES, 0.3, 0.5)


@pytest.mark.parametrize("share", [0.02, 0.08, 0.15])
def test_periods_of_several_pitches_are_found_and_lie_where_the_edges_were(share: float) -> None:
    edges, seen, speed_rpm = column(share)
    found = read_edges_with_missed(ROWS, speed_rpm, PULSES, 0.5)
    whole = ~found.timeout
    turned = np.interp(found.end_s, FINE, ANGLE) - np.interp(found.start_s, FINE, ANGLE)
    pitches = np.round(turned[whole] * PULSES / (2.0 * np.pi))
    assert np.mean(found.missed[whole] == pitches - 1.0) > 0.995
    assert np.mean(found.missed[whole] > 0) == pytest.approx(share, abs=0.4 * share)
    away = np.min(np.abs(found.end_s[whole][:, None] - edges), axis=1)
    assert np.median(away) < 5e-5
    mean_rpm = (
        turned[whole]
        / (found.end_s - found.start_s)[whole]
        * 30.0
        / np.pi
        / (1.0 + found.missed[whole])
    )
    assert np.quantile(np.abs(mean_rpm - found.speed_rpm[whole]), 0.95) < 10.0


def test_a_sensor_that_misses_none_is_read_as_it_is() -> None:
    _, _, speed_rpm = column(0.0)
    missed, waits = classify_rows(ROWS, speed_rpm, PULSES)
    assert not missed.any()
    assert np.mean(waits) < 0.01
    assert read_edges_with_missed(ROWS, speed_rpm, PULSES, 0.5).missed is None


@pytest.mark.parametrize("count", [MIN_LONG_PERIODS - 1, MIN_LONG_PERIODS])
def test_a_few_rows_of_half_the_speed_are_no_habit_of_the_sensor(count: int) -> None:
    _, _, speed_rpm = column(0.0)
    fast = np.flatnonzero(speed_rpm > 9000.0)[20::60][:count]
    speed_rpm[fast] *= 0.5
    assert (read_edges_with_missed(ROWS, speed_rpm, PULSES, 0.5).missed is None) == (
        count < MIN_LONG_PERIODS
    )


@pytest.mark.parametrize("speed_rpm", [np.zeros(200), np.full(200, np.nan), np.full(200, 9000.0)])
def test_columns_without_a_motion_to_follow(speed_rpm: np.ndarray) -> None:
    missed, waits = classify_rows(ROWS[:200], speed_rpm, PULSES)
    assert not missed.any()
    assert not waits.any()
