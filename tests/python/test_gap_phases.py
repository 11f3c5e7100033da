"""What a Hall wheel hides and what the log gives back: angles lost at stops, edges passed over, a
speed that is read too high.
"""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from made_log import MadeLog, drive_log, edge_times, hall_column, rig
from vgroove.gap.hall_edges import scale
from vgroove.gap.hall_edges.missed_edges import consistent_missed_edges, most_likely_pitches
from vgroove.gap.hall_edges.scale import edge_scale, most_agreed_value, timeout_scale
from vgroove.gap.residual import angle_alignment
from vgroove.gap.residual.problem import load_problem

STOPS = [
    (0.2, 0.5),
    (0.7, 0.0),
    (1.3, 0.8),
    (1.9, 0.0),
    (2.6, 0.4),
    (3.3, 0.0),
    (4.0, 0.9),
    (5.0, 0.0),
]
COGGING = {"torque_nm": 0.002, "periods_per_rev": 1.0, "phase_rad": 0.0}


@pytest.fixture(scope="module")
def stop_and_go() -> MadeLog:
    return drive_log(rig(effects={"cogging_torque": COGGING}), levels=STOPS)


def test_angles_lost_at_stops_are_found_again(stop_and_go: MadeLog) -> None:
    problem = load_problem([stop_and_go], rig())
    phase = problem.index("effects.cogging_torque.phase_rad")
    theta = np.repeat(
        load_problem([stop_and_go], rig(effects={"cogging_torque": COGGING})).theta0[None],
        16,
        axis=0,
    )
    theta[:, phase] = np.arange(16) * np.pi / 8.0  # the first edge lies anywhere
    parts = angle_alignment.angle_stretches(problem)
    assert parts.count > 2 and problem.runs[0].pitch_rad == pytest.approx(np.pi / 2.0)
    first = parts.of == parts.reference
    best = theta[int(np.argmin([problem.gap(r, first) for r in problem.residuals(theta)]))]
    assert problem.gap(problem.residuals(best)[0]) > 1.3
    assert problem.gap(angle_alignment.align_angles(problem, best).residuals(best)[0]) < 1.2


def test_a_rest_that_lies_elsewhere_before_the_first_edge_is_found() -> None:
    strong = rig(effects={"cogging_torque": COGGING | {"torque_nm": 0.008}})
    problem = load_problem([drive_log(strong, levels=STOPS)], strong)
    parts, theta = angle_alignment.angle_stretches(problem), problem.theta0
    assert parts.rest.tolist() == [True] + [False] * (parts.count - 1) and parts.reference == 1
    assert parts.restart[0].tolist().count(0) == 1 and len(parts.restart[0]) > parts.count
    rest = parts.rest[parts.of]
    best = problem.gap(problem.residuals(theta)[0], rest)
    moved = angle_alignment.with_angle_shift(problem, parts, np.where(parts.rest, 2.0, 0.0))
    assert moved.gap(moved.residuals(theta)[0], rest) > 1.3 * best
    again = angle_alignment.align_angles(moved, theta)
    assert again.gap(again.residuals(theta)[0], rest) < 1.05 * best
    assert np.array_equal(again.residuals(theta)[0][~rest], moved.residuals(theta)[0][~rest])


def test_nothing_is_turned_where_nothing_follows_the_angle(stop_and_go: MadeLog) -> None:
    problem = load_problem([stop_and_go], rig())
    assert angle_alignment.align_angles(problem, problem.theta0) is problem


def test_the_linear_search_finds_the_offsets_that_were_put_in() -> None:
    rng, shift = np.random.default_rng(3), np.pi / 2.0 * np.array([0, 2, 3, 1])
    normal = np.stack([np.diag(rng.uniform(50.0, 90.0, 2)) for _ in shift])
    true = np.array([0.8, -0.5])
    turned = [np.array([[np.cos(d), -np.sin(d)], [np.sin(d), np.cos(d)]]) @ true for d in shift]
    swing = angle_alignment.FirstOrderRipple(
        1.0, normal, np.stack([-n @ t for n, t in zip(normal, turned, strict=True)])
    )
    found = swing.best_shifts([np.pi / 2.0 * np.arange(4)] * 4)
    assert np.mod(found - shift, 2.0 * np.pi) == pytest.approx(np.zeros(4), abs=1e-9)
    assert swing.amplitudes(found) == pytest.approx(true, rel=1e-4)
    assert swing.gain(found) > 2.0 * swing.gain(np.zeros(4))


@pytest.mark.parametrize("gain", [0.004, -0.02])
def test_a_speed_that_is_read_too_high_is_seen_in_its_own_edges(gain: float) -> None:
    made = drive_log(rig())
    speed = made.columns["speed_rpm"]
    assert edge_scale(made.time_s, speed, 4, 0.5) == 1.0
    assert edge_scale(
        made.time_s, np.round(2.0 * speed * (1.0 + gain)) / 2.0, 4, 0.5
    ) - 1.0 == pytest.approx(gain, abs=3e-5)


