"""Lock-step of a board and a tool, one PWM period at a time: sensors between them, and the bytes of
the UART in both directions.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from vgroove.board import (
    CYCLES_PER_PERIOD,
    PERIOD_S,
    SWITCH_CONTACT,
    SWITCH_MODE_SHIFT,
    SWITCH_REVERSE,
    BoardInputs,
    BoardOutputs,
    unpack_answer,
)
from vgroove.errors import refused_by_plant
from vgroove.sil import SilBoard

COMPARE_TOP = 255
# Periods (16.3 ms) of a chunk: stimuli are computed, and the UART is served, once a chunk
CHUNK_PERIODS = 512
# Periods for which a tool's measurements are computed ahead: the firmware changes the duty at most
# once a tick of 1 ms, 31.4 periods
LOOK_AHEAD_PERIODS = 32
BYTE_CYCLES = 640  # 10 bits at 250 kBd
ADC_VOLTS, ADC_COUNTS = 5.0, 1024
# Voltage of the trigger's potentiometer as a share of the ADC reference: at rest, and its increase
# over the full travel
TRAVEL_AT_REST, TRAVEL_SPAN = 0.1, 0.8


class Board(Protocol):
    """AvrBoard or SilBoard."""

    def period(self, inputs: BoardInputs) -> BoardOutputs:
        """One PWM period."""
        ...


class Tool(Protocol):
    """A tool of the plant, or the truth generator of the tests."""

    def period(
        self, coast: bool, duty: float, dead: float, load_nm: float, /
    ) -> tuple[float, float, Sequence[int]]:
        """One PWM period at a duty of -1..1, where `dead` is the share of the bus voltage that dead
        time takes: motor current in A at its end, mean bus voltage in V, CPU cycles 0..509 of the
        Hall edges.
        """
        ...


@dataclass(frozen=True)
class FrontEnds:
    """Scales of the board's analogue front ends (current sensor, voltage divider, temperature
    sensor); the noise is the standard deviation of a single sample before the converter.
    """

    current_a_per_count: float = 0.125
    supply_v_per_count: float = 0.025
    temperature_c: float = 25.0
    current_noise_a: float = 0.0
    supply_noise_v: float = 0.0

    def temperature_counts(self) -> int:
        """TMP36: 500 mV at 0 degC, 10 mV/K."""
        return round((0.5 + 0.01 * self.temperature_c) / ADC_VOLTS * ADC_COUNTS)

    def scales(self) -> tuple[float, float, int]:
        """Counts per A, counts per V, counts of the temperature."""
        return 1 / self.current_a_per_count, 1 / self.supply_v_per_count, self.temperature_counts()


@dataclass(frozen=True)
class Profile:
    """Trigger, switches and load over time. Points are (time_s, value) joined by straight lines; a
    step is two points at one time.

    `travel` 0..1 of the trigger, whose contact closes at `contact_travel` and bounces for
    `bounce_s`; `load_nm` acts at the output. `hall_breaks` are spans (from_s, to_s) in which the
    Hall line is broken; `current_add_a` is added before the current's converter.
    """

    travel: Sequence[tuple[float, float]] = ((0.0, 0.0),)
    reverse: Sequence[tuple[float, float]] = ((0.0, 0.0),)
    load_nm: Sequence[tuple[float, float]] = ((0.0, 0.0),)
    current_add_a: Sequence[tuple[float, float]] = ((0.0, 0.0),)
    hall_breaks: Sequence[tuple[float, float]] = ()
    mode: int = 0
    contact_travel: float = 0.02
    bounce_s: float = 0.0


def interpolate_points(points: Sequence[tuple[float, float]], time_s: np.ndarray) -> np.ndarray:
    """Straight lines between points; at the time of a step the later value holds."""
    times, values = np.array(points, dtype=float).T
    right = np.interp(time_s, times, values)
    last = np.searchsorted(times, time_s, side="right") - 1
    exact = (last >= 0) & (times[np.maximum(last, 0)] == time_s)
    return np.where(exact, values[np.maximum(last, 0)], right)


def step_values(points: Sequence[tuple[float, float]], time_s: np.ndarray) -> np.ndarray:
    """The value of the last point that has passed."""
    times, values = np.array(points, dtype=float).T
    return values[np.maximum(np.searchsorted(times, time_s, side="right") - 1, 0)]


Stimulus = tuple[int, int, float, float, float, bool]  # of one PWM period, as in StimulusChunk


@dataclass
class StimulusChunk:
    """Stimuli of one chunk of n PWM periods, (n,) each: ADC counts of the trigger, switches, load
    in N m, ADC counts added to current and supply, whether the Hall line is broken.
    """

    trigger: np.ndarray
    switches: np.ndarray
    load_nm: np.ndarray
    current_counts: np.ndarray
    supply_counts: np.ndarray
    broken: np.ndarray

    def columns(self) -> tuple[np.ndarray, ...]:
        """The columns in the order in which _core.Stimuli takes them."""
        return (
            self.trigger,
            self.switches,
            self.load_nm,
            self.current_counts,
            self.supply_counts,
            self.broken,
        )

    def periods(self) -> Iterator[Stimulus]:
        """The columns' values period by period."""
        return zip(*(column.tolist() for column in self.columns()), strict=True)


