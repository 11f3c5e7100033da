"""Records the board's telemetry from a serial port to CSV, MF4, BLF or ASC, and says what was lost."""

import errno
import io
import json
import os
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from copy import copy
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from typing import Any

import can
import numpy as np
import serial
from can.interfaces.serial.serial_can import SerialBus
from can.io import ASCWriter, BLFWriter

from vgroove import telemetry
from vgroove.errors import VgrooveError
from vgroove.log import UNITS, csv_header, csv_rows
from vgroove.output import check_outputs, replacing, unwritable

BOOT_WAIT_S = 5.0
DUMP_AFTER_S = 0.4  # a board that resets when the port opens speaks of itself; then it is asked
DUMP_EVERY_S = 1.0
DUMPS_MAX = 8
FLUSH_S = 0.25
DONE = "run complete"  # a partner's end as it should be
# besides what a disk or a converter does
ENDS = ("port lost", "interrupted", "board restarted", "time over", "board silent", DONE)
SILENCE_S = 2.0
MF4_ROWS = 200_000  # converted at a time
SIDECAR_SCHEMA = "vgroove.recording/1"


class ResyncBus(SerialBus):
    """python-can's serial bus whose recv survives damage: it goes on with the next intact frame and
    counts what it skipped.
    """

    def __init__(
        self, channel: str, baudrate: int = 250_000, timeout: float = 0.05, **kwargs: Any
    ) -> None:
        self.framer = telemetry.Framer()
        self._waiting: deque[telemetry.Frame] = deque()
        super().__init__(channel, baudrate=baudrate, timeout=timeout, **kwargs)
        with suppress(AttributeError, NotImplementedError):
            self._ser.exclusive = True

    def read_frames(self) -> list[telemetry.Frame]:
        """Frames completed by what has arrived; waits at most the port's time-out for a first byte."""
        try:
            data = self._ser.read(1)
            data += self._ser.read(self._ser.in_waiting) if data else b""
        except (serial.SerialException, OSError, TypeError) as error:
            raise can.CanOperationError(f"could not read from serial: {error}") from error
        return self.framer.feed(data)

    def write(self, data: bytes) -> None:
        """Bytes to the board."""
        if not data:
            return
        try:
            self._ser.write(data)
        except (serial.SerialException, OSError) as error:
            raise can.CanOperationError(f"could not write to serial: {error}") from error

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self._waiting:
            self._waiting.extend(self.read_frames())
        return (self._waiting.popleft().message() if self._waiting else None), False


def command_message(name: str, sequence: int, time_ms: int, **signals: float) -> can.Message:
    """An inbound frame as python-can sends it; signals in physical values."""
    sequence_name = next(
        s.name
        for s in telemetry.database().get_message_by_name(name).signals
        if s.name.endswith("_sequence")
    )
    frame = telemetry.frame_of_signals(name, time_ms, **signals, **{sequence_name: sequence})
    message = frame.message()
    message.timestamp = (time_ms + 0.5) / 1000  # python-can truncates
    return message


class Partner:
    """Who speaks with the board while it is recorded: here nobody, and nothing but the recording's
    own limits ends it.
    """

    over = ""  # why the recording is to end
    most_silence_s = float("inf")

    def hear(self, frames: list[telemetry.Frame]) -> list[telemetry.Frame]:
        """Frames of the board; returns those that are to be recorded."""
        return frames

    def speak(self) -> bytes:
        """What is to be sent now; asked after each hear()."""
        return b""


@dataclass
class Recording:
    """What to record, and what became of it."""

    port: str
    output: Path
    baud: int = 250_000
    seconds: float | None = None
    partner: Partner = field(default_factory=Partner)
    session: telemetry.Session = field(default_factory=telemetry.Session)
    rows: int = 0
    ended: str = ""

    @property
    def recorded_s(self) -> float:
        """Board time from the BOOT frame on."""
        first, last = self.session.first_ms, self.session.last_ms
        return 0.0 if first is None or last is None else (last - first) / 1000

    @property
    def most_silence_s(self) -> float:
        """For how long the board may say nothing; infinite where only the user ends the recording."""
        return self.partner.most_silence_s if self.seconds is None else SILENCE_S + self.seconds


