"""Replays recorded inputs through filters and controllers, with fixed point and with floating point
of the same source, on this computer and on the simulated AVR (docs/fixed_point.md).
"""

import json
import struct
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vgroove import lockstep
from vgroove.board import AvrBoard, BoardInputs
from vgroove.errors import VgrooveError
from vgroove.scenario import Scenario, command_messages, make_plant
from vgroove.sil import SilBoard

FIXED, DOUBLE = "fixed", "double"
# SimTick of firmware/hal/sim/sim.h
TICK = np.dtype(
    [
        ("time_ms", "<u4"),
        ("stamps", "<u2", 4),
        ("current_sum", "<u2"),
        ("current_offset_q4", "<u2"),
        ("current_gain_a_q15", "<u2"),
        ("stamp_count", "u1"),
        ("current_count", "u1"),
        ("current_a_q9", "<i2"),
        ("speed_rpm_q1", "<i2"),
        ("controlled", "u1"),
        ("mode", "u1"),
        ("state", "u1"),
        ("stop_reason", "u1"),
        ("travel_q15", "<i2"),
        ("in_speed_rpm_q1", "<i2"),
        ("in_current_a_q9", "<i2"),
        ("duty_q15", "<i2"),
        ("trigger_q15", "<i2"),
        ("supply_mv", "<u2"),
        ("coasted", "u1"),
        ("edges", "u1"),
        ("requested_q15", "<i2"),
        ("estimate", "<i2"),
        ("blow_count", "<u2"),
        ("set", "<i2", 10),
        ("blow_set", "<u2", 4),
    ]
)
_STEP = struct.Struct("<5hHBB")
_FILTER = struct.Struct("<8s3HBB")
# Columns of an answer to a step, and to a filter's tick
REQUESTED, ESTIMATE, STATE, STOP_REASON, BLOWS = range(5)
CURRENT, SPEED = range(2)
ANSWER_COLUMNS = 5
AVR_SCALE = 256.0  # an AVR's answer is in 1/256 of the format's step
STEP_ANSWER, FILTER_ANSWER = struct.Struct("<iBB"), struct.Struct("<ii")
BYTES_PER_PERIOD = 2  # the receiver's buffer holds two
MAX_PERIODS = 5000  # (0.16 s) in which a step must be answered
REST = BoardInputs((512, 720, 102, 154))


@dataclass(frozen=True)
class Records:
    """Records for the replay: each a letter and its content."""

    parts: tuple[bytes, ...]

    @property
    def stream(self) -> bytes:
        """All records in succession."""
        return b"".join(self.parts)


def record_ticks(scenario: Scenario) -> np.ndarray:
    """What filters and controller take and give in each tick of a scenario on the native firmware:
    an array of TICK.
    """
    board, tool = SilBoard(), make_plant(scenario.tool, scenario.seed)
    line = lockstep.Script(command_messages(scenario.commands))
    options = lockstep.LockstepOptions(front=scenario.front_ends(), line=line, seed=scenario.seed)
    lockstep.run(board, tool, scenario.profile, scenario.duration_s, options)
    return np.frombuffer(board.machine.ticks, TICK)


def control_records(ticks: np.ndarray) -> Records:
    """The controller's starts and steps: one step for each tick with `controlled`."""
    parts, before = [], False
    for tick in ticks:
        if tick["controlled"]:
            if not before:
                setpoints = tick["set"].tobytes() + tick["blow_set"].tobytes()
                parts.append(b"S" + bytes([tick["mode"]]) + setpoints)
            values = [
                tick[name]
                for name in (
                    "travel_q15",
                    "in_speed_rpm_q1",
                    "in_current_a_q9",
                    "duty_q15",
                    "trigger_q15",
                    "supply_mv",
                    "coasted",
                    "edges",
                )
            ]
            parts.append(b"T" + _STEP.pack(*values))
        before = bool(tick["controlled"])
    return Records(tuple(parts))


