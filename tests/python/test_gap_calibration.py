"""Calibrated probabilities: the coefficients are those fitted to the recorded cases, and the
probability rises or falls with each quantity as it should.
"""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest

from gap_toy import Toy
from test_gap_verdict import decided
from vgroove.gap.verdict import calibration
from vgroove.gap.verdict.schema import NameEvidence

PROOF = Path(__file__).resolve().parents[1] / "proof" / "gap_certainty.py"
spec = importlib.util.spec_from_file_location("gap_certainty", PROOF)
proof = importlib.util.module_from_spec(spec)
spec.loader.exec_module(proof)
ROWS = json.loads(proof.ROWS.read_text(encoding="utf-8"))["rows"]


def test_the_coefficients_are_those_fitted_to_the_recorded_cases() -> None:
    np.testing.assert_allclose(
        calibration.COEFFICIENTS, proof.fitted(*proof.table(ROWS)), atol=0.011
    )


def test_probabilities_are_calibrated_on_cases_left_out_of_the_fit() -> None:
    x, true, weight = proof.table(ROWS)
    whole = weight == 1.0
    held_out = proof.held_out_probabilities(ROWS)[whole]
    sure = true[whole][held_out >= 0.9]
    assert len(sure) >= 10 and sure.mean() >= 0.9
    given = np.array([r["said"] for r in ROWS])[whole]
    assert (
        proof.figures(held_out, true[whole])["log_loss"]
        <= proof.figures(given, true[whole])["log_loss"]
    )


@pytest.mark.parametrize(
    ("sign", "up"), [("blocks", True), ("forms", True), ("closed", True), ("others", False)]
)
def test_the_probability_moves_with_each_quantity_in_its_direction(sign: str, up: bool) -> None:
    middle = {"blocks": 1.5, "forms": 1.0, "closed": 2.0, "others": 1.0}
    low, high = (
        calibration.probability(NameEvidence(**middle | {sign: middle[sign] + step}))
        for step in (-0.5, 0.5)
    )
    assert (low < high) is up


def test_an_effect_without_a_margin_is_below_one_half() -> None:
    assert calibration.probability(NameEvidence(0.0, 0.0, 5.0, 1.0)) < 0.5


def test_a_clear_effect_is_above_nine_tenths_and_a_tie_is_not() -> None:
    clear, tie = (
        Toy({"effects.current_offset.offset_a": 0.6}),
        Toy({"effects.coulomb_friction.torque_nm": 0.004}, still_speed=True),
    )
    for toy, one_way, sure in ((clear, False, True), (tie, True, False)):
        state, finding = decided(toy, one_way=one_way)
        assert (
            calibration.probability(
                calibration.name_evidence(state, finding.best, finding.best.ids[0])
            )
            > 0.9
        ) is sure