class Sink(ABC):
    """Where a recording goes. The file appears under its name when it is complete."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.part = path.with_name(f".{path.stem}.part{path.suffix}")
        self.rows = 0

    def frame(self, frame: telemetry.Frame) -> None:
        """An intact frame, in the order of arrival."""
        del frame

    @abstractmethod
    def block(self, columns: dict[str, np.ndarray]) -> None:
        """Rows that are final."""

    @abstractmethod
    def finish(self) -> None:
        """Complete the part file."""

    @abstractmethod
    def rescue(self) -> None:
        """The disk is full: complete the part file with what it holds, without more room; `path`
        then says under which name.
        """

    def publish(self) -> None:
        """Give the part file its name."""
        os.replace(self.part, self.path)

    def discard(self) -> None:
        """Leave nothing behind."""
        with suppress(OSError):
            self.part.unlink()

    @contextmanager
    def _or_nothing(self) -> Iterator[None]:
        try:
            yield
        except OSError:
            self.discard()
            raise


class PlainFile(io.FileIO):
    """A file without a buffer that writes all or raises: what could not be written is not tried
    again on closing.
    """

    def write(self, data: Any) -> int:
        view = memoryview(data).cast("B")
        total = len(view)
        while view:
            view = view[super().write(view) :]
        return total


class CsvSink(Sink):
    """The gap contract's columns, a row a FAST frame."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._file = PlainFile(self.part, "wb")
        with self._or_nothing():
            self._file.write(csv_header(telemetry.COLUMNS))
        self._whole = self._file.tell()

    def block(self, columns: dict[str, np.ndarray]) -> None:
        self._file.write(csv_rows(columns["time_s"], [columns[name] for name in telemetry.COLUMNS]))
        self._whole = self._file.tell()
        self.rows += len(columns["time_s"])

    def finish(self) -> None:
        os.fsync(self._file.fileno())
        self._file.close()

    def rescue(self) -> None:
        if not self._file.closed:
            self._file.truncate(self._whole)
            self._file.close()


class Mf4Sink(Sink):
    """The same columns as channels with units, made by asammdf at the end from a CSV file that
    grows meanwhile and stays if that fails.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._spool = CsvSink(path.with_name(path.name + ".csv"))

    def block(self, columns: dict[str, np.ndarray]) -> None:
        self._spool.block(columns)
        self.rows = self._spool.rows

    def finish(self) -> None:
        self._spool.finish()
        try:
            _mf4_of_csv(self._spool.part, self.part)
        except Exception as error:  # whatever asammdf raises: the rows are in the CSV file
            reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
            raise VgrooveError(f"{self.path}: the MF4 file could not be made: {reason}") from error

    def rescue(self) -> None:
        self._spool.rescue()
        with suppress(OSError):
            self.part.unlink()
        self.path, self.part = self._spool.path, self._spool.part

    def publish(self) -> None:
        super().publish()
        self._spool.discard()

    def discard(self) -> None:
        super().discard()
        self._spool.discard()


def _mf4_of_csv(source: Path, target: Path) -> None:
    """Rows of a CSV log of ours as an MF4 file, MF4_ROWS at a time; a file without rows becomes an
    empty one.
    """
    from asammdf import MDF, Signal

    with MDF(version="4.10") as mdf, source.open(encoding="ascii") as file:
        names = file.readline().strip().split(",")[1:]
        while lines := list(islice(file, MF4_ROWS)):
            time_s, *columns = np.loadtxt(lines, delimiter=",", ndmin=2).T
            if mdf.groups:
                mdf.extend(
                    0, [(np.ascontiguousarray(values), None) for values in (time_s, *columns)]
                )
            else:
                signals = [
                    Signal(values, time_s, unit=UNITS[name], name=name)
                    for name, values in zip(names, columns, strict=True)
                ]
                mdf.append(signals, comment="vgroove record")
        mdf.save(target, overwrite=True)


class BoardAscWriter(ASCWriter):
    """python-can's ASC writer with the board's own time, which the frames' CRC covers, instead of
    the time since the first frame.
    """

    def __init__(self, file: Any, **kwargs: Any) -> None:
        super().__init__(file, **kwargs)
        self.file.write(f"Begin Triggerblock {self._format_header_datetime(datetime.now())}\n")
        self.header_written = True
        self.log_event("Start of measurement", 0.0)


class BlfSink(Sink):
    """Every intact frame, by python-can's writer, stamped with the board's time."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._file = PlainFile(self.part, "wb")
        with self._or_nothing():
            self._writer = BLFWriter(self._file)
        self._writer.start_timestamp = 0.0
        self._whole = (self._file.tell(), 0)

    def frame(self, frame: telemetry.Frame) -> None:
        self._writer.on_message_received(frame.message())

    def block(self, columns: dict[str, np.ndarray]) -> None:
        self._writer._flush()
        self._whole = (self._file.tell(), self._writer.object_count)
        self.rows += len(columns["time_s"])

    def finish(self) -> None:
        self._writer.stop()

    def rescue(self) -> None:
        """Back to the last container that is whole; the header is rewritten in its place."""
        whole, self._writer.object_count = self._whole
        self._writer._buffer, self._writer._buffer_size = [], 0
        self._file.truncate(whole)
        self._file.seek(whole)
        self._writer.stop()


