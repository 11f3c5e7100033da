"""The run-up of a hammering log: the start angle of the hammer that it shows, the statistics of its
spans, and the nuisance directions beside which all statistics are judged.
"""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from impact_logs import PARAMETERS, impact_rig, plant_log, ramp
from vgroove.gap.catalogue.statistics import LEVEL, RUN_UP
from vgroove.gap.residual.impact.nuisance import NuisanceDirections
from vgroove.gap.residual.impact.problem import ImpactProblem
from vgroove.gap.residual.impact.roll_outs import (
    run_up_means,
    run_up_residuals,
    simulate_statistics,
)
from vgroove.gap.residual.impact.roughness import (
    NODE,
    ROUGHNESS,
    SLIP_TORQUE,
    linearised,
    roughness_responses,
)
from vgroove.gap.residual.impact.start_angle import (
    COLUMN,
    profiled_starts,
    start_angles,
    with_starts,
)
from vgroove.gap.residual.impact.start_scatter import StartScatter
from vgroove.gap.residual.impact.unknowns import (
    REPEATABILITY,
    SCALED,
    from_all_starts,
    further_scatter,
)
from vgroove.gap.residual.loading import load_problem
from vgroove.log import Log
from vgroove.reference.joints import REFERENCE_JOINTS
from vgroove.reference.rigs import with_load

SECONDS, TOLERANCE_RAD = 1.2, 0.02


def step(duty: float) -> np.ndarray:
    """A duty after 50 ms at rest."""
    return np.concatenate([np.zeros(50), ramp(duty, SECONDS)])


def drawn_start(seed: int) -> float:
    """The start angle in rad that plant_log draws for a seed."""
    return -float(np.random.default_rng(seed).uniform(0.05, 2.1))


def of_run_up(problem: ImpactProblem) -> np.ndarray:
    """Whether each residual (n,) belongs to the run-up."""
    names = np.array([s.column.endswith(RUN_UP) for s in problem.signals])
    return names[problem.signal]


