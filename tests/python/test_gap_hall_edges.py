"""Hall edges behind a speed column: each is found once and located to microseconds, at steady,
rising, falling and reversing speed.
"""

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from made_log import edge_times, hall_column, rig
from vgroove.gap.hall_edges.hidden_edges import HiddenEdges, _last_in_row
from vgroove.gap.hall_edges.hidden_periods import (
    accelerated_edge_times,
    counted_edge_times,
    long_span_s,
    most_summed,
)
from vgroove.gap.hall_edges.jitter import Jitter, edge_jitter, edge_sigma_rpm
from vgroove.gap.hall_edges.particle_step import spacing_error_s
from vgroove.gap.hall_edges.particles import PARTICLES, Particles, RowPair
from vgroove.gap.hall_edges.reader import read_edge_periods
from vgroove.gap.hall_edges.row_reader import RowReader, RowReading

FINE = np.arange(0, 30001) * 1e-4
ROWS = FINE[::10]
SPEEDS = {
    "ramp": 150.0 + 400.0 * FINE,
    "wave": 600.0 + 350.0 * np.sin(2.0 * np.pi * 0.8 * FINE),
    "steady": np.full(len(FINE), 1234.5),
    "slow": 40.0 + 30.0 * np.sin(2.0 * np.pi * 0.5 * FINE),
    "near one edge a row": 1565.0 + 12.0 * np.sin(2.0 * np.pi * 0.7 * FINE),
}


def motion(speed: np.ndarray) -> np.ndarray:
    return np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(FINE))])


@pytest.mark.parametrize("name", SPEEDS)
@pytest.mark.parametrize("lsb", [0.0, 0.5])
def test_each_period_is_found_once_and_shows_the_mean_speed_over_it(name: str, lsb: float) -> None:
    angle = motion(SPEEDS[name])
    edges = edge_times(FINE, angle, 4)
    found = read_edge_periods(ROWS, hall_column(ROWS, edges, 4, 0.3, lsb), 4, lsb)
    whole = ~found.timeout
    start, end = found.start_s[whole], found.end_s[whole]
    mean = (
        (np.interp(end, FINE, angle) - np.interp(start, FINE, angle))
        / (end - start)
        * 60.0
        / (2.0 * np.pi)
    )
    assert np.quantile(np.abs(mean - found.speed_rpm[whole]), 0.99) < 0.3 + lsb
    last = np.searchsorted(edges, ROWS, side="right") - 1
    seen = len(np.unique(last[last >= 1]))
    assert abs(int(whole.sum()) - seen) <= max(2, 0.006 * seen)


@pytest.mark.parametrize("name", ["ramp", "wave", "slow"])
def test_periods_lie_where_the_edges_were(name: str) -> None:
    edges = edge_times(FINE, motion(SPEEDS[name]), 4)
    found = read_edge_periods(ROWS, hall_column(ROWS, edges, 4, 0.3, 0.0), 4, 0.0)
    nearest = np.array([np.min(np.abs(edges - end)) for end in found.end_s[~found.timeout]])
    assert nearest.max() < 1e-6
    rounded = read_edge_periods(ROWS, hall_column(ROWS, edges, 4, 0.3, 0.5), 4, 0.5)
    nearest = np.array([np.min(np.abs(edges - end)) for end in rounded.end_s[~rounded.timeout]])
    assert np.quantile(nearest, 0.98) < (1e-5 if name != "slow" else 5e-4)


@pytest.mark.parametrize("name", ["ramp", "wave", "near one edge a row"])
def test_edges_are_counted_through(name: str) -> None:
    edges = edge_times(FINE, motion(SPEEDS[name]), 4)
    found = read_edge_periods(ROWS, hall_column(ROWS, edges, 4, 0.3, 0.5), 4, 0.5)
    whole = ~found.timeout
    assert abs(int(found.count[whole][-1]) - (len(edges) - 1)) <= 2


