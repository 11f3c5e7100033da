"""PROFILE frames that make a board perform a duty profile, at the times at which they are due."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from vgroove import telemetry

PERIOD_S = 0.02  # a frame holds for 50 ms on the board, so that one may be lost
OPEN = -1.0  # duty of an open bridge; any value below 0 opens it


@dataclass
class ProfileSender:
    """Frames of `duty(t)`, t in s since `begin_s`, for `duration_s`; duties are OPEN or 0..1.

    It can be the line of a lock-step run (`vgroove.lockstep.Line`).
    """

    duty: Callable[[float], float]
    duration_s: float
    begin_s: float = 0.0
    period_s: float = PERIOD_S
    sent: int = 0

    def due(self, time_s: float) -> bytes:
        """The frame that is due at `time_s`, empty if there is none.

        A late caller gets only the last of several due frames: an older duty has no effect.
        """
        frames = math.ceil(self.duration_s / self.period_s - 1e-9)
        due = min(int((time_s - self.begin_s) / self.period_s + 1e-9), frames - 1)
        if time_s < self.begin_s or due < self.sent:
            return b""
        self.sent = due + 1
        return profile_frame(self.duty(due * self.period_s), due, round(time_s * 1000))

    def send(self, data: bytes) -> None:
        """Bytes of the board, which are ignored."""
        del data

    receive = due


def profile_frame(duty: float, sequence: int, time_ms: int = 0) -> bytes:
    """One PROFILE frame on the wire: duty 0..1, or below 0 for an open bridge.

    `sequence`, taken modulo 256, must differ between successive frames.
    """
    duty_q15 = -1 if duty < 0 else min(round(duty * 2**15), 2**15 - 1)
    frame = telemetry.frame_of_signals(
        "PROFILE", time_ms, profile_duty_q15=duty_q15, profile_sequence=sequence & 0xFF
    )
    return telemetry.frame_bytes(frame)
