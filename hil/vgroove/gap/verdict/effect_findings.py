"""The effects of a verdict: their probabilities, the share of the gap that each closes, and the
rivals that these logs do not distinguish.
"""

from dataclasses import dataclass

import numpy as np

from vgroove.gap.catalogue import equivalents
from vgroove.gap.fitting.hypothesis import Fit
from vgroove.gap.selection.candidate_sets import fit_without
from vgroove.gap.selection.comparison import comparison_of
from vgroove.gap.selection.intervals import Estimate, estimate_of
from vgroove.gap.selection.search import win_shares
from vgroove.gap.selection.search_state import Search, is_valid, key
from vgroove.gap.verdict import calibration
from vgroove.gap.verdict.decision import Finding
from vgroove.gap.verdict.gap_figures import MIN_GAP, closed_share
from vgroove.gap.verdict.schema import ComparisonEvidence, EffectFinding, NameEvidence, Rival


@dataclass(frozen=True)
class ProbabilityLimits:
    """Bounds of stated probabilities; chosen on the tuning half of the blind set
    (docs/gap_bench.md).
    """

    max_named: float = 0.99  # largest, of a named effect or a rival
    max_partial: float = 0.85  # largest, of an effect that a verdict partial names
    max_unnamed: float = 0.4  # largest, of any other effect
    tied: float = 0.5  # smallest of a selected effect that has rivals, and largest of a rival


PROBABILITY = ProbabilityLimits()
AFTER_NAMED = 99  # sort key of effects that are not named


def effect_findings(search: Search, finding: Finding, estimate: Estimate) -> list[EffectFinding]:
    """All effects that were tried: named ones first, then by probability and by what they close
    alone. The parameters of the estimate's effects are those of the estimate, the others those of
    the fit of each effect alone.
    """
    evidence = {i: calibration.name_evidence(search, finding.best, i) for i in finding.best.ids}
    chance = probabilities(search, finding, evidence)
    before = search.reported_gap(search.nominal)
    found = []
    for effect in search.effects:
        alone = search.fits[(effect.id,)]
        source = estimate if effect.id in estimate.fit.ids else estimate_of(search, alone)
        unlisted = finding.verdict == "unlisted"
        found.append(
            EffectFinding(
                effect.id,
                effect.subsystem,
                round(chance[effect.id], 6),
                closed_share(before, search.reported_gap(alone), search.floor),
                0.0 if unlisted else lost_without(search, finding.best, effect.id),
                source.parameters(effect.id),
                evidence.get(effect.id),
                comparison_evidence(search, finding, effect.id),
            )
        )
    rank = {i: n for n, i in enumerate(selected(search, finding))}
    return sorted(
        found,
        key=lambda e: (rank.get(e.id, AFTER_NAMED), -e.probability, -(e.closes or 0.0), e.id),
    )


def comparison_evidence(
    search: Search, finding: Finding, effect_id: str
) -> ComparisonEvidence | None:
    """The comparison in which a named effect was found, without and with it; None for any other
    effect.
    """
    if not finding.names_effects or effect_id not in finding.best.ids:
        return None
    search = finding.search or search
    best = search.fits[key(finding.best.ids)]
    rest = fit_without(search, best, effect_id)
    before, after = (float(np.sqrt(search.score(f))) for f in (rest, best))
    return ComparisonEvidence(
        comparison_of(search), before, after, float(np.sqrt(search.floor_power))
    )


def selected(search: Search, finding: Finding) -> list[str]:
    """Ids of the named effects, that first without which the set leaves most; none for the
    verdicts none and unlisted.
    """
    if not finding.names_effects:
        return []
    left = {i: search.score(fit_without(search, finding.best, i)) for i in finding.best.ids}
    return sorted(finding.best.ids, key=lambda i: (-left[i], i))


def lost_without(search: Search, best: Fit, effect_id: str) -> float:
    """Share of the gap that opens again without one effect of the best set; 0 if no member."""
    if effect_id not in best.ids:
        return 0.0
    floor = search.floor
    rest = fit_without(search, best, effect_id)
    before, after, without = (search.reported_gap(f) for f in (search.nominal, best, rest))
    if before - floor < MIN_GAP:
        return 0.0
    return float(np.clip((without - after) / max(before - floor, 1e-9), 0.0, 1.0))


def probabilities(
    search: Search, finding: Finding, evidence: dict[str, NameEvidence]
) -> dict[str, float]:
    """Marginal probability of each effect by id: of a member of the best set from its evidence, of
    any other the share of bootstrap samples in which a set that contains it leaves the smallest gap
    (win_shares()).
    """
    candidates = [
        search.retuned,
        *(f for k, f in sorted(search.fits.items()) if k and is_valid(f)),
    ]
    share = win_shares(search, candidates)
    found = {
        e.id: float(sum(s for s, f in zip(share, candidates, strict=True) if e.id in f.ids))
        for e in search.effects
    }
    found |= {i: calibration.probability(one) for i, one in evidence.items()}
    if finding.verdict == "ambiguous":
        found = divide_among_rivals(found, finding)
    known: set[str] = set()
    if finding.names_effects:
        known = {i for f in (finding.best, *finding.rivals) for i in f.ids}
    most = PROBABILITY.max_partial if finding.verdict == "partial" else PROBABILITY.max_named
    return {i: min(p, most if i in known else PROBABILITY.max_unnamed) for i, p in found.items()}


def divide_among_rivals(chance: dict[str, float], finding: Finding) -> dict[str, float]:
    """Probabilities clipped for tied sets. With n rivals and spare = 0.5 / (1 + n): a selected
    effect that a rival lacks to 0.5..0.5 + spare, each rival to spare..0.5.
    """
    rivals = [i for f in finding.rivals for i in f.ids if i not in finding.best.ids]
    spare = PROBABILITY.tied / (1 + len(rivals))
    out = dict(chance)
    for i in (i for i in finding.best.ids if any(i not in f.ids for f in finding.rivals)):
        out[i] = float(np.clip(out[i], PROBABILITY.tied, PROBABILITY.tied + spare))
    for i in rivals:
        out[i] = float(np.clip(out[i], spare, PROBABILITY.tied))
    return out


def indistinguishable(search: Search, finding: Finding, flags: frozenset[str]) -> list[Rival]:
    """Effects that these logs do not distinguish from the selected ones: members of their
    equivalence classes on logs with these flags, then members of the tied sets.
    """
    if not finding.names_effects:
        return []
    found = [rival(search, other, i) for i in finding.best.ids for other in equivalents(i, flags)]
    for tied in finding.rivals:
        gone = [i for i in finding.best.ids if i not in tied.ids]
        for j, new in enumerate(i for i in tied.ids if i not in finding.best.ids):
            if gone and all(r.id != new for r in found):
                instead_of = gone[min(j, len(gone) - 1)]
                found.append(rival(search, new, instead_of, fitted=new))
    return found


def rival(search: Search, effect_id: str, instead_of: str, fitted: str | None = None) -> Rival:
    """A rival and the share that it closes alone. fitted: the effect whose fit gives that share; by
    default the effect that the rival replaces, for an equivalent, which has no fit of its own.
    """
    before, alone = (
        search.reported_gap(f) for f in (search.nominal, search.fits[(fitted or instead_of,)])
    )
    return Rival(effect_id, instead_of, closed_share(before, alone, search.floor))