def test_periods_of_a_sensor_that_counts_edges_lie_between_the_last_edges_of_rows() -> None:
    angle = motion(SPEEDS["wave"])
    edges = edge_times(FINE, angle, 24)
    found = read_edge_periods(ROWS, hall_column(ROWS, edges, 24, 0.3, 0.5), 24, 0.5)
    whole = ~found.timeout
    start, end, slack = found.start_s[whole][5:], found.end_s[whole][5:], found.slack_s[whole][5:]
    assert np.median(end - start) == pytest.approx(1e-3, rel=0.2)
    mean = (
        (np.interp(end, FINE, angle) - np.interp(start, FINE, angle))
        / (end - start)
        * 60.0
        / (2.0 * np.pi)
    )
    error, rate = (
        mean - found.speed_rpm[whole][5:],
        np.abs(np.interp(end, FINE, np.gradient(SPEEDS["wave"], FINE))) * 60.0 / (2.0 * np.pi),
    )
    assert np.quantile(np.abs(error) / (0.3 + rate * slack), 0.95) < 3.0
    assert np.sqrt(np.mean(error**2)) < 2.0


@pytest.mark.parametrize("lost", [False, True])
def test_a_row_after_a_missing_one_shows_the_mean_over_its_own_edges(lost: bool) -> None:
    """Of a sensor that counts edges: the row before is nan (lost = False) or absent (True)."""
    speed = steps_of_speed(6000.0)
    angle, missing = motion(speed), np.random.default_rng(5).random(len(ROWS[::2])) < 0.1
    column = hall_column(ROWS[::2], edge_times(FINE, angle, 32), 32, 0.05, 0.5)
    rows, column = (
        (ROWS[::2][~missing], column[~missing])
        if lost
        else (ROWS[::2], np.where(missing, np.nan, column))
    )
    found = read_edge_periods(rows, column, 32, 0.5).without_timeouts()
    mean = (
        (np.interp(found.end_s, FINE, angle) - np.interp(found.start_s, FINE, angle))
        / (found.end_s - found.start_s)
        * 30.0
        / np.pi
    )
    after = (
        np.flatnonzero(np.diff(found.row, prepend=-1) > 1)
        if not lost
        else np.flatnonzero(np.diff(rows, prepend=0.0)[found.row] > 3e-3)
    )
    assert len(after) > 50
    assert np.quantile(np.abs(mean - found.speed_rpm)[after], 0.95) < 4.0
    assert np.quantile(np.abs(mean - found.speed_rpm), 0.99) < 15.0


def steps_of_speed(top_rpm: float) -> np.ndarray:
    """Speed (rad/s) of a shaft that follows steps of its command with a time constant of 25 ms."""
    goal = (
        np.select([FINE < 0.8, FINE < 1.6, FINE < 2.4], [1.0, 0.5, 0.85], 0.6)
        * top_rpm
        * np.pi
        / 30.0
    )
    speed = np.zeros(len(FINE))
    for i in range(1, len(FINE)):
        speed[i] = speed[i - 1] + (goal[i] - speed[i - 1]) * 1e-4 / 0.025
    return speed


@pytest.mark.parametrize(
    "pulses, log_hz, largest_s", [(4, 500, 4e-5), (8, 1000, 8e-5), (32, 1000, 2e-5)]
)
def test_edges_are_placed_where_rows_show_the_last_of_several(
    pulses: int, log_hz: int, largest_s: float
) -> None:
    """The particle filter finds which edge a row reports from the speeds that follow, and the
    half width that it states covers the true time.
    """
    rng, angle = np.random.default_rng(5), motion(steps_of_speed(12000.0))
    edges = edge_times(FINE, angle, pulses)
    edges = edges + 2e-7 * rng.standard_normal(len(edges))
    rows = np.arange(1, 3 * log_hz) / log_hz
    found = read_edge_periods(rows, hall_column(rows, edges, pulses, 0.3, 0.5), pulses, 0.5)
    whole = ~found.timeout & (found.end_s > 0.1)
    true = edges[np.searchsorted(edges, rows[found.row[whole]], side="right") - 1]
    error, slack = np.abs(found.end_s[whole] - true), found.slack_s[whole]
    assert np.quantile(error, 0.9) < largest_s
    assert np.mean(error > 3.0 * slack + 5e-6) < 0.05


