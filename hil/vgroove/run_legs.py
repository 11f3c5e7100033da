"""A run that the diagnosis can propose (gap/next_run/menu.py) as legs, each in one direction of
rotation, because the direction of a board follows its switch, which the operator moves at
standstill.
"""

from dataclasses import dataclass

import numpy as np

from vgroove.gap.next_run.menu import PROFILE_S, RunProfile
from vgroove.profile_sender import OPEN, PERIOD_S


@dataclass(frozen=True)
class Leg:
    """A stretch of a run in steps of PERIOD_S: magnitude of the duty (n,), and where the bridge is
    open (n,).
    """

    reverse: bool
    duty: np.ndarray
    opens: np.ndarray

    @property
    def duration_s(self) -> float:
        """Length of the leg."""
        return len(self.duty) * PERIOD_S

    def slewed(self, slew_per_s: float) -> np.ndarray:
        """Duties (n,), OPEN where the bridge is open, that change at most at the rate of the
        trigger's ramp: a step of the duty from rest would trip the board's over-current fault.
        """
        max_step, duty, slewed = slew_per_s * PERIOD_S, 0.0, np.full(len(self.duty), OPEN)
        for k in range(len(self.duty)):
            if self.opens[k]:
                duty = 0.0
                continue
            duty += float(np.clip(self.duty[k] - duty, -max_step, max_step))
            slewed[k] = duty
        return slewed


def legs_of(profile: RunProfile) -> list[Leg]:
    """A run as at most two legs: its samples with a level of 0 or above, then those with a level of
    0 or below, as magnitudes; a direction without drive has no leg.
    """
    time_s = np.arange(round(PROFILE_S / PERIOD_S)) * PERIOD_S
    share, opens = profile.command(time_s), profile.bridge_open(time_s)
    legs = []
    for reverse, along in ((False, share), (True, -share)):
        if np.any(along > 0.0):
            legs.append(Leg(reverse, along[along >= 0.0], opens[along >= 0.0]))
    return legs
