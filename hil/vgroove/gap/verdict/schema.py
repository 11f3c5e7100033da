"""The parts of a verdict as dataclasses, one for each object of its JSON (docs/spec/gap.md, section
5); field names and their order are those of the JSON.

Standard library only: importing vgroove.gap must not load the numerical packages. Gaps are RMS
values in sensor sigmas over held-out rows; shares lie in 0..1.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from vgroove.gap.selection.parameter_estimate import ParameterEstimate

OMIT_IF_EMPTY = {"omit_if_empty": True}  # metadata of a field that the JSON may lack


@dataclass(frozen=True)
class SignalGap:
    """RMS error of one signal in its unit before, retuned and after, not clipped; floor: what noise
    alone gives. ISO/TS 18571 ratings: 0..1, None where the signal is too short or flat to rate.
    clip: sigmas at which its residuals are clipped in the pooled gap. closed: share of its own RMS
    error above the floor. rms: of the measured signal over the judged rows; before_share and
    after_share: the errors divided by it.
    """

    unit: str
    before: float
    retuned: float
    after: float
    floor: float
    iso18571_before: float | None
    iso18571_after: float | None
    clip: float
    closed: float | None
    rms: float
    before_share: float | None
    after_share: float | None


@dataclass(frozen=True)
class Gap:
    """Gap of the nominal model (before), of the retuned model (the rig's values refitted within
    their tolerances) and of the corrected model, predicted from folds (after) and with the values
    of the corrected rig, fitted to all rows (refit); floor: what noise alone gives. closed*:
    shares, None where the gap above the floor is below 0.1. held_out_s: the judged stretches in s,
    a list per log.
    """

    before: float
    retuned: float
    after: float
    refit: float
    floor: float
    closed: float | None
    closed_ci95: Sequence[float] | None
    closed_by_retuning: float | None
    closed_beyond_retuning: float | None
    restart_s: float
    held_out_s: Sequence[Sequence[Sequence[float]]]
    by_signal: Mapping[str, SignalGap]

    @property
    def with_samples(self) -> dict[str, SignalGap]:
        """The signals with a judged sample: the others have no floor."""
        return {name: one for name, one in self.by_signal.items() if one.floor > 0.0}


@dataclass(frozen=True)
class RegimeShare:
    """Share of the nominal model's squared gap in one regime of motion."""

    regime: str
    share: float


@dataclass(frozen=True)
class CorrelateShare:
    """Share of a signal's squared gap after retuning that one measured quantity explains."""

    follows: str
    signal: str
    share: float


@dataclass(frozen=True)
class Where:
    """Location of the gap: the subsystem of the largest Shapley share, all shares with
    'unexplained', regimes and correlates, largest first.
    """

    subsystem: str | None
    share: Mapping[str, float]
    by_regime: Sequence[RegimeShare]
    by_correlate: Sequence[CorrelateShare]


@dataclass(frozen=True)
class NameEvidence:
    """The four quantities that an effect's probability is calibrated on.

    margin: how much larger the squared gap of the best set without the effect is. blocks:
    log(1 + margin / standard deviation of the margin over the bootstrap blocks). forms:
    log(1 + margin / squared gap that the named set leaves). closed: log(squared gap that retuning
    leaves / that the named set leaves). others: number of other effects of the set.
    """

    blocks: float
    forms: float
    closed: float
    others: float


@dataclass(frozen=True)
class ComparisonEvidence:
    """The comparison in which an effect was found, with the RMS of its held-out residuals without
    the effect (before) and with it (after), in standard deviations that include the model's
    discrepancy, and what the sensors' noise alone gives (floor).

    comparison: "forward simulation", whose residuals are the reported gap, or "torque balance".
    """

    comparison: str
    before: float
    after: float
    floor: float


@dataclass(frozen=True)
class EffectFinding:
    """One effect of the catalogue: probability that it is present, share of the gap that it closes
    alone, share lost when it alone leaves the selected set, parameters by name. signs: what its
    probability is computed from, where it belongs to the best set. evidence: the comparison in
    which it was found, where the verdict names it.
    """

    id: str
    subsystem: str
    probability: float
    closes: float | None
    lost_without: float
    parameters: Mapping[str, ParameterEstimate]
    signs: NameEvidence | None
    evidence: ComparisonEvidence | None = field(default=None, metadata=OMIT_IF_EMPTY)


@dataclass(frozen=True)
class Rival:
    """An effect that these logs do not distinguish from a selected one; closes: share alone."""

    id: str
    instead_of: str
    closes: float | None


@dataclass(frozen=True)
class ProfileSeparation:
    """RMS difference, in sigma a sample, that the rivals would show in a run of the menu."""

    profile: str
    sigma: float


@dataclass(frozen=True)
class NextExperiment:
    """The run to record next: name in the menu, reason, command as [time in s, share of the largest
    command], and for rivals the separation of each run, largest first.
    """

    profile: str
    why: str
    points: Sequence[Sequence[float]]
    separation: Sequence[ProfileSeparation] = field(default=(), metadata=OMIT_IF_EMPTY)


@dataclass(frozen=True)
class Unexplained:
    """The remainder. significant: whether it is more than noise; best_correlate, signal: the
    measured quantity that it depends on, and the signal; looks_like: that dependence in words;
    could_gain: share of the remainder above the noise that a smooth correction would close;
    correction: points [quantity, correction in the signal's unit] of it.
    """

    significant: bool
    best_correlate: str | None
    signal: str | None
    share_of_squared_gap: float
    looks_like: str | None
    could_gain: float
    correction: Sequence[Sequence[float]]