def misplaced(
    pulses: int, log_hz: int, rest_of_speed: Callable[[np.ndarray], np.ndarray]
) -> np.ndarray:
    """Whether each period of a shaft that runs up and is braked, from nine instants within a row,
    lies where no edge was.
    """
    rows, fine, found_so = np.arange(1, 1.4 * log_hz) / log_hz, FINE[:14001], []
    for start_s in 1.0 + np.linspace(0.0, 1.0 / log_hz, 9):
        speed = (
            1400.0 * (1.0 - np.exp(-fine / 0.1)) * rest_of_speed(np.maximum(fine - start_s, 0.0))
        )
        edges = edge_times(
            fine,
            np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(fine))]),
            pulses,
        )
        found = read_edge_periods(rows, hall_column(rows, edges, pulses, 0.3, 0.5), pulses, 0.5)
        whole = ~found.timeout & (found.end_s > 0.9)
        away = np.min(np.abs(found.end_s[whole][:, None] - edges), axis=1)
        found_so.append(away > 3.0 * found.slack_s[whole] + 2e-5)
    return np.concatenate(found_so)


BRAKED = [
    (pulses, log_hz, decay_s)
    for pulses, log_hz in ((2, 300), (4, 500))
    for decay_s in (0.03, 0.05, 0.08)
]


@pytest.mark.parametrize(
    "braked",
    [pytest.param(BRAKED, marks=pytest.mark.proof, id="all"), pytest.param(BRAKED[4:5], id="one")],
)
def test_edges_of_a_braked_shaft_are_located_down_to_timeout_samples(
    braked: list[tuple[int, int, float]],
) -> None:
    """While the shaft slows down a row may report the last edge or the one before, and a timeout
    sample looks like an edge at the row's end.
    """
    shares = []
    for pulses, log_hz, decay_s in braked:
        brakes = (
            lambda since, decay_s=decay_s: np.exp(-since / decay_s),
            lambda since, decay_s=decay_s: np.maximum(1.0 - 0.5 * since / decay_s, 0.02),
        )
        shares += [np.mean(misplaced(pulses, log_hz, brake)) for brake in brakes]
    assert np.mean(shares) < 0.01


def test_a_vibration_is_not_taken_for_jitter() -> None:
    swing = 400.0 + 300.0 * np.tanh(FINE / 0.5) + 8.0 * np.sin(2.0 * np.pi * 60.0 * FINE)
    edges = edge_times(FINE, motion(swing), 4)
    shaken = edges + 2e-7 * np.random.default_rng(7).standard_normal(len(edges))
    found = edge_jitter(
        read_edge_periods(ROWS, hall_column(ROWS, shaken, 4, 0.3, 0.5), 4, 0.5),
        4,
        0.5 / np.sqrt(12.0),
    )
    assert np.hypot(found.angle_rad / 700.0, found.time_s) < 1e-6


def test_fast_motion_between_slow_rows_is_no_jitter_where_the_model_predicts_it() -> None:
    """At 300 Hz a ripple of 90 Hz is as fast as jitter. The model's expected speed is subtracted; a
    wrong expectation does not raise the estimate.
    """
    fine = np.arange(0.0, 6.0, 1e-4)
    ripple = 3.0 * np.sin(2.0 * np.pi * 90.0 * fine)
    angle = np.cumsum(1000.0 + 200.0 * np.sin(2.0 * np.pi * 0.8 * fine) + ripple) * 1e-4
    edges = edge_times(fine, angle, 4)
    shaken = edges + 2e-7 * np.random.default_rng(7).standard_normal(len(edges))
    rows = np.arange(1, 1799) / 300.0
    found = read_edge_periods(rows, hall_column(rows, shaken, 4, 0.3, 0.5), 4, 0.5)

    def jitter_s(share: float) -> float:
        known = np.cumsum(900.0 + share * ripple) * 1e-4
        over = [np.interp(instants, fine, known) for instants in (found.start_s, found.end_s)]
        expected = (over[1] - over[0]) / (found.end_s - found.start_s) * 60.0 / (2.0 * np.pi)
        jitter = edge_jitter(replace(found, expected_rpm=expected), 4, 0.5 / np.sqrt(12.0))
        return float(np.hypot(jitter.angle_rad / 1000.0, jitter.time_s))

    without_model = edge_jitter(found, 4, 0.5 / np.sqrt(12.0))
    plain = float(np.hypot(without_model.angle_rad / 1000.0, without_model.time_s))
    assert plain > 5e-7 and jitter_s(-1.0) <= plain
    assert 1e-7 < jitter_s(1.0) < 0.5 * plain


