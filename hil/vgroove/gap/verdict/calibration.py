"""Probability that a named effect is present: logistic calibration (J. Platt, Advances in Large
Margin Classifiers, 1999) on four quantities of the search.

The coefficients are fitted by tests/proof/gap_certainty.py to the opened cases of the blind set's
tuning half (docs/gap_bench.md), which docs/results/gap_certainty.json lists.
"""

from dataclasses import astuple

import numpy as np
from scipy.special import expit

from vgroove.gap.catalogue import contains
from vgroove.gap.fitting.hypothesis import Fit
from vgroove.gap.selection.model_comparison import bootstrap_means, small_sample_factor
from vgroove.gap.selection.search_state import COMPARISON, Search, is_valid
from vgroove.gap.verdict.schema import NameEvidence

# of the constant 1 and of the fields of NameEvidence in their order; printed by
# tests/proof/gap_certainty.py
COEFFICIENTS = (-0.42, 0.99, 0.33, 0.07, -1.01)
MIN_DEVIATION = 1e-12  # avoids a division by 0 where two fits are equal


def name_evidence(search: Search, best: Fit, effect_id: str) -> NameEvidence:
    """Evidence for one effect of the best set, from squared gaps above the noise.

    The minimum effect size is added to the squared gap that a set leaves, so that no divisor is
    nearly 0.
    """
    after = search.score(best)
    noise = min(1.0, after)
    left = after - noise + COMPARISON.min_gain * noise
    rival = strongest_without(search, best, effect_id)
    margin = max(0.0, search.score(rival) - after)
    start = max(left, search.score(search.retuned) - noise + COMPARISON.min_gain * noise)
    return NameEvidence(
        float(np.log1p(margin / difference_deviation(search, rival, best))),
        float(np.log1p(margin / left)),
        float(np.log(start / left)),
        len(best.ids) - 1.0,
    )


def strongest_without(search: Search, best: Fit, effect_id: str) -> Fit:
    """The set without the effect that predicts held-out rows best, no larger than the best set and
    no generalisation of it.
    """
    rivals = (
        f for f in search.fits.values() if effect_id not in f.ids and len(f.ids) <= len(best.ids)
    )
    return min(
        (f for f in rivals if is_valid(f) and not (f.ids and contains(f.ids, best.ids))),
        key=search.score,
    )


def difference_deviation(search: Search, one: Fit, other: Fit) -> float:
    """Standard deviation of the difference of two squared gaps under the block bootstrap, widened
    for few blocks.
    """
    means = bootstrap_means(search.blocks, search.block_losses(one) - search.block_losses(other))
    wider = small_sample_factor(search.blocks.count, 0.95)
    return max(float(means.std()) * wider, MIN_DEVIATION)


def probability(evidence: NameEvidence) -> float:
    """Probability that an effect with this evidence is present."""
    return float(expit(np.dot(COEFFICIENTS, (1.0, *astuple(evidence)))))
