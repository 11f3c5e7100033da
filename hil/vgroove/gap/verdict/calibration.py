"""How sure a name is: its margin over the best set that lacks it, beside the scatter of blocks and
beside what forms leave, and what its set closes. A logistic law of four signs; its coefficients are
those of the opened cases in docs/results/gap_certainty.json.
"""

from dataclasses import astuple, dataclass

import numpy as np
from scipy.special import expit

from vgroove.gap.catalogue import contains
from vgroove.gap.fitting.fit import Fit
from vgroove.gap.selection.model_comparison import draw_means, few_blocks
from vgroove.gap.selection.search_state import WORTH, Search, plausible

# Of 1 and the signs, in their order; printed by tests/proof/gap_certainty.py.
COEFFICIENTS = (-0.42, 0.99, 0.33, 0.07, -1.01)


@dataclass(frozen=True)
class NameEvidence:
    """What speaks for a name: logarithms of the margin in standard deviations, of the margin in
    what the set leaves, and of what retuning leaves in what the set leaves; last the number of the
    set's other effects.
    """

    blocks: float
    forms: float
    closed: float
    others: float


def name_evidence(search: Search, best: Fit, effect_id: str, floor: float) -> NameEvidence:
    """Signs of one effect of a set. Powers are squared gaps above the noise; what is not worth a
    further effect is no power.
    """
    after = search.score(best)
    noise = min(floor**2 * search.level(), after)
    left = after - noise + WORTH * noise
    rival = strongest_without(search, best, effect_id)
    margin = max(0.0, search.score(rival) - after)
    start = max(left, search.score(search.retuned) - noise + WORTH * noise)
    return NameEvidence(
        float(np.log1p(margin / spread(search, rival, best))),
        float(np.log1p(margin / left)),
        float(np.log(start / left)),
        len(best.ids) - 1.0,
    )


def strongest_without(search: Search, best: Fit, effect_id: str) -> Fit:
    """The set without the effect, no larger and no generalisation of the best, that predicts
    held-out rows best.
    """
    rivals = (
        f for f in search.fits.values() if effect_id not in f.ids and len(f.ids) <= len(best.ids)
    )
    return min(
        (f for f in rivals if plausible(f) and not (f.ids and contains(f.ids, best.ids))),
        key=search.score,
    )


def spread(search: Search, one: Fit, other: Fit) -> float:
    """Standard deviation of the difference of two squared gaps under the block bootstrap, wider
    where there are few blocks.
    """
    means = draw_means(search.blocks, search.sums(one) - search.sums(other))
    return max(
        float(means.std()) * few_blocks(int(np.count_nonzero(search.blocks.rows)), 0.95), 1e-12
    )


def probability(of: NameEvidence) -> float:
    """Probability that an effect with these signs is at work."""
    return float(expit(np.dot(COEFFICIENTS, (1.0, *astuple(of)))))