@pytest.mark.parametrize(
    "pulses, log_hz, periods",
    [(4, 300, 2), (4, 300, 0), (6, 500, 3), (3, 1000, 0), (3, 300, 1), (1, 1000, 0)],
)
def test_a_pattern_of_the_turn_is_no_jitter_where_rows_hide_edges(
    pulses: int, log_hz: int, periods: int
) -> None:
    """Two ripple periods a turn make four edges early and late alternately, as jitter would; rows
    that report every second or third edge mix the edges of the turn.
    """
    fine = np.arange(0.0, 6.0, 1e-4)
    angle = np.cumsum(900.0 + 250.0 * np.sin(2.0 * np.pi * 0.4 * fine)) * 1e-4
    angle += 5e-4 * np.sin(periods * angle + 0.3 + 0.5 * np.pi * (periods > 1))
    edges = edge_times(fine, angle, pulses)
    shaken = edges + 2e-7 * np.random.default_rng(7).standard_normal(len(edges))
    rows = np.arange(1, 6 * log_hz - 1) / log_hz
    found = edge_jitter(
        read_edge_periods(rows, hall_column(rows, shaken, pulses, 0.3, 0.5), pulses, 0.5),
        pulses,
        0.5 / np.sqrt(12.0),
    )
    assert 1.2e-7 < np.hypot(found.angle_rad / 1000.0, found.time_s) < 2.8e-7


@pytest.mark.parametrize("jitter_rad", [0.0, 0.003, 0.02])
@pytest.mark.parametrize("seed", range(5))
def test_the_scatter_of_few_edges_is_estimated(jitter_rad: float, seed: int) -> None:
    """Two and a half turns of a wheel with twelve unequal pitches."""
    speed = np.full(len(FINE), 30.0) * (1.0 - np.exp(-(FINE + 0.05) / 0.1))
    edges = edge_times(FINE, motion(speed), 12)[:32]
    rng = np.random.default_rng(seed)
    shaken = np.sort(edges + jitter_rad / 30.0 * rng.standard_normal(len(edges)))
    rows = ROWS[ROWS < shaken[-1] + 0.01]
    found = read_edge_periods(rows, hall_column(rows, shaken, 12, 3.0, 0.01), 12, 0.01)
    assert len(found.row) > 25
    estimate = edge_jitter(found, 12, 0.01 / np.sqrt(12.0)).angle_rad
    assert 0.3 * jitter_rad <= estimate < 1.8 * jitter_rad + 2e-4


def test_timeout_samples_before_standstill_are_recognised() -> None:
    speed = np.where(FINE < 1.0, 300.0, 0.0)
    edges = edge_times(FINE, motion(speed), 4)
    column = hall_column(ROWS, edges, 4, 0.05, 0.5)
    found = read_edge_periods(ROWS, column, 4, 0.5)
    timeouts = found.row[found.timeout]
    without_edge = np.flatnonzero((column > 0.0) & (ROWS > edges[-1] + (edges[-1] - edges[-2])))
    assert set(without_edge[1:-1]) <= set(timeouts)
    assert np.allclose(found.start_s[found.timeout], edges[-1], atol=2e-5)
    assert found.row.max() < np.flatnonzero(column == 0.0)[-1]


