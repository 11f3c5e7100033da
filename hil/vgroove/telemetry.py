"""Telemetry of the board: bytes to frames to signals, with everything that was lost or damaged
counted (docs/telemetry.md).
"""

import itertools
import json
import struct
from collections.abc import Iterable
from dataclasses import dataclass, field, fields
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from vgroove.errors import VgrooveError

if TYPE_CHECKING:  # they bring pandas with them: only what speaks CAN waits for that
    import can
    import cantools

PROTOCOL_VERSION = 2
FRAME_BYTES = 19
START, END, LENGTH = 0xAA, 0xBB, 8
FAST, STATE, BOOT, PARAM, PARAM_TABLE, ACK, HEALTH, CONTROL = range(256, 264)
SET_MODE, PARAM_READ, PARAM_WRITE, DUMP, CALIBRATE, SETPOINT, PROFILE = range(512, 519)
OUTBOUND = frozenset(range(FAST, CONTROL + 1))
# state_tick and control_tick are bytes: such a frame is at most this much older than it says
STATE_DELAY_MS = 256
JUMP_MS = 10_000  # a gap in time that needs a second frame to be believed
STATE_COLUMNS = ("trigger", "state", "mode")
CONTROL_COLUMNS = ("control_state", "stop_reason", "blow_count", "blow_period_ms", "estimate")
COLUMNS = ("duty", "supply_v", "current_a", "speed_rpm", "coast", *STATE_COLUMNS, *CONTROL_COLUMNS)
DUTY_COAST = -512
RESTARTED = "the board restarted"


def _table_of_crc8() -> bytes:
    table = bytearray()
    for byte in range(256):
        for _ in range(8):
            byte = ((byte << 1) ^ 0x2F if byte & 0x80 else byte << 1) & 0xFF
        table.append(byte)
    return bytes(table)


_CRC8 = _table_of_crc8()


def crc8(data: bytes) -> int:
    """AUTOSAR CRC8H2F: polynomial 0x2F, initial value 0xFF, inverted at the end."""
    crc = 0xFF
    for byte in data:
        crc = _CRC8[crc ^ byte]
    return crc ^ 0xFF


def crc16(data: bytes) -> int:
    """CRC-16 with polynomial 0x1021 and initial value 0xFFFF."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = ((crc << 1) ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


class Frame(NamedTuple):
    """An intact frame: board time in ms (modulo 2^32), id, 8 data bytes of which the last is the
    CRC.
    """

    time_ms: int
    id: int
    data: bytes

    def message(self) -> "can.Message":
        """The frame as python-can's serial bus would deliver it."""
        import can

        return can.Message(
            timestamp=self.time_ms / 1000,
            arbitration_id=self.id,
            is_extended_id=False,
            data=self.data,
        )


@dataclass(frozen=True)
class Parameter:
    """One line of the firmware's parameter list; physical value = raw / 2**q in `unit`."""

    name: str
    unit: str
    q: int
    default: int
    minimum: int
    maximum: int
    version: int
    text: str


@cache
def database() -> "cantools.database.can.Database":
    """The packaged signal list."""
    import cantools

    return cantools.database.load_string(
        resources.files("vgroove").joinpath("data/vgroove.dbc").read_text("utf-8"),
        "dbc",
        strict=True,
    )


@cache
def value_table(frame: str, signal: str) -> dict[int, str]:
    """Names of a signal's values."""
    return {
        int(k): str(v)
        for k, v in (
            database().get_message_by_name(frame).get_signal_by_name(signal).choices or {}
        ).items()
    }


@cache
def parameter_list() -> tuple[Parameter, ...]:
    """The packaged parameter list, by index."""
    content = json.loads(
        resources.files("vgroove").joinpath("data/parameters.json").read_text("utf-8")
    )
    return tuple(Parameter(**entry) for entry in content["parameters"])


def parameter_name(index: int) -> str:
    """Name of a parameter index; newer firmware may have more than this list."""
    known = parameter_list()
    return known[index].name if index < len(known) else f"parameter_{index}"


def frame_crc(time_ms: int, frame_id: int, payload: bytes) -> int:
    """CRC-8 of a frame over id, time and data[0..6]."""
    return crc8(struct.pack("<II", frame_id, time_ms) + payload[:7])


def frame_of(time_ms: int, frame_id: int, payload: bytes) -> Frame:
    """A frame with its CRC put in; `payload`: the first 7 data bytes."""
    return Frame(time_ms, frame_id, payload[:7] + bytes([frame_crc(time_ms, frame_id, payload)]))


