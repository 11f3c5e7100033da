"""A duty profile that a board performs: PROFILE frames in time, for a serial line, a lock-step run
or a test.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

from vgroove import telemetry

PERIOD_S = 0.02  # the board obeys a frame for 50 ms: one may be lost
OPEN = -1.0  # duty below 0: the bridge is open


@dataclass
class ProfileSender:
    """Frames of `duty(t)`, t in s from `begin_s` on, for `duration_s`; held to OPEN or 0..1. A line
    of `vgroove.lockstep`.
    """

    duty: Callable[[float], float]
    duration_s: float
    begin_s: float = 0.0
    period_s: float = PERIOD_S
    sent: int = 0

    def due(self, time_s: float) -> bytes:
        """The frames whose time has come, the last of a late caller's only: an old duty is worth
        nothing.
        """
        frames = math.ceil(self.duration_s / self.period_s - 1e-9)
        due = min(int((time_s - self.begin_s) / self.period_s + 1e-9), frames - 1)
        if time_s < self.begin_s or due < self.sent:
            return b""
        self.sent = due + 1
        return profile_frame(self.duty(due * self.period_s), due, round(time_s * 1000))

    def send(self, data: bytes) -> None:
        """What the board says is for others."""
        del data

    receive = due


def profile_frame(duty: float, sequence: int, time_ms: int = 0) -> bytes:
    """One PROFILE frame on the wire: duty 0..1, below 0 the bridge is open; the sequence number
    modulo 256 differs from frame to frame.
    """
    duty_q15 = -1 if duty < 0 else min(round(duty * 2**15), 2**15 - 1)
    frame = telemetry.frame_of_signals(
        "PROFILE", time_ms, profile_duty_q15=duty_q15, profile_sequence=sequence & 0xFF
    )
    return telemetry.frame_bytes(frame)