@pytest.mark.parametrize("agree", [True, False])
def test_timeout_samples_that_agree_replace_the_bounds_from_the_periods_before(
    agree: bool,
) -> None:
    """A shaft braked hard, logged at 300 Hz: its last edge came 40 us before the time that the sum
    of the periods gives. One such row alone could report a new edge.
    """
    edge_s, rows = -1.733e-3, np.array([-1, 0, 3, 4, 5, 6, 7]) / 300.0
    waits = [1288.5, 1288.5, *np.round(15.0 / (rows[2:] - edge_s) * 2.0) / 2.0]
    reader = RowReader(
        rows + 9e-3, np.array(waits if agree else [*waits[:3], 0.0, 0.0, 0.0, 0.0]), 4, 0.5
    )
    reader.begin(reader.reading(1, 1288.5))
    reader.last_row, reader.low, reader.high = 1, edge_s + 9.04e-3, edge_s + 9.13e-3
    reader.chain.low_s[-1], reader.chain.high_s[-1] = reader.low, reader.high
    for row in range(2, 7 if agree else 3):
        reader.follow(reader.reading(row, waits[row]))
        reader.last_row = row
    assert [sample.row for sample in reader.chain.timeouts] == ([2, 3, 4, 5, 6] if agree else [])
    if agree:
        assert reader.low < edge_s + 9e-3 < reader.high < reader.low + 2e-5
        assert reader.chain.low_s[-1] < edge_s + 9e-3 < reader.chain.high_s[-1]


def test_edges_of_a_missing_row_passed_at_the_mean_of_both_speeds() -> None:
    """Three rows of 2 ms, of which the second is missing: 1 edge a millisecond in the first, 2 in
    the third. Of the 7 edges since the first row 4 lie in the third, 0.5 ms apart; the other 3 are
    2/3 ms apart.
    """
    between = 2.0 / (1.0 / 1e-3 + 1.0 / 0.5e-3)
    own = 0.5e-3 * np.arange(1, 5)
    assert counted_edge_times(1e-3, 0.5e-3, 7, (0.0, 2e-3, 4e-3)) == pytest.approx(
        [*own, *(own[-1] + between * np.arange(1, 4))]
    )
    assert counted_edge_times(1e-3, 0.5e-3, 7, (2e-3, 2e-3, 4e-3)) == pytest.approx(
        0.5e-3 * np.arange(1, 8)
    )


def test_missing_samples_and_reversals_break_nothing() -> None:
    edges = edge_times(FINE, motion(SPEEDS["wave"]), 4)
    column = hall_column(ROWS, edges, 4, 0.3, 0.5)
    column[500:502] = np.nan
    column[1500:] *= -1.0
    found = read_edge_periods(ROWS, column, 4, 0.5)
    nearest = np.array([np.min(np.abs(edges - end)) for end in found.end_s[~found.timeout]])
    assert np.quantile(nearest, 0.98) < 2e-5
    assert len(np.unique(np.sign(found.speed_rpm))) == 2


@pytest.mark.parametrize("jitter_s", [2e-7, 1e-6])
def test_time_jitter_is_separated_from_motion_and_from_unequal_edges(jitter_s: float) -> None:
    rng = np.random.default_rng(3)
    edges = edge_times(FINE, motion(SPEEDS["wave"]), 4)
    uneven = np.tile([0.0, 3e-3, -2e-3, 1e-3], len(edges) // 4 + 1)[: len(edges)] / np.interp(
        edges, FINE, SPEEDS["wave"]
    )
    column = hall_column(
        ROWS, edges + uneven + jitter_s * rng.standard_normal(len(edges)), 4, 0.3, 0.5
    )
    found = edge_jitter(read_edge_periods(ROWS, column, 4, 0.5), 4, 0.5 / np.sqrt(12.0))
    fast = 900.0
    assert 0.6 < np.hypot(found.angle_rad / fast, found.time_s) / jitter_s < 1.7


def test_a_few_edges_give_no_jitter() -> None:
    edges = edge_times(FINE[:1000], motion(SPEEDS["ramp"])[:1000], 4)
    assert (
        edge_jitter(
            read_edge_periods(ROWS[:100], hall_column(ROWS[:100], edges, 4, 0.3, 0.5), 4, 0.5),
            4,
            0.1,
        )
        == Jitter()
    )


def test_hidden_edges_are_spaced_at_uniform_acceleration() -> None:
    """Six edges between two reported periods while the speed rises by a third: even spacing would
    make them late, and the error would add up over a run-up.
    """
    pitch, rate, w0, count = np.pi / 4.0, 9000.0, 500.0, 6
    times = (np.sqrt(w0**2 + 2.0 * rate * pitch * np.arange(count + 2)) - w0) / rate
    periods, exact = np.diff(times), times[-1] - times[1]
    evenly = float(
        np.sum(periods[0] + (periods[-1] - periods[0]) * np.arange(1, count + 1) / count)
    )
    length, bound, drift = RowReader(ROWS, np.zeros(len(ROWS)), 8, 0.5).step(
        periods[0], RowReading(0, 0.0, 0.0, periods[-1], 1e-8), count
    )
    assert abs(length - exact) < 0.05 * abs(evenly - exact)
    assert abs(length - exact) < drift < bound


