"""The cache of functions of arrays: equal contents share a result, everything else is computed."""

from dataclasses import dataclass

import numpy as np
import pytest

from vgroove.array_cache import cached_by_content


@dataclass(frozen=True)
class Columns:
    a: np.ndarray
    b: float = 0.0


def counted(most: int) -> tuple:
    """(list of the calls that were computed, cached function)."""
    calls: list = []

    @cached_by_content(most)
    def function(*arguments: object) -> int:
        calls.append(arguments)
        return len(calls)

    return calls, function


def test_equal_contents_are_computed_once() -> None:
    calls, function = counted(4)
    first = function(np.arange(6.0), Columns(np.ones(3)), 2)
    assert function(np.arange(12.0)[::2] / 2.0, Columns(np.ones(3)), 2) == first
    assert len(calls) == 1


@pytest.mark.parametrize(
    "other",
    [
        (np.arange(6.0) + 1e-16 + 1e-15, 2),
        (np.arange(6), 2),
        (np.arange(6.0).reshape(2, 3), 2),
        (np.arange(6.0), 3),
        (Columns(np.arange(6.0)), 2),
        (Columns(np.arange(6.0), 1.0), 2),
    ],
)
def test_other_values_types_shapes_and_fields_are_other_arguments(other: tuple) -> None:
    calls, function = counted(4)
    function(np.arange(6.0), 2)
    function(*other)
    assert len(calls) == 2


def test_the_result_used_longest_ago_is_dropped_first() -> None:
    calls, function = counted(2)
    for value in (1.0, 2.0, 1.0, 3.0, 1.0, 2.0):
        function(np.array([value]))
    assert [float(a[0][0]) for a in calls] == [1.0, 2.0, 3.0, 2.0]


def test_a_failed_call_is_not_kept() -> None:
    calls: list = []

    @cached_by_content(2)
    def function(value: float) -> float:
        calls.append(value)
        raise ValueError(value)

    for _ in range(2):
        with pytest.raises(ValueError, match="1"):
            function(1.0)
    assert len(calls) == 2
