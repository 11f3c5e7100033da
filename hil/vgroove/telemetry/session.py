"""One run of the board: frames in the order of their arrival become rows of a log."""

import struct
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from vgroove.errors import VgrooveError
from vgroove.telemetry.decoding import bit_field, decode, decode_integers, decode_many
from vgroove.telemetry.frame_finder import Counters
from vgroove.telemetry.frames import Frame, crc16
from vgroove.telemetry.signals import (
    ACK,
    BOOT,
    FAST,
    FRAME_IDS,
    HEALTH,
    PARAM,
    PARAM_TABLE,
    PROTOCOL_VERSION,
    LogColumn,
    columns_of,
    database,
    parameter_list,
    parameter_name,
)

TIME_MODULUS = 1 << 32  # of the frames' time in ms
BACKWARD_MS = 1 << 31  # a larger step of the modular time is a step backward: a restart
JUMP_MS = 10_000  # a larger gap in time needs a second frame that confirms it
CONFIRM_MS = 1000  # the second frame is at most this much later
START_OVER_MS = 5000  # after the first BOOT frame: a later restart of the board ends the run
# A tick signal is the low byte of the time since which the values of its frame hold; the frame is
# less than this later.
TICK_MODULUS_MS = 256
DUTY_FULL_SCALE = 255  # compare value of duty 1 where no BOOT frame was received
BOARD_RESTARTED = "the board restarted"


class HeldSignals:
    """Log columns of a frame whose values hold until the next frame of its kind."""

    def __init__(self, frame: str) -> None:
        self._columns = columns_of(frame)
        signals = database().get_message_by_name(frame).signals
        self._tick = next((s.name for s in signals if s.name.endswith("_tick")), None)
        self._current: dict[str, float] | None = None
        self._changes: list[tuple[int, dict[str, float]]] = []

    def add(self, now_ms: int, signals: dict[str, float]) -> None:
        """A frame that arrived at `now_ms`; its tick signal is the time since which its values
        hold, modulo 256.
        """
        age_ms = (now_ms - int(signals[self._tick])) % TICK_MODULUS_MS if self._tick else 0
        self._changes.append((now_ms - age_ms, signals))

    def at(self, times_ms: np.ndarray) -> dict[str, np.ndarray]:
        """Columns (n,) with the values in force at each of the rising `times_ms` (n,).

        NaN before the first frame. Changes before the last time are then dropped.
        """
        changes = sorted(self._changes, key=lambda change: change[0])
        unknown = {column.signal: np.nan for column in self._columns}
        known = [self._current or unknown, *(signals for _, signals in changes)]
        which = np.searchsorted([since for since, _ in changes], times_ms, side="right")
        if len(times_ms):
            self._current = known[which[-1]] if which[-1] or self._current else None
            self._changes = changes[which[-1] :]
        return {
            c.name: np.array([values[c.signal] for values in known])[which] for c in self._columns
        }


def _held_frames() -> dict[int, HeldSignals]:
    """The frames besides FAST that fill log columns, by id."""
    return {
        frame_id: HeldSignals(name)
        for name, frame_id in FRAME_IDS.items()
        if frame_id != FAST and columns_of(name)
    }


def _fast_columns(frames: list[Frame], full_scale: int) -> dict[str, np.ndarray]:
    """Log columns of FAST frames; the compare value at the end of its range opens the bridge."""
    signals = decode_many("FAST", frames)
    compare = signals["duty_compare"]
    open_value = database().get_message_by_name("FAST").get_signal_by_name("duty_compare").minimum
    coast = compare == open_value
    computed = {"duty": np.where(coast, 0.0, compare / full_scale), "coast": coast.astype(float)}

    def column(wanted: LogColumn) -> np.ndarray:
        return computed[wanted.name] if wanted.name in computed else signals[wanted.signal]

    return {wanted.name: column(wanted) for wanted in columns_of("FAST")}


