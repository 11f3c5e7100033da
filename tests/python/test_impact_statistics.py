"""Cycle statistics of a hammering log: harmonic fits, mean Hall readings, windows, and residuals
that are noise where the model is the tool.
"""

import numpy as np
import pytest

from impact_logs import PULSES, TIMEOUT_S, edge_reading, impact_rig, plant_log, ramp
from vgroove.errors import VgrooveError
from vgroove.gap.catalogue.statistics import PERIOD, STATISTICS
from vgroove.gap.residual.impact.cycle_statistics import NOISE_LEFT, interpolated
from vgroove.gap.residual.impact.hall_reading import edge_speed, mean_hall_speed
from vgroove.gap.residual.impact.harmonics import fit_harmonics, fundamental_hz
from vgroove.gap.residual.impact.impact_run import white_sigma
from vgroove.gap.residual.impact.unknowns import with_edge_errors
from vgroove.gap.residual.loading import load_problem
from vgroove.log import Log

ROW_S = 1e-3


def test_a_harmonic_fit_reaches_the_cramer_rao_bound() -> None:
    rng, count, rows = np.random.default_rng(3), 800, 80
    t = ROW_S * (np.arange(rows) - 0.5 * (rows - 1))
    hz = rng.uniform(30.0, 60.0, count)
    turn = 2.0 * np.pi * hz[:, None] * t
    current = 30.0 + 5.0 * t + 0.6 * np.cos(turn + 1.0) + 0.3 * np.cos(2.0 * turn)
    speed = 8000.0 + 250.0 * np.cos(turn + 2.0)
    noise = np.array([0.15, 20.0])
    signals = np.stack([current, speed]) + noise[:, None, None] * rng.standard_normal(
        (2, count, rows)
    )
    band = hz[:, None] * np.array([0.7, 1.3])
    start = fundamental_hz(signals, 1.0 / noise**2, ROW_S, band)
    found = fit_harmonics(signals, 1.0 / noise**2, ROW_S, start, 4)
    bound = (found.frequency_information / noise[:, None] ** 2).sum(axis=0) ** -0.5
    error = found.frequency_hz - hz
    assert np.std(error / bound) == pytest.approx(1.0, abs=0.1)
    assert abs(np.mean(error / bound)) < 0.15
    assert np.mean(np.abs(found.amplitude[0]), axis=0)[:2] == pytest.approx([0.6, 0.3], abs=0.01)
    assert np.std(found.level[0] - 30.0) == pytest.approx(0.15 / np.sqrt(rows), rel=0.15)
    assert np.median(found.scatter, axis=1) == pytest.approx(noise, rel=0.03)


def test_the_mean_hall_speed_is_the_mean_reading_over_the_places_of_the_edges() -> None:
    time_s = ROW_S * np.arange(400)
    rate = 2.0 * np.pi * 50.0

    def angle_at(t: np.ndarray) -> np.ndarray:
        return 1000.0 * t + 60.0 / rate * (1.0 - np.cos(rate * t))

    speed, angle = 1000.0 + 60.0 * np.sin(rate * time_s), angle_at(time_s)
    offsets = np.linspace(0.0, 2.0 * np.pi / PULSES, 64, endpoint=False)
    fine = np.linspace(0.0, time_s[-1], 40 * len(time_s))
    readings = [edge_reading(fine, angle_at(fine), offset) for offset in offsets]
    expected = np.interp(time_s, fine, np.mean(readings, axis=0))
    found = mean_hall_speed(angle[None], speed[None], ROW_S, PULSES, TIMEOUT_S)[0]
    inside = slice(20, -20)
    assert found[inside] == pytest.approx(expected[inside], rel=0.005)
    without = np.abs(speed - expected)[inside].max()  # the reading lags and smooths
    assert np.abs(found - expected)[inside].max() < 0.2 * without


