"""Remarks on subsystems with a share of the gap and without a named effect."""

from vgroove.gap.verdict.location import UNEXPLAINED
from vgroove.gap.verdict.unnamed_shares import MIN_SHARE, unnamed_share_remarks

NAMED = ["coulomb_friction"]  # of motor_mechanical


def test_a_share_without_a_named_effect_is_explained() -> None:
    share = {"motor_mechanical": 0.7, "gearbox": 0.19, "supply": MIN_SHARE, UNEXPLAINED: 0.06}
    first, second = unnamed_share_remarks(share, NAMED)
    assert "gearbox has 19 % of the gap" in first and "supply has 5 %" in second


def test_named_subsystems_small_shares_and_the_unexplained_need_no_reason() -> None:
    share = {"motor_mechanical": 0.9, "gearbox": 0.99 * MIN_SHARE, UNEXPLAINED: 0.06}
    assert unnamed_share_remarks(share, NAMED) == []


def test_a_verdict_without_names_has_no_remark() -> None:
    assert unnamed_share_remarks({"gearbox": 0.5, UNEXPLAINED: 0.5}, []) == []
