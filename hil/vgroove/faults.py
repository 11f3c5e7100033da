"""Faults that a run injects between board and tool (`vgroove run --fault NAME@T`, docs/faults.md):
sensors, switches, bridge, line, and the board itself.
"""

import difflib
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vgroove.board import (
    ADC_CHANNELS,
    CPU_HZ,
    CURRENT,
    PERIOD_S,
    SWITCH_CONTACT,
    BoardInputs,
    BoardOutputs,
)
from vgroove.errors import VgrooveError
from vgroove.lockstep import ADC_COUNTS

COUNT_TOP = ADC_COUNTS - 1
CURRENT_OFFSET_COUNTS = 64  # 8 A
REFERENCE_FACTOR = 1.1  # the reference is 9 % low
BUS_DIP_COUNTS, BUS_DIP_S = 240, 0.02  # 6 V
BOUNCE_S = 0.02
BIT_ERROR_RATE = 1e-3
SAVE_DELAY_S = 0.05  # from the command to the brown-out: the save has begun and is not complete
SAVED_INDEX, SAVED_VALUE = 13, 198  # slew_per_ms_q15, beside its default
BOOT_CYCLES = 29_800  # from the reset to the first PWM period, at which a run's time begins
BYTE_PERIODS = 2  # of a byte to the board


@dataclass
class State:
    """What an injected fault remembers: its random numbers, the last inputs before it, the level
    of the Hall line.
    """

    rng: np.random.Generator
    before: BoardInputs | None = None
    hall_high: bool = True  # open collector with pull-up
    broken: bool = False
    to_send: list[int] = field(default_factory=list)


Change = Callable[[BoardInputs, State, float], BoardInputs]


def _with_counts(inputs: BoardInputs, **changed: int) -> BoardInputs:
    counts = list(inputs.adc_counts)
    for name, value in changed.items():
        counts[ADC_CHANNELS.index(name)] = max(0, min(COUNT_TOP, value))
    return inputs._replace(adc_counts=tuple(counts))


def _hall_at(high: bool) -> Change:
    """The Hall line keeps a level; where it had the other one, it changes once."""

    def change(inputs: BoardInputs, state: State, since_s: float) -> BoardInputs:
        del since_s
        edges = () if state.broken or state.hall_high == high else (0,)
        state.broken, state.hall_high = True, high
        return inputs._replace(edges=edges)

    return change


def _current_stuck(inputs: BoardInputs, state: State, since_s: float) -> BoardInputs:
    del since_s
    held = inputs if state.before is None else state.before
    return _with_counts(inputs, current=held.adc_counts[CURRENT])


def _current_offset(inputs: BoardInputs, state: State, since_s: float) -> BoardInputs:
    del state, since_s
    return _with_counts(inputs, current=inputs.adc_counts[CURRENT] + CURRENT_OFFSET_COUNTS)


def _adc_reference(inputs: BoardInputs, state: State, since_s: float) -> BoardInputs:
    """The trigger's potentiometer divides the reference itself and keeps its counts."""
    del state, since_s
    current, bus, _, temperature = (round(REFERENCE_FACTOR * c) for c in inputs.adc_counts)
    return _with_counts(inputs, current=current, bus=bus, temperature=temperature)


def _bus_dip(inputs: BoardInputs, state: State, since_s: float) -> BoardInputs:
    del state
    return _with_counts(inputs, bus=BUS_DIP_COUNTS) if since_s < BUS_DIP_S else inputs


def _trigger_stuck(inputs: BoardInputs, state: State, since_s: float) -> BoardInputs:
    del state, since_s
    pressed = _with_counts(inputs, trigger=920)
    return pressed._replace(switches=inputs.switches | SWITCH_CONTACT)


def _contact_bounce(inputs: BoardInputs, state: State, since_s: float) -> BoardInputs:
    if since_s >= BOUNCE_S or state.rng.integers(2):
        return inputs
    return inputs._replace(switches=inputs.switches ^ SWITCH_CONTACT)


def _pot_open(inputs: BoardInputs, state: State, since_s: float) -> BoardInputs:
    """The ground wire is off: the wiper has the reference's voltage."""
    del state, since_s
    return _with_counts(inputs, trigger=COUNT_TOP)


def _flipped(data: bytes, rng: np.random.Generator) -> bytes:
    """Bytes with independent bit errors."""
    if not data:
        return data
    flips = rng.random((len(data), 8)) < BIT_ERROR_RATE
    return bytes(b ^ int((f * (1 << np.arange(8))).sum()) for b, f in zip(data, flips, strict=True))


def _line_errors(inputs: BoardInputs, state: State, since_s: float) -> BoardInputs:
    del since_s
    return inputs._replace(rx=_flipped(inputs.rx, state.rng))