def frame_of_signals(name: str, time_ms: int, **signals: float) -> Frame:
    """A frame from physical values of its signals; those not named are 0, the CRC is computed."""
    message = database().get_message_by_name(name)
    values = {
        signal.name: signals.pop(signal.name, 0 if (signal.minimum or 0) <= 0 else signal.minimum)
        for signal in message.signals
    }
    if signals:
        raise VgrooveError(f"{name} has no signal {', '.join(sorted(signals))}.")
    return frame_of(time_ms, message.frame_id, message.encode(values))


def frame_bytes(frame: Frame) -> bytes:
    """The frame on the wire, in python-can's serial format."""
    return struct.pack("<BIBI", START, frame.time_ms, LENGTH, frame.id) + frame.data + bytes([END])


def frame_from_message(message: "can.Message") -> Frame | None:
    """A frame read by python-can; None where id, length or CRC do not fit."""
    time_ms = round(message.timestamp * 1000) & 0xFFFFFFFF
    frame = Frame(time_ms, message.arbitration_id, bytes(message.data))
    plain = not (message.is_extended_id or message.is_error_frame or message.is_remote_frame)
    return (
        frame
        if plain and len(frame.data) == LENGTH and frame_crc(*frame) == frame.data[7]
        else None
    )


@cache
def _time_in_crc() -> tuple[np.ndarray, np.ndarray]:
    """What the low and the high half of the time change in a frame's CRC: it is linear in each bit."""
    none = frame_crc(0, 0, bytes(7))
    halves = []
    for first in (0, 16):
        half = np.zeros(1 << 16, np.uint8)
        for bit in range(16):
            half[1 << bit : 2 << bit] = half[: 1 << bit] ^ (
                frame_crc(1 << (first + bit), 0, bytes(7)) ^ none
            )
        halves.append(half)
    return halves[0], halves[1]


def _offsets_that_fit(frames: list[Frame]) -> np.ndarray:
    """All offsets (ms, modulo 2^32) that make the CRC of every one of these frames right."""
    low, high = _time_in_crc()
    wanted = [frame.data[7] ^ frame_crc(0, frame.id, frame.data) for frame in frames]
    # low halves by what they change: 256 of each
    order = np.argsort(low, kind="stable").reshape(256, 256)
    found = []
    for block in np.split(np.arange(1 << 16, dtype=np.uint32), 64):
        times = (
            (block << np.uint32(16))[:, None] | order[high[block] ^ wanted[0]].astype(np.uint32)
        ).ravel()
        offsets = times - np.uint32(frames[0].time_ms)
        for frame, want in zip(frames[1:], wanted[1:], strict=True):
            times = offsets + np.uint32(frame.time_ms)
            offsets = offsets[
                (low[times & np.uint32(0xFFFF)] ^ high[times >> np.uint32(16)]) == want
            ]
        found.append(offsets)
    return np.concatenate(found)


def _agreeing(frames: list[Frame], offsets: np.ndarray) -> np.ndarray:
    """How many of the frames have a right CRC with each offset."""
    low, high = _time_in_crc()
    count = np.zeros(len(offsets), int)
    for frame in frames:
        times = offsets + np.uint32(frame.time_ms)
        count += (low[times & np.uint32(0xFFFF)] ^ high[times >> np.uint32(16)]) == frame.data[
            7
        ] ^ frame_crc(0, frame.id, frame.data)
    return count


