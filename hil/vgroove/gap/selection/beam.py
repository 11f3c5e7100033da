"""Beam search over sets of effects, for short logs that forward selection leaves far from the
noise.

A measured machine often lacks several effects at once. Forward selection extends the set that
predicts the held-out rows best as long as the gain is significant over the blocks of the logs. In a
log of a few steps it is not, and a delay beside two frictions, for example, closes little before
both are known. The beam search extends several sets of each size, those that fit all rows best; the
decision examines afterwards which members of what it finds are established.
"""

from dataclasses import dataclass, replace

import numpy as np

from vgroove.gap.fitting.hypothesis import Fit
from vgroove.gap.residual.huber import huber_weight
from vgroove.gap.selection.candidate_sets import distinct_hypotheses
from vgroove.gap.selection.discrepancy import rescale
from vgroove.gap.selection.extension import added_effects, extensions
from vgroove.gap.selection.limits import STEPWISE
from vgroove.gap.selection.search_state import COMPARISON, Search, is_valid, key


@dataclass(frozen=True)
class BeamLimits:
    """Size of the beam, and where it is used; chosen on ten measured logs that are not part of the
    tests.
    """

    max_blocks: int = 30  # bootstrap blocks of the logs, above which forward selection suffices
    singles: int = 12  # single effects that are extended
    width: int = 6  # larger sets of each size that are extended
    extensions: int = 4  # first-order candidates of each of them that are fitted
    # share of the squared reported gap that the found set must close: effects that are present
    # leave only the error of their form, about a sixteenth (see limits.py), and several together
    # approximate the larger part of many other things
    min_closed: float = 0.95
    # least share that all effects together close to first order beside the set of forward
    # selection; less than min_closed, because effects are not linear
    min_closed_by_all: float = 0.8


BEAM = BeamLimits()


def search_from_several_sets(search: Search, best: Fit) -> tuple[Search, Fit]:
    """Search and best set after a beam search; `best` is the result of forward selection.

    The set that predicts the held-out rows best replaces `best` if it closes at least
    BEAM.min_closed of the squared reported gap and leaves a smaller gap. Search and `best` are
    returned unchanged otherwise, and where suits_beam_search() is False. Among many sets some
    imitate a part of an effect outside the catalogue, which the limit keeps out.
    """
    if not suits_beam_search(search, best):
        return search, best
    search.progress("sets of several effects")
    before = dict(search.fits)
    found = best_of_beam(search)
    closes_nearly_all = search.reported_share(found) >= BEAM.min_closed
    if closes_nearly_all and search.reported_gap(found) < search.reported_gap(best):
        return rescale(search), found
    search.fits.clear()
    search.fits.update(before)
    return search, best


def best_of_beam(search: Search) -> Fit:
    """The set that predicts the held-out rows best, after sets of up to max_effects members were
    fitted, each size from the best fitting ones of the size before.
    """
    for size in range(1, STEPWISE.max_effects):
        bases = best_fitting(search, size)
        # pairs are always fitted: a single effect of several numbers may imitate two others
        if not bases or (size > 1 and not search.is_far_from_noise(bases[0])):
            break
        candidates = [
            one
            for base in bases
            for one in extensions(search, base, BEAM.extensions)
            if key(one.ids) not in search.fits
        ]
        search.fit_and_keep(distinct_hypotheses(candidates))
    return search.ranked()[0]


def suits_beam_search(search: Search, best: Fit) -> bool:
    """Whether the logs have few blocks and the best set of forward selection ends far from the
    noise, in the forward simulation of a tool that does not hammer: the cycles of a hammering one
    are many, and each of its simulations is long. False where all effects together close less than
    BEAM.min_closed_by_all.
    """
    if search.problem.sigma_is_bound or search.gap_problem is not None:
        return False
    if search.blocks.count > BEAM.max_blocks or not search.is_far_from_noise(best):
        return False
    return closed_by_all_effects(search, best) >= BEAM.min_closed_by_all


def closed_by_all_effects(search: Search, best: Fit) -> float:
    """Estimate of the share of the reported gap, squared, that the set would close with all further
    effects of the catalogue added: one linear least-squares step over all rows.

    Its regressors are the derivatives of the residuals with respect to all parameters and, because
    an effect may be started far from 0, the change of the residuals from the set to each effect's
    start value. Residuals above the clip have less weight (Huber). For the forward simulation.
    """
    columns = [best.jacobian]
    for one in added_effects(search, best):
        columns += [one.columns, (one.residual - best.residual)[:, None].astype(np.float32)]
    slopes = np.hstack(columns)
    root = np.sqrt(huber_weight(best.residual, COMPARISON.clip_sigma)).astype(np.float32)
    weighted = slopes * root[:, None]
    size = np.sqrt(np.square(weighted).sum(axis=0))
    weighted /= np.where(size > 0.0, size, 1.0)
    shift, *_ = np.linalg.lstsq(weighted, root * best.residual.astype(np.float32), rcond=None)
    left = best.residual - (weighted @ shift) / root
    return search.reported_share(replace(best, out_of_fold=left))


def best_fitting(search: Search, size: int) -> list[Fit]:
    """The fits of sets of one size with the smallest cost over all rows, best first."""
    fits = [f for k, f in search.fits.items() if len(k) == size and is_valid(f)]
    count = BEAM.singles if size == 1 else BEAM.width
    return search.engine.closest(fits)[:count]
