"""The cases of tests/proof/altered_machines.py: what a change does to a log and to a rig."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "proof"))

import altered_machines as altered  # noqa: E402


@pytest.mark.parametrize("half", altered.HALVES)
def test_each_case_is_a_function_of_its_half_and_names(half: str) -> None:
    for machine, change in altered.cases(half, "robotino_current"):
        first, again = (altered.made_case(half, machine, change) for _ in range(2))
        assert first.size == again.size and first.rig == again.rig
        for one, other in zip(first.logs, again.logs, strict=True):
            assert all(
                np.array_equal(one[name], other[name], equal_nan=True) for name in one.columns
            )


def test_the_halves_have_different_sizes() -> None:
    drawn = [c for c in altered.cases("report", None) if not altered.is_unaltered(c[1])]
    assert len(drawn) >= 20
    for machine, change in drawn:
        sizes = {altered.made_case(half, machine, change).size for half in altered.HALVES}
        assert len(sizes) == 2


def test_an_added_torque_needs_current_in_proportion() -> None:
    """The torque opposes the motion and has the drawn share of the motor's torque."""
    whole = altered.complete_case("robotino_current")
    case = altered.made_case("tune", "robotino_current", "viscous_friction added")
    constant = case.rig.motor["torque_constant_nm_per_a"]
    added, drive = [], []
    for before, after in zip(whole.logs, case.logs, strict=True):
        torque = constant * (after["current_a"] - before["current_a"])
        speed = altered.motion(whole.rig, before).speed
        known = np.isfinite(torque)
        assert np.allclose(torque[known], case.size * speed[known])
        added.append(torque)
        drive.append(np.nan_to_num(constant * before["current_a"]))
    share = altered.rms(added) / altered.rms(drive)
    assert altered.DRAG_SHARE[0] * 0.9 < share < altered.DRAG_SHARE[1] * 1.1


def test_a_misstated_motor_is_that_of_the_machine_divided_by_the_error() -> None:
    whole = altered.complete_case("emps")
    case = altered.made_case("report", "emps", "added_inertia misstated")
    assert case.size > 0.0
    assert case.rig.motor["inertia_kg_m2"] * (1.0 + case.size) == pytest.approx(
        whole.rig.motor["inertia_kg_m2"]
    )


def test_a_low_pass_answers_a_step_with_its_time_constant() -> None:
    time_s = np.arange(0.0, 1.0, 0.01)
    answer = altered.low_pass(time_s, (time_s > 0.0).astype(float), 0.1)
    assert answer == pytest.approx(-np.expm1(-time_s / 0.1), abs=1e-9)


@pytest.mark.parametrize(
    ("verdict", "selected", "first", "complete", "sure_and_wrong"),
    [
        ("partial", {"coulomb_friction": 0.8}, True, True, False),
        ("effect", {"coulomb_friction": 0.8, "clock_skew": 0.95}, True, False, True),
        ("effect", {"clock_skew": 0.8}, False, False, False),
        ("ambiguous", {"coulomb_friction": 0.5}, False, False, False),
        ("unlisted", {}, False, False, False),
    ],
)
def test_a_verdict_is_compared_with_the_right_names(
    verdict: str, selected: dict[str, float], first: bool, complete: bool, sure_and_wrong: bool
) -> None:
    case = altered.made_case("tune", "robotino_current", "coulomb_friction withheld")
    said = {
        "verdict": verdict,
        "selected": list(selected),
        "effects": [{"id": i, "probability": p} for i, p in selected.items()],
    }
    found = altered.scored(case, said)
    assert (found["first"], found["complete"]) == (first, complete)
    assert found["sure_and_wrong"] is sure_and_wrong


def test_nothing_may_be_named_where_nothing_was_changed() -> None:
    case = altered.made_case("tune", "emps", "unaltered")
    for verdict, right in (("none", True), ("unlisted", True), ("partial", False)):
        said = {"verdict": verdict, "selected": ["clock_skew"] if verdict == "partial" else []}
        assert altered.scored(case, said)["complete"] is right