@dataclass
class Session:
    """One run of the board, from a BOOT frame on.

    `boot`, `parameters` (raw values by index) and `table` describe the board; FAST frames and the
    changes of the others are kept until `take_rows`. A BOOT frame of an unknown protocol version
    raises VgrooveError. After a restart of the board (`restarted`) all frames are ignored: they
    belong to another run.
    """

    counters: Counters = field(default_factory=Counters)
    needs_boot: bool = True
    boot: dict[str, int] | None = None
    parameters: dict[int, int] = field(default_factory=dict)
    table: dict[str, int] | None = None
    acks: list[dict[str, int]] = field(default_factory=list)
    health: dict[str, int] | None = None
    restarted: bool = False
    first_ms: int | None = None  # of the first BOOT frame; without `needs_boot` of the first frame
    last_ms: int | None = None  # unwrapped
    _fast: list[tuple[int, Frame]] = field(default_factory=list)
    _held: dict[int, HeldSignals] = field(default_factory=_held_frames)
    _last_fast: tuple[int, int] | None = None
    _jumped: Frame | None = None  # its time jumped; the next frame confirms or refutes it
    _final: bool = False  # whether a dump of the parameters was complete or a row was taken

    def feed(self, frames: Iterable[Frame]) -> None:
        """Add frames in the order of their arrival."""
        for frame in frames:
            self._add(frame)

    def _add(self, frame: Frame) -> None:
        if self.restarted:
            return
        if frame.id == BOOT:
            _check_protocol(frame)
        elif self.boot is None and self.needs_boot:
            self.counters.before_boot += 1
            return
        jumped, self._jumped = self._jumped, None
        if jumped is not None and (frame.time_ms - jumped.time_ms) % TIME_MODULUS <= CONFIRM_MS:
            self._dispatch(jumped)
        elif jumped is not None:
            self.counters.corrupt += 1
        if not self.restarted:
            self._dispatch_unless_jumped(frame)

    def _step_ms(self, frame: Frame) -> int:
        """Time since the last frame, modulo 2^32; for the first frame its own time."""
        return (frame.time_ms - (self.last_ms or 0)) % TIME_MODULUS

    def _dispatch_unless_jumped(self, frame: Frame) -> None:
        if frame.id != BOOT and self.last_ms is not None and self._step_ms(frame) > JUMP_MS:
            self._jumped = frame
        else:
            self._dispatch(frame)

    def _dispatch(self, frame: Frame) -> None:
        step = self._step_ms(frame)
        if self.last_ms is not None and step >= BACKWARD_MS:
            self._restart(frame)
            return
        self.last_ms = (self.last_ms or 0) + step
        if self.first_ms is None and not self.needs_boot:
            self.first_ms = self.last_ms
        if frame.id in self._held:
            self._held[frame.id].add(self.last_ms, decode(frame))
        if frame.id == FAST:
            self._add_fast(frame)
        elif frame.id == BOOT:
            self._add_boot(frame)
        elif frame.id == PARAM:
            self._add_parameter(frame)
        elif frame.id == PARAM_TABLE:
            self._add_table(frame)
        elif frame.id == ACK:
            self.acks.append(decode_integers(frame))
        elif frame.id == HEALTH:
            self.health = decode_integers(frame)

    @property
    def may_start_over(self) -> bool:
        """Whether the run starts over at a restart of the board, as that of opening the port is:
        until the parameters are complete, for a short time. No row is final before.
        """
        if not self.needs_boot or self._final:
            return False
        return self.last_ms is None or self.last_ms - self.first_ms < START_OVER_MS

    def _restart(self, frame: Frame) -> None:
        """A frame whose time is earlier than that of the frame before shows a restart of the board:
        begin the run again with it, or end the run.
        """
        self.counters.restarts += 1
        if frame.id != BOOT or not self.may_start_over:
            self.restarted = True
            return
        self.counters.fast -= len(self._fast)
        self._fast, self._held, self._last_fast = [], _held_frames(), None
        self.first_ms = self.last_ms = frame.time_ms
        self._add_boot(frame)

    def _add_boot(self, frame: Frame) -> None:
        boot = decode_integers(frame)
        if self.boot is not None and boot["fast_divider"] != self.boot["fast_divider"]:
            self._last_fast = None
        self.boot = boot
        self.first_ms = self.last_ms if self.first_ms is None else self.first_ms
        self.parameters = {}
        self.table = None

    def _add_parameter(self, frame: Frame) -> None:
        values = decode_integers(frame)
        self.parameters[values["param_index"]] = values["param_value"]

    def _add_table(self, frame: Frame) -> None:
        """End of a dump. With a parameter missing or wrong the table stays None, which makes the
        recorder request the dump again.
        """
        table = decode_integers(frame)
        complete = sorted(self.parameters) == list(range(table["table_count"]))
        if complete and self._dump_crc16() == table["table_crc16"]:
            self.table, self._final = table, True

    def _dump_crc16(self) -> int:
        """CRC-16 over all received parameters by index, which is the order of a dump (the answer to
        a PARAM_READ during the dump does not change it).
        """
        return crc16(
            b"".join(struct.pack("<Bi", *item) for item in sorted(self.parameters.items()))
        )

    def _add_fast(self, frame: Frame) -> None:
        first_bit, mask = bit_field("FAST", "fast_counter")
        counter = (int.from_bytes(frame.data, "little") >> first_bit) & mask
        now = self.last_ms
        if self._last_fast is not None:
            sent = self._fast_sent_since(now, counter, modulus=mask + 1)
            if sent is None:
                self.counters.corrupt += 1
                return
            self.counters.lost += sent - 1
        self.counters.fast += 1
        self._last_fast = (now, counter)
        self._fast.append((now, frame))

    def _fast_sent_since(self, now: int, counter: int, modulus: int) -> int | None:
        """Number of FAST frames sent since the last received one, up to this one.

        It is congruent to the counter's step and the nearest such number to the elapsed ticks;
        None where time and counter contradict each other.
        """
        before, counter_before = self._last_fast
        divider = max(1, self.boot["fast_divider"] if self.boot else 1)
        ticks = (now - before) // divider
        step = (counter - counter_before) % modulus
        sent = step + modulus * round((ticks - step) / modulus)
        if sent > ticks:
            sent -= modulus
        if sent < 1 or now <= before:
            return None
        self.counters.not_sent += ticks - sent
        return sent

    def ready_until(self) -> int:
        """Tick (ms) up to which rows are final: no frame that concerns them can follow."""
        if self.last_ms is None or self.may_start_over:
            return -1
        return self.last_ms - TICK_MODULUS_MS

    def take_rows(self, until_ms: int | None = None) -> dict[str, np.ndarray]:
        """Remove and return the rows up to a tick (None: all), as columns `time_s` and COLUMNS."""
        count = sum(1 for time_ms, _ in self._fast if until_ms is None or time_ms <= until_ms)
        taken, self._fast = self._fast[:count], self._fast[count:]
        self._final = self._final or count > 0
        times = np.array([time_ms for time_ms, _ in taken], dtype=np.int64)
        full_scale = self.boot["duty_full_scale"] if self.boot else DUTY_FULL_SCALE
        columns = {"time_s": times / 1000}
        columns |= _fast_columns([frame for _, frame in taken], full_scale)
        for held in self._held.values():
            columns |= held.at(times)
        return columns

    def metadata(self) -> dict[str, object]:
        """Boot, parameters and counters, as the sidecar file and a Log carry them."""
        known = [(k, p) for k, p in enumerate(parameter_list()) if k in self.parameters]
        raw = {parameter_name(index): value for index, value in sorted(self.parameters.items())}
        return {
            "boot": self.boot,
            "parameters": {
                "raw": raw,
                "value": {p.name: self.parameters[k] / 2**p.q for k, p in known},
                "unit": {p.name: p.unit for k, p in known},
                "complete": self.table is not None,
                "table": self.table,
            },
            "counters": self.counters.as_dict(),
            "health": self.health,
        }


def _check_protocol(boot: Frame) -> None:
    version = decode_integers(boot)["protocol_version"]
    if version != PROTOCOL_VERSION:
        raise VgrooveError(
            f"The board sends telemetry protocol {version}, this vgroove decodes "
            f"{PROTOCOL_VERSION}: flash the firmware of this version, or install the vgroove that "
            "belongs to the board's firmware."
        )
