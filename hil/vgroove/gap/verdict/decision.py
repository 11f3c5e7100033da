"""Says what the search found in the contract's terms: verdict, gap figures, effects with
probability and intervals, rivals, remainder.
"""

from dataclasses import asdict, dataclass

import numpy as np

from vgroove.gap.catalogue import SPECIAL_CASES, equivalents
from vgroove.gap.fitting.fit import Fit
from vgroove.gap.selection.intervals import Estimate, stretches_of
from vgroove.gap.selection.model_comparison import block_sums, draw_means, make_blocks, squared
from vgroove.gap.selection.search import WORTH_FORM, fit_set, win_shares
from vgroove.gap.selection.search_state import CLIP, VISIBLE, Search, gap_of, key, plausible
from vgroove.gap.verdict import calibration, location

# of the squared gap: one effect by the contract; larger sets imitate more
BULK = {1: 0.7, 2: 0.85, 3: 0.9, 4: 0.9}
LARGER_PART = 0.5  # of the squared gap beyond retuning that one effect must close all the same
SURE = 0.99
NOT_WORTH = 0.4  # an effect that is significant and still not worth naming
PATCHED = (1.0 + VISIBLE) ** 2 - 1.0  # excess power of the least gap that the contract calls one
# effects whose forms are off by a quarter of their size leave (1 / 4)^2 of their squared gap
NEARLY_ALL = {2: 0.92, 3: 0.95, 4: 0.95}


@dataclass
class Finding:
    """What was decided: the verdict, the fit whose effects are named, its rivals, and what is left."""

    verdict: str
    best: Fit
    rivals: list[Fit]
    left: location.Structure


def decide(
    search: Search, best: Fit, rivals: list[Fit], left: location.Structure, floor: float
) -> Finding:
    """The verdict from the selected set, its rivals and the structure of what remains."""
    bulk = closed_squared(search, best, floor)
    if not best.ids:
        follows = left.best_correlate is not None
        real = (
            left.significant
            and search.score(best) > floor**2 * (1.0 + PATCHED)
            and (follows or search.surely_leaves_a_gap(best))
        )
        return Finding("unlisted" if real else "none", best, [], left)
    doubtful = left.significant and (
        imitates(search, best, bulk, floor) or patched(search, best, bulk, floor)
    )
    lead = leading(search, best, floor) if doubtful else None
    if lead is not None and not is_left_out(search, lead):
        return Finding("effect", lead, [], left)
    if doubtful or is_left_out(search, best):
        return Finding("unlisted", best, [], left)
    return Finding("ambiguous" if rivals else "effect", best, rivals, left)


def excess(search: Search, best: Fit, floor: float) -> float:
    """Squared gap that is left above the noise, in units of the noise."""
    return search.score(best) / (floor**2 * search.level()) - 1.0


def leading(search: Search, best: Fit, floor: float) -> Fit | None:
    """The member of a doubtful set that is an effect by itself: what the others mend is its form."""
    alone = [search.fits[(i,)] for i in best.ids if len(best.ids) > 1 and (i,) in search.fits]
    good = [
        one for one in alone if not imitates(search, one, closed_squared(search, one, floor), floor)
    ]
    return min(good, key=search.score, default=None)


def imitates(search: Search, best: Fit, bulk: float, floor: float) -> bool:
    """Whether the set closes too little to be what is there. One effect is held against the gap
    before retuning, as the contract says, over the contract's blocks or over all: what retuning
    took of it counts for it, as long as the effect closes the larger part of the rest.
    """
    if len(best.ids) > 1:
        return bulk < BULK[len(best.ids)]
    shares = (
        share_closed(of(search.nominal), of(best), floor) for of in (search.score, search.reported)
    )
    return bulk < LARGER_PART or max(shares) < BULK[1]


def patched(search: Search, best: Fit, bulk: float, floor: float) -> bool:
    """Whether a set of several effects looks like a patchwork: effects that are really there leave
    no visible gap, or a small part of a large one (their forms are not quite the catalogue's);
    several that leave more imitate something else.
    """
    return (
        len(best.ids) > 1
        and bulk < NEARLY_ALL[len(best.ids)]
        and excess(search, best, floor) > PATCHED
    )


