"""The forty fixed cases of the blind set (docs/gap_bench.md), in two halves for two workers: the
counts of right and wrong verdicts stay within limits.
"""

import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

from fixed_cases import ROWS, case_lines, counts, diagnosed
from vgroove.gap_bench.scored import Scored


@dataclass(frozen=True)
class Half:
    """Every second case from `first` on, and the limits of its counts."""

    first: int
    right_least: int
    sure_and_wrong_most: int
    false_alarms_most: int


# Of 20 cases 19 and 17 are right, as fixed_cases.py counts them; the limits are two standard
# deviations of the binomial distribution below. One wrong name of a probability of 0.9 or more and
# one false alarm are allowed; there is none.
HALVES = (Half(0, 17, 1, 1), Half(1, 13, 1, 1))

pytestmark = pytest.mark.parametrize(
    "half",
    [pytest.param(h, marks=pytest.mark.xdist_group(f"half_{h.first}")) for h in HALVES],
    ids=["even", "odd"],
)


@cache
def verdicts(half: Half) -> list[Scored]:
    """The scored cases of a half, computed once."""
    with tempfile.TemporaryDirectory() as folder:
        return [
            diagnosed(row, Path(folder) / f"case_{n}")
            for n, row in enumerate(ROWS[half.first :: 2])
        ]


@pytest.fixture
def cases(half: Half) -> list[Scored]:
    return verdicts(half)


def test_enough_cases_are_right(half: Half, cases: list[Scored]) -> None:
    assert len(cases) == 20
    assert counts(cases)["right"] >= half.right_least, case_lines(cases)


def test_few_wrong_names_have_a_high_probability(half: Half, cases: list[Scored]) -> None:
    assert counts(cases)["sure_and_wrong"] <= half.sure_and_wrong_most, case_lines(cases)


def test_there_are_few_false_alarms(half: Half, cases: list[Scored]) -> None:
    assert counts(cases)["false_alarms"] <= half.false_alarms_most, case_lines(cases)
