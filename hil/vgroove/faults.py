"""Faults that a run injects between board and tool (`vgroove run --fault NAME@T`, docs/faults.md):
sensors, switches, bridge, line, and the board itself.
"""

import difflib
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from math import ceil
from typing import Any

import numpy as np

from vgroove.board import (
    BUS,
    CPU_HZ,
    CURRENT,
    INPUTS,
    OUTPUTS,
    PERIOD_S,
    SWITCH_CONTACT,
    TEMPERATURE,
    TRIGGER,
    BoardInputs,
    BoardOutputs,
    is_sent,
    pack_inputs,
    unpack_outputs,
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
BOUNCE_PERIODS = ceil(BOUNCE_S / PERIOD_S)
ROUNDING = 1e-6  # of a period, by which the time of a fault may miss the start of one


@dataclass
class State:
    """State of an injected fault: a seed, the last inputs before it, the level of the Hall
    line.
    """

    seed: int
    before: np.ndarray | None = None  # one row of INPUTS
    hall_high: bool = True  # open collector with pull-up


# Changes inputs (n,) of INPUTS in place; since (n,): periods since the first of the fault. A period
# may be asked for again, after the board has changed its gates: equal inputs, equal changes.
Change = Callable[[np.ndarray, np.ndarray, State], None]


def _set_counts(inputs: np.ndarray, channel: int, counts: np.ndarray | int) -> None:
    inputs["adc_counts"][:, channel] = np.clip(counts, 0, COUNT_TOP)


def _hall_at(high: bool) -> Change:
    """The Hall line keeps a level; where it had the other one, it changes once."""

    def change(inputs: np.ndarray, since: np.ndarray, state: State) -> None:
        changes = (since == 0) & (state.hall_high != high)
        inputs["edge_count"] = changes
        inputs["edge_cycle"][changes] = 0

    return change


def _current_stuck(inputs: np.ndarray, since: np.ndarray, state: State) -> None:
    if state.before is None:
        state.before = inputs[since == 0][0]
    _set_counts(inputs, CURRENT, int(state.before["adc_counts"][CURRENT]))


def _current_offset(inputs: np.ndarray, since: np.ndarray, state: State) -> None:
    del since, state
    _set_counts(inputs, CURRENT, inputs["adc_counts"][:, CURRENT] + CURRENT_OFFSET_COUNTS)


def _adc_reference(inputs: np.ndarray, since: np.ndarray, state: State) -> None:
    """The trigger's potentiometer divides the reference itself and keeps its counts."""
    del since, state
    for channel in (CURRENT, BUS, TEMPERATURE):
        _set_counts(inputs, channel, np.rint(REFERENCE_FACTOR * inputs["adc_counts"][:, channel]))


def _bus_dip(inputs: np.ndarray, since: np.ndarray, state: State) -> None:
    del state
    inputs["adc_counts"][since * PERIOD_S < BUS_DIP_S, BUS] = BUS_DIP_COUNTS


def _trigger_stuck(inputs: np.ndarray, since: np.ndarray, state: State) -> None:
    del since, state
    _set_counts(inputs, TRIGGER, 920)
    inputs["switches"] |= SWITCH_CONTACT


def _contact_bounce(inputs: np.ndarray, since: np.ndarray, state: State) -> None:
    bounces = since < BOUNCE_PERIODS
    if bounces.any():
        flips = np.random.default_rng(state.seed).integers(2, size=BOUNCE_PERIODS)
        inputs["switches"][bounces] ^= (flips[since[bounces]] * SWITCH_CONTACT).astype(np.uint8)


def _pot_open(inputs: np.ndarray, since: np.ndarray, state: State) -> None:
    """The ground wire is off: the wiper has the reference's voltage."""
    del since, state
    _set_counts(inputs, TRIGGER, COUNT_TOP)


def _bit_errors(bytes_sent: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Bytes (n,) with independent bit errors."""
    flips = rng.random((len(bytes_sent), 8)) < BIT_ERROR_RATE
    return bytes_sent ^ np.packbits(flips, axis=1)[:, 0]


def _line_errors(inputs: np.ndarray, since: np.ndarray, state: State) -> None:
    for row in np.flatnonzero(inputs["rx_count"]):
        rng = np.random.default_rng([state.seed, int(since[row])])
        inputs["rx"][row] = _bit_errors(inputs["rx"][row], rng)


@cache
def _parameter_command() -> bytes:
    """The bytes of a frame PARAM_WRITE, which makes the board save a parameter."""
    from vgroove import telemetry

    values = {"write_index": SAVED_INDEX, "write_value": SAVED_VALUE, "write_sequence": 1}
    return telemetry.frame_bytes(telemetry.frame_of_signals("PARAM_WRITE", 0, **values))


def _parameter_write(inputs: np.ndarray, since: np.ndarray, state: State) -> None:
    """A command that saves a parameter arrives, beginning with the fault."""
    del state
    command = np.frombuffer(_parameter_command(), np.uint8)
    place = since // BYTE_PERIODS
    arrives = (since % BYTE_PERIODS == 0) & (place < len(command))
    inputs["rx_count"][arrives] = 1
    inputs["rx"][arrives, 0] = command[place[arrives]]


def _unchanged(inputs: np.ndarray, since: np.ndarray, state: State) -> None:
    del inputs, since, state


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
        self._state = State(self.seed)
        self._rng = np.random.default_rng(self.seed)
        self._first = ceil(self.injection.at_s / PERIOD_S - ROUNDING)  # period of the fault

    def __enter__(self) -> "FaultyBoard":
        self.board.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self.board.__exit__(*error)

    def period(self, inputs: BoardInputs) -> BoardOutputs:
        """One PWM period with the fault, from its time on."""
        return unpack_outputs(self.periods(pack_inputs(inputs)))

    def periods(self, messages: bytes) -> bytes:
        """As AvrBoard.periods(), with the fault. The first period of the fault is a call of its
        own, because the fault may change the gates.
        """
        since = len(self.commands) - self._first
        inputs = np.frombuffer(messages, INPUTS)[: max(1, -since) if since <= 0 else None].copy()
        if since >= 0:
            self.injection.fault.change(inputs, since + np.arange(len(inputs)), self._state)
        answer = self.board.periods(inputs.tobytes())
        outputs = np.frombuffer(answer, OUTPUTS).copy()
        self.commands += [
            None if coast else compare
            for coast, compare in zip(
                outputs["coast"].tolist(), outputs["compare"].tolist(), strict=True
            )
        ]
        if since < 0:
            self._remember(inputs[: len(outputs)])
        else:
            self._change_outputs(outputs)
        return outputs.tobytes()

    def _remember(self, inputs: np.ndarray) -> None:
        """Inputs (n,) of periods before the fault."""
        self._state.before = inputs[-1]
        self._state.hall_high ^= bool(inputs["edge_count"].sum() % 2)

    def _change_outputs(self, outputs: np.ndarray) -> None:
        if self.injection.fault.damages_line:
            sent = is_sent(outputs)
            outputs["tx"][sent] = _bit_errors(outputs["tx"][sent], self._rng)
        if self.injection.fault.opens_bridge:
            outputs["coast"], outputs["compare"], outputs["dead_counts"] = 1, 0, 0
