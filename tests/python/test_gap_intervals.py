"""Parameter values over long stretches: where the speed decays more slowly than the model restarts,
and only there, they come from longer runs.
"""

import tomllib
from dataclasses import replace

import numpy as np
import pytest

from vgroove.bench import trap
from vgroove.gap.catalogue import BY_ID, Scales
from vgroove.gap.fitting.engine import Engine
from vgroove.gap.residual.loading import load_problem
from vgroove.gap.residual.problem import Problem
from vgroove.gap.selection.intervals import (
    ESTIMATE,
    Estimate,
    estimate_over_long_stretches,
    restarts_under_voltage_s,
    time_clusters,
)
from vgroove.log import Log
from vgroove.rig import Rig, rig_from_dict
from vgroove.units import RPM_PER_RAD_S

COULOMB = [BY_ID["coulomb_friction"]]
SCALES = Scales(
    volt=24.0,
    amp=0.2,
    speed=20.0,
    torque=0.2,
    inertia=trap.INERTIA,
    motor_inertia=trap.INERTIA,
    resistance=1.0,
    coulomb=0.0,
    viscous=trap.ASSUMED_DAMPING,
    ratio=1.0,
    duration=20.0,
    interval=0.002,
    pwm_hz=20000.0,
    supply_ohm=0.0,
)


def joint(**motor: float) -> Rig:
    table = tomllib.loads(trap.RIG)
    return rig_from_dict(table | {"motor": table["motor"] | motor}, "one joint")


@pytest.fixture(scope="module")
def problem() -> Problem:
    seen = trap.measured(trap.simulate_motion(*trap.excitation(2, trap.TRAIN_S, trap.TRAIN_NM)), 2)
    columns = {
        "current_a": seen.torque_nm,
        "speed_rpm": seen.speed_rad_s * RPM_PER_RAD_S,
        "position_rad": seen.angle_rad,
    }
    return load_problem([Log(seen.time_s, columns, "one joint")], joint())


@pytest.fixture(scope="module")
def engine(problem: Problem) -> Engine:
    return Engine(problem, SCALES, problem.rig.tolerance)


def test_the_time_constant_is_inertia_over_all_damping() -> None:
    assert joint().speed_time_constant_s == pytest.approx(trap.INERTIA / trap.ASSUMED_DAMPING)
    table = tomllib.loads(trap.RIG)
    driven = rig_from_dict(table | {"input": {"kind": "voltage_v"}}, "one joint")
    assert driven.speed_time_constant_s == pytest.approx(
        trap.INERTIA / (trap.ASSUMED_DAMPING + 1.0)
    )


def test_long_stretches_are_more_accurate_and_their_intervals_hold_the_true_values(
    problem: Problem, engine: Engine
) -> None:
    short = engine.fit(engine.hypotheses(COULOMB), 8)[0]
    found = estimate_over_long_stretches(engine, short)
    damping, friction = (
        found.retuned_parameters()["motor.viscous_nm_s_per_rad"],
        found.parameters("coulomb_friction")["torque_nm"],
    )
    before = short.hypothesis.theta(problem.theta0, short.x[None, :])[0][
        problem.index("motor.viscous_nm_s_per_rad")
    ]
    assert abs(damping - trap.DAMPING) < 0.5 * abs(before - trap.DAMPING)
    assert damping == pytest.approx(trap.DAMPING, rel=0.01)
    assert friction.ci95[0] < trap.COULOMB < friction.ci95[1]
    assert 2.0 * scatter(found, "effects.coulomb_friction.torque_nm") < 0.05 * trap.COULOMB


def scatter(found: Estimate, name: str) -> float:
    """Half width of a parameter from the fit alone, without form error."""
    at = [c.name for c in found.fit.hypothesis.coordinates].index(name)
    return float(found.half_widths[at] * found.fit.hypothesis.coordinates[at].factors[0])


def test_an_interval_contains_the_form_error(problem: Problem, engine: Engine) -> None:
    found = estimate_over_long_stretches(engine, engine.fit(engine.hypotheses(COULOMB), 8)[0])
    friction = found.parameters("coulomb_friction")["torque_nm"]
    half = 0.5 * (friction.ci95[1] - friction.ci95[0])
    assert half == pytest.approx(
        np.hypot(
            scatter(found, "effects.coulomb_friction.torque_nm"),
            ESTIMATE.form_error * friction.value,
        )
    )


def test_a_model_that_lacks_an_effect_has_no_long_estimate(
    problem: Problem, engine: Engine
) -> None:
    retuned = engine.fit(engine.hypotheses([]), 8)[0]
    assert problem.gap(retuned.residual) > ESTIMATE.max_gap
    assert estimate_over_long_stretches(engine, retuned) is None


def test_a_shaft_whose_speed_decays_between_restarts_is_not_fitted_again(
    problem: Problem, engine: Engine
) -> None:
    one = engine.fit(engine.hypotheses(COULOMB), 1)[0]
    interval_s = restarts_under_voltage_s(problem)
    assert interval_s == 0.25
    damped = replace(problem, rig=joint(viscous_nm_s_per_rad=trap.INERTIA / (0.9 * interval_s)))
    assert estimate_over_long_stretches(Engine(damped, SCALES, problem.rig.tolerance), one) is None


def test_a_model_without_fitted_parameters_is_not_fitted_again(problem: Problem) -> None:
    bare = Engine(problem, SCALES, {})
    assert estimate_over_long_stretches(bare, bare.fit(bare.hypotheses([]), 0)[0]) is None


@pytest.mark.parametrize(
    ("lengths_s", "clusters"),
    [
        ([0.2], 8),  # shorter than eight strokes: an eighth of the log
        ([3.99], 8),
        ([6.0], 12),  # of half a second
        ([0.2, 6.0], 20),  # each log has its own
        ([0.0], 1),  # one row
    ],
)
def test_a_short_log_has_eight_clusters(lengths_s: list[float], clusters: int) -> None:
    """Of two clusters Student's t of one degree of freedom makes an interval of any width. The
    first row may have any time.
    """
    rows = [300 if length else 1 for length in lengths_s]
    log = np.repeat(np.arange(len(rows)), rows)
    times = [
        7.3 + np.linspace(0.0, n, k, endpoint=k < 2) for n, k in zip(lengths_s, rows, strict=True)
    ]
    found = time_clusters(log, np.concatenate(times))
    counts = np.bincount(found)
    assert len(counts) == clusters
    assert all(len(np.unique(log[found == k])) == 1 for k in range(clusters))
    for k in range(len(rows)):
        mine = np.unique(found[log == k], return_counts=True)[1]
        assert mine.max() <= mine.min() + 1
