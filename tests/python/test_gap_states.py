"""Local polynomial regression and measured states: the width of a fit follows noise and curvature,
and no fit crosses a reversal.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vgroove.gap.cleaning.sensor_noise import (
    divided_differences,
    position_noise,
    position_noise_sigma,
)
from vgroove.gap.residual.local_polynomial import (
    KnownForce,
    LocalFit,
    Observations,
    local_fits,
    shrunk,
)
from vgroove.gap.residual.restarts import Restarts, StateObserver, find_restarts
from vgroove.gap.residual.sensors import DELAY, FILTER, MEAN, SensorErrors
from vgroove.rig import read_rig

TIME = np.arange(200) * 1e-3


def local_fit(observed: Observations, time_s: float) -> LocalFit:
    """The fit at one instant."""
    return local_fits(observed, np.array([time_s]))[0]


def seen(values: np.ndarray, sigma: float) -> Observations:
    return Observations(TIME, TIME, values, np.full(len(values), sigma))


def test_noise_on_a_smooth_motion_is_averaged_over_many_rows() -> None:
    rng = np.random.default_rng(1)
    errors = [
        local_fit(seen(300.0 + 50.0 * TIME + rng.normal(size=200), 1.0), 0.1).value - 305.0
        for _ in range(200)
    ]
    assert np.std(errors) < 0.42  # a quadratic through eight rows has 0.53


def test_a_kink_is_fitted_with_few_rows() -> None:
    bent = np.where(TIME < 0.1, 10.0, 10.0 + 2000.0 * (TIME - 0.1))
    assert local_fit(seen(bent, 0.1), 0.104).value == pytest.approx(18.0, abs=1.5)
    assert local_fit(seen(bent, 0.1), 0.085).value == pytest.approx(10.0, abs=0.05)


def test_fits_at_many_instants_are_those_at_each() -> None:
    """Also at instants without observations enough, and where the values reverse or are missing."""
    values = np.where(TIME < 0.1, 40.0 * (TIME - 0.1), 80.0 * (TIME - 0.1))
    values += 0.3 * np.random.default_rng(5).normal(size=200)
    values[150] = np.nan
    observed, instants = seen(values, 0.3), np.linspace(-0.01, 0.21, 23)
    assert local_fits(observed, instants) == [local_fit(observed, t) for t in instants]


# a force in steps, whose speed a quadratic does not fit
STEPPED_FORCE = KnownForce(TIME, np.where(np.arange(200) // 8 % 2 == 0, 4000.0, -2500.0))


@pytest.mark.parametrize("length", [0.0, 0.7e-3, 5.3e-3])
def test_a_known_force_adds_no_uncertainty_to_a_state(length: float) -> None:
    noise, start, end = np.random.default_rng(4).normal(size=200), TIME - length, TIME
    start = np.maximum(start, 0.0)
    still = Observations(start, end, 300.0 + noise, np.ones(200))
    driven = replace(
        still, value=still.value + STEPPED_FORCE.means(start, end), known_force=STEPPED_FORCE
    )
    for instant in (0.07, 0.0842, 0.1):
        true = 300.0 + STEPPED_FORCE.at(np.array([instant]))[0][0]
        found, plain = local_fit(driven, instant), local_fit(still, instant)
        assert found.value - true == pytest.approx(plain.value - 300.0, abs=1e-9)
        assert found.sigmas == pytest.approx(plain.sigmas)
        assert local_fit(replace(driven, known_force=None), instant).sigmas > 1.5 * found.sigmas


def test_the_means_of_a_known_force_over_spans_are_its_integral() -> None:
    fine = np.linspace(0.0, 0.199, 19901)
    speed = np.concatenate(
        [
            [0.0],
            np.cumsum(
                STEPPED_FORCE.rate[np.searchsorted(TIME, 0.5 * (fine[1:] + fine[:-1]))] * 1e-5
            ),
        ]
    )
    assert STEPPED_FORCE.at(fine)[0] == pytest.approx(speed, abs=1e-6)
    span = slice(3210, 4771)
    mean = np.mean(0.5 * (speed[span][1:] + speed[span][:-1]))
    assert STEPPED_FORCE.means(fine[[span.start]], fine[[span.stop - 1]]) == pytest.approx(
        [mean], abs=1e-6
    )


def test_slope_with_a_known_force_is_that_of_the_whole_speed() -> None:
    steady = KnownForce(TIME, np.full(200, 500.0))
    found = local_fit(replace(seen(500.0 * TIME - 80.0 * TIME, 0.1), known_force=steady), 0.1)
    assert (found.value, found.slope, found.curvature) == pytest.approx((42.0, 420.0, 0.0), abs=0.1)


@pytest.mark.parametrize(("value", "left"), [(3.0, 3.0 - 1.0 / 3.0), (-2.0, -1.5), (0.5, 0.0)])
def test_what_noise_explains_of_a_derivative_is_taken_away(value: float, left: float) -> None:
    """The share of its square: 1 of 9, 1 of 4, all."""
    assert shrunk(np.array([value, 0.0]), np.ones(2)) == pytest.approx([left, 0.0])


def test_a_steady_speed_between_two_steps_of_its_sensor_has_nearly_no_derivatives() -> None:
    """A counter shows the steps in turn for three rows each: through few rows that is a motion.
    With a lag of 12 rows it would move the start of a simulation by a tenth of a step at most.
    """
    speed = 100.0 + np.where(np.arange(200) // 3 % 2, 4.0, 0.0)
    for row in range(40, 160, 7):
        found = local_fit(seen(speed, 4.0 / np.sqrt(12.0)), TIME[row])
        moved = found.slope * 0.012 + 0.5 * found.curvature * 0.012**2
        assert abs(moved) < 0.4


@pytest.mark.parametrize("form", [FILTER, DELAY, MEAN])
def test_the_true_speed_at_a_restart_is_that_of_the_lagging_sensor_corrected(form: int) -> None:
    """On w = 2 t + 30 t^2 / 2 a sensor of lag T shows at t = 1: the filter w - T w' + T^2 w'', the
    delay w(t - T), the mean that of w over the last 2 T; the slope of each is w' - T w''.
    """
    lag, slope, bend, speed = 0.02, 2.0 + 30.0, 30.0, 2.0 + 15.0
    shown = {
        FILTER: speed - lag * slope + lag**2 * bend,
        DELAY: speed - lag * slope + lag**2 * bend / 2.0,
        MEAN: speed - lag * slope + 2.0 * lag**2 * bend / 3.0,
    }[form]
    found = Restarts(
        np.array([0]),
        np.array([[0.0, shown, 0.0]]),
        np.array([[0.0, slope - lag * bend]]),
        np.array([[0.0, bend]]),
    )
    one, none = np.ones((1, 2)), np.zeros((1, 2))
    errors = SensorErrors(one, none, np.array([[0.0, lag]]), np.array([form]), np.ones(1))
    assert found.states(errors)[0, 0, 1] == pytest.approx(speed, abs=1e-9)


def test_no_fit_crosses_a_reversal() -> None:
    rng = np.random.default_rng(2)
    turning = np.where(TIME < 0.1, 40.0 * (TIME - 0.1), 80.0 * (TIME - 0.1)) + 0.3 * rng.normal(
        size=200
    )
    at = 0.101
    few = Observations(TIME[97:105], TIME[97:105], turning[97:105], np.full(8, 0.3))
    assert local_fit(seen(turning, 0.3), at) == local_fit(few, at)


@pytest.mark.parametrize("uneven", [0.0, 0.3])
@pytest.mark.parametrize("noise", [1e-4, 1e-2])
def test_noise_of_a_position_is_found_under_its_motion_however_uneven_the_rows(
    noise: float, uneven: float
) -> None:
    rng = np.random.default_rng(3)
    t = (np.arange(4000) + uneven * rng.uniform(-1.0, 1.0, 4000)) / 500.0
    motion = 20.0 * np.sin(2.0 * t) + 3.0 * np.sin(11.0 * t)
    assert position_noise_sigma(t, motion + noise * rng.normal(size=4000)) == pytest.approx(
        noise, rel=0.1
    )


@pytest.mark.parametrize(("order", "rows"), [(2, 1), (2, 8), (4, 3)])
def test_divided_differences_leave_noise_as_it_is_and_nothing_of_a_lower_polynomial(
    order: int, rows: int
) -> None:
    rng = np.random.default_rng(4)
    t = np.cumsum(rng.uniform(0.2, 1.8, 4000)) * 1e-3
    polynomial = np.polyval(rng.normal(size=order), t)
    assert np.abs(divided_differences(t, polynomial, order, rows)).max() < 1e-9
    assert divided_differences(
        t, polynomial + rng.normal(size=4000), order, rows
    ).std() == pytest.approx(1.0, rel=0.05)


def test_a_position_is_never_finer_than_its_step() -> None:
    rig = read_rig(Path(__file__).resolve().parents[2] / "rigs/impact_driver_drive.toml")
    steps = np.round(np.linspace(0.0, 30.0, 5000) / 0.01) * 0.01
    sigma = position_noise(rig, np.arange(5000) * 1e-3, steps).sigma
    assert 0.999 < sigma / (0.01 / np.sqrt(12.0)) < 1.2


@pytest.mark.parametrize("from_angle, speed", [(True, 102.0), (False, 80.0)])
def test_differences_of_an_angle_depend_on_the_loggers_clock_and_on_no_speed_sensor(
    from_angle: bool, speed: float
) -> None:
    found = Restarts(
        np.array([0]),
        np.array([[3.0, 100.0, 0.0]]),
        np.array([[0.0, -1200.0]]),
        np.zeros((1, 2)),
        from_angle,
    )
    gain, offset, lag = np.array([[1.0, 1.1]]), np.array([[0.0, 0.0]]), np.array([[0.0, 0.01]])
    state = found.states(SensorErrors(gain, offset, lag, np.array([FILTER]), np.array([1.02])))[
        0, 0
    ]
    assert state == pytest.approx([3.0, speed, 0.0])


def test_a_clipped_current_is_replaced_by_the_current_that_the_motion_needs() -> None:
    found = Restarts(
        np.array([0]),
        np.array([[-5.0, 100.0, 0.0]]),
        np.zeros((1, 2)),
        np.zeros((1, 2)),
        motion_a=np.array([-30.0]),
    )
    none, sets = np.zeros((4, 2)), np.ones(4)
    limit_a = np.array([np.inf, 5.0, 5.5, 5.6])
    states = found.states(SensorErrors(none + 1.0, none, none, np.full(4, FILTER), sets, limit_a))
    assert states[:, 0, 0] == pytest.approx([-5.0, -30.0, -30.0, -5.0])
    assert np.all(states[:, 0, 1] == 100.0)


def speeds_of(time_s: np.ndarray, speed: np.ndarray, sigma: float) -> StateObserver:
    """Observer of a speed column alone."""
    seen = Observations(time_s, time_s, speed, np.full(len(speed), sigma), interval_s=0.01)
    return StateObserver(seen, None, lambda _: 0.0, lambda *_: 0.0)


@pytest.mark.parametrize(
    ("speed", "first", "sigma"),
    [
        (np.array([0.0, 24.0, 85.0, 130.0]), 0.0, 1.0),  # hard starts from rest
        (np.array([0.0, 0.0, 10.0, 40.0]), 0.0, 1.0),
        (np.array([1.0, 2.1, 2.9, 4.0]), 0.0, 10.0),  # one that the noise hides
        (np.array([50.0, 51.0, 50.5, 51.5]), 50.0, 10.0),
        (np.array([-90.0, -80.0, -71.0, -59.0]), -90.0, 10.0),
    ],
)
def test_a_log_begins_in_motion_where_the_line_through_its_first_speeds_says_so(
    speed: np.ndarray, first: float, sigma: float
) -> None:
    time_s = 0.01 * np.arange(40)
    speed = np.append(speed, np.full(36, speed[-1]))
    found = find_restarts(speeds_of(time_s, speed, sigma), time_s, 0.2)
    assert found.measured[0, 1] == pytest.approx(first, abs=1.0)
    assert (found.speed_sigma[0] > 5.0) == (first != 0.0)


def test_of_equally_certain_instants_the_nearest_to_the_regular_one_is_taken() -> None:
    time_s = 0.01 * np.arange(120)
    found = find_restarts(speeds_of(time_s, np.zeros(120), 1.0), time_s, 0.2)
    assert found.rows.tolist() == [0, 20, 40, 60, 80, 100]