def time_offset(frames: list[Frame], likely: Iterable[int] = (0,)) -> int | None:
    """What to add to the frames' times (ms) to get the board's, where a recording kept only time
    differences; None if nothing fits.

    The CRC covers the time, so the frames themselves tell: an offset is right when most of 200
    frames, spread over all, agree with it. The `likely` ones are tried first. Of the others the
    least that fits is taken: high bits of the time that never change in the recording are known
    only up to the 8 bits of the CRC, so the start may be wrong by multiples of a minute and more;
    differences are right.
    """
    sample = frames[:: max(1, len(frames) // 200)]
    stride = len(sample) // 6
    searched = (_offsets_that_fit(sample[first::stride][:6]) for first in range(min(stride, 10)))
    for offsets in itertools.chain([np.array(list(likely), np.uint32)], searched):
        agreeing = _agreeing(sample, offsets)
        best = agreeing.max(initial=0)
        if 2 * best > len(sample):
            return int(offsets[agreeing == best].min())
    return None


def decode(frame: Frame) -> dict[str, float]:
    """Physical values of a frame's signals, by cantools."""
    return database().decode_message(frame.id, frame.data, decode_choices=False)


def decode_many(name: str, frames: list[Frame]) -> dict[str, np.ndarray]:
    """Physical values of many frames of one kind, each an array over the frames; the same as
    `decode`, all at once.
    """
    words = np.frombuffer(b"".join(frame.data for frame in frames), "<u8")
    columns = {}
    for signal in database().get_message_by_name(name).signals:
        raw = ((words >> np.uint64(signal.start)) & np.uint64((1 << signal.length) - 1)).astype(
            np.int64
        )
        if signal.is_signed:
            raw = raw - ((raw >> (signal.length - 1)) << signal.length)
        columns[signal.name] = raw * float(signal.scale) + float(signal.offset)
    return columns


@dataclass
class Counters:
    """What came and what did not. bytes = 19 * frames + skipped_bytes + what the framer still
    holds.
    """

    bytes: int = 0
    frames: int = 0
    skipped_bytes: int = 0  # belonged to no intact frame
    # frames complete in form whose CRC is wrong, or whose time or counter cannot be
    corrupt: int = 0
    fast: int = 0
    lost: int = 0  # FAST frames that were sent between two received ones
    not_sent: int = 0  # ticks for which the board itself sent no FAST frame
    before_boot: int = 0  # frames before the first BOOT, ignored
    restarts: int = 0

    def begin(self, before: "Counters", frames: int, held: int) -> None:
        """Count from the BOOT frame on: `frames` with it, `held` bytes behind them; damage up to
        `before` is not the recording's.
        """
        self.frames = frames
        self.skipped_bytes -= before.skipped_bytes
        self.corrupt -= before.corrupt
        self.bytes = FRAME_BYTES * frames + self.skipped_bytes + held

    def as_dict(self) -> dict[str, int]:
        """For the sidecar file."""
        return {item.name: getattr(self, item.name) for item in fields(self)}


class Framer:
    """Finds intact frames in a stream of bytes; after damage it looks for the next start byte
    inside what it has.
    """

    def __init__(self, counters: Counters | None = None) -> None:
        self.counters = counters or Counters()
        self._held = bytearray()

    @property
    def held(self) -> int:
        """Bytes that may become a frame."""
        return len(self._held)

    def feed(self, data: bytes) -> list[Frame]:
        """Frames that are complete with these bytes."""
        self.counters.bytes += len(data)
        self._held += data
        held, frames, at = self._held, [], 0
        while True:
            start = held.find(START, at)
            start = len(held) if start < 0 else start
            self.counters.skipped_bytes += start - at
            at = start
            if len(held) - at < FRAME_BYTES:
                if len(held) - at > 5 and held[at + 5] != LENGTH:
                    self.counters.skipped_bytes += 1
                    at += 1
                    continue
                break
            frame = self._frame_at(at)
            if frame is None:
                self.counters.skipped_bytes += 1
                at += 1
            else:
                frames.append(frame)
                at += FRAME_BYTES
        del held[:at]
        self.counters.frames += len(frames)
        return frames

    def _frame_at(self, at: int) -> Frame | None:
        held = self._held
        if held[at + 5] != LENGTH or held[at + FRAME_BYTES - 1] != END:
            return None
        time_ms, _, frame_id = struct.unpack_from("<IBI", held, at + 1)
        data = bytes(held[at + 10 : at + 18])
        if frame_crc(time_ms, frame_id, data) != data[7]:
            self.counters.corrupt += 1
            return None
        if frame_id not in OUTBOUND:
            self.counters.corrupt += 1
            return None
        return Frame(time_ms, frame_id, data)


class Held:
    """Signals that hold from one frame of their kind to the next."""

    def __init__(self, names: tuple[str, ...]) -> None:
        self._names = names
        self._now: dict[str, float] | None = None
        self._events: list[tuple[int, dict[str, float]]] = []

    def take(self, now_ms: int, tick: str, signals: dict[str, float]) -> None:
        """A frame that came at `now_ms`; its signal `tick` says since when it holds."""
        since = now_ms - ((now_ms - int(signals[tick])) & 0xFF)
        self._events.append((since, signals))

    def at(self, times: np.ndarray) -> dict[str, np.ndarray]:
        """The signals in force at each tick; NaN before the first frame. What is older is
        forgotten.
        """
        events = sorted(self._events, key=lambda event: event[0])
        known = [self._now or dict.fromkeys(self._names, np.nan)] + [
            signals for _, signals in events
        ]
        which = np.searchsorted([since for since, _ in events], times, side="right")
        if len(times):
            self._now = known[which[-1]] if which[-1] or self._now else None
            self._events = events[which[-1] :]
        return {name: np.array([signals[name] for signals in known])[which] for name in self._names}


@dataclass
class Session:
    """One run of the board: from a BOOT frame on, frames in the order of their arrival.

    `boot`, `parameters` (raw values by index) and `table` describe the board; FAST, STATE and
    CONTROL frames wait for `take_rows`. A BOOT frame of an unknown protocol version raises
    VgrooveError. After a restart of the board (`restarted`) further frames are ignored: they belong
    to another run.
    """

    counters: Counters = field(default_factory=Counters)
    needs_boot: bool = True
    boot: dict[str, int] | None = None
    parameters: dict[int, int] = field(default_factory=dict)
    table: dict[str, int] | None = None
    acks: list[dict[str, int]] = field(default_factory=list)
    health: dict[str, int] | None = None
    restarted: bool = False
    first_ms: int | None = None  # of the first BOOT frame
    last_ms: int | None = None  # unwrapped
    _fast: list[tuple[int, Frame]] = field(default_factory=list)
    _states: "Held" = field(default_factory=lambda: Held(STATE_COLUMNS))
    _controls: "Held" = field(default_factory=lambda: Held(CONTROL_COLUMNS))
    _last_fast: tuple[int, int] | None = None
    _suspect: Frame | None = None

    def feed(self, frames: Iterable[Frame]) -> None:
        """Take frames in the order of their arrival."""
        for frame in frames:
            self._take(frame)

    def _take(self, frame: Frame) -> None:
        if self.restarted:
            return
        if frame.id == BOOT:
            self._check_boot(frame)
        elif self.boot is None and self.needs_boot:
            self.counters.before_boot += 1
            return
        suspect, self._suspect = self._suspect, None
        if suspect is not None and self._believes(suspect, frame):
            self._dispatch(suspect)
        elif suspect is not None:
            self.counters.corrupt += 1
        if not self.restarted:
            self._dispatch_or_suspect(frame)

    def _believes(self, suspect: Frame, frame: Frame) -> bool:
        """A jump in time is real when the next frame has jumped as well."""
        return (frame.time_ms - suspect.time_ms) & 0xFFFFFFFF <= 1000

    def _dispatch_or_suspect(self, frame: Frame) -> None:
        step = 0 if self.last_ms is None else (frame.time_ms - self.last_ms) & 0xFFFFFFFF
        if frame.id != BOOT and step > JUMP_MS:
            self._suspect = frame
        else:
            self._dispatch(frame)

    def _dispatch(self, frame: Frame) -> None:
        step = (
            frame.time_ms if self.last_ms is None else (frame.time_ms - self.last_ms) & 0xFFFFFFFF
        )
        if self.last_ms is not None and step >= 1 << 31:
            self._restart(frame)
            return
        self.last_ms = (self.last_ms or 0) + step
        match frame.id:
            case 256:
                self._take_fast(frame)
            case 257:
                self._states.take(self.last_ms, "state_tick", decode(frame))
            case 258:
                self._take_boot(frame)
            case 259:
                self._take_param(frame)
            case 260:
                self._take_table(frame)
            case 261:
                self.acks.append({key: int(value) for key, value in decode(frame).items()})
            case 262:
                self.health = {key: int(value) for key, value in decode(frame).items()}
            case 263:
                self._controls.take(self.last_ms, "control_tick", decode(frame))

    def _restart(self, frame: Frame) -> None:
        """Another run begins: before the parameters were complete nothing is lost by starting over,
        later the run ends here.
        """
        self.counters.restarts += 1
        if frame.id != BOOT or self.table is not None:
            self.restarted = True
            return
        self._fast, self._states, self._controls, self._last_fast = (
            [],
            Held(STATE_COLUMNS),
            Held(CONTROL_COLUMNS),
            None,
        )
        self.first_ms = self.last_ms = frame.time_ms
        self._take_boot(frame)

    def _check_boot(self, frame: Frame) -> None:
        version = frame.data[0]
        if version != PROTOCOL_VERSION:
            raise VgrooveError(
                f"The board speaks telemetry protocol {version}, this vgroove knows {PROTOCOL_VERSION}: "
                "flash the firmware of this version, or install the vgroove that belongs to the board's."
            )

    def _take_boot(self, frame: Frame) -> None:
        boot = {key: int(value) for key, value in decode(frame).items()}
        if self.boot is not None and boot["fast_divider"] != self.boot["fast_divider"]:
            self._last_fast = None
        self.boot = boot
        self.first_ms = self.last_ms if self.first_ms is None else self.first_ms
        self.parameters = {}
        self.table = None

    def _take_param(self, frame: Frame) -> None:
        index, value = frame.data[0], struct.unpack_from("<i", frame.data, 2)[0]
        self.parameters[index] = value

    def _take_table(self, frame: Frame) -> None:
        """Closes a dump; with a parameter missing or wrong the table stays None, so that the dump
        is asked for again.
        """
        table = {key: int(value) for key, value in decode(frame).items()}
        whole = sorted(self.parameters) == list(range(table["table_count"]))
        if whole and self._dump_crc16() == table["table_crc16"]:
            self.table = table

    def _dump_crc16(self) -> int:
        """CRC-16 of the parameters as they are known, in the order of a dump (a PARAM_READ in
        between must not disturb it).
        """
        return crc16(
            b"".join(
                struct.pack("<Bi", index, self.parameters[index])
                for index in sorted(self.parameters)
            )
        )

    def _take_fast(self, frame: Frame) -> None:
        counter = frame.data[6] >> 4
        now = self.last_ms
        if self._last_fast is not None:
            sent = self._fast_sent_since(now, counter)
            if sent is None:
                self.counters.corrupt += 1
                return
            self.counters.lost += sent - 1
        self.counters.fast += 1
        self._last_fast = (now, counter)
        self._fast.append((now, frame))

    def _fast_sent_since(self, now: int, counter: int) -> int | None:
        """Frames that the board sent up to this one: congruent to the counter, nearest to the time;
        None where both cannot be true.
        """
        before, counter_before = self._last_fast
        divider = max(1, self.boot["fast_divider"] if self.boot else 1)
        ticks = (now - before) // divider
        step = (counter - counter_before) & 15
        sent = step + 16 * round((ticks - step) / 16)
        if sent > ticks:
            sent -= 16
        if sent < 1 or now <= before:
            return None
        self.counters.not_sent += ticks - sent
        return sent

    def ready_until(self) -> int:
        """Rows up to this tick can be taken: no STATE or CONTROL frame that concerns them can still
        come.
        """
        return -1 if self.last_ms is None else self.last_ms - STATE_DELAY_MS

    def take_rows(self, until_ms: int | None = None) -> dict[str, np.ndarray]:
        """Rows up to a tick (None: all that there are) as columns `time_s` and COLUMNS; taken rows
        are forgotten.
        """
        count = sum(1 for time_ms, _ in self._fast if until_ms is None or time_ms <= until_ms)
        taken, self._fast = self._fast[:count], self._fast[count:]
        times = np.array([time_ms for time_ms, _ in taken], dtype=np.int64)
        fast = decode_many("FAST", [frame for _, frame in taken])
        scale = self.boot["duty_full_scale"] if self.boot else 255
        coast = fast["duty_compare"] == DUTY_COAST
        columns = {
            "time_s": times / 1000,
            "duty": np.where(coast, 0.0, fast["duty_compare"] / scale),
            "supply_v": fast["supply_v"],
            "current_a": fast["current_a"],
            "speed_rpm": fast["speed_rpm"],
            "coast": coast.astype(float),
        }
        return columns | self._states.at(times) | self._controls.at(times)

    def metadata(self) -> dict[str, object]:
        """Boot, parameters and counters, as the sidecar file and a Log carry them."""
        known = parameter_list()
        values = {parameter_name(index): raw for index, raw in sorted(self.parameters.items())}
        physical = {
            p.name: self.parameters[k] / 2**p.q for k, p in enumerate(known) if k in self.parameters
        }
        units = {p.name: p.unit for k, p in enumerate(known) if k in self.parameters}
        return {
            "boot": self.boot,
            "parameters": {
                "raw": values,
                "value": physical,
                "unit": units,
                "complete": self.table is not None,
                "table": self.table,
            },
            "counters": self.counters.as_dict(),
            "health": self.health,
        }
