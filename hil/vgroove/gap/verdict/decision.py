"""The decision: none, effect, partial, ambiguous or unlisted, from the selected set, its rivals and
what the set leaves (docs/spec/gap.md, section 5).
"""

from dataclasses import dataclass, replace

import numpy as np

from vgroove.gap.catalogue import BY_ID, SPECIAL_CASES, Effect, contains
from vgroove.gap.fitting.hypothesis import Fit
from vgroove.gap.selection.candidate_sets import fit_set, fit_without
from vgroove.gap.selection.intervals import (
    Estimate,
    best_estimate,
    estimate_of,
    in_catalogue_form,
)
from vgroove.gap.selection.search import (
    Selection,
    select_whitened,
    tied_rivals,
    unwhitened_fit,
)
from vgroove.gap.selection.search_state import COMPARISON, Search, key
from vgroove.gap.selection.size_prior import is_implausible, prior_excludes
from vgroove.gap.verdict.covariates import Covariates
from vgroove.gap.verdict.established import (
    established_set,
    is_established,
    is_established_rival,
    without_doubtful,
)
from vgroove.gap.verdict.remainder import Remainder, remaining


@dataclass(frozen=True)
class DecisionLimits:
    """Thresholds of the decision, shares of squared gaps above the noise. Chosen on the tuning half
    of the blind set (docs/gap_bench.md) unless a source is stated; entry n of a tuple is for sets
    of n + 1 effects.
    """

    # Least share that a set closes (docs/spec/gap.md, section 5): one effect of the gap before
    # retuning; several, which together imitate more, of the gap that retuning leaves. The first one
    # also divides the verdicts partial and effect.
    min_closed: tuple[float, ...] = (COMPARISON.min_closed, 0.85, 0.9, 0.9)
    min_closed_beyond_retuning: float = 0.5  # least share that one effect closes of the latter
    # Least share that a set of several effects closes if it leaves a visible gap. Effects that are
    # at work leave only their form error (see selection/limits.py): a form that deviates by about
    # a quarter of the effect leaves about (1/4)^2.
    min_closed_by_several: tuple[float, ...] = (0.0, 0.92, 0.95, 0.95)
    # other effects that may replace a member of an established set of several effects
    most_rivals: int = 1
    min_gap_power: float = 1e-9  # avoids a division by 0 where there is no gap


DECISION = DecisionLimits()


@dataclass(frozen=True)
class Finding:
    """The decision: the verdict, the set that it is about, its rivals, and the remainder. search:
    the one in whose residuals the members are established; None if they are not.
    """

    verdict: str
    best: Fit
    rivals: list[Fit]
    remainder: Remainder
    search: Search | None = None

    @property
    def names_effects(self) -> bool:
        """Whether the verdict names the effects of the best set."""
        return self.verdict in ("effect", "partial", "ambiguous")


@dataclass(frozen=True)
class Established:
    """The established set (the retuned fit where there is none) and its rivals, as fits of the
    selection's search. search: the one in whose residuals they are established.
    """

    best: Fit
    rivals: list[Fit]
    search: Search


def decide(selection: Selection, remainder: Remainder, covariates: Covariates) -> Finding:
    """The verdict from the selected set, its rivals and the remainder.

    A set that leaves no significant remainder is named as it was selected. Of any other set the
    established members are named, with further effects that are established beside them. Where
    nothing is established, the set is named if it ends near the noise and closes enough, and the
    gap is unlisted otherwise.
    """
    search, best = selection.search, selection.best
    if best.ids and stands_for_excluded(search, best):
        return Finding("unlisted", best, [], remainder)
    if not remainder.significant or (best.ids and not leaves_visible_gap(search, best)):
        return without_remainder(selection, remainder, covariates)
    if not best.ids and not is_unlisted_gap(search, best, remainder):
        return Finding("none", best, [], remainder)
    found = established_part(selection, covariates)
    part = found.best
    if approximates_other_effect(search, part) and is_limited_by_noise(search, part):
        part = search.retuned
    if part.ids and not search.closes_reported_gap(part):
        part = search.retuned
    if not part.ids:
        return without_established(selection, remainder, covariates)
    same = key(part.ids) == key(best.ids)
    left = remainder if same else remaining(search, part, covariates)
    return replace(named(search, part, found.rivals, left), search=found.search)


