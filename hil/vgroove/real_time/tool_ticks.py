"""The simulated tool, one tick of the firmware after the other: which PWM periods, ADC samples and
Hall edges belong to a tick (docs/architecture.md, "Time on the board"), as in lock-step.
"""

import struct
from collections import deque

from vgroove import lockstep
from vgroove.board import BUS, CURRENT, CYCLES_PER_PERIOD, TEMPERATURE, TRIGGER
from vgroove.errors import VgrooveError, refused_by_plant
from vgroove.real_time.frames import EDGES_MAX, Drive, TickInputs
from vgroove.scenario import Scenario, command_messages, make_plant
from vgroove.telemetry import FRAME_BYTES, LENGTH, Frame

# Cycles after the common start of the timers, firmware/hal/hal.h
CYCLES_PER_TICK = 16_000
FIRST_TOP_CYCLES = 255
CYCLES_PER_SAMPLE = 2_040
FIRST_SAMPLE_CYCLES = 2_241
LATENCY_CYCLES = 319
APPLY_LATER_CYCLES = 256
CAPTURE_CYCLES = 4  # of the noise canceller
RECEIVE_CYCLE = 128
PERIODS_PER_SAMPLE = 4
# Channels of the ADC's 16 slots, firmware/drivers/adc_sequence.c
SLOTS = (CURRENT, CURRENT, BUS, CURRENT, CURRENT, CURRENT, TRIGGER, CURRENT) + (
    CURRENT,
    CURRENT,
    BUS,
    CURRENT,
    CURRENT,
    CURRENT,
    TEMPERATURE,
    CURRENT,
)
HEADER = struct.Struct("<BIBI")  # start, time, length, id
OPEN_BRIDGE = Drive(0, True, 0, 0)
PREPARE_PERIODS = 4 * CYCLES_PER_TICK // CYCLES_PER_PERIOD


def samples_until(tick: int) -> int:
    """Number of ADC samples that the first `tick` ticks take."""
    usable = CYCLES_PER_TICK * tick - FIRST_SAMPLE_CYCLES - LATENCY_CYCLES
    return usable // CYCLES_PER_SAMPLE + 1


