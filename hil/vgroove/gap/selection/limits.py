"""Thresholds that decide how large a set of effects grows and which members it loses again."""

from dataclasses import dataclass


@dataclass(frozen=True)
class StepwiseLimits:
    """Thresholds of the stepwise selection. Shares are of squared gaps above the noise. Chosen on
    the tuning half of the blind set unless a derivation is stated.
    """

    max_effects: int = 4  # members of a set
    near_noise: float = 2.0  # gap, in noise, below which the clip is set again: all is explained
    # A form that deviates by a quarter of its size leaves (1 / 4)^2 of the squared gap: a member
    # that gains less, of what the others close, may only correct the form of another.
    max_form_share: float = 0.05
    # the same in equations that the others do not enter, where their forms leave next to nothing
    max_form_share_elsewhere: float = 0.01
    min_part_elsewhere: float = 0.5  # of what is left there, that the member must then close
    # docs/spec/gap.md, section 3: an effect in another form closes at least 0.7 of its squared gap
    max_friction_form_share: float = 0.3 / 0.7
    min_share_of_tied_member: float = 0.1  # that a member with tied alternatives must gain
    min_part_of_second: float = 0.5  # of what the first leaves, that a second effect must promise
    max_exchanges: int = 3  # rounds in which one member is exchanged
    extensions_of_rival: int = 3  # first-order candidates of each close rival of a set
    rivals_extended: int = 2  # close rivals whose extensions are tried
    extensions_in_exchange: int = 4  # first-order candidates in a member's place
    max_more_parameters: int = 2  # parameters that a rival may have beyond the best set


STEPWISE = StepwiseLimits()