@pytest.mark.parametrize("seed", range(20, 26))
def test_the_run_up_shows_the_start_angle_and_is_at_the_noise(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rig = impact_rig(
        load__slip_slope_nm_per_rad=float(rng.uniform(60.0, 400.0)),
        supply__voltage_v=float(rng.uniform(16.5, 20.0)),
    )
    log = plant_log(rig, {}, seed, step(float(rng.uniform(0.7, 1.0))))
    problem = load_problem([log], rig)
    run, plant = problem.runs[0], problem.of_log(0, problem.theta0[None])
    found = profiled_starts(run, plant)[0]
    assert found == pytest.approx(drawn_start(seed), abs=TOLERANCE_RAD)
    left = problem.residuals(problem.theta0)[0][of_run_up(problem)]
    assert len(left) > 10
    assert 0.5 < np.sqrt(np.mean(left**2)) < 1.3


@pytest.mark.parametrize("seed", [30, 31, 32])
def test_each_parameter_set_has_a_start_angle_of_its_own(seed: int) -> None:
    """An added inertia slows the spin-up; a model without it fits best from another angle."""
    rig, name = impact_rig(), "effects.added_inertia.kg_m2"
    log = plant_log(rig, {"added_inertia.kg_m2": 1e-5}, seed, step(0.9))
    problem = load_problem([log], rig)
    theta = np.stack([problem.theta0, problem.theta0])
    theta[1, PARAMETERS.index(name)] = 1e-5
    found = profiled_starts(problem.runs[0], problem.of_log(0, theta))
    assert found[1] == pytest.approx(drawn_start(seed), abs=TOLERANCE_RAD)
    without, beside = problem.residuals(theta)[:, of_run_up(problem)]
    assert np.sqrt(np.mean(beside**2)) < 1.3 < 3.0 < np.sqrt(np.mean(without**2))


def test_start_angles_lie_between_two_lugs_and_do_not_depend_on_the_order_of_sets() -> None:
    rig = impact_rig()
    problem = load_problem([plant_log(rig, {}, 5, step(0.9))], rig)
    plant = np.repeat(problem.of_log(0, problem.theta0[None]), 3, axis=0)
    plant[:, PARAMETERS.index("effects.winding_resistance.relative")] = [0.0, 0.1, -0.1]
    tried = start_angles(plant[0])
    assert np.all((-2.15 < tried) & (tried < 0.0)) and len(np.unique(tried)) == len(tried)
    together = profiled_starts(problem.runs[0], plant)
    apart = [profiled_starts(problem.runs[0], plant[k : k + 1])[0] for k in (2, 0, 1)]
    np.testing.assert_array_equal(together, np.array(apart)[[1, 2, 0]])


def test_a_stated_start_angle_is_not_searched() -> None:
    rig = impact_rig(mechanism__hammer_start_rad=drawn_start(9))
    problem = load_problem([plant_log(impact_rig(), {}, 9, step(0.9))], rig)
    assert problem.runs[0].early is None
    assert problem.of_log(0, problem.theta0[None])[0, COLUMN] == drawn_start(9)
    left = problem.residuals(problem.theta0)[0][of_run_up(problem)]
    assert np.sqrt(np.mean(left**2)) < 1.3


@pytest.mark.parametrize("cut", [150, 400])
def test_a_log_that_begins_in_motion_has_no_run_up(cut: int) -> None:
    """The joint does not turn: a log of one that does is refused once the tool hammers."""
    rig = with_load(impact_rig(), REFERENCE_JOINTS["locked"].load)
    whole = plant_log(rig, {}, 4, step(0.9))
    columns = {name: values[cut:] for name, values in whole.columns.items()}
    problem = load_problem([Log(whole.time_s[cut:], columns, "cut")], rig)
    assert not of_run_up(problem).any()
    resting = columns | {"duty": np.where(np.arange(len(columns["duty"])) < 30, 0.0, 0.9)}
    problem = load_problem([Log(whole.time_s[cut:], resting, "coasting")], rig)
    assert not of_run_up(problem).any()


def test_whitened_residuals_of_noise_and_nuisances_have_unit_covariance() -> None:
    rng = np.random.default_rng(2)
    responses = rng.standard_normal((12, 3)) * [5.0, 1.0, 0.2]
    white = NuisanceDirections.of(responses)
    root = white.whitened(np.eye(12))
    covariance = np.eye(12) + responses @ responses.T
    assert root @ covariance @ root.T == pytest.approx(np.eye(12), abs=1e-6)
    assert root == pytest.approx(root.T)
    apart = np.linalg.qr(np.hstack([responses, rng.standard_normal((12, 1))]))[0][:, -1]
    assert white.whitened(apart) == pytest.approx(apart)
    most = responses[:, 0] / np.linalg.norm(responses[:, 0])
    assert np.linalg.norm(white.whitened(most)) < 0.2


def test_the_scatter_over_start_angles_is_shared_where_statistics_move_together() -> None:
    rng, size = np.random.default_rng(3), np.array([1.0, 5.0, 0.2] * 20)
    apart = StartScatter.of(size * rng.standard_normal((96, 60)))
    assert np.allclose(apart.apart, size, rtol=0.25)
    assert np.linalg.norm(apart.shared / size[:, None], axis=1).max() < 0.5
    together = StartScatter.of(size * rng.standard_normal((96, 1)))
    assert np.all(together.apart < 0.15 * size)
    assert np.allclose(np.linalg.norm(together.shared, axis=1), size, rtol=0.2)


def test_the_covariance_over_start_angles_keeps_its_variances() -> None:
    rng = np.random.default_rng(4)
    statistics = rng.standard_normal((96, 3)) @ rng.standard_normal((3, 50))
    statistics += 0.5 * rng.standard_normal((96, 50))
    found = StartScatter.of(statistics)
    variance = found.apart**2 + np.sum(found.shared**2, axis=1)
    assert np.allclose(variance, statistics.var(axis=0, ddof=1))
    constant = StartScatter.of(np.ones((96, 4)))
    assert not constant.apart.any() and not constant.shared.any()


@pytest.mark.parametrize("seed", range(3))
def test_a_part_of_the_statistics_is_judged_under_its_own_covariance(seed: int) -> None:
    rng = np.random.default_rng(seed)
    responses, rows = rng.standard_normal((20, 5)) * 3.0, rng.random(20) < 0.4
    part = NuisanceDirections.of(responses).of_rows(rows)
    covariance = np.eye(rows.sum()) + responses[rows] @ responses[rows].T
    half = part.whitened(np.eye(rows.sum()))
    assert half @ covariance @ half.T == pytest.approx(np.eye(rows.sum()), abs=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_the_start_angle_does_not_make_up_for_the_roughness(seed: int) -> None:
    """A slip torque that is larger by one standard deviation of the roughness moves the first blows
    by many standard deviations of their noise, but is judged as about one.
    """
    rig = impact_rig(load__run_torque_nm=float(np.random.default_rng(seed).uniform(1.0, 6.0)))
    problem = load_problem([plant_log(rig, {}, seed, step(0.9))], rig)
    run, theta = problem.runs[0], np.repeat(problem.of_log(0, problem.theta0[None]), 2, axis=0)
    theta[1, PARAMETERS.index(SLIP_TORQUE)] = ROUGHNESS
    found = profiled_starts(run, theta)
    assert found == pytest.approx(drawn_start(seed), abs=TOLERANCE_RAD)
    theta[:, COLUMN] = found[0]
    plain, rough = run_up_means(run, theta)[:, run.judged[run.is_run_up]]
    noise = np.linalg.norm((rough - plain) / run.sigma[run.judged & run.is_run_up])
    plain, rough = run_up_residuals(run, theta)
    assert np.linalg.norm(rough - plain) < 0.5 * noise
    assert np.linalg.norm(rough - plain) < 3.0 < noise


@pytest.mark.parametrize("column", ["current_a", "supply_v"])
def test_scatter_that_the_model_does_not_show_is_a_gap(column: str) -> None:
    """A contact that opens and closes over some tens of ms makes neighbouring windows differ; a
    sigma from the log's own scatter would hide it.
    """
    rig = impact_rig()
    plain = plant_log(rig, {}, 8, step(0.9))
    rng = np.random.default_rng(1)
    switched = np.repeat(rng.integers(0, 2, 1 + len(plain.time_s) // 60), 60)[: len(plain.time_s)]
    size = {"current_a": 1.0, "supply_v": 0.15}[column]
    moved = plain.columns | {column: plain.columns[column] + size * switched}
    logs = (plain, Log(plain.time_s, moved, "loose contact"))
    steady, loose = (load_problem([log], rig) for log in logs)
    assert steady.gap(steady.residuals(steady.theta0)[0]) < 1.1
    assert loose.gap(loose.residuals(loose.theta0)[0]) > 2.0
    at = [k for k, s in enumerate(loose.signals) if s.column == f"{column}.level"][0]
    wider = np.median(loose.sigma[loose.signal == at]) / np.median(
        steady.sigma[steady.signal == at]
    )
    assert wider < 1.5


@pytest.mark.parametrize("curved", [0.0, 0.7, -2.0])
def test_the_response_to_roughness_keeps_the_moments_of_a_parabola(curved: float) -> None:
    """Of y = a + b x + c x^2 with x normal of variance 1 the slope is b, and a + b x leaves an RMS
    of |c| sqrt(E[x^4]) = |c| sqrt(3).
    """
    x = np.array([0.0, NODE, -NODE])[:, None]
    change, left = linearised(np.stack([2.0 + 3.0 * x + curved * x**2, 0.0 * x]))
    assert change == pytest.approx(3.0)
    assert left == pytest.approx(abs(curved) * np.sqrt(3.0 / 2.0))  # RMS over two tools


@pytest.mark.parametrize(
    ("file", "seconds", "together"),
    [("impact_driver", 2.0, True), ("impact_driver_wood_screw", 2.0, False)],
)
def test_windows_at_one_place_of_the_joint_meet_one_roughness(
    file: str, seconds: float, together: bool
) -> None:
    """A seated bolt turns by a few degrees from window to window, a screw by a turn."""
    rig = impact_rig(file)
    duty = np.concatenate([np.zeros(50), ramp(0.9, seconds)])
    problem = load_problem([plant_log(rig, {}, 3, duty)], rig)
    run = problem.runs[0]
    plant = problem.of_log(0, problem.theta0[None])
    response = roughness_responses(run, plant).directions
    level = [p.column == "current_a" and p.kind == LEVEL for p in run.parts].index(True)
    rows = response[run.part == level][-8:]
    covariance = rows @ rows.T
    size = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(size, size)
    assert len(rows) == 8 and np.all(size > 0.0)
    assert correlation[0, -1] > 0.6 if together else abs(correlation[0, -1]) < 0.1
    ends = np.repeat(plant, 2, axis=0)
    ends[:, PARAMETERS.index(SLIP_TORQUE)] = ROUGHNESS * NODE, -ROUGHNESS * NODE
    rough, smooth = simulate_statistics(run, ends)
    throughout = 0.5 / NODE * np.abs(rough - smooth)[run.part == level][-8:]
    # the mean over a window that passes several places varies less than the torque at one
    assert np.all(size <= throughout * 1.0001)
    assert np.all(size > throughout * (0.8 if together else 0.2))


def test_the_scale_of_a_sensor_is_no_gap_up_to_its_repeatability() -> None:
    """A scale that is off by 5 standard deviations of its repeatability gives a residual of 5."""
    rig = impact_rig()
    problem = load_problem([plant_log(rig, {}, 6, step(0.9))], rig)
    run = problem.runs[0]
    scaled = np.array([p.column == "supply_v" and p.kind in SCALED for p in run.parts])[run.part]
    change = np.where(scaled, 5.0 * REPEATABILITY * run.measured, 0.0)
    moved = replace(run, measured=run.measured + change)
    plain = (change / run.sigma)[run.judged]
    left = moved.residuals(run.measured[None])[0]
    assert np.linalg.norm(plain) > 25.0
    assert np.linalg.norm(left) == pytest.approx(5.0, rel=0.1)


def test_tools_of_the_tolerances_add_scatter_over_the_start_only_where_theirs_is_larger() -> None:
    """The same tool again adds nothing but the error of sampling; another one beside a tool without
    scatter half its variance.
    """
    rig = impact_rig()
    run = load_problem([plant_log(rig, {}, 6, step(0.9))], rig).runs[0]
    theta = rig.parameters()
    statistics = simulate_statistics(run, with_starts(theta, start_angles(theta)))
    assert not further_scatter(run, theta[None], statistics).any()
    same = further_scatter(run, np.tile(theta, (4, 1)), statistics)
    own = np.nanstd(statistics, axis=0)
    kept = run.judged & ~run.is_run_up
    assert np.median(same[kept] / own[kept]) < 0.5
    other = np.tile(theta, (2, 1))
    other[1, PARAMETERS.index("mechanism.spring_preload_n")] *= 1.2
    found = further_scatter(run, other, 0.0 * statistics)
    each = simulate_statistics(run, from_all_starts(other[1:], 12)[0])
    expected = np.sqrt(0.5) * np.std(each, axis=0)
    assert found[kept] == pytest.approx(expected[kept], rel=1e-6)


@pytest.mark.parametrize("overlap_rad", [0.8, 0.9, 1.05])
@pytest.mark.parametrize("start_rad", [-0.0015, -1.1, None])
def test_a_start_angle_at_a_lug_is_found(overlap_rad: float, start_rad: float | None) -> None:
    """The free angle of some overlaps is rounded to an angle on a lug, which the plant refuses, and
    so is a step beyond an angle next to one. None: next to the lug behind.
    """
    free = np.pi - overlap_rad
    start = 0.0015 - free if start_rad is None else start_rad
    true = impact_rig(mechanism__lug_overlap_rad=overlap_rad, mechanism__hammer_start_rad=start)
    log = plant_log(true, {}, 3, step(0.9))
    problem = load_problem([log], impact_rig(mechanism__lug_overlap_rad=overlap_rad))
    run, plant = problem.runs[0], problem.of_log(0, problem.theta0[None])
    assert profiled_starts(run, plant)[0] == pytest.approx(start, abs=TOLERANCE_RAD)
    left = problem.residuals(problem.theta0)[0][of_run_up(problem)]
    assert np.sqrt(np.mean(left**2)) < 1.4


def test_sets_of_different_lugs_do_not_depend_on_one_another() -> None:
    problem = load_problem([plant_log(impact_rig(), {}, 5, step(0.9))], impact_rig())
    plant = np.repeat(problem.of_log(0, problem.theta0[None]), 3, axis=0)
    plant[:, PARAMETERS.index("mechanism.lug_overlap_rad")] = [1.1, 1.0, 0.9]
    together = profiled_starts(problem.runs[0], plant)
    apart = [profiled_starts(problem.runs[0], plant[k : k + 1])[0] for k in range(3)]
    np.testing.assert_array_equal(together, apart)


def test_a_spin_up_without_rows_leaves_the_start_angle_to_the_later_statistics() -> None:
    log = plant_log(impact_rig(), {}, 5, step(0.9))
    kept = (np.arange(len(log.time_s)) < 60) | (np.arange(len(log.time_s)) > 100)
    columns = {name: values[kept] for name, values in log.columns.items()}
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        problem = load_problem([Log(log.time_s[kept], columns, "hole")], impact_rig())
        found = profiled_starts(problem.runs[0], problem.of_log(0, problem.theta0[None]))
    assert -np.pi + 1.0 < found[0] < 0.0
