"""The remainder of a fit: whether it is more than noise, which measured quantity it depends on, and
what a smooth correction over that quantity would close.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from vgroove.gap.fitting.hypothesis import Fit
from vgroove.gap.selection.model_comparison import Blocks, difference_interval
from vgroove.gap.selection.search_state import COMPARISON, Search
from vgroove.gap.verdict import correlates
from vgroove.gap.verdict.correlates import Covariate
from vgroove.gap.verdict.covariates import UNWOUND_ANGLE, Covariates
from vgroove.gap.verdict.location import is_significant_gain
from vgroove.gap.verdict.schema import CorrelateShare, Unexplained
from vgroove.units import TURN_RAD

# signal -> covariate that is its own smoothed column: its noise would correlate with its residual
OWN_COVARIATE = {"current_a": "current", "supply_v": "bus voltage"}


@dataclass(frozen=True)
class RemainderLimits:
    """Thresholds of the remainder; chosen on the tuning half of the blind set
    (docs/gap_bench.md).
    """

    min_excess: float = 0.15  # smallest squared gap above the noise of a remainder, in noise powers
    min_correlate_share: float = 0.05  # of the squared gap: smaller correlates are not listed


REMAINDER = RemainderLimits()


@dataclass(frozen=True)
class Remainder:
    """What a fit leaves. significant: whether it is more than noise; best_correlate, signal: the
    covariate that it depends on, and the signal; gain: squared gap that bin means over the
    covariate close.

    could_gain: share of the remainder above the noise that a smooth correction would close;
    correction: its points [covariate, correction in sigmas]; looks_like: the curve in words.
    """

    significant: bool
    best_correlate: str | None
    gain: float
    signal: str | None
    could_gain: float = 0.0
    correction: tuple[tuple[float, float], ...] = ()
    looks_like: str | None = None


@dataclass(frozen=True)
class SignalResiduals:
    """Held-out residuals (n,), clipped; signal (n,): index into names, the signals' columns; blocks
    of the bootstrap.
    """

    value: np.ndarray
    signal: np.ndarray
    names: list[str]
    blocks: Blocks

    @staticmethod
    def of(search: Search, one: Fit) -> "SignalResiduals":
        """Residuals of a fit, clipped as in the comparison of fits."""
        clip, problem = COMPARISON.clip_sigma, search.problem
        names = [s.column for s in problem.signals]
        return SignalResiduals(
            np.clip(one.out_of_fold, -clip, clip), problem.signal, names, search.blocks
        )

    def rows(self, k: int, covariate: Covariate) -> np.ndarray:
        """Tested rows (n,) of a signal in which the covariate is known."""
        return self.blocks.tested & (self.signal == k) & np.isfinite(covariate.value)

    def signals_for(self, covariate: Covariate) -> Iterator[int]:
        """Indices of the signals of which the covariate is not the own column."""
        for k, name in enumerate(self.names):
            if OWN_COVARIATE.get(name) != covariate.name:
                yield k

    def without(self, rows: np.ndarray, covariate: Covariate) -> np.ndarray:
        """Residuals of some rows less what bin means over the covariate predict of them."""
        value, cluster = covariate.value[rows], self.blocks.cluster[rows]
        return self.value[rows] - correlates.predict_by_bins(self.value[rows], value, cluster)


@dataclass(frozen=True)
class Correlate:
    """A covariate, the signal whose residual depends on it, the squared gap that it explains over
    all rows, and the residuals (n,) without it.
    """

    covariate: Covariate
    signal: int
    gain: float
    left: np.ndarray


def remaining(search: Search, best: Fit, covariates: Covariates) -> Remainder:
    """The remainder of a fit, from two-fold cross-validated bin means over each covariate and over
    spectral lines.
    """
    residuals = SignalResiduals.of(search, best)
    top = strongest(residuals, measured_covariates(covariates))
    found = top is not None and explains(search, residuals, top)
    if not (found or stands_above_noise(search, best)):
        return Remainder(False, None, top.gain if top else 0.0, None)
    line = strongest(residuals, spectral_lines(search, residuals, covariates))
    if (
        line is not None
        and (not found or line.gain > top.gain)
        and explains(search, residuals, line)
    ):
        top, found = line, True
    if not found:
        return Remainder(True, None, top.gain if top else 0.0, None)
    return described(search, best, residuals, top)


def explains(search: Search, residuals: SignalResiduals, one: Correlate) -> bool:
    """Whether a correlate closes a significant part of the remainder."""
    return is_significant_gain(search, residuals.value**2, one.left**2)


def described(search: Search, best: Fit, residuals: SignalResiduals, top: Correlate) -> Remainder:
    """The remainder with the smooth correction over its strongest correlate."""
    rows = residuals.rows(top.signal, top.covariate)
    value = residuals.value[rows]
    covariate = Covariate(top.covariate.name, top.covariate.value[rows], top.covariate.period)
    x, y = correlates.smooth_curve(value, covariate)
    share = correlates.cross_validated_gain(value, covariate, search.blocks.cluster[rows])
    gain = share * float((value**2).sum())
    above = max((search.score(best) - search.floor_power) * search.blocks.total, 1e-9)
    return Remainder(
        True,
        top.covariate.name,
        top.gain,
        residuals.names[top.signal],
        float(np.clip(gain / above, 0.0, 1.0)),
        tuple(correlates.thin_curve(x, y)),
        correlates.describe_curve(x, y, covariate),
    )


def stands_above_noise(search: Search, best: Fit) -> bool:
    """Whether a fit leaves more than the power of the sensors' noise, and, unless the gap is far
    from the noise, not in one or two blocks only, as a single event of the run would.
    """
    if search.leaves_most_of_far_gap(best):
        return True
    noise = search.floor_power
    if search.score(best) <= (1.0 + REMAINDER.min_excess) * noise:
        return False
    above = search.block_losses(best) - noise * search.blocks.rows
    least = difference_interval(search.blocks, above, COMPARISON.likely)[0]
    return least > COMPARISON.min_gain * noise or search.is_far_from_noise(best)


def measured_covariates(covariates: Covariates) -> list[Covariate]:
    """Covariates in alphabetical order; angles are periodic."""
    return [
        Covariate(name, value, TURN_RAD if name.endswith("angle") else 0.0)
        for name, value in sorted(covariates.items())
        if name != UNWOUND_ANGLE
    ]


def strongest(residuals: SignalResiduals, covariates: list[Covariate]) -> Correlate | None:
    """The covariate and the signal for which bin means close most; None where nothing is closed."""
    top: Correlate | None = None
    for covariate in covariates:
        for k in residuals.signals_for(covariate):
            rows = residuals.rows(k, covariate)
            left = residuals.value.copy()
            left[rows] = residuals.without(rows, covariate)
            closed = float((residuals.value[rows] ** 2 - left[rows] ** 2).sum())
            gain = closed / residuals.blocks.total
            if gain > (top.gain if top else 0.0):
                top = Correlate(covariate, k, gain, left)
    return top


def spectral_lines(
    search: Search, residuals: SignalResiduals, covariates: Covariates
) -> list[Covariate]:
    """Lines of each signal's residual spectra over time and over the motor's angle, as covariates
    (n,).
    """
    problem, found = search.problem, []
    angle = covariates.get(UNWOUND_ANGLE)
    for k in range(len(residuals.names)):
        rows = residuals.blocks.tested & (residuals.signal == k) & (residuals.value != 0.0)
        if angle is not None:
            rows &= np.isfinite(angle)
        if rows.sum() < correlates.CORRELATE.line_rows:
            continue
        lines = correlates.spectral_covariates(
            residuals.value[rows],
            problem.time_s[rows],
            angle[rows] if angle is not None else None,
            search.engine.scales.ratio,
            problem.log[rows],
        )
        for one in lines:
            whole = np.full(len(residuals.value), np.nan)
            whole[rows] = one.value
            found.append(Covariate(one.name, whole, one.period))
    return found


def correlate_shares(search: Search, covariates: Covariates) -> list[CorrelateShare]:
    """Share of the squared gap after retuning, above the noise, that each covariate explains in
    each signal alone, largest first; small shares are left out.
    """
    residuals = SignalResiduals.of(search, search.retuned)
    counted = search.blocks.tested & ~search.problem.censored
    tested = residuals.value[search.blocks.tested]
    total = float((tested**2).sum() - search.floor_power * counted.sum())
    found = []
    for covariate in measured_covariates(covariates) if total > 0.0 else []:
        for k in residuals.signals_for(covariate):
            rows = residuals.rows(k, covariate) & (residuals.value != 0.0)
            left = residuals.without(rows, covariate)
            share = float((residuals.value[rows] ** 2 - left**2).sum()) / total
            if share > REMAINDER.min_correlate_share:
                name = residuals.names[k]
                found.append(CorrelateShare(covariate.name, name, min(1.0, share)))
    return sorted(found, key=lambda f: (-f.share, f.follows, f.signal))


def unexplained(search: Search, remainder: Remainder) -> Unexplained:
    """The remainder as the verdict states it: its correction in the signal's unit."""
    signals = search.problem.signals
    sigma = next((s.sigma for s in signals if s.column == remainder.signal), 1.0)
    mine = [k for k, s in enumerate(signals) if s.column == remainder.signal]
    sigma *= search.discrepancy(mine[0]) if mine else 1.0
    return Unexplained(
        remainder.significant,
        remainder.best_correlate,
        remainder.signal,
        remainder.gain / max(search.score(search.nominal), 1e-9),
        remainder.looks_like,
        remainder.could_gain,
        [(x, y * sigma) for x, y in remainder.correction],
    )