class AscSink(Sink):
    """Every intact frame as a line, by python-can's writer, stamped with the board's time."""

    END = b"End TriggerBlock\n"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._file = PlainFile(self.part, "wb")
        self._text = io.StringIO()
        self._writer = BoardAscWriter(self._text)

    def frame(self, frame: telemetry.Frame) -> None:
        self._writer.on_message_received(frame.message())

    def _drain(self) -> None:
        text = self._text.getvalue()
        self._text.seek(0)
        self._text.truncate()
        self._file.write(text.encode())

    def block(self, columns: dict[str, np.ndarray]) -> None:
        self._drain()
        self.rows += len(columns["time_s"])

    def finish(self) -> None:
        self._drain()
        self._file.write(self.END)
        self._file.close()

    def rescue(self) -> None:
        """Back to the end of a line that leaves room for the end mark."""
        size = self._file.tell()
        self._file.close()
        with self.part.open("rb+") as file:
            file.seek(max(0, size - 1024))
            tail = file.read()
            cut = size - len(tail) + tail[: -len(self.END)].rfind(b"\n") + 1
            file.truncate(cut)
            file.seek(cut)
            file.write(self.END)


SINKS: dict[str, type[Sink]] = {".csv": CsvSink, ".mf4": Mf4Sink, ".blf": BlfSink, ".asc": AscSink}


def record(
    recording: Recording,
    stopped: Callable[[], bool],
    progress: Callable[[Recording], None] = lambda _: None,
) -> None:
    """Record until `stopped()`, until `seconds` of board time or the partner's run are over, or
    until the port goes away; the file is then complete.

    Raises VgrooveError: the port cannot be opened or shows no board, unknown protocol, file cannot
    be written, disk full (what was recorded is kept), the port went away or the partner gave up
    before the end (likewise), no sample came.
    """
    sink_type = SINKS.get(recording.output.suffix.lower())
    if sink_type is None:
        raise VgrooveError(f"{recording.output}: a recording ends in .csv, .mf4, .blf or .asc.")
    check_outputs((recording.output, _sidecar(recording.output)))
    bus = _open(recording)
    try:
        bus.framer.counters = recording.session.counters
        begin = _wait_for_boot(bus, recording, stopped)
        sink = _opened(sink_type, recording.output)
        _record_into(sink, bus, recording, begin, stopped, progress)
    finally:
        bus.shutdown()
    progress(recording)


def _open(recording: Recording) -> ResyncBus:
    try:
        return ResyncBus(recording.port, baudrate=recording.baud)
    except (serial.SerialException, can.CanError, OSError, ValueError) as error:
        raise VgrooveError(f"{recording.port}: the port cannot be opened: {error}.") from error


def _opened(sink_type: type[Sink], path: Path) -> Sink:
    try:
        return sink_type(path)
    except OSError as error:
        raise unwritable(path, error) from error


class _Dumper:
    """Asks the board for its parameters, again while they are not complete."""

    def __init__(self, bus: ResyncBus, first_after_s: float) -> None:
        self._bus = bus
        self._start = time.monotonic()
        self._next = self._start + first_after_s
        self._sent = 0

    def ask(self) -> None:
        now = time.monotonic()
        if now < self._next or self._sent >= DUMPS_MAX:
            return
        self._sent += 1
        self._next = now + DUMP_EVERY_S
        try:
            self._bus.send(command_message("DUMP", self._sent, int((now - self._start) * 1000)))
        except (can.CanError, serial.SerialException, OSError) as error:
            raise can.CanOperationError(f"could not write to serial: {error}") from error


def _from_boot(frames: list[telemetry.Frame]) -> list[telemetry.Frame]:
    return frames[next(k for k, frame in enumerate(frames) if frame.id == telemetry.BOOT) :]


def _wait_for_boot(
    bus: ResyncBus, recording: Recording, stopped: Callable[[], bool]
) -> list[telemetry.Frame]:
    """Frames from the first BOOT frame on; what came before is counted."""
    session, dumper = recording.session, _Dumper(bus, DUMP_AFTER_S)
    deadline = time.monotonic() + BOOT_WAIT_S
    before = copy(session.counters)
    while time.monotonic() < deadline:
        if stopped():
            raise KeyboardInterrupt
        try:
            dumper.ask()
            frames = bus.read_frames()
        except can.CanOperationError as error:
            raise VgrooveError(
                f"{recording.port}: the port was lost before the board said what it is ({error})."
            ) from error
        kept = recording.partner.hear(frames)
        session.feed(kept)
        if session.boot is not None:
            session.counters.begin(before, len(_from_boot(frames)), bus.framer.held)
            return _from_boot(kept)
        before = copy(session.counters)
    counters = session.counters
    heard = f"{counters.bytes} bytes, {counters.frames} intact frames"
    raise VgrooveError(
        f"{recording.port}: no boot frame within {BOOT_WAIT_S:g} s at {recording.baud} Bd ({heard}): "
        "is it a vgroove board, and is the rate the one that it uses?"
    )


