"""The measured problem follows its protocol and cannot be changed; so does its test double."""

from dataclasses import FrozenInstanceError

import numpy as np
import pytest

from gap_toy import Toy
from made_log import drive_log, rig
from vgroove.gap.residual.loading import load_problem
from vgroove.gap.residual.problem import Problem
from vgroove.gap.residual.protocol import MeasuredProblem

MEMBERS = [name for name in vars(MeasuredProblem) if not name.startswith("_")]


@pytest.fixture(scope="module")
def problem() -> Problem:
    return load_problem([drive_log(rig(), seconds=3.0)], rig())


@pytest.fixture(scope="module")
def double() -> Toy:
    return Toy({})


@pytest.mark.parametrize("name", MEMBERS)
def test_the_problem_and_its_double_have_every_member_of_the_protocol(
    problem: Problem, double: Toy, name: str
) -> None:
    assert hasattr(problem, name) and hasattr(double, name)


def test_a_measured_problem_is_immutable(problem: Problem) -> None:
    with pytest.raises(FrozenInstanceError):
        problem.restart_s = 1.0
    run = problem.runs[0]
    arrays = (problem.sigma, run.restarts.measured, run.channels[0].measured, run.regime)
    for array in arrays:
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0


def test_other_restart_angles_leave_the_problem_as_it_was(problem: Problem) -> None:
    before = problem.runs[0].restarts.angle_rad.copy()
    stretch = np.zeros(len(before), dtype=int)
    angles = problem.angles.shifted((stretch,), np.array([0.5]))
    moved = problem.with_angles(angles)
    np.testing.assert_array_equal(problem.runs[0].restarts.angle_rad, before)
    np.testing.assert_array_equal(moved.runs[0].restarts.angle_rad, before + 0.5)
    assert problem.with_angles(problem.angles) is problem
    np.testing.assert_array_equal(
        problem.residuals(problem.theta0, angles), moved.residuals(problem.theta0)
    )