class StimulusSource:
    """Computes a profile as successive StimulusChunks; the same seed gives the same noise."""

    def __init__(self, profile: Profile, front: FrontEnds, seed: int) -> None:
        self.profile, self.front = profile, front
        self.random = np.random.default_rng(seed)
        self.closed = False
        self.bouncing_until = -1.0

    def chunk(self, first: int, count: int) -> StimulusChunk:
        """Periods first .. first + count - 1; chunks must be taken in order."""
        p, front = self.profile, self.front
        time_s = (np.arange(first, first + count) + 1) * PERIOD_S
        travel = np.clip(interpolate_points(p.travel, time_s), 0.0, 1.0)
        noise = self.random.standard_normal((2, count))
        # zero current is 512 counts; 0.5 makes the truncation of counts_of a rounding to nearest
        current = (
            512.5
            + (interpolate_points(p.current_add_a, time_s) + front.current_noise_a * noise[0])
            / front.current_a_per_count
        )
        supply = 0.5 + front.supply_noise_v * noise[1] / front.supply_v_per_count
        broken = np.zeros(count, bool)
        for begin, end in p.hall_breaks:
            broken |= (time_s >= begin) & (time_s < end)
        trigger = np.round((TRAVEL_AT_REST + TRAVEL_SPAN * travel) * (ADC_COUNTS - 1)).astype(
            np.int64
        )
        return StimulusChunk(
            trigger,
            self._switches(travel, time_s).astype(np.int64),
            interpolate_points(p.load_nm, time_s),
            current,
            supply,
            broken,
        )

    def _switches(self, travel: np.ndarray, time_s: np.ndarray) -> np.ndarray:
        contact = travel >= self.profile.contact_travel
        if self.profile.bounce_s > 0:
            contact = self._bounced(contact, time_s)
        reverse = step_values(self.profile.reverse, time_s) > 0.5
        return (
            contact * SWITCH_CONTACT
            + reverse * SWITCH_REVERSE
            + ((self.profile.mode & 3) << SWITCH_MODE_SHIFT)
        )

    def _bounced(self, contact: np.ndarray, time_s: np.ndarray) -> np.ndarray:
        """The contact (n,) with random values for bounce_s after each change."""
        bounced = contact.copy()
        for k, closed in enumerate(contact.tolist()):
            if closed != self.closed:
                self.closed = closed
                self.bouncing_until = float(time_s[k]) + self.profile.bounce_s
            if time_s[k] < self.bouncing_until:
                bounced[k] = self.random.integers(2)
        return bounced


class Line(Protocol):
    """The host's end of the UART, served once a chunk."""

    def send(self, data: bytes) -> None:
        """Bytes from the board."""
        ...

    def receive(self, time_s: float) -> bytes:
        """Bytes for the board up to this time."""
        ...