class ToolTicks:
    """Simulates the scenario's tool up to one tick after the other. Commands are added before the
    periods in which they act are simulated.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._tool = make_plant(scenario.tool, scenario.seed)
        self._front = scenario.front_ends()
        self._scales = self._front.scales()
        self._stimulus = lockstep.StimulusSource(scenario.profile, self._front, scenario.seed)
        self._stimuli: deque[lockstep.Stimulus] = deque()
        self._drawn: lockstep.StimulusChunk | None = None
        self._prepared: list[lockstep.Stimulus] = []
        self._script = lockstep.Script(command_messages(scenario.commands))
        self._pacer = lockstep.Pacer()
        self._unsent, self._sent_bytes = bytearray(), 0
        self._source = scenario.source
        self._periods = round(scenario.duration_s / lockstep.PERIOD_S)
        self._period = 0
        self._samples: list[int] = []
        self._edges: deque[int] = deque()
        self._commands: deque[tuple[int, bytes]] = deque()  # by cycle of the first byte
        self._gates = OPEN_BRIDGE
        self._orders: deque[tuple[int, Drive]] = deque()  # by the cycle at which they are applied

    def add_command(self, drive: Drive) -> None:
        """The bridge command that the firmware has computed in a tick."""
        at = CYCLES_PER_TICK * (drive.tick + 1) + (APPLY_LATER_CYCLES if drive.later else 0)
        self._orders.append((at, drive))

    def inputs(self, tick: int) -> TickInputs:
        """Simulate up to a tick, and what the firmware takes in it; ticks must be in order."""
        end, switches = CYCLES_PER_TICK * tick, 0
        while (start := FIRST_TOP_CYCLES + CYCLES_PER_PERIOD * self._period) < end:
            switches = self._simulate_period(start)
        count = samples_until(tick) - samples_until(tick - 1)
        samples, self._samples = tuple(self._samples[:count]), self._samples[count:]
        edges = []
        while self._edges and self._edges[0] <= end:
            edges.append(self._edges.popleft() - end + CYCLES_PER_TICK)
        if len(edges) > EDGES_MAX:
            raise VgrooveError(
                f"{self._source}: {len(edges)} Hall edges within 1 ms, the line carries "
                f"{EDGES_MAX}: lower the speed or sensors.hall_pulses_per_rev"
            )
        return TickInputs(tick, samples, switches, tuple(edges))

    def prepare(self) -> None:
        """Compute noise, trigger and load of the next ticks in advance, a part in each call.
        Call it when the board is not waiting for an answer.
        """
        if self._drawn is not None:
            self._prepared, self._drawn = list(self._drawn.periods()), None
        elif len(self._stimuli) < PREPARE_PERIODS and not self._prepared:
            self._drawn = self._draw(self._period + len(self._stimuli))

    def command_frames(self, tick: int) -> list[Frame]:
        """The host's command whose bytes begin to arrive before a tick; at most one a tick."""
        if self._commands and self._commands[0][0] < CYCLES_PER_TICK * tick:
            data = self._commands.popleft()[1]
            _, time_ms, _, frame_id = HEADER.unpack(data[: HEADER.size])
            return [Frame(time_ms, frame_id, data[HEADER.size : HEADER.size + LENGTH])]
        return []

    def _simulate_period(self, start: int) -> int:
        """Simulate one PWM period; returns the switches in it."""
        if not self._stimuli:
            self._next_chunk()
        trigger, switches, load_nm, current_counts, supply_counts, broken = self._stimuli.popleft()
        self._receive(start)
        while self._orders and self._orders[0][0] < start:
            self._gates = self._orders.popleft()[1]
        current_a, supply_v, edges = self._tool.period(*_command(self._gates), load_nm)
        if self._period % PERIODS_PER_SAMPLE == 0:
            per_ampere, per_volt, temperature = self._scales
            counts = (
                lockstep.counts_of(current_a * per_ampere + current_counts),
                lockstep.counts_of(supply_v * per_volt + supply_counts),
                trigger,
                temperature,
            )
            self._samples.append(counts[SLOTS[self._period // PERIODS_PER_SAMPLE % len(SLOTS)]])
        if not broken:
            self._edges.extend(start + edge + CAPTURE_CYCLES for edge in edges)
        self._period += 1
        return switches

    def _next_chunk(self) -> None:
        if not self._prepared:
            self._prepared = list((self._drawn or self._draw(self._period)).periods())
        self._stimuli.extend(self._prepared)
        self._prepared, self._drawn = [], None
        data = self._script.receive(self._period * lockstep.PERIOD_S)
        self._pacer.add(data)
        self._unsent += data

    def _draw(self, period: int) -> lockstep.StimulusChunk:
        """The stimuli of the chunk that begins with a period."""
        left = self._periods - period  # the last chunk is as long as that of a lock-step run
        count = min(lockstep.CHUNK_PERIODS, left) if left > 0 else lockstep.CHUNK_PERIODS
        with refused_by_plant(self._source):
            return self._stimulus.chunk(period, count)

    def _receive(self, start: int) -> None:
        """Note the cycle at which the first byte of a command arrives."""
        if not self._pacer.next():
            return
        if self._sent_bytes % FRAME_BYTES == 0:
            frame = bytes(self._unsent[:FRAME_BYTES])
            del self._unsent[:FRAME_BYTES]
            self._commands.append((start + RECEIVE_CYCLE, frame))
        self._sent_bytes += 1


def _command(gates: Drive) -> tuple[bool, float, float]:
    """Coast, duty and share of the dead time of a bridge command."""
    top, compare = lockstep.COMPARE_TOP, gates.compare
    dead = gates.dead_counts / (2 * top) if 0 < abs(compare) < top else 0.0
    return gates.coast, compare / top, dead