def test_jitter_of_an_encoder_is_not_its_motion() -> None:
    """32 edges a turn, slow and changing: after the projection a window holds rounding, not the
    curvature of the motion.
    """
    fine = np.arange(0.0, 6.0, 1e-4)
    speed = 60.0 + 50.0 * np.sin(2.0 * np.pi * 0.7 * fine)
    edges = edge_times(fine, np.cumsum(speed) * 1e-4, 32)
    rows = np.arange(1, 1799) / 300.0
    found = read_edge_periods(rows, hall_column(rows, edges, 32, 0.05, 0.5), 32, 0.5)
    jitter = edge_jitter(found, 32, 0.5 / np.sqrt(12.0))
    assert (
        edge_sigma_rpm(
            rig(sensors={"hall_pulses_per_rev": 32, "log_hz": 300}), found, jitter
        ).mean()
        < 3.0
    )


def spacing_error(before_s: float, after_s: float, number: int, usual_change: float) -> float:
    """Error bound of the last of so many edges whose periods change from before_s to after_s."""
    zero, now_s = np.zeros(PARTICLES), number * after_s
    particles = Particles(
        zero, zero, zero, zero, zero, zero, now_s=0.0, growth=0.0, growth_change=usual_change
    )
    row = RowPair(0.0, 0.0, 0.0, now_s, (0.0, 0.0), (before_s, after_s), 0.0, counts=False)
    return spacing_error_s(particles, row, np.full(PARTICLES, number))[0]


@pytest.mark.parametrize("number", [2, 3, 5])
@pytest.mark.parametrize("after_s", [1.9e-3, 2.2e-3])
def test_the_spacing_error_covers_a_sudden_change_in_the_first_or_last_hidden_period(
    number: int, after_s: float
) -> None:
    """A command steps anywhere in a row: the bound on the last edge's error holds and is tight."""
    before_s = 2e-3
    error_s = spacing_error(before_s, after_s, number, usual_change=1e-4)
    steady = accelerated_edge_times(before_s, after_s, number)[-1]
    late, early = (number - 1) * before_s + after_s, number * after_s
    largest = max(abs(late - steady), abs(early - steady))
    assert 0.95 * error_s < largest < 1.1 * error_s


def test_the_spacing_error_is_smaller_where_periods_change_as_usual() -> None:
    sudden, usual = (spacing_error(2e-3, 1.9e-3, 3, change) for change in (1e-4, 0.1))
    assert usual < 0.3 * sudden


@pytest.mark.parametrize("following_rpm, span", [(3781.0, 2), (3750.5, 1)])
def test_a_value_that_repeats_while_periods_grow_shows_a_row_without_an_edge(
    following_rpm: float, span: int
) -> None:
    """One or two edges fit the long row. The speed of the next row decides: where it repeats, that
    row holds no edge, which is possible only if the long row has two, the last one at its end.
    """
    reader = RowReader(
        np.array([-5.154e-3, 0.0, 2.186e-3]), np.array([3842.5, 3781.0, following_rpm]), 4, 0.5
    )
    reader.begin(reader.reading(0, 3842.5))
    reader.last_row, reader.low, reader.high = 0, -7.965e-3, -7.828e-3
    reader.follow(reader.reading(1, 3781.0))
    assert reader.chain.span[-1] == span


def test_each_row_reports_its_last_edge() -> None:
    """A smoothed edge beyond its row's end becomes the edge before, one that another edge follows
    within the row becomes the next, where the distance exceeds the half width.
    """
    now = np.arange(1, 7) * 5e-3
    end = now + 1e-3 * np.array([-0.5, 0.2, -0.5, -2.2, -2.05, -0.5])
    found = HiddenEdges(
        end, np.full(6, 1e-4), np.array([1, 3, 2, 2, 3, 2]), np.zeros(6, dtype=bool)
    )
    placed = _last_in_row(found, now, np.full(6, 2e-3))
    assert np.allclose(placed.end_s - now, 1e-3 * np.array([-0.5, -1.8, -0.5, -0.2, -2.05, -0.5]))
    assert placed.step.tolist() == [1, 2, 3, 3, 2, 2]