def established_part(selection: Selection, covariates: Covariates) -> Established:
    """The established set of a selection, or the one in whitened residuals where it has more
    members, or as many others that do not merely generalise the former and gain less over it than
    an established member. Neither where it leaves a larger reported gap, nor where its sizes are
    implausible and it closes little more. No member is named whose size may be 0 by the reported
    interval.

    A set must be established in the residuals as they are: whitened, also what is outside the
    catalogue leaves errors that one of its effects imitates with one size (an intermittent load a
    Coulomb friction).
    """
    search = selection.search
    part = known_members(search, established_set(search, selection.best, covariates))
    plain, plain_rivals = without_replaceable(selection, part, covariates)
    if unknown_sizes(search, plain):
        plain, plain_rivals = search.retuned, []
    other = select_whitened(search) if part.ids else None
    if other is not None:
        found = known_members(other.search, established_set(other.search, other.best, covariates))
        if key(found.ids) != key(part.ids) and len(found.ids) >= len(part.ids):
            found, rivals = without_replaceable(other, found, covariates)
            best, *rivals = (unwhitened_fit(search, f) for f in (found, *rivals))
            more = len(found.ids) > len(part.ids)
            general = contains(best.ids, plain.ids) and not search.gains_share(best, plain)
            improves = search.reported_gap(best) <= search.reported_gap(plain)
            unlikely = is_less_plausible(search, best, plain)
            known = not unknown_sizes(search, best)
            if improves and (more or not general) and known and not unlikely:
                return Established(best, rivals, other.search)
    return Established(plain, plain_rivals, search)


def is_less_plausible(search: Search, fuller: Fit, leaner: Fit) -> bool:
    """Whether the smaller set `leaner` is to be preferred for its parameter values: those of
    `fuller` are implausible and its own are not, and `fuller` closes in addition less of the
    reported gap than an established member must close.
    """
    more = search.reported_share(fuller) - search.reported_share(leaner)
    implausible = is_implausible(search, fuller) and not is_implausible(search, leaner)
    return implausible and more < COMPARISON.min_established_share


def leanest_established(
    selection: Selection, part: Fit, covariates: Covariates
) -> tuple[Fit, list[Fit]]:
    """The established set and its rivals, the sets that predict the logs equally well. The set is
    replaced by a rival that has special cases of its effects (a Coulomb friction instead of an
    asymmetric one), since this has fewer parameters, and by an established rival whose sizes are
    far more probable by their prior; without members whose size may be 0 in that rival.
    """
    search, taken = selection.search, set()
    while True:
        taken.add(key(part.ids))
        rivals = established_rivals(selection, part, covariates)
        leaner = (f for f in rivals if takes_place(search, f, part, covariates))
        found = next((known_members(search, f) for f in leaner), part)
        if key(found.ids) in taken:
            return part, rivals
        part = found


def takes_place(search: Search, rival: Fit, part: Fit, covariates: Covariates) -> bool:
    """Whether a rival of an established set is named in its place (leanest_established())."""
    special = len(rival.ids) == len(part.ids) and contains(part.ids, rival.ids)
    return special or is_likelier(search, rival, part, covariates)


def is_likelier(search: Search, rival: Fit, part: Fit, covariates: Covariates) -> bool:
    """Whether a rival is established and the prior of the sizes excludes the set beside it."""
    excluded = prior_excludes(search, part, rival) and not search.leaves_far_gap_of(rival, part)
    return excluded and is_established(search, rival, covariates)


def without_replaceable(
    selection: Selection, part: Fit, covariates: Covariates
) -> tuple[Fit, list[Fit]]:
    """The set that the verdict names, and its rivals.

    A member that more than DECISION.most_rivals other effects could replace is removed, that of the
    smallest gain first, and its part of the gap is reported as unexplained: the logs do not show
    which of these effects is present, or whether the member only imitates one that the catalogue
    lacks. It stays where the set ends near the noise, where it closes the larger part of what the
    set without it leaves, and where nothing would be established without it.
    """
    search, leaner = selection.search, part
    while leaner is not None:
        part, rivals = leanest_established(selection, leaner, covariates)
        if is_limited_by_noise(search, part):
            break
        many = [i for i in part.ids if len(replacements(i, part, rivals)) > DECISION.most_rivals]
        without = [fit_without(search, part, i) for i in many]
        tried = [f for f in without if f.ids and not closes_larger_part(search, part, f)]
        rest = (without_doubtful(search, f, covariates) for f in sorted(tried, key=search.score))
        leaner = next((known_members(search, f) for f in rest if f.ids), None)
    return part, rivals


def closes_larger_part(search: Search, fuller: Fit, leaner: Fit) -> bool:
    """Whether a set closes the larger part of what a leaner one leaves."""
    return closed_share_of_score(search, leaner, fuller) >= COMPARISON.min_gain_of_left


