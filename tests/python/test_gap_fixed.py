"""The forty fixed blind cases, in two halves for two workers: the diagnosis must not get worse on
them.
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
    """Every second case from `first` on, and limits of its counts: the counts that
    `python tests/python/fixed_cases.py` printed when the limits were set, less two standard
    deviations of a binomial distribution of 20.
    """

    first: int
    right_least: int
    sure_and_wrong_most: int
    false_alarms_most: int


# Limits from these counts: 19 and 17 of 20 right, none sure and wrong, no false alarm.
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


def test_as_many_are_right_as_were(half: Half, cases: list[Scored]) -> None:
    assert len(cases) == 20
    assert counts(cases)["right"] >= half.right_least, case_lines(cases)


def test_no_more_sure_wrong_names_than_were(half: Half, cases: list[Scored]) -> None:
    assert counts(cases)["sure_and_wrong"] <= half.sure_and_wrong_most, case_lines(cases)


def test_no_more_false_alarms_than_were(half: Half, cases: list[Scored]) -> None:
    assert counts(cases)["false_alarms"] <= half.false_alarms_most, case_lines(cases)