def is_left_out(search: Search, best: Fit) -> bool:
    """Whether a general effect does here no more than its special case, which the catalogue is
    searched without.
    """
    for member in best.ids:
        for special in set(SPECIAL_CASES.get(member, ())) & search.without - set(best.ids):
            one = fit_set(search, [special if i == member else i for i in best.ids], best)
            if not search.better(best, one, WORTH_FORM):
                return True
    return False


def closed_squared(search: Search, best: Fit, floor: float) -> float:
    """Share of the squared gap beyond retuning that the set closes."""
    return share_closed(search.score(search.retuned), search.score(best), floor)


def share_closed(before: float, after: float, floor: float) -> float:
    """Share of a squared gap above the noise that is gone."""
    return (before - after) / max(before - floor**2, 1e-9)


def closed(before: float, after: float, floor: float) -> float | None:
    """The contract's share of the gap, null when there is hardly any."""
    return (
        None
        if before - floor < 0.1
        else float(np.clip((before - after) / (before - floor), 0.0, 1.0))
    )


def gap_section(problem: object, search: Search, shown: Fit, floor: float) -> dict[str, object]:
    """gap.* of the verdict; shown is the fit whose `after` is reported."""
    before, retuned, after = (
        gap_of(problem, f.held) for f in (search.nominal, search.retuned, shown)
    )
    return {
        "before": before,
        "retuned": retuned,
        "after": after,
        "floor": floor,
        "closed": closed(before, after, floor),
        "closed_ci95": closed_interval(problem, search, shown, before, floor),
        "closed_by_retuning": closed(before, retuned, floor),
        "closed_beyond_retuning": closed(retuned, after, floor),
        "restart_s": float(problem.restart_s),
        "held_out_s": [[[float(a), float(b)] for a, b in log] for log in problem.held_out_s],
        "by_signal": by_signal(problem, search, shown),
    }


def closed_interval(
    problem: object, search: Search, shown: Fit, before: float, floor: float
) -> list[float] | None:
    """Block-bootstrap interval of `closed` over the rows that count in it; clipped as the reported
    gap is, whatever the search clips at.
    """
    if before - floor < 0.1:
        return None
    rows = search.rows
    blocks = make_blocks(
        rows.log, rows.time_s, problem.judged, search.blocks.length_s, search.seed, rows.conditional
    )
    b, a = (
        np.sqrt(draw_means(blocks, block_sums(blocks, squared(f, CLIP))))
        for f in (search.nominal, shown)
    )
    ratio = np.clip((b - a) / np.maximum(b - floor, 1e-6), 0.0, 1.0)
    return [float(q) for q in np.quantile(ratio, [0.025, 0.975])]


def by_signal(problem: object, search: Search, shown: Fit) -> dict[str, dict[str, object]]:
    """Gaps in units and ISO/TS 18571 ratings of each judged signal."""
    columns = [
        problem.gap_by_signal(f.held, problem.judged)
        for f in (search.nominal, search.retuned, shown)
    ]
    floors = problem.floor_by_signal(problem.judged)
    ratings = [problem.iso18571(f.held, problem.judged) for f in (search.nominal, shown)]
    out = {}
    for info in problem.signals:
        name = info.column
        if name in columns[0]:
            out[name] = {
                "unit": info.unit,
                "before": columns[0][name],
                "retuned": columns[1][name],
                "after": columns[2][name],
                "floor": floors[name],
                "iso18571_before": ratings[0].get(name),
                "iso18571_after": ratings[1].get(name),
            }
    return out


def probabilities(
    search: Search, finding: Finding, signs: dict[str, calibration.NameEvidence]
) -> dict[str, float]:
    """Marginal probability of each effect: of a selected one by its signs, of any other how often a
    set that holds it wins under the block bootstrap, and not more than what is not worth naming.
    """
    candidates = [
        search.retuned,
        *(f for k, f in sorted(search.fits.items()) if k and plausible(f)),
    ]
    share = win_shares(search, candidates)
    out = {
        e.id: float(sum(s for s, f in zip(share, candidates, strict=True) if e.id in f.ids))
        for e in search.effects
    }
    out |= {i: calibration.probability(one) for i, one in signs.items()}
    if finding.verdict == "ambiguous":
        out = share_among_rivals(out, finding)
    known = (
        {i for f in (finding.best, *finding.rivals) for i in f.ids}
        if finding.verdict in ("effect", "ambiguous")
        else set()
    )
    return {i: min(p, SURE if i in known else NOT_WORTH) for i, p in out.items()}


