"""Which members of a set are established (docs/spec/gap.md, section 5): each gains significantly
and substantially, keeps its size wherever the logs show it, and is not an incomplete correction of
its subsystem.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from vgroove.gap.catalogue import SPECIAL_CASES
from vgroove.gap.fitting.hypothesis import Fit
from vgroove.gap.selection.candidate_sets import fit_set, fit_without
from vgroove.gap.selection.forward import grow, leaves_established_share
from vgroove.gap.selection.limits import STEPWISE
from vgroove.gap.selection.model_comparison import difference_interval
from vgroove.gap.selection.search_state import COMPARISON, Search, is_valid
from vgroove.gap.verdict import consistency
from vgroove.gap.verdict.consistency import LIMITS
from vgroove.gap.verdict.covariates import Covariates


@dataclass(frozen=True)
class EstablishedLimits:
    """Thresholds of an established member (docs/spec/gap.md, section 5)."""

    tried: int = 5  # larger sets that are tried, best first, to extend an established set


ESTABLISHED = EstablishedLimits()


@dataclass(frozen=True)
class Member:
    """A member of a fitted set, and the findings on it, each computed when it is first asked for.

    id: of the effect; covariates: the measured quantities over which its size may vary.
    """

    search: Search
    best: Fit
    id: str
    covariates: Covariates

    @cached_property
    def without(self) -> Fit:
        """The set fitted without it."""
        return fit_without(self.search, self.best, self.id)

    @cached_property
    def gain(self) -> float:
        """Squared gap that it gains."""
        return max(self.search.score(self.without) - self.search.score(self.best), 0.0)

    @cached_property
    def significant(self) -> bool:
        """Whether its gain is significant and a substantial share (gains_enough())."""
        return gains_enough(self.search, self.best, self.without, self.id)

    @cached_property
    def keeps_size(self) -> bool:
        """Whether its size is the same wherever the logs show it."""
        left = max(self.search.score(self.search.retuned) - self.search.floor_power, 1e-9)
        return consistency.keeps_its_size(self.search, self.best, self.id, self.gain / left)

    @cached_property
    def loses_little(self) -> bool:
        """Whether the parts of the logs that it makes worse are few."""
        return consistency.loses_little(self.search, self.best, self.without)

    @cached_property
    def complete(self) -> bool:
        """Whether the flexible correction of its subsystem gains little in addition."""
        further = consistency.subsystem_gain(self.search, self.best, self.id)
        return further <= LIMITS.max_subsystem_gain * self.gain

    @cached_property
    def constant(self) -> bool:
        """Whether a size that varies over a covariate gains little in addition."""
        further = consistency.varying_gain(self.search, self.best, self.id, self.covariates)
        return further <= LIMITS.max_varying_gain * self.gain

    @cached_property
    def inside_bounds(self) -> bool:
        """Whether no number of it ends at a bound of the search."""
        return not consistency.is_at_bound(self.best, self.id)

    @property
    def is_rival(self) -> bool:
        """Whether it may be present instead of an established one."""
        return self.inside_bounds and self.significant and self.keeps_size

    @property
    def established(self) -> bool:
        """Whether it fulfils every rule."""
        return self.is_rival and self.loses_little and self.constant and self.complete


def gains_enough(search: Search, best: Fit, without: Fit, effect_id: str) -> bool:
    """Whether a member's gain is significant at 99 %, by the block bootstrap or by its sizes apart
    in parts of the logs, and a substantial share of what retuning leaves, over all signals or in
    one alone.
    """
    gain = search.block_losses(without) - search.block_losses(best)
    clear = difference_interval(search.blocks, gain, COMPARISON.significance)[0] > 0.0
    if not (clear or consistency.is_significant_size(search, best, effect_id)):
        return False
    return search.gains_share(best, without)


def established_set(search: Search, best: Fit, covariates: Covariates) -> Fit:
    """The largest established part of a set, extended while a further member is established; the
    retuned fit where nothing is.
    """
    best = without_doubtful(search, best, covariates)
    while len(best.ids) < STEPWISE.max_effects and leaves_established_share(search, best):
        larger = established_extension(search, best, covariates)
        if larger is None:
            break
        best = larger
    return with_special_cases(search, best, covariates)


def with_special_cases(search: Search, best: Fit, covariates: Covariates) -> Fit:
    """The set with each general effect replaced by its special case, unless the general one gains
    over it what an established member must gain.
    """
    for member in best.ids:
        for special in set(SPECIAL_CASES.get(member, ())) - set(best.ids) - search.without:
            one = fit_set(search, [special if i == member else i for i in best.ids], best)
            if search.gains_share(best, one):
                continue
            if all(Member(search, one, i, covariates).established for i in one.ids):
                return with_special_cases(search, one, covariates)
    return best


def without_doubtful(search: Search, best: Fit, covariates: Covariates) -> Fit:
    """The set without the members that are not established, that of the smallest gain removed
    first.
    """
    while best.ids:
        members = [Member(search, best, i, covariates) for i in best.ids]
        doubtful = [m for m in members if not m.established]
        if not doubtful:
            return best
        weakest = min(doubtful, key=lambda m: (m.gain, m.id))
        best = fit_without(search, best, weakest.id) if len(best.ids) > 1 else search.retuned
    return best


def is_established_rival(search: Search, rival: Fit, best: Fit, covariates: Covariates) -> bool:
    """Whether the members of a tied set that an established one lacks gain significantly and keep
    their sizes.
    """
    return all(
        Member(search, rival, i, covariates).is_rival for i in rival.ids if i not in best.ids
    )


def established_extension(search: Search, best: Fit, covariates: Covariates) -> Fit | None:
    """The best set of one more member whose members are all established; None if there is none."""
    if best.ids:
        grow(search, best)
    for one in larger_sets(search, best)[: ESTABLISHED.tried]:
        if all(Member(search, one, i, covariates).established for i in one.ids):
            return one
    return None


def larger_sets(search: Search, best: Fit) -> Sequence[Fit]:
    """Fitted sets of one member more than the given one, best first."""
    found = (
        f for f in search.ranked(len(best.ids) + 1) if set(best.ids) < set(f.ids) and is_valid(f)
    )
    return list(found)
