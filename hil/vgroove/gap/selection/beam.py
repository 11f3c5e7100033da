"""Beam search over sets of effects, for short logs that forward selection leaves far from the
noise.

A measured machine often lacks several effects at once. Forward selection extends the set that
predicts the held-out rows best as long as the gain is significant over the blocks of the logs. In a
log of a few steps it is not, and a delay beside two frictions, for example, closes little before
both are known. The beam search extends several sets of each size, those that fit all rows best; the
decision examines afterwards which members of what it finds are established.
"""

from dataclasses import dataclass

from vgroove.gap.fitting.hypothesis import Fit
from vgroove.gap.selection.candidate_sets import distinct_hypotheses
from vgroove.gap.selection.extension import extensions
from vgroove.gap.selection.forward import is_visibly_better
from vgroove.gap.selection.limits import STEPWISE
from vgroove.gap.selection.search_state import Search, is_valid, key, rescale


@dataclass(frozen=True)
class BeamLimits:
    """Size of the beam, and where it is used; chosen on measured logs of other people, which are
    not part of the tests (docs/gap_method.md).
    """

    max_blocks: int = 30  # bootstrap blocks of the logs, above which forward selection suffices
    width: int = 6  # sets of each size that are extended
    extensions: int = 4  # first-order candidates of each of them that are fitted


BEAM = BeamLimits()


def search_from_several_sets(search: Search, best: Fit) -> tuple[Search, Fit]:
    """The search, rescaled, and the set that predicts the held-out rows best; both as they are
    where the logs have many blocks, the best set of forward selection ends near the noise, or no
    other one closes a visible gap.
    """
    if len(search.blocks.rows) > BEAM.max_blocks or not search.is_far_from_noise(best):
        return search, best
    search.progress("sets of several effects")
    for size in range(1, STEPWISE.max_effects):
        bases = best_fitting(search, size)
        if not bases or not search.is_far_from_noise(bases[0]):
            break
        candidates = [
            one
            for base in bases
            for one in extensions(search, base, BEAM.extensions)
            if key(one.ids) not in search.fits
        ]
        search.fit_and_keep(distinct_hypotheses(candidates))
    found = search.ranked()[0]
    if found is best or not found.ids or not is_visibly_better(search, found):
        return search, best
    return rescale(search), found


def best_fitting(search: Search, size: int) -> list[Fit]:
    """The fits of sets of one size with the smallest squared errors over all rows, best first."""
    fits = [f for k, f in search.fits.items() if len(k) == size and is_valid(f)]
    return sorted(fits, key=lambda f: (f.cost, f.ids))[: BEAM.width]
