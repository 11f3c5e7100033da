"""Which members of a set are established (docs/spec/gap.md, section 5): each gains significantly
and substantially, keeps its size wherever the logs show it, and is not an incomplete correction of
its subsystem.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import takewhile

from vgroove.gap.catalogue import SPECIAL_CASES, contains
from vgroove.gap.fitting.hypothesis import Fit
from vgroove.gap.selection.candidate_sets import fit_set, fit_without, ids_without
from vgroove.gap.selection.forward import grow, leaves_established_share
from vgroove.gap.selection.limits import STEPWISE
from vgroove.gap.selection.model_comparison import difference_interval
from vgroove.gap.selection.search_state import COMPARISON, Search, ends_at_bound, key
from vgroove.gap.verdict import consistency, other_periods
from vgroove.gap.verdict.consistency import LIMITS
from vgroove.gap.verdict.covariates import Covariates


@dataclass(frozen=True)
class EstablishedLimits:
    """Thresholds of an established member (docs/spec/gap.md, section 5)."""

    tried: int = 24  # fitted sets whose members are examined, best first, for an established one


ESTABLISHED = EstablishedLimits()
# By id() of a fit: the fit, so that no other one gets its id, and whether it is established.
Examined = dict[int, tuple[Fit, bool]]


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
        """Whether its gain is significant and a substantial share (gains_enough()). Where one event
        of the log shows nearly all of a large gap, the other parts of the log do not determine it.
        """
        if self.search.closes_far_gap(self.best, self.without):
            return self.search.gains_share(self.best, self.without)
        return gains_enough(self.search, self.best, self.without, self.id)

    @cached_property
    def keeps_size(self) -> bool:
        """Whether its size is the same wherever the logs show it."""
        closed = self.search.closed_share(self.best, self.without)
        return consistency.keeps_its_size(
            self.search, self.best, self.id, closed, self.closed_reported
        )

    @property
    def closed_reported(self) -> float:
        """Share of the reported gap of the set without the member that the member closes; 0 if that
        gap is near the noise.
        """
        return self.search.closed_far_share(self.best, self.without)

    @cached_property
    def loses_little(self) -> bool:
        """Whether the parts of the logs that it makes worse are few."""
        return consistency.loses_little(self.search, self.best, self.without)

    @cached_property
    def complete(self) -> bool:
        """Whether the flexible correction of its subsystem gains little in addition."""
        further = consistency.subsystem_gain(self.search, self.best, self.id)
        return self._is_minor(further, LIMITS.max_subsystem_gain)

    @cached_property
    def constant(self) -> bool:
        """Whether a size that varies over a covariate gains little in addition."""
        further = consistency.varying_gain(self.search, self.best, self.id, self.covariates)
        return self._is_minor(further, LIMITS.max_varying_gain)

    def _is_minor(self, further: float, most: float) -> bool:
        """Whether a further squared gap is at most the share `most` of the gain: as the comparison
        counts both, or in the reported gap, in which errors beyond the clip of the comparison count
        too. The further gap is there the same share of what the set leaves.
        """
        if further <= most * self.gain:
            return True
        share = further / max(self.search.excess_power(self.best), further)
        return share * (1.0 - self.closed_reported) <= most * self.closed_reported

    @cached_property
    def inside_bounds(self) -> bool:
        """Whether no number of it ends at a bound of the search."""
        return not ends_at_bound(self.best, self.id)

    @cached_property
    def needs_its_period(self) -> bool:
        """Whether a torque of any other period would close clearly less than it."""
        return other_periods.needs_its_period(
            self.search, self.best, self.id, self.without, self.gain
        )

    @property
    def is_rival(self) -> bool:
        """Whether it may be present instead of an established one."""
        return self.inside_bounds and self.significant and self.keeps_size and self.needs_its_period

    @property
    def established(self) -> bool:
        """Whether it fulfils every rule."""
        return self.is_rival and self.loses_little and self.constant and self.complete


def gains_enough(search: Search, best: Fit, without: Fit, effect_id: str) -> bool:
    """Whether a member's gain is significant, by the block bootstrap or by its sizes apart in parts
    of the logs, and a substantial share of what retuning leaves, over all signals or in one alone.
    """
    gain = search.block_losses(without) - search.block_losses(best)
    level = consistency.significance(search, effect_id)
    clear = difference_interval(search.blocks, gain, level)[0] > 0.0
    if not (clear or consistency.is_significant_size(search, best, effect_id)):
        return False
    return search.gains_share(best, without)


def established_set(search: Search, best: Fit, covariates: Covariates) -> Fit:
    """The established part of a set, or another fitted set whose members are all established and
    which is better; sets of one more member are fitted as long as this finds a better one. The
    retuned fit where nothing is established.

    Not only parts of the selected set are examined: a member may keep its size only beside another
    one that the selection left out.
    """
    examined: Examined = {}
    found, before = without_doubtful(search, best, covariates), None
    while found is not before:
        if can_grow(search, found):
            grow(search, found)
        before, found = found, best_established(search, found, covariates, examined)
    found = single_sufficient(search, found, covariates)
    return with_special_cases(search, fewer_sufficient(search, found, covariates), covariates)


def single_sufficient(search: Search, found: Fit, covariates: Covariates) -> Fit:
    """The best single effect that is established, if the several effects of `found` gain no more
    over it than the error of its form; else `found`, as also where one of its members, or a general
    form of one, predicts as well alone.

    Several effects together may follow the error of form that one other leaves. Each of them is
    needed beside the others, so that the rules for single members do not show it.
    """
    singles = search.ranked(1) if len(found.ids) > 1 else []
    members = [f for f in singles if contains_a_member(f, found)]
    for known in (f for f in singles if not contains_a_member(f, found)):
        one = fit_set(search, known.ids, known)
        if search.gains_over_form_error(found, one):
            break
        if is_established(search, one, covariates):
            others = (f for f in members if not contains(f.ids, one.ids))
            return found if any(search.is_tied(f, one) for f in others) else one
    return found


def fewer_sufficient(search: Search, found: Fit, covariates: Covariates) -> Fit:
    """An established set of fewer effects and fewer parameters than `found` whose reported gap is
    not larger; `found` where there is none. Of several, one of the fewest effects is taken, and of
    these the one with the smallest squared gap in the fitted comparison. Only where both sets end
    far from the noise: the fitted comparison clips large errors there, the reported gap does not.
    """
    other = search.gap_problem is not None or search.unwhitened is not None
    if other or not search.is_far_from_noise(found):
        return found
    most, left = found.hypothesis.count, search.reported_gap(found)
    limit = COMPARISON.near_best * search.score(found)
    for size in range(1, len(found.ids)):
        near = takewhile(lambda f: search.score(f) <= limit, search.ranked(size))
        for known in (f for f in near if f.hypothesis.count < most):
            one = fit_set(search, known.ids, known)
            no_larger = search.is_far_from_noise(one) and search.reported_gap(one) <= left
            if no_larger and is_established(search, one, covariates):
                return one
    return found


def contains_a_member(one: Fit, found: Fit) -> bool:
    """Whether a set holds a member of another one, or a general form of it."""
    return any(contains(one.ids, (i,)) for i in found.ids)


def can_grow(search: Search, one: Fit) -> bool:
    """Whether a further member could be established beside those of a set."""
    return 0 < len(one.ids) < STEPWISE.max_effects and leaves_established_share(search, one)


def best_established(search: Search, found: Fit, covariates: Covariates, examined: Examined) -> Fit:
    """The best fitted set that is better than `found` and whose members are all established;
    `found` where there is none. Sets that are examined are added to `examined`.
    """
    limit = search.score(found)
    for one in search.ranked():
        if search.score(one) >= limit:
            break
        if id(one) not in examined and may_be_established(search, one):
            if len(examined) >= ESTABLISHED.tried:
                continue
            examined[id(one)] = one, is_established(search, one, covariates)
        if examined.get(id(one), (one, False))[1] and replaces(search, one, found):
            return one
    return found


def replaces(search: Search, one: Fit, found: Fit) -> bool:
    """Whether an established set `one` replaces the established set `found`, whose squared gap is
    larger. It does if `found` is empty, or leaves a gap far above the noise of which `one` closes
    nearly all. Otherwise the two must not be tied, and a set of more members must be significantly
    better.
    """
    if not found.ids or search.closes_far_gap(one, found):
        return True
    if search.is_tied(found, one):
        return False
    return len(one.ids) <= len(found.ids) or search.is_better(one, found)


def may_be_established(search: Search, one: Fit) -> bool:
    """Whether no known fit without one of a set's members shows that this member gains less than an
    established one.
    """
    leaner = (search.fits.get(key(ids_without(one, member))) for member in one.ids)
    return all(f is None or search.gains_share(one, f) for f in leaner)


def is_established(search: Search, one: Fit, covariates: Covariates) -> bool:
    """Whether all members of a set are established."""
    return all(Member(search, one, i, covariates).established for i in one.ids)


def with_special_cases(search: Search, best: Fit, covariates: Covariates) -> Fit:
    """The set with each general effect replaced by its special case, unless the general one gains
    over it what an established member must gain.
    """
    for member in best.ids:
        for special in set(SPECIAL_CASES.get(member, ())) - set(best.ids) - search.without:
            one = fit_set(search, [special if i == member else i for i in best.ids], best)
            if search.gains_share(best, one):
                continue
            if is_established(search, one, covariates):
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
    """Whether a tied set has members that an established one lacks, and all of these gain
    significantly and keep their sizes.
    """
    others = [i for i in rival.ids if i not in best.ids]
    return bool(others) and all(Member(search, rival, i, covariates).is_rival for i in others)
