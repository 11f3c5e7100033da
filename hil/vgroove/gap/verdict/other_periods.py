"""Whether a periodic effect needs its own period: of a remainder that only drifts with the angle, a
torque of any other period closes about as much (docs/spec/gap.md, section 5).
"""

from dataclasses import dataclass, replace

import numpy as np

from vgroove.gap.catalogue import PERIODIC, Effect
from vgroove.gap.fitting.hypothesis import Fit, Hypothesis
from vgroove.gap.residual.angle_alignment import periods_per_rev
from vgroove.gap.selection.candidate_sets import fit_without
from vgroove.gap.selection.extension import differentiate_added, starts_beside
from vgroove.gap.selection.search_state import Search
from vgroove.gap.selection.single_effects import STARTS
from vgroove.gap.verdict.consistency import further_gain


@dataclass(frozen=True)
class OtherPeriods:
    """The comparison of a periodic effect with torques of other numbers of periods in its place:
    which numbers are tried, and the largest gain that one of them may have if the effect is to be
    established. Chosen on tuning cases of the blind set and on measured logs (docs/gap_bench.md).
    """

    count: int = 12  # of more and of fewer periods each, in equal ratios
    largest_ratio: float = 4.0  # of the member's number of periods
    max_gain: float = 0.5  # of one of them, as a share of the member's gain


OTHER = OtherPeriods()


def needs_its_period(search: Search, best: Fit, effect_id: str, without: Fit, gain: float) -> bool:
    """Whether a torque of no other period closes more than OTHER.max_gain of the squared gap that a
    member gains. without: the set fitted without it. True for effects without a period, and where
    the logs, or the options, leave no effect whose number of periods is fitted.
    """
    ripple = fitted_ripple(search)
    if effect_id not in PERIODIC or ripple is None:
        return True
    scales, theta = search.engine.scales, best.theta(search.problem.theta0)
    counts = other_counts(periods_per_rev(search.problem, theta, effect_id), scales.turns)
    counts = counts[counts <= scales.periods]
    beside = fit_without(search, without, ripple.id) if ripple.id in without.ids else without
    limit = OTHER.max_gain * gain
    return all(
        further_gain(search, without, one.columns) <= limit
        for one in differentiate_added(search, beside, ripples(search, beside, ripple, counts))
    )


def fitted_ripple(search: Search) -> Effect | None:
    """The periodic effect whose number of periods is fitted, None where the logs cannot show it."""
    return next((e for e in search.effects if e.periodic and e.periodic.is_fitted), None)


def other_counts(own: float, turns: float) -> np.ndarray:
    """Other numbers of periods a motor turn (k,), larger and smaller than `own`. Over a log of so
    many turns each of them passes at least one period more or less than `own`: closer ones follow
    the log as well.
    """
    ratios = np.geomspace(1.0, OTHER.largest_ratio, OTHER.count + 1)[1:]
    counts = own * np.concatenate([1.0 / ratios[::-1], ratios])
    return counts[np.abs(counts - own) * turns >= 1.0]


def ripples(search: Search, beside: Fit, ripple: Effect, counts: np.ndarray) -> list[Hypothesis]:
    """A ripple of nearly zero amplitude beside a fit, for each number of periods a motor turn."""
    (h, *_) = starts_beside(search, beside, ripple, restart=True)
    periods = f"effects.{ripple.id}.{ripple.periodic.periods}"
    own = range(beside.hypothesis.count, h.count)
    starts = np.repeat(h.start[None, :], len(counts), axis=0)
    for k in own:
        c = h.coordinates[k]
        starts[:, k] = counts / c.factors[0] if c.name == periods else STARTS.tiny_ripple
    return [replace(h, start=start) for start in starts]