def replacements(member: str, best: Fit, rivals: list[Fit]) -> set[str]:
    """Effects that could replace a member of a set: those that rivals contain in its place. Special
    cases of the member do not count.
    """
    found = {i for f in rivals if member not in f.ids for i in f.ids if i not in best.ids}
    return found - set(SPECIAL_CASES.get(member, ()))


def established_rivals(selection: Selection, part: Fit, covariates: Covariates) -> list[Fit]:
    """Rivals of the established set of a selection; none of an empty set."""
    if not part.ids:
        return []
    search, same = selection.search, key(part.ids) == key(selection.best.ids)
    return [
        f
        for f in (selection.rivals if same else tied_rivals(search, part))
        if not prior_excludes(search, f, part)
        and not (len(f.ids) < len(part.ids) and search.leaves_far_gap_of(f, part))
        and is_established_rival(search, f, part, covariates)
        and set(unknown_sizes(search, f)) <= set(part.ids)
    ]


def leaves_visible_gap(search: Search, best: Fit) -> bool:
    """Whether a set leaves a visible gap above the sensors' noise."""
    if search.leaves_most_of_far_gap(best):
        return True
    return relative_excess_power(search, best) > COMPARISON.visible_excess


def is_limited_by_noise(search: Search, best: Fit) -> bool:
    """Whether a set ends near the sensors' noise. Effects that are present close the gap there, and
    a set that closes too little imitates what is outside the catalogue.
    """
    return search.gap_problem is None and not search.is_far_from_noise(best)


def without_remainder(
    selection: Selection, remainder: Remainder, covariates: Covariates
) -> Finding:
    """The finding on a set that leaves no significant remainder."""
    if not selection.best.ids:
        return Finding("none", selection.best, [], remainder)
    return with_known_sizes(selection, remainder, covariates)


def without_established(
    selection: Selection, remainder: Remainder, covariates: Covariates
) -> Finding:
    """The finding on a set of which no member is established: it is named only near the noise,
    where it must close enough.
    """
    search, best = selection.search, selection.best
    if not best.ids or is_doubtful(search, best) or not is_limited_by_noise(search, best):
        return Finding("unlisted", best, [], remainder)
    return with_known_sizes(selection, remainder, covariates)


def with_known_sizes(selection: Selection, remainder: Remainder, covariates: Covariates) -> Finding:
    """The verdict that names the members of a set whose sizes are known, without asking whether
    they are established. Where none is known, or where the others close too little or end far from
    the noise: unlisted, or none where the retuned model leaves no visible gap.
    """
    search, best = selection.search, selection.best
    known = known_members(search, best)
    is_known = not unknown_sizes(search, known)
    if known is best and is_known:
        return named(search, best, selection.rivals, remainder)
    if not is_known or is_doubtful(search, known) or not is_limited_by_noise(search, known):
        verdict = "unlisted" if leaves_visible_gap(search, search.retuned) else "none"
        return Finding(verdict, best, [], remainder)
    left = remaining(search, known, covariates)
    return named(search, known, tied_rivals(search, known), left)


def known_members(search: Search, one: Fit) -> Fit:
    """The set without the members whose size may be 0 (unknown_sizes()). They are removed one at a
    time, the one with the smallest gain first, and the remaining members are fitted again after
    each. One member always remains.
    """
    while len(one.ids) > 1 and (unknown := unknown_sizes(search, one)):
        one = fit_without(search, one, unknown[0])
    return one


def unknown_sizes(search: Search, one: Fit) -> list[str]:
    """Members of a set whose size may be 0, that of the least gain first: by the estimate with the
    search's restarts, and by the reported one. Intervals are linear approximations: a size without
    which most of a gap far above the noise comes back is not 0.
    """
    if not one.ids:
        return []
    estimate = estimate_of(search, one)
    members = [i for i in one.ids if not is_known_size(estimate, BY_ID[i])]
    if members and search.unwhitened is None:
        reported = best_estimate(search, one)
        members = [i for i in members if not is_known_size(reported, BY_ID[i])]
    members = [
        i
        for i in members
        if search.closed_far_share(one, fit_without(search, one, i)) < COMPARISON.min_closed
    ]
    return sorted(members, key=lambda i: search.score(fit_without(search, one, i)))


def is_known_size(estimate: Estimate, effect: Effect) -> bool:
    """Whether the 95 % confidence region of an effect's sizes (its switches, or numbers of the unit
    of its leading one), of one or of all together, excludes 0: with its other numbers free, or
    held, since a time constant means nothing at size 0. An effect that is off at infinity (a limit,
    a stiffness) has the size 1 / value, whose interval contains 0 where that of the value does, to
    first order.
    """
    if effect.counted:
        return all(
            e.ci95 is None or e.ci95[0] > 0.0 for e in estimate.parameters(effect.id).values()
        )
    alike = [p.name for p in effect.parameters if p.unit == effect.leading.unit]
    sizes = effect.switch or alike
    names = [effect.name(p) for p in effect.parameters if p.name in sizes]
    return estimate.excludes_zero(effect.id, names)


