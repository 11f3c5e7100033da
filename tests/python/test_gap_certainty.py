"""Probability of a named effect: the coefficients are the fit to the committed cases, and each kind
of evidence has the right sign.
"""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest

from gap_toy import Toy
from test_gap_verdict import FLOOR, decided
from vgroove.gap.verdict import calibration

PROOF = Path(__file__).resolve().parents[1] / "proof" / "gap_certainty.py"
spec = importlib.util.spec_from_file_location("gap_certainty", PROOF)
proof = importlib.util.module_from_spec(spec)
spec.loader.exec_module(proof)
ROWS = json.loads(proof.ROWS.read_text(encoding="utf-8"))["rows"]


def test_the_coefficients_are_the_fit_to_the_committed_cases() -> None:
    np.testing.assert_allclose(
        calibration.COEFFICIENTS, proof.fitted(*proof.table(ROWS)), atol=0.011
    )


def test_probabilities_hold_on_cases_they_were_not_fitted_to() -> None:
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
def test_every_evidence_has_the_right_sign(sign: str, up: bool) -> None:
    middle = {"blocks": 1.5, "forms": 1.0, "closed": 2.0, "others": 1.0}
    low, high = (
        calibration.probability(calibration.NameEvidence(**middle | {sign: middle[sign] + step}))
        for step in (-0.5, 0.5)
    )
    assert (low < high) is up


def test_a_name_without_evidence_has_a_low_probability() -> None:
    assert calibration.probability(calibration.NameEvidence(0.0, 0.0, 5.0, 1.0)) < 0.5


def test_evidence_of_a_clear_effect_and_of_a_tie() -> None:
    clear, tie = (
        Toy({"effects.current_offset.offset_a": 0.6}),
        Toy({"effects.coulomb_friction.torque_nm": 0.004}, still_speed=True),
    )
    for toy, one_way, sure in ((clear, False, True), (tie, True, False)):
        state, finding = decided(toy, one_way=one_way)
        assert (
            calibration.probability(
                calibration.name_evidence(state, finding.best, finding.best.ids[0], FLOOR)
            )
            > 0.9
        ) is sure
