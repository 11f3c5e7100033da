"""The scale of a Hall speed against its own edges is estimated where the log shows it and is 1
elsewhere.
"""

import tracemalloc

import numpy as np
import pytest

from made_log import drive_log, edge_times, hall_column, rig
from vgroove.gap.hall_edges import scale
from vgroove.gap.hall_edges.scale import edge_scale, most_agreed_value, timeout_scale


@pytest.mark.parametrize("gain", [0.004, -0.02])
def test_a_gain_of_the_speed_is_estimated_from_its_own_edges(gain: float) -> None:
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
def test_timeout_samples_give_the_gain_where_rows_hide_many_edges(
    gain: float, stops_per_s: float, error: float
) -> None:
    time_s, speed = stopping_column(gain, stops_per_s)
    assert timeout_scale(time_s, speed, 32, 0.5) - 1.0 == pytest.approx(gain, abs=3e-3)
    assert edge_scale(time_s, speed, 32, 0.5) - 1.0 == pytest.approx(gain, abs=error)


@pytest.mark.parametrize(
    ("pulses", "contradictory", "accepted"), [(16, 13, False), (16, 100, True), (4, 13, True)]
)
def test_a_few_chains_of_a_sensor_that_counts_give_no_scale(
    pulses: int, contradictory: int, accepted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One of many scales leaves the fewest chains by chance: of a sensor that counts edges, 1 % of
    its 2,500 periods must end a chain before a scale is searched.
    """
    time_s = np.arange(2501) * 1e-3
    speed = 3000.0 + time_s

    def chains(_: np.ndarray, scaled: np.ndarray, *_more: object) -> int:
        return 2 if scaled[0] > 3200.0 else contradictory

    monkeypatch.setattr(scale, "count_chains", chains)
    monkeypatch.setattr(scale, "period_error_bounds", lambda *_: np.zeros((0, 2)))
    monkeypatch.setattr(scale, "longest_chain", lambda *_: (1.0, 0.0, 0))
    found = edge_scale(time_s, speed, pulses, 0.5)
    assert found < 3000.0 / 3200.0 if accepted else found == 1.0


def test_a_shaft_that_never_stops_has_no_timeout_samples_to_scale() -> None:
    time_s, speed = stopping_column(0.052)
    assert timeout_scale(time_s, np.where(speed > 500.0, speed, np.nan), 32, 0.5) == 1.0


def test_the_memory_for_timeout_samples_is_bounded() -> None:
    time_s, speed = stopping_column(0.052)
    period = time_s[-1] + time_s[1]
    many = np.concatenate([time_s + k * period for k in range(100)])
    tracemalloc.start()
    assert timeout_scale(many, np.tile(speed, 100), 32, 0.5) - 1.0 == pytest.approx(0.052, abs=3e-3)
    assert tracemalloc.get_traced_memory()[1] < 100e6
    tracemalloc.stop()


def test_the_most_agreed_value_ignores_a_few_stretches_that_miscount() -> None:
    assert most_agreed_value(np.array([[-1.0, 3.0], [1.0, 4.0], [0.0, 2.0], [7.0, 8.0]])) == 1.5
    assert most_agreed_value(np.zeros((0, 2))) == 0.0


def test_a_filtered_speed_has_no_scale() -> None:
    made = drive_log(rig())
    late = made.columns["speed_rpm"].copy()
    for n in range(1, len(late)):
        late[n] = late[n - 1] + 0.3 * (late[n] - late[n - 1])
    assert edge_scale(made.time_s, np.round(2.0 * late) / 2.0, 4, 0.5) == 1.0