def _record_into(
    sink: Sink,
    bus: ResyncBus,
    recording: Recording,
    begin: list[telemetry.Frame],
    stopped: Callable[[], bool],
    progress: Callable[[Recording], None],
) -> None:
    """Fill, complete and publish the sink, whatever happens to it; the sidecar says how it ended."""
    started = datetime.now(UTC)
    try:
        for frame in begin:
            sink.frame(frame)
        recording.ended = _run(sink, bus, recording, stopped, progress)
        sink.block(recording.session.take_rows())
        sink.finish()
    except (OSError, VgrooveError, MemoryError, KeyboardInterrupt) as error:
        recording.ended = _ended_by(error, sink.path)
        _keep(sink, sink.rescue)
    recording.rows = sink.rows
    if sink.rows == 0:
        sink.discard()
        raise VgrooveError(
            f"{recording.port}: {recording.ended}; no sample was recorded, nothing is written."
        )
    _keep(sink, sink.publish)
    recording.output = sink.path
    _write_sidecar(recording, started)
    _complain(recording)


def _ended_by(error: BaseException, path: Path) -> str:
    """Why a recording ended before its time, in words."""
    if isinstance(error, KeyboardInterrupt):
        return "interrupted"
    if isinstance(error, VgrooveError):
        return str(error)
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
        return "disk full"
    return f"{path}: cannot be written: {getattr(error, 'strerror', None) or type(error).__name__}"


def _keep(sink: Sink, work: Callable[[], None]) -> None:
    """Complete or rename the part file; where even that fails it stays as it is, and the sentence
    names it.
    """
    try:
        work()
    except OSError as error:
        raise VgrooveError(
            f"{sink.path}: cannot be written: {error.strerror or error}; what was recorded is in {sink.part}."
        ) from error


def _run(
    sink: Sink,
    bus: ResyncBus,
    recording: Recording,
    stopped: Callable[[], bool],
    progress: Callable[[Recording], None],
) -> str:
    """Feed the sink until the recording ends; returns why it ended."""
    session, partner, dumper = recording.session, recording.partner, _Dumper(bus, DUMP_EVERY_S)
    flush_at = heard_at = time.monotonic()
    while True:
        try:
            if session.table is None:
                dumper.ask()
            frames = bus.read_frames()
            kept = partner.hear(frames)
            bus.write(partner.speak())
        except can.CanOperationError:
            return "port lost"
        session.feed(kept)
        for frame in kept:
            sink.frame(frame)
        now = time.monotonic()
        heard_at = now if frames else heard_at
        if now >= flush_at:
            flush_at = now + FLUSH_S
            sink.block(session.take_rows(session.ready_until()))
            recording.rows = sink.rows
            progress(recording)
        ended = "interrupted" if stopped() else _ended(recording, now - heard_at)
        if ended:
            return ended


def _ended(recording: Recording, silent_s: float) -> str:
    """Why the recording is at its end; empty while it is not."""
    if recording.session.restarted:
        return "board restarted"
    if recording.seconds is not None and recording.recorded_s >= recording.seconds:
        return "time over"
    if silent_s > recording.most_silence_s:
        return "board silent"
    return recording.partner.over


def _sidecar(output: Path) -> Path:
    return output.with_name(output.name + ".json")


def _write_sidecar(recording: Recording, started: datetime) -> None:
    """What a log does not say itself: board, parameters, losses."""
    path = _sidecar(recording.output)
    content = {
        "schema": SIDECAR_SCHEMA,
        "file": recording.output.name,
        "port": recording.port,
        "baud": recording.baud,
        "started_utc": started.isoformat(timespec="milliseconds"),
        "ended": recording.ended,
        "rows": recording.rows,
        **recording.session.metadata(),
    }
    try:
        with replacing(path) as file:
            file.write((json.dumps(content, indent=2) + "\n").encode())
    except OSError as error:
        done = f"{recording.rows} rows are in {recording.output}"
        raise VgrooveError(
            f"{path}: cannot be written: {error.strerror or error}; {done}."
        ) from error


def _complain(recording: Recording) -> None:
    """Ends that the user did not ask for, after the file has been completed."""
    kept = f"{recording.rows} rows until then are in {recording.output}"
    if recording.ended == "disk full":
        raise VgrooveError(f"{recording.output}: the disk is full; {kept}.")
    if recording.ended not in ENDS:
        raise VgrooveError(f"{recording.ended}; {kept}.")
    if recording.ended in (
        "port lost",
        "board silent",
        "board restarted",
    ) and recording.most_silence_s < float("inf"):
        of = "" if recording.seconds is None else f" of {recording.seconds:g}"
        raise VgrooveError(
            f"{recording.port}: {recording.ended} after {recording.recorded_s:.1f}{of} s; {kept}."
        )