class Script:
    """Bytes sent to the board at set times, (time_s, bytes)."""

    def __init__(self, messages: Iterable[tuple[float, bytes]] = ()) -> None:
        self._messages = deque(sorted(messages, key=lambda message: message[0]))

    def send(self, data: bytes) -> None:
        """Bytes from the board are dropped."""
        del data

    def receive(self, time_s: float) -> bytes:
        """Messages up to this time."""
        due = bytearray()
        while self._messages and self._messages[0][0] <= time_s:
            due += self._messages.popleft()[1]
        return bytes(due)


class Pacer:
    """Distributes bytes over periods at the rate of a line of 250 kBd."""

    def __init__(self) -> None:
        self._waiting: deque[int] = deque()
        self._credit_cycles = BYTE_CYCLES

    def add(self, data: bytes) -> None:
        """Bytes that the host has sent."""
        self._waiting.extend(data)

    def next(self) -> bytes:
        """The byte whose stop bit ends in this period, or none."""
        self._credit_cycles = min(self._credit_cycles + CYCLES_PER_PERIOD, 2 * BYTE_CYCLES)
        if not self._waiting or self._credit_cycles < BYTE_CYCLES:
            return b""
        self._credit_cycles -= BYTE_CYCLES
        return bytes((self._waiting.popleft(),))

    def take(self, periods: int) -> np.ndarray:
        """next() of as many periods, (n,): the byte or -1."""
        bytes_or_none = np.full(periods, -1, np.int16)
        at = 0
        while at < periods and self._waiting:
            byte = self.next()
            bytes_or_none[at] = byte[0] if byte else -1
            at += 1
        self._credit_cycles = min(
            self._credit_cycles + (periods - at) * CYCLES_PER_PERIOD, 2 * BYTE_CYCLES
        )
        return bytes_or_none


@dataclass
class Progress:
    """Progress of a run: bytes that the board has sent, periods done, and the board's last
    outputs.
    """

    sent: bytearray = field(default_factory=bytearray)
    periods: int = 0
    gates: BoardOutputs = BoardOutputs(True, 0, 0, b"")

    @property
    def time_s(self) -> float:
        """Simulated time."""
        return self.periods * PERIOD_S


def counts_of(value: float) -> int:
    """ADC counts of a value in counts, truncated and clipped."""
    return 0 if value < 0 else ADC_COUNTS - 1 if value >= ADC_COUNTS else int(value)


@dataclass
class _Run:
    """Board and tool of a run, and the sensors and the line between them."""

    board: Board
    tool: Tool
    front: FrontEnds
    pacer: Pacer
    truth: Any = None


RunChunk = Callable[[_Run, StimulusChunk, Progress], None]


def _chunk_loop(board: Board, tool: Tool) -> RunChunk:
    """The fastest loop for this board and tool; all of them give the same bytes. A board that has
    periods() (AvrBoard) may be asked for several periods at once; one that changes what period()
    does must change periods() too.
    """
    from vgroove import _core

    if type(tool) not in (_core.DrivePlant, _core.ImpactPlant, _core.DrillPlant):
        return _run_chunk
    if type(board) is SilBoard:
        return _run_chunk_native
    return _run_chunk_ahead if getattr(board, "periods", None) else _run_chunk


def _core_stimuli(run: _Run, stimuli: StimulusChunk) -> Any:
    from vgroove import _core

    received = run.pacer.take(len(stimuli.trigger))
    return _core.Stimuli(*stimuli.columns(), received, run.front.scales())


def _run_chunk_native(run: _Run, stimuli: StimulusChunk, progress: Progress) -> None:
    """Board and tool are in this process: the loop runs in C++."""
    from vgroove import _core

    machine, chunk = run.board.machine, _core_stimuli(run, stimuli)
    progress.sent += _core.run_lockstep(machine, run.tool, chunk, progress.gates[:3], run.truth)
    progress.gates = BoardOutputs(machine.coast, machine.compare, machine.dead_counts, machine.tx)


