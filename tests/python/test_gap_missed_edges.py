"""Missed edges where rows report only the last of several edges: they are found and located, and a
log without missed edges gives none.
"""

import numpy as np
import pytest

from made_log import edge_times, hall_column
from vgroove.gap.hall_edges.missed_edge_rows import (
    MIN_LONG_PERIODS,
    classify_rows,
    read_edges_with_missed,
)
from vgroove.gap.hall_edges.missed_edges import consistent_missed_edges, most_likely_pitches

FINE = np.arange(0, 40001) * 1e-4
ROWS = FINE[20::20]
PULSES = 8
SPEED = 900.0 + 500.0 * np.sin(2.0 * np.pi * 0.6 * FINE)  # rad/s: one to four edges a row
ANGLE = np.concatenate([[0.0], np.cumsum(0.5 * (SPEED[1:] + SPEED[:-1]) * np.diff(FINE))])


def column(share: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All edges, those that the sensor detects, and the speed column that these give."""
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


def test_a_sensor_that_misses_none_gives_no_missed_edges() -> None:
    _, _, speed_rpm = column(0.0)
    missed, timeout = classify_rows(ROWS, speed_rpm, PULSES)
    assert not missed.any()
    assert np.mean(timeout) < 0.01
    assert read_edges_with_missed(ROWS, speed_rpm, PULSES, 0.5).missed is None


@pytest.mark.parametrize("count", [MIN_LONG_PERIODS - 1, MIN_LONG_PERIODS])
def test_a_few_rows_of_half_the_speed_are_no_missed_edges(count: int) -> None:
    _, _, speed_rpm = column(0.0)
    fast = np.flatnonzero(speed_rpm > 9000.0)[20::60][:count]
    speed_rpm[fast] *= 0.5
    assert (read_edges_with_missed(ROWS, speed_rpm, PULSES, 0.5).missed is None) == (
        count < MIN_LONG_PERIODS
    )


@pytest.mark.parametrize("speed_rpm", [np.zeros(200), np.full(200, np.nan), np.full(200, 9000.0)])
def test_constant_and_empty_columns_give_no_missed_edges(speed_rpm: np.ndarray) -> None:
    missed, timeout = classify_rows(ROWS[:200], speed_rpm, PULSES)
    assert not missed.any()
    assert not timeout.any()


def test_missed_edges_are_separated_from_the_curvature_of_the_motion() -> None:
    speed = np.linspace(100.0, 400.0, 60)
    count = np.ones(60, int)
    count[[7, 20, 21, 40]] = [2, 2, 3, 4]
    level = np.log(speed / count)
    assert np.array_equal(most_likely_pitches(level), count)
    assert np.array_equal(consistent_missed_edges(level, count), count - 1)
    # uniformly accelerated from rest: no ratio of successive speeds means a missed edge
    starting = np.log(np.sqrt(np.arange(1.0, 30.0)))
    assert np.array_equal(most_likely_pitches(starting), np.ones(29, int))
