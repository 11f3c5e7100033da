"""The work of a diagnosis, counted in runs of the log, which a longer log does not raise and more
effects raise at most in proportion.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "proof"))

from gap_growth import cost


def test_a_longer_log_is_not_run_more_often() -> None:
    short, long = cost(3.0, 2), cost(12.0, 2)
    assert short["named"] == long["named"] == ["viscous_friction"]
    assert long["runs"] < 1.3 * short["runs"]


def test_more_effects_ask_for_runs_in_proportion_at_most() -> None:
    halves, whole = [cost(3.0, 2, begin) for begin in (0, 1)], cost(3.0)
    # the true one is in both, equivalents are one in the whole
    assert sum(half["effects"] for half in halves) <= whole["effects"] + 2
    assert whole["runs"] < 1.15 * sum(half["runs"] for half in halves)
