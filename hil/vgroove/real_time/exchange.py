"""The exchange with a board in real time: a bridge command in, the inputs of the tick after the
next out. The board's timer sets the pace; the host answers.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from vgroove.errors import VgrooveError
from vgroove.real_time.board_clock import BoardClock
from vgroove.real_time.frames import (
    DRIVE,
    SENSE_A,
    TICK_S,
    Drive,
    TickInputs,
    drive_of,
    sense_frames,
)
from vgroove.real_time.link import Link, RunEnded
from vgroove.real_time.pauses import Pauses, watch_pauses
from vgroove.real_time.priority import undisturbed
from vgroove.real_time.tool_ticks import ToolTicks
from vgroove.telemetry import Counters, Frame, frame_bytes, frame_of

START_S = 3.0  # in which a board begins a run
START_AGAIN_S = 0.05
WAIT_S = 1e-3
SEND_AGAIN_TICKS = 2.5  # of the board without an answer: inputs or answer are lost
SILENT_S = 1.0
COMPLETE = "complete"
AHEAD = 2  # a command acts from the next tick on: the inputs that follow are of the one after it


@dataclass(frozen=True)
class Exchange:
    """One tick: when the host received the board's command and sent the inputs of tick + 2 (host
    clock, s), the execution time of the tool's step, the board's clock (s) when the tick began.
    """

    tick: int
    received_s: float
    sent_s: float
    step_s: float
    board_s: float


@dataclass
class RealTimeRun:
    """What a run has received: exchanges in the order of ticks, the telemetry's bytes, damage, how
    often inputs were sent again, and the ticks after which the board opened the bridge because
    inputs were missing. `pauses` is None where they were not watched. `planned`: number of
    exchanges of the whole run; `ended`: why the run ended.
    """

    exchanges: list[Exchange] = field(default_factory=list)
    telemetry: bytearray = field(default_factory=bytearray)
    counters: Counters = field(default_factory=Counters)
    sent_again: int = 0
    safe_ticks: list[int] = field(default_factory=list)
    prioritised: bool = False
    pauses: Pauses | None = None
    planned: int = 0
    ended: str = COMPLETE


class _Host:
    """The host's side of one run."""

    def __init__(self, link: Link, tool: ToolTicks, ticks: int, run: RealTimeRun) -> None:
        self._link, self._tool, self._ticks, self._run = link, tool, ticks, run
        self._sent: dict[int, list[Frame]] = {}  # inputs of the ticks that are under way
        self._early: dict[int, Drive] = {}  # commands whose predecessor is lost
        self._clock = BoardClock()
        self._next = 1

    def start(self) -> None:
        """Begin a run on the board; what it sent before belongs to an earlier one."""
        self._first = [self._tool.inputs(tick) for tick in range(1, AHEAD + 1)]
        deadline, again_s = time.monotonic() + START_S, 0.0
        while (now := time.monotonic()) < deadline:
            if now >= again_s:
                again_s = now + START_AGAIN_S
                self._link.send([frame_of(0, SENSE_A, bytes(7))])
            for frame in self._link.receive(WAIT_S):
                if frame.id == DRIVE and frame.time_ms == 0 and not drive_of(frame).idle:
                    return
        raise self._no_board()

    def _no_board(self) -> VgrooveError:
        counters = self._link.counters
        if counters.frames:
            return VgrooveError(
                f"{self._link.name}: the board sends frames ({counters.frames} intact) but begins "
                "no run: flash the build for real-time runs (docs/hil.md), or check the line from "
                "the host to the board."
            )
        return VgrooveError(
            f"{self._link.name}: no answer within {START_S:g} s ({counters.bytes} bytes, no intact "
            "frame): is the board powered, and does it run the build for real-time runs "
            "(docs/hil.md)?"
        )

    def run(self, progress: Callable[[int], None]) -> None:
        """Exchange until the last tick's command has arrived."""
        for inputs in self._first:
            self._send(inputs)
        moved_s = sent_s = time.monotonic()
        while self._next <= self._ticks:
            before = self._next
            for frame in self._link.receive(WAIT_S):
                self._take(frame)
            now = time.monotonic()
            if self._next > before:
                moved_s = sent_s = now
                if self._next // 100 != before // 100:
                    progress(self._next)
            elif now - moved_s > SILENT_S:
                raise RunEnded(
                    f"{self._link.name}: the board has sent no command since tick "
                    f"{self._next - 1} ({SILENT_S:g} s ago): check line and power; what was "
                    "received until then is kept",
                    "board silent",
                )
            elif now - sent_s > SEND_AGAIN_TICKS * self._tick_s():
                sent_s = now
                self._send_again()

    def _tick_s(self) -> float:
        """Time of the host's clock in which the board's advances by one tick."""
        exchanges = self._run.exchanges
        if len(exchanges) < 2 or exchanges[-1].board_s <= exchanges[0].board_s:
            return 10 * TICK_S
        host_s = exchanges[-1].received_s - exchanges[0].received_s
        return TICK_S * host_s / (exchanges[-1].board_s - exchanges[0].board_s)

    def _take(self, frame: Frame) -> None:
        received_s = time.monotonic()
        if frame.id != DRIVE:
            self._run.telemetry += frame_bytes(frame)
            return
        drive = drive_of(frame)
        if drive.idle:
            raise RunEnded(
                f"{self._link.name}: the board has restarted after tick {self._next - 1}: check "
                "its supply and its reset wire; what was received until then is kept",
                "board restarted",
            )
        if drive.safe and drive.tick not in self._run.safe_ticks:
            self._run.safe_ticks.append(drive.tick)
        if drive.tick > self._next:
            self._early[drive.tick] = drive
            self._send_again()
        while drive is not None and drive.tick == self._next:
            self._answer(drive, received_s)
            drive = self._early.pop(self._next, None)

    def _answer(self, drive: Drive, received_s: float) -> None:
        """Simulate the tool with a new command and send the inputs that follow from it."""
        begin = time.perf_counter()
        self._tool.add_command(drive)
        self._sent.pop(drive.tick, None)
        inputs = self._tool.inputs(drive.tick + AHEAD)
        step_s = time.perf_counter() - begin
        sent_s = time.monotonic()
        self._send(inputs)
        board_s = self._board_s(drive, received_s)
        self._run.exchanges.append(Exchange(drive.tick, received_s, sent_s, step_s, board_s))
        self._next = drive.tick + 1
        self._tool.prepare()

    def _board_s(self, drive: Drive, received_s: float) -> float:
        exchanges, safe = self._run.exchanges, self._run.safe_ticks
        waited = drive.tick - 1 in safe[-2:]
        sent_s = exchanges[-AHEAD].sent_s if len(exchanges) >= AHEAD else received_s
        return self._clock.seconds(drive, waited, sent_s, received_s)

    def _send(self, inputs: TickInputs) -> None:
        commands = self._tool.command_frames(inputs.tick)
        frames = sense_frames(inputs)
        self._sent[inputs.tick] = frames
        self._link.send([*commands, *frames])

    def _send_again(self) -> None:
        """Send the inputs that are under way once more; the board drops what it has."""
        self._run.sent_again += 1
        self._link.send([frame for tick in sorted(self._sent) for frame in self._sent[tick]])


def run_in_real_time(
    link: Link,
    tool: ToolTicks,
    ticks: int,
    run: RealTimeRun,
    progress: Callable[[int], None] = lambda _: None,
) -> None:
    """Run a tool of ToolTicks for a number of ticks (ms) against a board; `run` receives the
    result, also where the run ends early. VgrooveError: no board, the line is lost, the board is
    silent or has restarted.
    """
    host = _Host(link, tool, ticks, run)
    run.counters, run.planned = link.counters, ticks
    with watch_pauses() as run.pauses:
        host.start()
        link.counters.__init__()
        with undisturbed() as run.prioritised:
            host.run(progress)