@pytest.mark.parametrize("pulses", [16, 24, 100])
@pytest.mark.parametrize("seed", range(3))
def test_rows_that_span_several_edges_are_no_jitter_in_short_moves(pulses: int, seed: int) -> None:
    """Moves of 13 rows with 8 rows of rest: no chain is as long as a window of the estimate."""
    rng = np.random.default_rng(seed)
    values, true = [], []
    for _ in range(40):
        fine = np.linspace(0.0, 0.0131, 1311)
        low, high = np.sort(rng.uniform(300.0, 700.0, 2))
        speed = low + (high - low) * np.sin(120.0 * fine + rng.uniform(0.0, 6.0))
        angle = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(fine))])
        rows = fine[::100][:13]
        edges = edge_times(fine, angle, pulses, rng.uniform())
        values += [*np.zeros(8), *hall_column(rows, edges, pulses, 0.05, 0.5)]
        true += [*np.zeros(8), *np.interp(rows, fine, speed)]
    time_s = 1e-3 * np.arange(len(values))
    edges = read_edge_periods(time_s, np.array(values), pulses, 0.5)
    jitter = edge_jitter(edges, pulses, 0.5 / np.sqrt(12.0))
    sigma = edge_sigma_rpm(rig(sensors={"hall_pulses_per_rev": pulses}), edges, jitter)
    speed = np.interp(0.5 * (edges.start_s + edges.end_s), time_s, true) * 60.0 / (2.0 * np.pi)
    error = np.median(np.abs(edges.speed_rpm - speed))
    assert len(edges.row) > 300 and np.median(sigma) < 4.0 * max(error, 1.0)


@pytest.mark.parametrize("ratio", [0.2, 0.5, 0.9, 1.0, 1.0001, 1.5, 3.0, 9.0])
@pytest.mark.parametrize("more", [1, 2, 30, 500])
def test_the_length_of_many_periods_is_their_sum(ratio: float, more: int) -> None:
    first_s, last_s = 1e-3, 1e-3 * ratio
    count = most_summed(first_s, last_s) + more
    rate = np.linspace(1.0 / first_s**2, 1.0 / last_s**2, count + 1)[1:]
    summed = float((1.0 / np.sqrt(rate)).sum())
    longest = max(first_s, last_s)
    assert long_span_s(first_s, last_s, count) == pytest.approx(summed, abs=1e-6 * longest)
    times = accelerated_edge_times(first_s, last_s, count)
    assert len(times) == count and times[-1] == pytest.approx(summed, abs=1e-6 * longest)
    assert np.all(np.diff(times) > 0.0)


def test_the_time_of_a_row_does_not_grow_with_the_square_of_its_edges() -> None:
    """A shaft at 25,000 rpm, logged once a second: 1,700 edges in each row."""
    time_s = np.arange(100.0)
    speed = 2.5e4 * (0.8 + 0.2 * np.sin(2.0 * np.pi * time_s / 30.0))
    begin_s = time.process_time()
    found = read_edge_periods(time_s, np.round(speed, 1), 4, 0.5)
    assert time.process_time() - begin_s < 4.0  # 0.7 s; with sums of all periods 11 s
    assert len(found.end_s) > 90 and np.all(np.diff(found.end_s) > 0.0)


@pytest.mark.parametrize("pulses", [1, 4, 16])
@pytest.mark.parametrize("interval_s", [1e-4, 1e-2])
def test_a_column_that_is_no_hall_speed_is_read_without_an_error(
    pulses: int, interval_s: float
) -> None:
    """Its rows contradict one another, so that the last edge may lie after a row's end."""
    for seed in range(40):
        rng = np.random.default_rng(seed)
        noise = np.round(rng.choice([30.0, 3000.0]) * rng.random(200), 2)
        found = read_edge_periods(interval_s * np.arange(200), noise, pulses, 0.5)
        assert np.isfinite(found.end_s).all()