def _run_chunk_ahead(run: _Run, stimuli: StimulusChunk, progress: Progress) -> None:
    """The board is another process, with which an exchange takes longer than a period of either:
    the tool's measurements are computed ahead, for the gates in force, and hold until the board
    changes these.
    """
    from vgroove import _core

    chunk, count, at = _core_stimuli(run, stimuli), len(stimuli.trigger), 0
    while at < count:
        gates = progress.gates[:3]
        ahead = _core.look_ahead(run.tool, chunk, gates, at, LOOK_AHEAD_PERIODS)
        outputs = unpack_answer(run.board.periods(ahead))
        _core.advance_tool(run.tool, chunk, gates, at, len(outputs), run.truth)
        progress.sent += b"".join(output.tx for output in outputs)
        progress.gates = outputs[-1]
        at += len(outputs)


def _run_chunk(run: _Run, stimuli: StimulusChunk, progress: Progress) -> None:
    board, tool, pacer, truth = run.board, run.tool, run.pacer, run.truth
    per_ampere, per_volt, temperature = run.front.scales()
    coast, compare, dead_counts, _ = progress.gates
    sent = progress.sent
    for trigger, switches, load_nm, current_counts, supply_counts, broken in stimuli.periods():
        dead = (
            dead_counts / (2 * COMPARE_TOP)
            if 0 < compare < COMPARE_TOP or -COMPARE_TOP < compare < 0
            else 0.0
        )
        current, supply, edges = tool.period(coast, compare / COMPARE_TOP, dead, load_nm)
        if truth is not None:
            truth.note(tool, coast, compare)
        counts = (
            counts_of(current * per_ampere + current_counts),
            counts_of(supply * per_volt + supply_counts),
            trigger,
            temperature,
        )
        gates = board.period(BoardInputs(counts, () if broken else edges, switches, pacer.next()))
        coast, compare, dead_counts, tx = gates
        if tx:
            sent += tx
    progress.gates = gates


@dataclass(frozen=True)
class LockstepOptions:
    """What a lock-step run may have besides board, tool, profile and duration.

    front: the board's front ends; line: the serial line's other end; seed: of the sensors' noise;
    truth: a vgroove._core.Truth that records the true values of a tool of the plant; on_progress:
    called after each chunk, by run() alone.
    """

    front: FrontEnds | None = None
    line: Line | None = None
    seed: int = 1
    truth: Any = None
    on_progress: Callable[[Progress], None] | None = None


DEFAULT_OPTIONS = LockstepOptions()


def steps(
    board: Board,
    tool: Tool,
    profile: Profile,
    duration_s: float,
    options: LockstepOptions = DEFAULT_OPTIONS,
) -> Iterator[Progress]:
    """Run board and tool in lock-step from rest and yield after each chunk; Progress.sent holds all
    bytes that the board has sent.

    With a tool of the plant the loop is a faster one, with the same bytes (_chunk_loop).
    """
    front, line = options.front or FrontEnds(), options.line or Script()
    stimulus, progress = StimulusSource(profile, front, options.seed), Progress()
    parts = _Run(board, tool, front, Pacer(), options.truth)
    run_chunk = _chunk_loop(board, tool)
    periods = round(duration_s / PERIOD_S)
    while progress.periods < periods:
        count = min(CHUNK_PERIODS, periods - progress.periods)
        parts.pacer.add(line.receive(progress.time_s))
        before = len(progress.sent)
        with refused_by_plant(f"after {progress.time_s:.3f} s of lock-step"):
            run_chunk(parts, stimulus.chunk(progress.periods, count), progress)
        progress.periods += count
        line.send(bytes(progress.sent[before:]))
        yield progress


def run(
    board: Board,
    tool: Tool,
    profile: Profile,
    duration_s: float,
    options: LockstepOptions = DEFAULT_OPTIONS,
) -> bytes:
    """Run to the end; returns the bytes that the board sent. Same arguments, same bytes."""
    progress = Progress()
    for progress in steps(board, tool, profile, duration_s, options):
        if options.on_progress:
            options.on_progress(progress)
    return bytes(progress.sent)