def _parameter_write(inputs: BoardInputs, state: State, since_s: float) -> BoardInputs:
    """A command that saves a parameter arrives, beginning with the fault."""
    from vgroove import telemetry

    if not state.broken:
        state.broken = True
        values = {"write_index": SAVED_INDEX, "write_value": SAVED_VALUE, "write_sequence": 1}
        frame = telemetry.frame_of_signals("PARAM_WRITE", 0, **values)
        state.to_send = list(telemetry.frame_bytes(frame))
    if state.to_send and round(since_s / PERIOD_S) % BYTE_PERIODS == 0:
        return inputs._replace(rx=bytes([state.to_send.pop(0)]))
    return inputs


def _unchanged(inputs: BoardInputs, state: State, since_s: float) -> BoardInputs:
    del state, since_s
    return inputs


@dataclass(frozen=True)
class Fault:
    """One kind of fault. `change` alters the board's inputs; `board_option`: the option of
    vgroove-board that injects it at a cycle, `option_delay_s` later; `opens_bridge`: the gate
    driver has switched off, whatever the board commands; `damages_line`: bit errors in what the
    board sends.
    """

    name: str
    text: str
    change: Change = _unchanged
    board_option: str = ""
    option_delay_s: float = 0.0
    opens_bridge: bool = False
    damages_line: bool = False


FAULTS = {
    fault.name: fault
    for fault in (
        Fault("hall_open", "Hall line open: high, no edges", _hall_at(True)),
        Fault("hall_short", "Hall line shorted to ground: low, no edges", _hall_at(False)),
        Fault("current_stuck", "current sensor keeps its last value", _current_stuck),
        Fault("current_offset", "current sensor off by 8 A", _current_offset),
        Fault("adc_reference", "ADC reference 9 % low", _adc_reference),
        Fault("bus_dip", "bus voltage 6 V for 20 ms", _bus_dip),
        Fault("brown_out", "brown-out reset", board_option="brown_out"),
        Fault(
            "eeprom_brown_out",
            "brown-out reset while a parameter is saved",
            _parameter_write,
            "brown_out",
            SAVE_DELAY_S,
        ),
        Fault("trigger_stuck", "trigger and contact held closed", _trigger_stuck),
        Fault("contact_bounce", "contact bounces for 20 ms", _contact_bounce),
        Fault("pot_open", "ground wire of the potentiometer off: full travel", _pot_open),
        Fault("watchdog", "main loop hangs, interrupts go on", board_option="hang"),
        Fault("line_errors", "bit errors of 1e-3 on the line", _line_errors, damages_line=True),
        Fault("bridge_fault", "gate driver switches itself off", opens_bridge=True),
    )
}


@dataclass(frozen=True)
class Injection:
    """A fault and the time at which it begins."""

    fault: Fault
    at_s: float

    def board_options(self) -> dict[str, int]:
        """Options of vgroove-board that inject it."""
        option = self.fault.board_option
        at_s = self.at_s + self.fault.option_delay_s
        return {option: round(at_s * CPU_HZ) + BOOT_CYCLES} if option else {}


def parse_injection(text: str) -> Injection:
    """The injection that NAME@T names; VgrooveError for an unknown fault or time."""
    name, _, time = text.partition("@")
    if name not in FAULTS:
        near = difflib.get_close_matches(name, FAULTS, n=1, cutoff=0.0)[0]
        raise VgrooveError(
            f"--fault {text}: there is no fault {name}; the nearest known one is {near} "
            f"(known: {', '.join(FAULTS)})"
        )
    try:
        at_s = float(time)
    except ValueError:
        at_s = -1.0
    if not 0.0 <= at_s < float("inf"):
        raise VgrooveError(f"--fault {text}: write NAME@T with the time in s, such as {name}@0.5")
    return Injection(FAULTS[name], at_s)


@dataclass
class FaultyBoard:
    """A board between which and its tool a fault acts; a context manager. `commands` keeps what
    the board commanded in each period: the compare value, None for an open bridge.
    """

    board: Any
    injection: Injection
    seed: int = 1
    commands: list[int | None] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._state = State(np.random.default_rng(self.seed))

    def __enter__(self) -> "FaultyBoard":
        self.board.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self.board.__exit__(*error)

    def period(self, inputs: BoardInputs) -> BoardOutputs:
        """One PWM period with the fault, from its time on."""
        fault, state = self.injection.fault, self._state
        since_s = len(self.commands) * PERIOD_S - self.injection.at_s
        if since_s < 0.0:
            state.before = inputs
            state.hall_high ^= bool(len(inputs.edges) % 2)
        else:
            inputs = fault.change(inputs, state, since_s)
        out = self.board.period(inputs)
        self.commands.append(None if out.coast else out.compare)
        if since_s >= 0.0 and fault.damages_line:
            out = out._replace(tx=_flipped(out.tx, state.rng))
        if since_s >= 0.0 and fault.opens_bridge:
            out = out._replace(coast=True, compare=0, dead_counts=0)
        return out