def share_among_rivals(out: dict[str, float], finding: Finding) -> dict[str, float]:
    """Rivals that tie keep a share of the doubt: the selected effect gets a half and more, each
    rival a half at most.
    """
    rivals = [i for f in finding.rivals for i in f.ids if i not in finding.best.ids]
    spare = 0.5 / (1 + len(rivals))
    for i in (i for i in finding.best.ids if any(i not in f.ids for f in finding.rivals)):
        out[i] = float(np.clip(out[i], 0.5, 0.5 + spare))
    for i in rivals:
        out[i] = float(np.clip(out[i], spare, 0.5))
    return out


def estimate_of(search: Search, one: Fit) -> Estimate:
    """The numbers of a fit as the search made it."""
    return Estimate(
        search.engine,
        one,
        (search.blocks.cluster, stretches_of(search.rows.log, search.rows.time_s)),
    )


def lost_without(search: Search, problem: object, best: Fit, effect_id: str, floor: float) -> float:
    """Share of the gap that opens again when the effect alone leaves the selected set."""
    if effect_id not in best.ids:
        return 0.0
    rest = search.fits.get(key([i for i in best.ids if i != effect_id]), search.retuned)
    before, after, without = (gap_of(problem, f.held) for f in (search.nominal, best, rest))
    return (
        float(np.clip((without - after) / max(before - floor, 1e-9), 0.0, 1.0))
        if before - floor >= 0.1
        else 0.0
    )


def effects_section(
    problem: object, search: Search, finding: Finding, floor: float, estimate: Estimate
) -> list[dict[str, object]]:
    """All effects that were tried: selected ones first, then by probability and by what they close
    alone. The estimate's effects take their numbers from it, the others from the fits of each
    alone.
    """
    signs = {i: calibration.name_evidence(search, finding.best, i, floor) for i in finding.best.ids}
    chance, before, out = (
        probabilities(search, finding, signs),
        gap_of(problem, search.nominal.held),
        [],
    )
    for effect in search.effects:
        alone = search.fits[(effect.id,)]
        source = estimate if effect.id in estimate.fit.ids else estimate_of(search, alone)
        out.append(
            {
                "id": effect.id,
                "subsystem": effect.subsystem,
                "probability": round(chance[effect.id], 6),
                "closes": closed(before, gap_of(problem, alone.held), floor),
                "lost_without": lost_without(search, problem, finding.best, effect.id, floor)
                if finding.verdict != "unlisted"
                else 0.0,
                "parameters": source.parameters(effect.id),
                "signs": asdict(signs[effect.id]) if effect.id in signs else None,
            }
        )
    named = selected(search, problem, finding, floor)
    return sorted(
        out,
        key=lambda e: (
            named.index(e["id"]) if e["id"] in named else 99,
            -e["probability"],
            -(e["closes"] or 0.0),
            e["id"],
        ),
    )


def selected(search: Search, problem: object, finding: Finding, floor: float) -> list[str]:
    """Named effects, strongest first; none of them when the gap is unlisted or no gap at all."""
    if finding.verdict in ("none", "unlisted"):
        return []
    strength = {i: lost_without(search, problem, finding.best, i, floor) for i in finding.best.ids}
    return sorted(finding.best.ids, key=lambda i: (-strength[i], i))


def indistinguishable(
    problem: object, search: Search, finding: Finding, kinds: frozenset[str], floor: float
) -> list[dict[str, object]]:
    """Members of the selected effects' equivalence classes, then the tied rivals."""
    if finding.verdict not in ("effect", "ambiguous"):
        return []
    before, out = gap_of(problem, search.nominal.held), []
    for i in finding.best.ids:
        for other in equivalents(i, kinds):
            out.append(
                {
                    "id": other,
                    "instead_of": i,
                    "closes": closed(before, gap_of(problem, search.fits[(i,)].held), floor),
                }
            )
    for rival in finding.rivals:
        gone = [i for i in finding.best.ids if i not in rival.ids]
        for j, new in enumerate(i for i in rival.ids if i not in finding.best.ids):
            if all(o["id"] != new for o in out) and gone:
                out.append(
                    {
                        "id": new,
                        "instead_of": gone[min(j, len(gone) - 1)],
                        "closes": closed(before, gap_of(problem, search.fits[(new,)].held), floor),
                    }
                )
    return out