def edge_speed_of(angle: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Readings (rows,) of one motion at rows every ROW_S."""
    return edge_speed(angle[None], speed[None], ROW_S, PULSES, TIMEOUT_S)[0]


PITCH = 2.0 * np.pi / PULSES


@pytest.mark.parametrize("speed", [1000.0, -1000.0, 1.01 * PITCH / TIMEOUT_S])
def test_simulated_edges_of_a_constant_speed_show_it_from_the_second_edge_on(speed: float) -> None:
    time_s = ROW_S * np.arange(300)
    found = edge_speed_of(speed * time_s, np.full(300, speed))
    shown = time_s >= 2.0 * PITCH / abs(speed)
    assert found[~shown] == pytest.approx(0.0)
    assert found[shown] == pytest.approx(speed, rel=1e-9)


@pytest.mark.parametrize("speed", [0.0, 0.99 * PITCH / TIMEOUT_S, -0.99 * PITCH / TIMEOUT_S])
def test_a_speed_whose_edges_are_further_apart_than_the_timeout_reads_zero(speed: float) -> None:
    time_s = ROW_S * np.arange(300)
    assert not edge_speed_of(speed * time_s, np.full(300, speed)).any()


@pytest.mark.parametrize(("turned", "shows"), [(0.0, False), (1.99, False), (2.01, True)])
def test_a_shaft_that_passes_fewer_than_two_edges_reads_zero(turned: float, shows: bool) -> None:
    speed = turned * PITCH / 0.08
    time_s = ROW_S * np.arange(81)
    assert edge_speed_of(speed * time_s, np.full(81, speed)).any() == shows


def test_a_shaft_that_swings_back_repeats_no_edge() -> None:
    """It turns by four pitches, swings back by three and stays: the reading is the pitch over the
    age of the fourth edge until the timeout.
    """
    rows = np.arange(200)
    speed = PITCH * np.interp(rows, [0, 39, 41, 69, 71], [110.0, 110.0, -110.0, -110.0, 0.0])
    angle = ROW_S * np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]))])
    assert 4.0 < angle.max() / PITCH < 5.0
    assert angle[-1] / PITCH < 1.5
    found, fourth_s = edge_speed_of(angle, speed), 4.0 / 110.0
    later = rows[50:] * ROW_S - fourth_s
    expected = np.where(later > TIMEOUT_S, 0.0, PITCH / later)
    assert found[50:] == pytest.approx(expected, rel=1e-6)


def test_simulated_edges_read_as_the_edges_of_the_exact_motion() -> None:
    time_s, rate = ROW_S * np.arange(400), 2.0 * np.pi * 50.0

    def angle_at(t: np.ndarray) -> np.ndarray:
        return 1000.0 * t + 60.0 / rate * (1.0 - np.cos(rate * t))

    fine = np.linspace(0.0, time_s[-1], 1000 * (len(time_s) - 1) + 1)
    exact = edge_reading(fine, angle_at(fine), 0.0)[::1000]
    found = edge_speed_of(angle_at(time_s), 1000.0 + 60.0 * np.sin(rate * time_s))
    inside = slice(20, -20)
    assert found[inside] == pytest.approx(exact[inside], rel=2e-3)


def test_a_motion_that_the_plant_could_not_simulate_reads_nan() -> None:
    assert np.isnan(edge_speed_of(np.full(30, np.nan), np.zeros(30))).all()


@pytest.mark.parametrize("seed", range(4))
def test_the_shape_of_a_hall_speed_is_at_the_errors_of_its_edges(seed: int) -> None:
    rig = impact_rig(supply__voltage_v=17.0 + seed)
    problem = load_problem([plant_log(rig, {}, seed, ramp(0.9, 1.8))], rig)
    residual = problem.residuals(problem.theta0)[0]
    names = np.array([signal.column for signal in problem.signals])[problem.signal]
    shape = residual[(problem.time_s > 0.8) & (names == "speed_rpm.shape")]
    assert 0.7 < np.sqrt(np.mean(shape**2)) < 1.2


@pytest.mark.parametrize("size", [0.0, 0.3, 5.0])
def test_errors_of_edges_bound_the_standard_deviations_of_the_speed_alone(size: float) -> None:
    """To errors of this size in standard deviations of white noise; 0.1 where there are none."""
    problem = load_problem([plant_log(impact_rig(), {}, 1, ramp(0.9, 1.5))], impact_rig())
    run = problem.runs[0]
    white = white_sigma(run)
    error = size * white * np.random.default_rng(0).standard_normal((2, 200, len(white)))
    error[1] *= 0.5  # of a tool whose errors are smaller
    error = np.concatenate([error, np.full_like(error[:1], np.nan)])  # and of an impossible one
    found = with_edge_errors(run, error).sigma
    speed = np.array([p.column == "speed_rpm" for p in run.parts])[run.part]
    speed &= run.judged & ~run.is_run_up
    assert speed.any()
    assert found[~speed] == pytest.approx(run.sigma[~speed])
    expected = np.fmin(run.sigma, max(size, 0.1) * white)
    assert found[speed] == pytest.approx(expected[speed], rel=0.1)
    assert (found <= run.sigma).all()


def test_interpolated_windows_keep_smooth_signals_and_reduce_noise_as_stated() -> None:
    rng, places = np.random.default_rng(1), np.linspace(50.0, 60.0, 41)
    t = np.arange(4000.0)
    smooth = np.cos(2.0 * np.pi * t / 25.0)
    windows = interpolated(smooth[None], places, 40)[0]
    exact = np.cos(2.0 * np.pi * (places[:, None] + np.arange(40)) / 25.0)
    assert np.abs(windows - exact).max() < 2e-3
    noise = interpolated(rng.standard_normal((1, 4000)), rng.uniform(10.0, 3900.0, 4000), 40)
    assert np.std(noise) == pytest.approx(NOISE_LEFT, abs=0.02)


@pytest.mark.parametrize("seed", range(4))
def test_a_log_of_the_model_itself_is_at_the_noise_at_drawn_joints_and_supplies(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rig = impact_rig(
        load__slip_slope_nm_per_rad=float(np.exp(rng.uniform(np.log(60.0), np.log(700.0)))),
        supply__voltage_v=float(rng.uniform(16.5, 20.0)),
    )
    log = plant_log(rig, {}, seed, ramp(float(rng.uniform(0.6, 1.0)), 1.8))
    problem = load_problem([log], rig)
    residual = problem.residuals(problem.theta0)[0]
    assert problem.gap(residual) < 1.05
    assert np.mean(np.abs(residual) > 4.0) < 0.01
    late = residual[problem.time_s > 1.2]
    assert 0.1 < np.sqrt(np.mean(late**2)) < 1.15


def test_statistics_respond_smoothly_to_a_parameter() -> None:
    rig = impact_rig(load__slip_slope_nm_per_rad=500.0)
    problem = load_problem([plant_log(rig, {}, 1, ramp(0.95, 1.8))], rig)
    theta = np.repeat(problem.theta0[None], 3, axis=0)
    theta[1:, problem.index("effects.impact_damping.relative")] = [0.02, 0.4]
    rows = problem.residuals(theta)
    near, far = (rows[1] - rows[0]) / 0.02, (rows[2] - rows[0]) / 0.4
    late = problem.time_s > 0.8
    assert np.sqrt(np.mean((near - far)[late] ** 2)) < 0.6 * np.sqrt(np.mean(far[late] ** 2))


def test_judged_signals_are_named_statistics_with_units() -> None:
    rig = impact_rig()
    log = plant_log(rig, {}, 2, ramp(0.9, 1.5), bench=("hammer_mm", "anvil_angle_rad"))
    problem = load_problem([log], rig)
    names = {s.column: s.unit for s in problem.signals}
    assert {name.split(".")[0] for name in names} == {PERIOD, *STATISTICS}
    assert names[PERIOD] == "s"
    assert names["current_a.level"] == "A"
    assert names["anvil_angle_rad.rise"] == "rad/s"
    assert names["hammer_mm.shape"] == "mm"


def test_a_log_that_is_too_short_or_without_current_and_speed_is_refused() -> None:
    rig = impact_rig()
    whole = plant_log(rig, {}, 1, ramp(0.9, 1.5))
    short = Log(whole.time_s[:300], {k: v[:300] for k, v in whole.columns.items()}, "short.csv")
    with pytest.raises(VgrooveError, match="too short to judge"):
        load_problem([short], rig)
    kept = {k: whole.columns[k] for k in ("duty", "supply_v")}
    with pytest.raises(VgrooveError, match="needs a column current_a or speed_rpm"):
        load_problem([Log(whole.time_s, kept, "bus.csv")], rig)