def stopping_column(gain: float, stops_per_s: float = 1.5) -> tuple[np.ndarray, np.ndarray]:
    """Rows and speeds of an encoder on a shaft that speeds up to 6100 rpm and stops again and
    again.
    """
    fine = np.arange(0, 60001) * 1e-4
    speed = 640.0 * np.sin(stops_per_s * np.pi * fine) ** 2
    edges = edge_times(
        fine, np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * 1e-4)]), 32
    )
    rows = fine[::20]
    return rows, np.round(2.0 * (1.0 + gain) * hall_column(rows, edges, 32, 0.05, 0.0)) / 2.0


@pytest.mark.parametrize(
    ("gain", "stops_per_s", "error"),
    [(0.0, 1.5, 1e-12), (0.052, 1.5, 1e-4), (-0.06, 1.5, 1e-4), (0.052, 3.0, 2e-3)],
)
def test_rows_that_wait_for_an_edge_tell_a_gain_that_many_edges_a_row_hide(
    gain: float, stops_per_s: float, error: float
) -> None:
    time_s, speed = stopping_column(gain, stops_per_s)
    assert timeout_scale(time_s, speed, 32, 0.5) - 1.0 == pytest.approx(gain, abs=3e-3)
    assert edge_scale(time_s, speed, 32, 0.5) - 1.0 == pytest.approx(gain, abs=error)


@pytest.mark.parametrize(
    ("pulses", "torn", "believed"), [(16, 13, False), (16, 100, True), (4, 13, True)]
)
def test_a_few_torn_chains_of_a_sensor_that_counts_are_chance(
    pulses: int, torn: int, believed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One of many scales chains 2,500 periods better than all others; of a sensor that counts 1 %
    of them must tear to say anything.
    """
    time_s = np.arange(2501) * 1e-3
    speed = 3000.0 + time_s

    def chains(_: np.ndarray, scaled: np.ndarray, *_more: object) -> int:
        return 2 if scaled[0] > 3200.0 else torn

    monkeypatch.setattr(scale, "count_chains", chains)
    monkeypatch.setattr(scale, "period_error_bounds", lambda *_: np.zeros((0, 2)))
    monkeypatch.setattr(scale, "longest_chain", lambda *_: (1.0, 0.0, 0))
    found = edge_scale(time_s, speed, pulses, 0.5)
    assert found < 3000.0 / 3200.0 if believed else found == 1.0


def test_a_shaft_that_never_stops_tells_no_scale_by_waiting() -> None:
    time_s, speed = stopping_column(0.052)
    assert timeout_scale(time_s, np.where(speed > 500.0, speed, np.nan), 32, 0.5) == 1.0


def test_however_many_rows_wait_no_more_than_fit_into_memory_are_asked() -> None:
    time_s, speed = stopping_column(0.052)
    period = time_s[-1] + time_s[1]
    many = np.concatenate([time_s + k * period for k in range(100)])
    tracemalloc.start()
    assert timeout_scale(many, np.tile(speed, 100), 32, 0.5) - 1.0 == pytest.approx(0.052, abs=3e-3)
    assert tracemalloc.get_traced_memory()[1] < 100e6
    tracemalloc.stop()


def test_the_share_that_most_stretches_allow_is_not_moved_by_a_few_that_miscount() -> None:
    assert most_agreed_value(np.array([[-1.0, 3.0], [1.0, 4.0], [0.0, 2.0], [7.0, 8.0]])) == 1.5
    assert most_agreed_value(np.zeros((0, 2))) == 0.0


def test_a_filtered_speed_has_no_scale() -> None:
    made = drive_log(rig())
    late = made.columns["speed_rpm"].copy()
    for n in range(1, len(late)):
        late[n] = late[n - 1] + 0.3 * (late[n] - late[n - 1])
    assert edge_scale(made.time_s, np.round(2.0 * late) / 2.0, 4, 0.5) == 1.0


def test_a_gain_closes_to_the_noise() -> None:
    made = drive_log(rig())
    high = replace(
        made,
        columns=made.columns
        | {"speed_rpm": np.round(2.0 * made.columns["speed_rpm"] * 1.004) / 2.0},
    )
    problem = load_problem([high], rig(effects={"speed_gain": {"relative": 0.004}}))
    assert problem.gap(problem.residuals(problem.theta0)[0]) < 1.15
    assert any("edge periods behind speed_rpm" in w for w in problem.warnings)


def test_a_fifth_of_the_edges_may_be_missing() -> None:
    problem = load_problem([drive_log(rig(), dropout=0.2)], rig())
    theta = np.repeat(problem.theta0[None], 2, axis=0)
    theta[1, problem.index("effects.hall_dropout.probability")] = 0.2
    before, after = (problem.gap(r) for r in problem.residuals(theta))
    assert before > 2.0 and after < 1.1
    assert problem.missed_share == pytest.approx(0.2, rel=0.1)


def test_missed_edges_are_no_bend_of_the_motion() -> None:
    speed = np.linspace(100.0, 400.0, 60)
    count = np.ones(60, int)
    count[[7, 20, 21, 40]] = [2, 2, 3, 4]
    level = np.log(speed / count)
    assert np.array_equal(most_likely_pitches(level), count)
    assert np.array_equal(consistent_missed_edges(level, count), count - 1)
    # uniformly accelerated from rest: neither half nor twice
    starting = np.log(np.sqrt(np.arange(1.0, 30.0)))
    assert np.array_equal(most_likely_pitches(starting), np.ones(29, int))
