"""The cost of a diagnosis as the number of simulations of the log: independent of the length of the
log, and at most proportional to the number of effects.
"""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "proof"))

from gap_growth import cost

pytestmark = pytest.mark.proof


def test_a_longer_log_needs_no_more_simulations() -> None:
    short, long = cost(3.0, 2), cost(12.0, 2)
    assert short["named"] == long["named"] == ["viscous_friction"]
    assert long["runs"] < 1.3 * short["runs"]


def test_simulations_are_at_most_proportional_to_the_number_of_effects() -> None:
    halves, whole = [cost(3.0, 2, begin) for begin in (0, 1)], cost(3.0)
    # the true effect is in both halves, and equivalent effects count once in the whole
    assert sum(half["effects"] for half in halves) <= whole["effects"] + 2
    assert whole["runs"] < 1.15 * sum(half["runs"] for half in halves)
