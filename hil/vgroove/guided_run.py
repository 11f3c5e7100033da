"""A run that the diagnosis can propose (gap/next_run/menu.py), performed on a board: commands the
duty by PROFILE frames and instructs the operator, who holds the trigger.

    PREPARE --> PRESS <--> HOLD --> DRIVE --> COAST --> ENDED
       ^                              |
       +---------- next leg ----------+

PREPARE  no frames are sent; conditions: trigger released, mode duty, direction of the leg, shaft at
         rest, parameters received
PRESS    duty 0 is commanded, so that nothing turns when the trigger is pulled
HOLD     the trigger is held; the run begins after HOLD_S
DRIVE    the duties of the leg are commanded; whatever ends the board's drive ends the run
COAST    no frames are sent and the board opens its bridge; recorded for COAST_S

All times are the board's: without its telemetry no frame is sent, and the board ends the drive by
itself.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum, auto

import numpy as np

from vgroove import telemetry
from vgroove.gap.next_run.menu import RunProfile
from vgroove.profile_sender import PERIOD_S, ProfileSender
from vgroove.recorder import MAX_SILENCE_S, RUN_COMPLETE, HostProgram
from vgroove.run_legs import legs_of

HOLD_S = 1.0
COAST_S = 0.5
TIMEOUT_S = 120.0  # for the operator in each leg: PREPARE, PRESS and HOLD together
# Unanswered frames in succession: those of 0.5 s, which is less than HOLD_S, so that no run begins
# on a line on which the board receives nothing.
MAX_UNANSWERED = 25
MODE_INTERVAL_S = 1.0  # between two requests of mode duty
MAX_TIME_STEP_MS = 1000  # a frame whose time is further ahead of the last one is damaged
TRIGGER_MARGIN = 0.02  # the trigger limits a commanded duty that exceeds its travel by more
RELEASE_S = 0.2  # longest time in which a hand releases the trigger
NO_ANSWER = (
    "the board sends telemetry but has answered no command for half a second: "
    "check the line to its RX pin"
)
REFUSALS = {
    "unknown_id": "the board's firmware has no PROFILE frames: flash the firmware of this version",
    "not_now": "the board performs a run in mode duty only: turn the mode switch to position 0",
}


class Phase(Enum):
    """Phases of a run."""

    PREPARE = auto()
    PRESS = auto()
    HOLD = auto()
    DRIVE = auto()
    COAST = auto()
    ENDED = auto()


OPERATOR_PHASES = (Phase.PREPARE, Phase.PRESS, Phase.HOLD)  # each waits for the operator
SENDING_PHASES = (Phase.PRESS, Phase.HOLD, Phase.DRIVE)


@dataclass(frozen=True)
class BoardState:
    """Content of a STATE frame."""

    state: str
    mode: str
    reverse: bool
    contact: bool
    trigger: float
    faults: tuple[str, ...]

    @classmethod
    def of(cls, frame: telemetry.Frame) -> "BoardState":
        """The content of a STATE frame."""
        values = telemetry.decode(frame)
        state = telemetry.value_table("STATE", "state")[int(values["state"])]
        mode = telemetry.value_table("STATE", "mode")[int(values["mode"])]
        bits = telemetry.value_table("STATE", "faults").items()
        faults = tuple(name for bit, name in bits if int(values["faults"]) & bit)
        reverse, contact = values["reverse"] != 0, values["contact"] != 0
        return cls(state, mode, reverse, contact, values["trigger"], faults)


@dataclass
class GuidedRun(HostProgram):
    """A run in progress; `session` is that of its recording, whose rows begin with the first leg.

    `sent` and `answered` count PROFILE frames.
    """

    profile: RunProfile
    session: telemetry.Session
    phase: Phase = Phase.PREPARE
    ended: str = ""
    started: bool = False
    sent: int = 0
    answered: int = 0
    unanswered: int = 0  # PROFILE frames since the last answer
    least_trigger: float = 1.0  # smallest trigger travel at which it limited the commanded duty
    max_silence_s = MAX_SILENCE_S
    # board time and travel at which the trigger limited the duty in the last RELEASE_S
    _limits: deque[tuple[float, float]] = field(default_factory=deque)
    _board: BoardState | None = None
    _now_ms: int | None = None
    _phase_since_s: float = 0.0
    _operator_since_s: float | None = None  # board time at which the operator's TIMEOUT_S began
    _leg: int = 0
    _duties: np.ndarray = field(default_factory=lambda: np.zeros(0))
    _sender: ProfileSender | None = None
    _mode_requested_s: float = -MODE_INTERVAL_S
    _mode_refused: bool = False

    def __post_init__(self) -> None:
        self.legs = legs_of(self.profile)

    def select(self, frames: Sequence[telemetry.Frame]) -> list[telemetry.Frame]:
        """Take note of the board's frames; those of FAST are recorded once the run has started."""
        for frame in frames:
            self._follow_time(frame.time_ms)
            if frame.id == telemetry.STATE:
                self._board = BoardState.of(frame)
            elif frame.id == telemetry.ACK:
                self._add_answer(frame)
        return [frame for frame in frames if self.started or frame.id != telemetry.FAST]

    def _follow_time(self, time_ms: int) -> None:
        if self._now_ms is None:
            self._now_ms = time_ms
            return
        step_ms = (time_ms - self._now_ms) & 0xFFFFFFFF
        plausible = step_ms <= MAX_TIME_STEP_MS or self.phase is Phase.PREPARE
        self._now_ms += step_ms if plausible else 0

    def _add_answer(self, frame: telemetry.Frame) -> None:
        ack = telemetry.decode_integers(frame)
        result = telemetry.value_table("ACK", "ack_result").get(ack["ack_result"], "")
        if ack["ack_command"] == telemetry.SET_MODE:
            self._mode_refused = result != "ok"
        elif ack["ack_command"] == telemetry.PROFILE:
            self.answered, self.unanswered = self.answered + 1, 0
            if result in REFUSALS and self.phase in SENDING_PHASES:
                self._end(REFUSALS[result])

    def next_bytes(self) -> bytes:
        """Enter the phase that follows and return the bytes to send."""
        if self._now_ms is None or self.ended:
            return b""
        if self._operator_since_s is None:
            self._operator_since_s = self._now_s
        following = self._next_phase()
        if following is not self.phase:
            self._enter(following)
        if self.phase is Phase.DRIVE:
            self._note_trigger_limit()
        return self._mode_request() if self.phase is Phase.PREPARE else self._profile_frame()

    @property
    def _now_s(self) -> float:
        return (self._now_ms or 0) / 1000

    @property
    def _phase_s(self) -> float:
        return self._now_s - self._phase_since_s

    def _drives(self) -> bool:
        return self._board is not None and self._board.state == "drive"

    def _note_trigger_limit(self) -> None:
        """Record a trigger travel below the commanded duty in least_trigger once the drive has gone
        on for RELEASE_S: a hand that releases the trigger passes such travels too, and then the
        drive ends.
        """
        if self._board.trigger < self._duty_now() - TRIGGER_MARGIN:
            self._limits.append((self._now_s, self._board.trigger))
        while self._limits and self._limits[0][0] <= self._now_s - RELEASE_S:
            self.least_trigger = min(self.least_trigger, self._limits.popleft()[1])

    def _mode_and_direction_match(self) -> bool:
        """Whether the board is in mode duty and in the direction of the leg, without faults."""
        board = self._board
        return (
            board is not None
            and board.mode == "duty"
            and board.reverse == self.legs[self._leg].reverse
            and not board.faults
        )

    def _next_phase(self) -> Phase:
        """The phase that follows from the state of the board."""
        operator_s = self._now_s - (self._operator_since_s or 0.0)
        timed_out = self.phase in OPERATOR_PHASES and operator_s > TIMEOUT_S
        if timed_out or self.unanswered > MAX_UNANSWERED:
            return Phase.ENDED
        match self.phase:
            case Phase.PREPARE:
                return self._after_prepare()
            case Phase.PRESS:
                if self._drives():
                    return Phase.HOLD
                return Phase.PRESS if self._mode_and_direction_match() else Phase.PREPARE
            case Phase.HOLD:
                if not self._drives():
                    return Phase.PRESS
                return Phase.DRIVE if self._phase_s >= HOLD_S else Phase.HOLD
            case Phase.DRIVE:
                return self._after_drive()
            case Phase.COAST:
                return Phase.ENDED if self._phase_s >= COAST_S else Phase.COAST
        return Phase.ENDED

    def _after_prepare(self) -> Phase:
        ready = (
            self._mode_and_direction_match()
            and self._board.state == "idle"
            and not self._board.contact
            and self.session.table is not None
        )
        return Phase.PRESS if ready else Phase.PREPARE

    def _after_drive(self) -> Phase:
        if self._phase_s >= self.legs[self._leg].duration_s:
            return Phase.COAST if self._leg + 1 == len(self.legs) else Phase.PREPARE
        return Phase.DRIVE if self._drives() else Phase.ENDED

    def _enter(self, phase: Phase) -> None:
        before, self.phase = self.phase, phase
        self._phase_since_s, phase_s = self._now_s, self._phase_s
        if phase is Phase.ENDED:
            self._end(self._reason(before, phase_s))
        elif phase is Phase.PRESS:
            self._sender = ProfileSender(lambda _: 0.0, TIMEOUT_S + HOLD_S, self._now_s)
        elif phase is Phase.DRIVE:
            self._begin_leg()
        elif phase is Phase.PREPARE and before is Phase.DRIVE:
            self._leg, self._operator_since_s = self._leg + 1, self._now_s

    def _begin_leg(self) -> None:
        leg = self.legs[self._leg]
        names = [parameter.name for parameter in telemetry.parameter_list()]
        slew_per_ms_q15 = self.session.parameters[names.index("slew_per_ms_q15")]
        self._duties = leg.slewed(slew_per_ms_q15 / 2**15 * 1000)
        self._sender = ProfileSender(
            lambda t: float(self._duties[round(t / PERIOD_S)]), leg.duration_s, self._now_s
        )
        if not self.started:
            self.started, self.session.first_ms = True, self.session.last_ms

    def _duty_now(self) -> float:
        return float(self._duties[min(int(self._phase_s / PERIOD_S), len(self._duties) - 1)])

    def _profile_frame(self) -> bytes:
        if self.phase not in SENDING_PHASES:
            return b""
        frame = self._sender.due(self._now_s)
        self.sent += len(frame) > 0
        self.unanswered += len(frame) > 0
        return frame

    def _mode_request(self) -> bytes:
        """A request of mode duty where the board stands still in another mode."""
        board = self._board
        wanted = (
            board is not None
            and board.state == "idle"
            and not board.contact
            and board.mode != "duty"
        )
        if not wanted or self._now_s - self._mode_requested_s < MODE_INTERVAL_S:
            return b""
        self._mode_requested_s = self._now_s
        return telemetry.frame_bytes(
            telemetry.frame_of_signals("SET_MODE", self._now_ms & 0xFFFFFFFF, mode_request=0)
        )

    def _end(self, reason: str) -> None:
        self.phase, self.ended = Phase.ENDED, reason

    def _reason(self, before: Phase, phase_s: float) -> str:
        """Why the run has ended, from the phase that was left after `phase_s`."""
        if before is Phase.COAST:
            return RUN_COMPLETE
        if self.unanswered > MAX_UNANSWERED:
            return NO_ANSWER
        if before in OPERATOR_PHASES:
            return f"not done within {TIMEOUT_S:g} s: {self._missing_condition()}"
        at = f"{self._earlier_legs_s() + phase_s:.1f} s into the run of {self.total_s:.1f} s"
        if self._board.faults:
            return f"the board reports {' and '.join(self._board.faults)}, {at}"
        if self._board.state == "stopped":
            lost = "the board received none for 50 ms and ended the drive"
            return f"frames were lost on the line: {lost}, {at}"
        moved = "direction switch was moved" if self._board.contact else "trigger was released"
        return f"the {moved}, {at}"

    @property
    def total_s(self) -> float:
        """Length of all legs."""
        return sum(leg.duration_s for leg in self.legs)

    def _earlier_legs_s(self) -> float:
        return sum(leg.duration_s for leg in self.legs[: self._leg])

    @property
    def driven_s(self) -> float:
        """Length of the run that has been driven."""
        return self._earlier_legs_s() + (self._phase_s if self.phase is Phase.DRIVE else 0.0)

    def instruction(self) -> str:
        """What the operator is to do."""
        match self.phase:
            case Phase.PREPARE:
                return self._missing_condition()
            case Phase.PRESS:
                if self._board.state in ("stopped", "release"):
                    return "release the trigger"
                return "pull the trigger fully and hold it: nothing turns until the run begins"
            case Phase.HOLD:
                return f"hold the trigger, the run begins{self._trigger_limit()}"
            case Phase.DRIVE:
                return f"{self.profile.name}: hold the trigger{self._brake_setting()}"
        return "release the trigger"

    def _missing_condition(self) -> str:
        """The first condition that a leg still needs to begin, as an instruction."""
        board, direction = self._board, "backward" if self.legs[self._leg].reverse else "forward"
        if board is None:
            return "wait: the board has sent no STATE frame yet"
        if board.faults:
            faults = " and ".join(board.faults)
            return f"the board reports {faults}: release the trigger, remove the cause"
        if board.contact:
            switch = f", then set the direction switch to {direction}" if self._leg else ""
            return "release the trigger" + switch
        if board.mode != "duty" and self._mode_refused:
            return "turn the mode switch to position 0"
        if board.mode != "duty":
            return "wait: the board changes to mode duty"
        if board.reverse != self.legs[self._leg].reverse:
            return f"set the direction switch to {direction}"
        if self.session.table is None:
            return "wait: the board sends its parameters"
        return "wait: the shaft comes to rest" if board.state != "idle" else "hold the trigger"

    def _trigger_limit(self) -> str:
        if self._board.trigger >= 1.0 - TRIGGER_MARGIN:
            return ""
        return f"; it allows {100 * self._board.trigger:.0f} % only: pull it fully"

    def _brake_setting(self) -> str:
        if not self.profile.load:
            return ""
        share = np.interp(self._phase_s, *np.array(self.profile.load).T)
        return f", brake at {100 * share:.0f} % of its largest load"

    def remarks(self) -> list[str]:
        """Remarks for the user on the run that was performed."""
        out = []
        if self.least_trigger < 1.0:
            least = f"it allowed a duty of only {100 * self.least_trigger:.0f} %"
            kept = "the log holds the duty that was driven"
            out.append(f"the trigger limited the run: at one time {least}; {kept}")
        missing = self.sent - self.answered
        if missing > 0:
            out.append(f"{missing} of {self.sent} frames to the board were not answered")
        if self.profile.load:
            out.append(
                "the log lacks the brake's torque: add it as the column load_nm before diagnosing"
            )
        if self._mode_requested_s >= 0.0:
            out.append("the board stays in mode duty until it restarts or another mode is set")
        return out
