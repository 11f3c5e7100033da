"""Leads a board through a run of the diagnosis' menu: what the operator is to do, PROFILE frames by
the board's own clock, how it ended.

    READY --> PRESS <--> HOLD --> PLAY --> COAST --> OVER
      ^                            |
      +--------- next leg ---------+

READY  no frames: trigger open, mode duty, the leg's direction and the board's parameters are
awaited PRESS  duty 0 is commanded, so that a pressed trigger turns nothing HOLD   the trigger is
held; the run begins in a moment PLAY   the leg's duties; whatever ends the drive ends the run COAST
the frames have ended and the board opens its bridge; recorded a little longer

Time is the board's: without its telemetry no frame is due, and the board ends the drive by itself.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum, auto

import numpy as np

from vgroove import telemetry
from vgroove.gap.next_run.menu import SECONDS, Course
from vgroove.profile_sender import OPEN, PERIOD_S, ProfileSender
from vgroove.recorder import DONE, SILENCE_S, Partner

HOLD_S = 1.0
AFTER_S = 0.5
PATIENCE_S = 120.0
# frames in a row: half a second, less than HOLD_S, so that no run begins unheard
UNANSWERED_MOST = 25
ASK_MODE_S = 1.0
JUMP_MS = 1000  # in time, that is damage and no telemetry
SLACK = 0.02  # a trigger so little below what is commanded limits nothing
UNANSWERED = (
    "the board speaks but answers no command for half a second: does the line reach its RX pin?"
)
REFUSALS = {
    "unknown_id": "the board's firmware knows no PROFILE frames: flash the firmware of this version",
    "not_now": "the board performs a run in mode duty only: turn the mode switch to position 0",
}


class Phase(Enum):
    """Where a run stands."""

    READY = auto()
    PRESS = auto()
    HOLD = auto()
    PLAY = auto()
    COAST = auto()
    OVER = auto()


WAITING = (Phase.READY, Phase.PRESS, Phase.HOLD)
SPEAKING = (Phase.PRESS, Phase.HOLD, Phase.PLAY)


@dataclass(frozen=True)
class Leg:
    """A stretch of a course in one direction, in steps of PERIOD_S: magnitude of the duty (n,), and
    where the bridge is open (n,).
    """

    reverse: bool
    duty: np.ndarray
    opens: np.ndarray

    @property
    def duration_s(self) -> float:
        """Its length."""
        return len(self.duty) * PERIOD_S

    def slewed(self, slew_per_s: float) -> np.ndarray:
        """Duties (n,), OPEN where the bridge is open, that change as fast as the trigger's ramp: a
        step from rest would trip the board.
        """
        most, now, out = slew_per_s * PERIOD_S, 0.0, np.full(len(self.duty), OPEN)
        for k in range(len(self.duty)):
            now = 0.0 if self.opens[k] else now + float(np.clip(self.duty[k] - now, -most, most))
            out[k] = OPEN if self.opens[k] else now
        return out


def legs_of(course: Course) -> list[Leg]:
    """A course as legs: rests and forward levels, then rests and backward ones. A board's direction
    follows its switch, at standstill.
    """
    time_s = np.arange(round(SECONDS / PERIOD_S)) * PERIOD_S
    share, opens = course.command(time_s), course.opens(time_s)
    legs = []
    for reverse, along in ((False, share), (True, -share)):
        if np.any(along > 0.0):
            legs.append(Leg(reverse, along[along >= 0.0], opens[along >= 0.0]))
    return legs


@dataclass(frozen=True)
class BoardState:
    """A STATE frame."""

    state: str
    mode: str
    reverse: bool
    contact: bool
    trigger: float
    faults: tuple[str, ...]

    @classmethod
    def of(cls, frame: telemetry.Frame) -> "BoardState":
        """From the frame."""
        said = telemetry.decode(frame)
        state, mode = (
            telemetry.value_table("STATE", name)[int(said[name])] for name in ("state", "mode")
        )
        faults = tuple(
            name
            for bit, name in telemetry.value_table("STATE", "faults").items()
            if int(said["faults"]) & bit
        )
        return cls(state, mode, said["reverse"] != 0, said["contact"] != 0, said["trigger"], faults)


@dataclass
class Conductor(Partner):
    """A run on a board; `session` is that of its recording, which begins with the first leg."""

    course: Course
    session: telemetry.Session
    phase: Phase = Phase.READY
    over: str = ""
    begun: bool = False
    sent: int = 0
    answered: int = 0
    unanswered: int = 0  # in a row
    limited_to: float = 1.0  # least travel of the trigger where more was commanded
    most_silence_s = SILENCE_S
    _board: BoardState | None = None
    _now_ms: int | None = None
    _since_s: float = 0.0  # of the phase
    _waits_since_s: float | None = None
    _leg: int = 0
    _duties: np.ndarray = field(default_factory=lambda: np.zeros(0))
    _sender: ProfileSender | None = None
    _mode_asked_s: float = -ASK_MODE_S
    _mode_refused: bool = False

    def __post_init__(self) -> None:
        self.legs = legs_of(self.course)

    def hear(self, frames: Sequence[telemetry.Frame]) -> list[telemetry.Frame]:
        """Takes what the board says, and hands out what is to be recorded: no rows before the run
        has begun.
        """
        for frame in frames:
            self._take_time(frame.time_ms)
            if frame.id == telemetry.STATE:
                self._board = BoardState.of(frame)
            elif frame.id == telemetry.ACK:
                self._take_ack(frame)
        return [frame for frame in frames if self.begun or frame.id != telemetry.FAST]

    def _take_time(self, time_ms: int) -> None:
        if self._now_ms is None:
            self._now_ms = time_ms
            return
        step_ms = (time_ms - self._now_ms) & 0xFFFFFFFF
        self._now_ms += step_ms if step_ms <= JUMP_MS or self.phase is Phase.READY else 0

    def _take_ack(self, frame: telemetry.Frame) -> None:
        ack = {name: int(value) for name, value in telemetry.decode(frame).items()}
        result = telemetry.value_table("ACK", "ack_result").get(ack["ack_result"], "")
        if ack["ack_command"] == telemetry.SET_MODE:
            self._mode_refused = result != "ok"
        elif ack["ack_command"] == telemetry.PROFILE:
            self.answered, self.unanswered = self.answered + 1, 0
            if result in REFUSALS and self.phase in SPEAKING:
                self._end(REFUSALS[result])

    def speak(self) -> bytes:
        """What is to be sent now."""
        if self._now_ms is None or self.over:
            return b""
        if self._waits_since_s is None:
            self._waits_since_s = self._now_s
        following = self._next_phase()
        if following is not self.phase:
            self._enter(following)
        if self.phase is Phase.PLAY and self._board.trigger < self._duty_now() - SLACK:
            self.limited_to = min(self.limited_to, self._board.trigger)
        return self._ask_mode() if self.phase is Phase.READY else self._due()

    @property
    def _now_s(self) -> float:
        return (self._now_ms or 0) / 1000

    @property
    def _phase_s(self) -> float:
        return self._now_s - self._since_s

    def _drives(self) -> bool:
        return self._board is not None and self._board.state == "drive"

    def _suits(self) -> bool:
        """Whether mode and direction are those of the leg."""
        board = self._board
        return (
            board is not None
            and board.mode == "duty"
            and board.reverse == self.legs[self._leg].reverse
            and not board.faults
        )

    def _next_phase(self) -> Phase:
        """The phase that follows from what the board says."""
        impatient = (
            self.phase in WAITING and self._now_s - (self._waits_since_s or 0.0) > PATIENCE_S
        )
        if impatient or self.unanswered > UNANSWERED_MOST:
            return Phase.OVER
        match self.phase:
            case Phase.READY:
                ready = (
                    self._suits()
                    and self._board.state == "idle"
                    and not self._board.contact
                    and self.session.table is not None
                )
                return Phase.PRESS if ready else Phase.READY
            case Phase.PRESS:
                return (
                    Phase.HOLD if self._drives() else Phase.PRESS if self._suits() else Phase.READY
                )
            case Phase.HOLD:
                return (
                    Phase.PRESS
                    if not self._drives()
                    else Phase.PLAY
                    if self._phase_s >= HOLD_S
                    else Phase.HOLD
                )
            case Phase.PLAY:
                return self._next_of_play()
            case Phase.COAST:
                return Phase.OVER if self._phase_s >= AFTER_S else Phase.COAST
        return Phase.OVER

    def _next_of_play(self) -> Phase:
        if self._phase_s >= self.legs[self._leg].duration_s:
            return Phase.COAST if self._leg + 1 == len(self.legs) else Phase.READY
        return Phase.PLAY if self._drives() else Phase.OVER

    def _enter(self, phase: Phase) -> None:
        before, self.phase = self.phase, phase
        self._since_s, played_s = self._now_s, self._phase_s
        if phase is Phase.OVER:
            self._end(self._reason(before, played_s))
        elif phase is Phase.PRESS:
            self._sender = ProfileSender(lambda _: 0.0, PATIENCE_S + HOLD_S, self._now_s)
        elif phase is Phase.PLAY:
            self._play()
        elif phase is Phase.READY and before is Phase.PLAY:
            self._leg, self._waits_since_s = self._leg + 1, self._now_s

    def _play(self) -> None:
        slew = next(
            k for k, p in enumerate(telemetry.parameter_list()) if p.name == "slew_per_ms_q15"
        )
        self._duties = self.legs[self._leg].slewed(self.session.parameters[slew] / 2**15 * 1000)
        self._sender = ProfileSender(
            lambda t: float(self._duties[round(t / PERIOD_S)]),
            self.legs[self._leg].duration_s,
            self._now_s,
        )
        if not self.begun:
            self.begun, self.session.first_ms = True, self.session.last_ms

    def _duty_now(self) -> float:
        return float(self._duties[min(int(self._phase_s / PERIOD_S), len(self._duties) - 1)])

    def _due(self) -> bytes:
        if self.phase not in SPEAKING:
            return b""
        frame = self._sender.due(self._now_s)
        self.sent += len(frame) > 0
        self.unanswered += len(frame) > 0
        return frame

    def _ask_mode(self) -> bytes:
        """Mode duty, where the board stands still in another one."""
        board = self._board
        wanted = (
            board is not None
            and board.state == "idle"
            and not board.contact
            and board.mode != "duty"
        )
        if not wanted or self._now_s - self._mode_asked_s < ASK_MODE_S:
            return b""
        self._mode_asked_s = self._now_s
        return telemetry.frame_bytes(
            telemetry.frame_of_signals("SET_MODE", self._now_ms & 0xFFFFFFFF, mode_request=0)
        )

    def _end(self, reason: str) -> None:
        self.phase, self.over = Phase.OVER, reason

    def _reason(self, before: Phase, phase_s: float) -> str:
        """Why the run is over."""
        if before is Phase.COAST:
            return DONE
        if self.unanswered > UNANSWERED_MOST:
            return UNANSWERED
        if before in WAITING:
            return f"not within {PATIENCE_S:g} s: {self._wish()}"
        at = f"{self._played_before() + phase_s:.1f} s into the run of {self.total_s:.1f} s"
        if self._board.faults:
            return f"the board reports {' and '.join(self._board.faults)}, {at}"
        if self._board.state == "stopped":
            return f"frames were lost on the line: the board heard none for 50 ms and ended the drive, {at}"
        return f"the {'direction switch was moved' if self._board.contact else 'trigger was released'}, {at}"

    @property
    def total_s(self) -> float:
        """Length of all legs."""
        return sum(leg.duration_s for leg in self.legs)

    def _played_before(self) -> float:
        return sum(leg.duration_s for leg in self.legs[: self._leg])

    @property
    def played_s(self) -> float:
        """What has been performed."""
        if self.phase in (Phase.COAST, Phase.OVER):
            return self.total_s
        return self._played_before() + (self._phase_s if self.phase is Phase.PLAY else 0.0)

    def hint(self) -> str:
        """What the operator is to do."""
        match self.phase:
            case Phase.READY:
                return self._wish()
            case Phase.PRESS:
                stopped = self._board.state in ("stopped", "release")
                return (
                    "release the trigger"
                    if stopped
                    else "pull the trigger fully and hold it: nothing turns until the run begins"
                )
            case Phase.HOLD:
                short = (
                    f"; it allows {100 * self._board.trigger:.0f} % only: pull it fully"
                    if self._board.trigger < 1.0 - SLACK
                    else ""
                )
                return f"hold the trigger, the run begins{short}"
            case Phase.PLAY:
                return f"{self.course.name}: hold the trigger{self._load_words()}"
        return "release the trigger"

    def _wish(self) -> str:
        """What stands in the way of a leg's beginning."""
        board, way = self._board, "backward" if self.legs[self._leg].reverse else "forward"
        if board is None:
            return "the board is to say how it stands"
        if board.faults:
            return f"the board reports {' and '.join(board.faults)}: release the trigger, remove the cause"
        if board.contact:
            return "release the trigger" + (
                f", then set the direction switch to {way}" if self._leg else ""
            )
        if board.mode != "duty":
            return (
                "turn the mode switch to position 0"
                if self._mode_refused
                else "the board is to go to mode duty"
            )
        if board.reverse != self.legs[self._leg].reverse:
            return f"set the direction switch to {way}"
        if self.session.table is None:
            return "the board is to list its parameters"
        return "the shaft is to stand still" if board.state != "idle" else "hold the trigger"

    def _load_words(self) -> str:
        if not self.course.load:
            return ""
        return f", brake at {100 * np.interp(self._phase_s, *np.array(self.course.load).T):.0f} % of its largest load"

    def remarks(self) -> list[str]:
        """What should be known of a run that was performed."""
        out = []
        if self.limited_to < 1.0:
            least = f"at its least it allowed {100 * self.limited_to:.0f} %"
            out.append(
                f"the trigger limited the run: {least}; the log holds the duty that was driven"
            )
        if self.sent > self.answered:
            out.append(
                f"{self.sent - self.answered} of {self.sent} frames to the board were not answered"
            )
        if self.course.load:
            out.append(
                "the log lacks the brake's torque: add it as the column load_nm before it is diagnosed"
            )
        if self._mode_asked_s >= 0.0:
            out.append("the board stays in mode duty until it starts anew or is told another")
        return out