def named(search: Search, best: Fit, rivals: list[Fit], remainder: Remainder) -> Finding:
    """The verdict that names a set: ambiguous if it has rivals; partial if a significant remainder
    stays and the set closes less than min_closed of one effect; else effect.
    """
    if rivals:
        return Finding("ambiguous", best, rivals, remainder)
    partial = remainder.significant and search.reported_share(best) < COMPARISON.min_closed
    return Finding("partial" if partial else "effect", best, [], remainder)


def is_unlisted_gap(search: Search, retuned: Fit, remainder: Remainder) -> bool:
    """Whether retuning leaves a significant gap that is far from the noise (then one event, such as
    a run-up, is enough), or is visible and either depends on a measured quantity or is visible in
    most bootstrap samples.
    """
    if not remainder.significant or search.leaves_most_of_far_gap(retuned):
        return remainder.significant
    visible = search.floor_power * (1.0 + COMPARISON.visible_excess)
    return search.score(retuned) > visible and (
        remainder.best_correlate is not None or search.leaves_gap_in_most_draws(retuned)
    )


def is_doubtful(search: Search, best: Fit) -> bool:
    """Whether a set may only approximate something outside the catalogue."""
    return closes_too_little(search, best) or approximates_other_effect(search, best)


def relative_excess_power(search: Search, best: Fit) -> float:
    """Squared gap that a set leaves above the noise, divided by the noise power."""
    return search.score(best) / search.floor_power - 1.0


def closes_too_little(search: Search, best: Fit) -> bool:
    """Whether a set closes too little to be the missing effects.

    The share of one effect is that of the gap before retuning, over the judged blocks or over all,
    whichever is larger, or in one column alone: an error of the current sensor closes nothing in
    the speed. What retuning closes is thus attributed to the effect, provided that the effect
    closes the larger part of what retuning leaves.
    """
    least = DECISION.min_closed[len(best.ids) - 1]
    beyond = closed_beyond_retuning(search, best)
    if len(best.ids) > 1:
        return beyond < least
    shares = (
        closed_share_of_score(search, search.nominal, best),
        search.closed_reported_share(best, search.nominal),
    )
    too_little = beyond < DECISION.min_closed_beyond_retuning or max(shares) < least
    return too_little and not closes_one_column(search, best, least)


def closes_one_column(search: Search, best: Fit, least: float) -> bool:
    """Whether the log has a column in which an effect closes at least the share `least` of the gap
    before retuning, and also min_closed_beyond_retuning of the gap that retuning leaves there.
    """
    before, beyond = (
        search.closed_share(best, f).by_column for f in (search.nominal, search.retuned)
    )
    enough = (before >= least) & (beyond >= DECISION.min_closed_beyond_retuning)
    return bool(np.any(enough))


def approximates_other_effect(search: Search, best: Fit) -> bool:
    """Whether a set of several effects leaves a visible gap and closes less than effects that are
    present would: several smooth laws together approximate many others.
    """
    return (
        len(best.ids) > 1
        and closed_beyond_retuning(search, best) < DECISION.min_closed_by_several[len(best.ids) - 1]
        and leaves_visible_gap(search, best)
    )


def stands_for_excluded(search: Search, best: Fit) -> bool:
    """Whether a general effect of the set is no better than its special case, which the user
    excluded from the catalogue.
    """
    for member in best.ids:
        for special in set(SPECIAL_CASES.get(member, ())) & search.without - set(best.ids):
            one = fit_set(search, [special if i == member else i for i in best.ids], best)
            if not search.outdoes_special_case(best, one):
                return True
    return False


def closed_beyond_retuning(search: Search, best: Fit) -> float:
    """Share of the squared gap left by retuning that a set closes."""
    return closed_share_of_score(search, search.retuned, best)


def closed_share_of_score(search: Search, leaner: Fit, fuller: Fit) -> float:
    """Share of the squared gap that a leaner fit leaves above the sensors' noise that a fuller one
    closes.
    """
    before, after = search.score(leaner), search.score(fuller)
    return (before - after) / max(before - search.floor_power, DECISION.min_gap_power)


def reported_fit(search: Search, finding: Finding) -> Fit:
    """The fit whose gap is reported as `after`: the best set in the catalogue's forms, or the
    retuned model where no effect is named.
    """
    if not finding.names_effects:
        return search.retuned
    return in_catalogue_form(search, finding.best)
