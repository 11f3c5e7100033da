"""Selects the set of effects that predicts held-out rows best: single effects, forward steps, a
beam search far from the noise, backward steps, exchanges, and the rivals that predict as well.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vgroove.gap.catalogue import FRICTION_LAWS, LESS_LIKELY, contains
from vgroove.gap.fitting.hypothesis import Fit
from vgroove.gap.selection.backward import backward, drop_form_corrections
from vgroove.gap.selection.beam import search_from_several_sets
from vgroove.gap.selection.candidate_sets import (
    distinct_hypotheses,
    fit_set,
    fit_without,
    prefer_special_cases,
)
from vgroove.gap.selection.discrepancy import whitened
from vgroove.gap.selection.extension import extensions
from vgroove.gap.selection.forward import forward
from vgroove.gap.selection.limits import STEPWISE
from vgroove.gap.selection.model_comparison import bootstrap_means
from vgroove.gap.selection.search_state import COMPARISON, Search, is_valid, key
from vgroove.gap.selection.single_effects import align_to_selection, fit_single_effects
from vgroove.gap.selection.size_prior import MIN_PRIOR_ODDS, is_implausible, prior_density


@dataclass(frozen=True)
class Selection:
    """Result of a search: the state in which it ended, the best fit (the retuned one where no
    effect is better), and the rivals that predict the held-out rows as well.
    """

    search: Search
    best: Fit
    rivals: list[Fit]


def select(search: Search) -> Selection:
    """The whole search on one problem.

    The shaft angles of the selected fit are those that its own parameters align, as `vgroove sim`
    aligns them with the corrected rig.
    """
    return settled(*search_from_several_sets(*forward(fit_single_effects(search))))


def select_whitened(search: Search) -> Selection | None:
    """The search repeated in residuals without correlation in time (whitened()), from the fits that
    it ended with; None where the best fit ends near the noise.
    """
    other = whitened(search)
    return None if other is search else settled(*forward(other))


def settled(search: Search, best: Fit) -> Selection:
    """The selection that begins with the best set of forward selection or of the beam search."""
    rivals: list[Fit] = []
    if best.ids:
        best = backward(search, leanest_tied(search, best))
        search.progress("rivals")
        best = drop_form_corrections(
            search, exchange_members(search, best), STEPWISE.max_form_share
        )
        best, rivals = drop_doubtful_members(search, best)
    search, best = align_to_selection(search, best)
    return Selection(search, best, rivals)


def unwhitened_fit(search: Search, one: Fit) -> Fit:
    """The fit of a search to the set of a fit of its whitened() one."""
    return fit_set(search, one.ids, one) if one.ids else search.retuned


def drop_doubtful_members(search: Search, best: Fit) -> tuple[Fit, list[Fit]]:
    """The selected fit and its rivals, without small members that rivals replace by other effects,
    and without laws of friction whose gain may be a form error of another law.
    """
    rivals = tied_rivals(search, best)
    replaced = [i for i in best.ids if any(i not in f.ids for f in rivals)]
    leaner = best
    if replaced:
        leaner = drop_form_corrections(search, best, STEPWISE.min_share_of_tied_member, replaced)
    laws = interchangeable_friction_laws(best, rivals)
    if leaner is best and laws:
        leaner = drop_form_corrections(search, best, STEPWISE.max_friction_form_share, laws)
    return (best, rivals) if leaner is best else drop_doubtful_members(search, leaner)


def interchangeable_friction_laws(best: Fit, rivals: Sequence[Fit]) -> list[str]:
    """Laws of friction in the best set that rivals replace by other laws of friction only; empty
    unless the set has two laws of friction.
    """
    replacements = {
        i: [set(f.ids) - set(best.ids) for f in rivals if i not in f.ids]
        for i in FRICTION_LAWS.intersection(best.ids)
    }
    if len(replacements) < 2:
        return []
    return sorted(
        i
        for i, sets in replacements.items()
        if sets and all(replacement <= FRICTION_LAWS for replacement in sets)
    )


def exchange_members(search: Search, best: Fit) -> Fit:
    """The best set after exchanges of single members; they end when the result is no better or
    tied.

    Forward selection misses pairs whose members gain little alone.
    """
    for _ in range(STEPWISE.max_exchanges):
        fit_exchanges(search, best)
        other = search.ranked(len(best.ids))[0]
        if (
            other is best
            or search.score(other) >= search.score(best)
            or search.is_tied(best, other)
        ):
            break
        best = backward(search, leanest_tied(search, prefer_special_cases(search, other)))
    return best


def fit_exchanges(search: Search, best: Fit) -> None:
    """Fit the sets with one member replaced by another effect that are the best to first order."""
    if len(best.ids) < 2:
        return
    close: list[Fit] = []
    for member in best.ids:
        leaner = fit_without(search, best, member)
        found = extensions(search, leaner, STEPWISE.extensions_in_exchange)
        close += [f for f in found if key(f.ids) not in search.fits]
    search.fit_and_keep(distinct_hypotheses(close))


def tied_rivals(search: Search, best: Fit) -> list[Fit]:
    """Converged sets that predict the held-out rows as well as best, best first. A rival has no
    more effects than the best set and is no generalisation of it.
    """
    most = best.hypothesis.count + STEPWISE.max_more_parameters
    pool = [
        f for k, f in search.fits.items() if k and key(best.ids) != k and f.hypothesis.count <= most
    ]
    pool = [
        f
        for f in pool
        if len(f.ids) <= len(best.ids) and is_valid(f) and not contains(f.ids, best.ids)
    ]
    tied = sorted((f for f in pool if search.is_tied(f, best)), key=search.score)
    if is_implausible(search, best):
        return tied
    return [f for f in tied if not is_implausible(search, f)]


def leanest_tied(search: Search, best: Fit) -> Fit:
    """The tied set with the fewest parameters. Among sets with equally many parameters and equal
    gaps it is the one of the effects that are likelier a priori (an added inertia rather than a
    wrong clock).

    A special case replaces its general effect unless the general one is better.
    """
    candidates = sorted(
        (f for k, f in search.fits.items() if k and is_valid(f)),
        key=lambda f: (*preference(search, f), search.score(f)),
    )
    for one in candidates:
        if not is_preferred(search, one, best) or len(one.ids) > len(best.ids):
            continue
        if is_as_good(search, one, best):
            return one
    return best


def is_as_good(search: Search, one: Fit, best: Fit) -> bool:
    """Whether a set may replace the best: it is tied, or a special case that is not worse."""
    if contains(best.ids, one.ids):
        return not search.outdoes_special_case(best, one)
    return search.is_tied(one, best)


def is_preferred(search: Search, one: Fit, best: Fit) -> bool:
    """Whether a set is preferred to the best one by preference(); among sets of as many parameters
    the prior of their sizes decides, then, where the gaps of both are equal up to chance, the
    number of less likely effects.
    """
    mine, its = preference(search, one), preference(search, best)
    if mine[:2] != its[:2]:
        return mine[:2] < its[:2]
    odds = prior_density(search, one) / prior_density(search, best)
    if odds > MIN_PRIOR_ODDS or odds < 1.0 / MIN_PRIOR_ODDS:
        return odds > 1.0
    return mine < its and search.equal_up_to_chance(one, best)


def preference(search: Search, one: Fit) -> tuple[bool, int, int]:
    """Sort key among tied sets, smallest first: contradicted by the scale of the Hall edges or of
    implausible size, number of parameters, number of less likely effects.
    """
    rare = sum(i in LESS_LIKELY for i in one.ids)
    doubtful = search.contradicts_edge_scale(one) or is_implausible(search, one)
    return doubtful, one.hypothesis.count, rare


def win_shares(search: Search, candidates: Sequence[Fit]) -> np.ndarray:
    """Share (k,) of the bootstrap samples in which each candidate set has the smallest squared gap,
    with half the minimum effect size added for each parameter.
    """
    penalty = 0.5 * COMPARISON.min_gain
    means = np.stack(
        [
            bootstrap_means(search.blocks, search.block_losses(f)) + penalty * f.hypothesis.count
            for f in candidates
        ]
    )
    return np.bincount(np.argmin(means, axis=0), minlength=len(candidates)) / means.shape[1]
