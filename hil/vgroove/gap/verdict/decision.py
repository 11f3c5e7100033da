"""The decision: none, effect, ambiguous or unlisted, from the selected set, its rivals and what the
set leaves (docs/spec/gap.md, section 5).
"""

from dataclasses import dataclass

from vgroove.gap.catalogue import SPECIAL_CASES
from vgroove.gap.fitting.hypothesis import Fit
from vgroove.gap.selection.candidate_sets import fit_set
from vgroove.gap.selection.intervals import in_catalogue_form
from vgroove.gap.selection.search import Selection
from vgroove.gap.selection.search_state import COMPARISON, Search
from vgroove.gap.verdict.remainder import Remainder


@dataclass(frozen=True)
class DecisionLimits:
    """Thresholds of the decision, shares of squared gaps above the noise. Chosen on the tuning half
    of the blind set (docs/gap_bench.md) unless a source is stated; entry n of a tuple is for sets
    of n + 1 effects.
    """

    # Least share that a set closes (docs/spec/gap.md, section 5): one effect of the gap before
    # retuning; several, which together imitate more, of the gap that retuning leaves.
    min_closed: tuple[float, ...] = (0.7, 0.85, 0.9, 0.9)
    min_closed_beyond_retuning: float = 0.5  # least share that one effect closes of the latter
    # Least share that a set of several effects closes if it leaves a visible gap. Effects that are
    # at work leave only their form error (see selection/limits.py): a form that deviates by about
    # a quarter of the effect leaves about (1/4)^2.
    min_closed_by_several: tuple[float, ...] = (0.0, 0.92, 0.95, 0.95)
    # relative excess power of the smallest visible gap (docs/spec/gap.md, section 5)
    visible_excess: float = (1.0 + COMPARISON.visible_gap) ** 2 - 1.0
    min_gap_power: float = 1e-9  # avoids a division by 0 where there is no gap


DECISION = DecisionLimits()


@dataclass(frozen=True)
class Finding:
    """The decision: the verdict, the set that it is about, its rivals, and the remainder."""

    verdict: str
    best: Fit
    rivals: list[Fit]
    remainder: Remainder

    @property
    def names_effects(self) -> bool:
        """Whether the verdict names the effects of the best set."""
        return self.verdict in ("effect", "ambiguous")


def decide(selection: Selection, remainder: Remainder) -> Finding:
    """The verdict from the selected set, its rivals and the remainder.

    A doubtful set is replaced by a member that closes enough alone: the gain of the others is taken
    as its form error.
    """
    search, best, rivals = selection.search, selection.best, selection.rivals
    if not best.ids:
        unlisted = is_unlisted_gap(search, best, remainder)
        return Finding("unlisted" if unlisted else "none", best, [], remainder)
    doubtful = remainder.significant and is_doubtful(search, best)
    single = sufficient_member(search, best) if doubtful else None
    if single is not None and not stands_for_excluded(search, single):
        return Finding("effect", single, [], remainder)
    if doubtful or stands_for_excluded(search, best):
        return Finding("unlisted", best, [], remainder)
    return Finding("ambiguous" if rivals else "effect", best, rivals, remainder)


def is_unlisted_gap(search: Search, retuned: Fit, remainder: Remainder) -> bool:
    """Whether retuning leaves a visible gap that is significant, and that either depends on a
    measured quantity or is visible in most bootstrap samples.
    """
    return (
        remainder.significant
        and search.score(retuned) > search.floor**2 * (1.0 + DECISION.visible_excess)
        and (remainder.best_correlate is not None or search.leaves_gap_in_most_draws(retuned))
    )


def is_doubtful(search: Search, best: Fit) -> bool:
    """Whether a set may only approximate something outside the catalogue."""
    return closes_too_little(search, best) or approximates_other_effect(search, best)


def relative_excess_power(search: Search, best: Fit) -> float:
    """Squared gap that a set leaves above the noise, divided by the noise power."""
    return search.score(best) / (search.floor**2 * search.noise_power()) - 1.0


def sufficient_member(search: Search, best: Fit) -> Fit | None:
    """The best member of a doubtful set that closes enough alone; None where no member does."""
    alone = [search.fits[(i,)] for i in best.ids if len(best.ids) > 1 and (i,) in search.fits]
    enough = [one for one in alone if not closes_too_little(search, one)]
    return min(enough, key=search.score, default=None)


def closes_too_little(search: Search, best: Fit) -> bool:
    """Whether a set closes too little to be the missing effects.

    The share of one effect is that of the gap before retuning, over the judged blocks or over all,
    whichever is larger. What retuning closes is thus credited to the effect, provided that the
    effect closes the larger part of what retuning leaves.
    """
    beyond = closed_beyond_retuning(search, best)
    least = DECISION.min_closed[len(best.ids) - 1]
    if len(best.ids) > 1:
        return beyond < least
    shares = (
        closed_power_share(of(search.nominal), of(best), search.floor)
        for of in (search.score, search.reported_score)
    )
    return beyond < DECISION.min_closed_beyond_retuning or max(shares) < least


def approximates_other_effect(search: Search, best: Fit) -> bool:
    """Whether a set of several effects leaves a visible gap and closes less than effects that are
    present would: several smooth laws together approximate many others.
    """
    return (
        len(best.ids) > 1
        and closed_beyond_retuning(search, best) < DECISION.min_closed_by_several[len(best.ids) - 1]
        and relative_excess_power(search, best) > DECISION.visible_excess
    )


def stands_for_excluded(search: Search, best: Fit) -> bool:
    """Whether a general effect of the set is no better than its special case, which the user
    excluded from the catalogue.
    """
    for member in best.ids:
        for special in set(SPECIAL_CASES.get(member, ())) & search.without - set(best.ids):
            one = fit_set(search, [special if i == member else i for i in best.ids], best)
            if not search.is_better(best, one, COMPARISON.min_general_gain):
                return True
    return False


def closed_beyond_retuning(search: Search, best: Fit) -> float:
    """Share of the squared gap left by retuning that a set closes."""
    return closed_power_share(search.score(search.retuned), search.score(best), search.floor)


def closed_power_share(before: float, after: float, floor: float) -> float:
    """Share of a squared gap above the noise that is closed; before, after: squared gaps, floor: a
    gap.
    """
    return (before - after) / max(before - floor**2, DECISION.min_gap_power)


def reported_fit(search: Search, finding: Finding) -> Fit:
    """The fit whose gap is reported as `after`: the best set in the catalogue's forms, or the
    retuned model where no effect is named.
    """
    if not finding.names_effects:
        return search.retuned
    return in_catalogue_form(search, finding.best)
