"""Thresholds of the stepwise selection: how large a set of effects grows, and which members are
removed.

The form of an effect is the functional form of its equation. The form error is the part of the
squared gap that remains because a real effect has a slightly different form than the catalogue's;
further effects of the catalogue can close it without being present in the tool.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class StepwiseLimits:
    """Thresholds of the stepwise selection. Shares are of squared gaps above the noise. Chosen on
    the tuning half of the blind set (docs/gap_bench.md) unless a derivation is stated.
    """

    max_effects: int = 4  # members of a set
    # Largest form error, as a share of what an effect closes: a form that deviates by about a
    # quarter of the effect leaves about (1/4)^2 of its squared gap. A member that gains less may
    # only correct the form of another.
    max_form_share: float = 0.05
    # the same in equations that the others do not enter, where their form errors are small
    max_form_share_elsewhere: float = 0.01
    # part of what the others leave that the member must close for that smaller share to apply
    min_part_elsewhere: float = 0.5
    # the same for a law of friction beside another: an effect in another form closes at least 0.7
    # of its squared gap (docs/spec/gap.md, section 5), so that 0.3 / 0.7 of what it closes may be
    # left
    max_friction_form_share: float = 0.3 / 0.7
    # share of what the others close that a member must gain if a tied rival lacks it
    min_share_of_tied_member: float = 0.1
    # largest part of the squared gap above the noise left by the set so far (base) that may remain
    # with two further effects to first order; a pair that leaves more is not fitted
    max_part_left_by_two: float = 0.5
    max_exchanges: int = 3  # rounds in which one member is exchanged
    extensions_of_rival: int = 3  # first-order candidates of each close rival of a set
    rivals_extended: int = 2  # close rivals whose extensions are tried
    extensions_in_exchange: int = 4  # first-order candidates that replace a member
    max_more_parameters: int = 2  # parameters that a rival may have more than the best set


STEPWISE = StepwiseLimits()
