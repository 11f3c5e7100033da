"""Every third of the forty fixed cases of the blind set (docs/gap_bench.md), in four parts: the
counts of right and wrong verdicts stay within limits. One part guards every change, the others take
too long for it.
"""

import tempfile
from functools import cache
from pathlib import Path

import pytest

from fixed_cases import GUARD, case_lines, counts, diagnosed
from vgroove.gap_bench.scored import Scored

# All 13 cases are right, as fixed_cases.py counts them. No wrong name has a probability of 0.9 or
# more, and there is no false alarm.
PARTS = 4

pytestmark = pytest.mark.parametrize(
    "part",
    [
        pytest.param(
            part,
            marks=[
                pytest.mark.xdist_group(f"fixed cases, part {part}"),
                *([] if part == 1 else [pytest.mark.proof]),
            ],
        )
        for part in range(PARTS)
    ],
)


@cache
def verdicts(part: int) -> list[Scored]:
    """The scored cases of a part, computed once."""
    with tempfile.TemporaryDirectory() as folder:
        return [
            diagnosed(row, Path(folder) / f"case_{n}") for n, row in enumerate(GUARD[part::PARTS])
        ]


@pytest.fixture
def cases(part: int) -> list[Scored]:
    return verdicts(part)


def test_all_cases_are_right(cases: list[Scored]) -> None:
    assert len(cases) >= 3
    assert counts(cases)["right"] == len(cases), case_lines(cases)


def test_no_wrong_name_has_a_high_probability(cases: list[Scored]) -> None:
    assert counts(cases)["sure_and_wrong"] == 0, case_lines(cases)


def test_there_is_no_false_alarm(cases: list[Scored]) -> None:
    assert counts(cases)["false_alarms"] == 0, case_lines(cases)