def filter_records(ticks: np.ndarray) -> Records:
    """The inputs of the filters, a record for each tick."""
    names = ("current_sum", "current_offset_q4", "current_gain_a_q15")
    counts = ("stamp_count", "current_count")
    return Records(
        tuple(
            b"F" + _FILTER.pack(tick["stamps"].tobytes(), *(tick[n] for n in (*names, *counts)))
            for tick in ticks
        )
    )


def _program(kind: str) -> Path:
    path = Path(__file__).resolve().parents[3] / "build/dev/hil/fixed_point" / f"replay-{kind}"
    if not path.is_file():
        raise VgrooveError(f"there is no {path}: build it with `make build`")
    return path


def _run(kind: str, records: Records, *options: str) -> bytes:
    done = subprocess.run(
        [str(_program(kind)), *options], input=records.stream, capture_output=True, check=False
    )
    if done.returncode != 0:
        raise VgrooveError(f"the replay has failed: {done.stderr.decode().strip()}")
    return done.stdout


def replay(kind: str, records: Records) -> np.ndarray:
    """Answers (n, ANSWER_COLUMNS) to all steps or filter ticks, in the steps of their formats."""
    return np.frombuffer(_run(kind, records)).reshape(-1, ANSWER_COLUMNS)


def native_ns(kind: str, records: Records, repeats: int) -> float:
    """Time of one step on this computer in ns, the least of three runs; reading a record is part of
    it.
    """
    runs = [float(_run(kind, records, "--repeat", str(repeats))) for _ in range(3)]
    return min(runs)


@dataclass(frozen=True)
class AvrReplay:
    """Answers of the simulated AVR as those of `replay` (without BLOWS), and the cycles of a step:
    mean and worst.
    """

    answers: np.ndarray
    mean_cycles: float
    worst_cycles: int


def _elf(kind: str) -> Path:
    return Path(__file__).resolve().parents[3] / "build/avr-mega" / f"replay_{kind}.elf"


class _Line:
    """The serial line of a board that replays records."""

    def __init__(self, board: AvrBoard) -> None:
        self._board, self._received = board, bytearray()

    def receive(self, count: int) -> bytes:
        """The next bytes of the board."""
        for _ in range(MAX_PERIODS):
            if len(self._received) >= count:
                break
            self._received += self._board.period(REST).tx
        else:
            raise VgrooveError("the replay on the simulated AVR does not answer")
        taken = bytes(self._received[:count])
        del self._received[:count]
        return taken

    def send(self, data: bytes) -> None:
        """Bytes to the board, as fast as its receiver takes them."""
        for at in range(0, len(data), BYTES_PER_PERIOD):
            sent = self._board.period(REST._replace(rx=data[at : at + BYTES_PER_PERIOD]))
            self._received += sent.tx


def replay_on_avr(kind: str, records: Records) -> AvrReplay:
    """Replay records on the simulated ATmega2560."""
    answers = []
    with tempfile.TemporaryDirectory() as folder:
        stats = Path(folder) / "stats.json"
        with AvrBoard(_elf(kind), mcu="atmega2560", stats=stats) as board:
            line = _Line(board)
            for record in records.parts:
                assert line.receive(1) == b">"
                line.send(record)
                answers += _avr_answer(line, record[:1])
            line.receive(1)
        control = json.loads(stats.read_text())["control"]
    return AvrReplay(np.array(answers), control["mean_cycles"], control["worst_cycles"])


def _avr_answer(line: _Line, kind: bytes) -> list[list[float]]:
    if kind == b"T":
        requested, state, reason = STEP_ANSWER.unpack(line.receive(STEP_ANSWER.size))
        return [[requested / AVR_SCALE, np.nan, state, reason, np.nan]]
    if kind == b"F":
        values = FILTER_ANSWER.unpack(line.receive(FILTER_ANSWER.size))
        return [[*(value / AVR_SCALE for value in values), np.nan, np.nan, np.nan]]
    return []
