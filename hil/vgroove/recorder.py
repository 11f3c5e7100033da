"""Records the board's telemetry from a serial port to a file, and reports what was lost."""

import errno
import json
import time
from collections.abc import Callable
from contextlib import suppress
from copy import copy
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

import can
import numpy as np
import serial

from vgroove import telemetry
from vgroove.errors import VgrooveError
from vgroove.output import check_outputs, replacing, unwritable
from vgroove.recording_files import RecordingFile, file_type
from vgroove.serial_bus import ResyncBus, command_message, open_bus

BOOT_TIMEOUT_S = 5.0
# A board that resets when the port opens sends BOOT by itself within this time; from others it is
# requested by DUMP.
FIRST_DUMP_S = 0.4
DUMP_INTERVAL_S = 1.0
MAX_DUMPS = 8
FLUSH_INTERVAL_S = 0.25
MAX_SILENCE_S = 2.0
RUN_COMPLETE = "run complete"  # the expected end of a host program
# Values of `ended`; an error of the disk or of the conversion has its message there instead.
ENDS = (
    "port lost",
    "interrupted",
    "board restarted",
    "time over",
    "board silent",
    RUN_COMPLETE,
)
# Ends that are errors, the latter unless only the user's Ctrl-C was to end the recording.
LOST_ENDS, EARLY_ENDS = ("port lost",), ("board silent", "board restarted")
SIDECAR_SCHEMA = "vgroove.recording/1"


class HostProgram:
    """What the host sends while it records, and which frames it keeps. This one sends nothing,
    keeps all and never ends the recording.
    """

    ended = ""  # why the recording is to end
    max_silence_s = float("inf")  # for which the board may send nothing

    def select(self, frames: list[telemetry.Frame]) -> list[telemetry.Frame]:
        """Take note of the board's frames and return those that are to be recorded."""
        return frames

    def next_bytes(self) -> bytes:
        """Bytes to send; called after each `select`."""
        return b""


@dataclass
class Recording:
    """What to record, and its result. `without_boot`: begin with the first intact frame; duty 1 is
    then taken as compare value 255, and parameters are missing unless the board sends them.
    """

    port: str
    output: Path
    baud: int = 250_000
    seconds: float | None = None
    without_boot: bool = False
    program: HostProgram = field(default_factory=HostProgram)
    notify: Callable[[str], None] = lambda _: None  # is called with remarks for the user
    # is called with each block of rows that is recorded, (n,) by column name with `time_s`
    take_rows: Callable[[dict[str, np.ndarray]], None] = lambda _: None
    session: telemetry.Session = field(default_factory=telemetry.Session)
    rows: int = 0
    ended: str = ""

    @property
    def recorded_s(self) -> float:
        """Board time since the BOOT frame."""
        first, last = self.session.first_ms, self.session.last_ms
        return 0.0 if first is None or last is None else (last - first) / 1000

    @property
    def max_silence_s(self) -> float:
        """For how long the board may send nothing; infinite where only the user ends the
        recording.
        """
        return self.program.max_silence_s if self.seconds is None else MAX_SILENCE_S + self.seconds


def record(
    recording: Recording,
    stopped: Callable[[], bool],
    progress: Callable[[Recording], None] = lambda _: None,
) -> None:
    """Record until `stopped()`, until `seconds` of board time have passed, until the host program
    ends, or until the port is lost; the file is then complete.

    Raises VgrooveError: the port cannot be opened or no board answers, unknown protocol, the file
    cannot be written, no row was received; with the recorded rows kept: the disk is full, the port
    was lost or the host program failed before the end.
    """
    create = file_type(recording.output)
    check_outputs((recording.output, _sidecar(recording.output)))
    file = _create(create, recording)
    try:
        _record_into(file, recording, stopped, progress)
    finally:
        file.release()
    progress(recording)


def _record_into(
    file: RecordingFile,
    recording: Recording,
    stopped: Callable[[], bool],
    progress: Callable[[Recording], None],
) -> None:
    try:
        bus = open_bus(recording.port, recording.baud)
    except BaseException:
        file.discard()
        raise
    try:
        bus.framer.counters = recording.session.counters
        _Recorder(bus, recording, stopped, progress).run(file)
    finally:
        bus.shutdown()


def _create(create: type[RecordingFile], recording: Recording) -> RecordingFile:
    """The file to fill. It is made before the port is opened, which resets some boards."""
    path = recording.output
    try:
        file = create(path)
    except OSError as error:
        raise unwritable(path, error) from error
    if file.recovered:
        recording.notify(recovered_text(path, file.recovered))
    return file


def recovered_text(output: Path, recovered: Path) -> str:
    """The remark on a part file that a killed process had left."""
    return (
        f"{output}: an earlier recording to this file was killed; what it recorded is in "
        f"{recovered}."
    )


class _DumpRequester:
    """Requests the board's parameters by DUMP frames, repeatedly until the caller has them all."""

    def __init__(self, bus: ResyncBus, first_after_s: float) -> None:
        self._bus = bus
        self._start = time.monotonic()
        self._next = self._start + first_after_s
        self._sent = 0

    def request(self) -> None:
        """Send a DUMP frame if one is due."""
        now = time.monotonic()
        if now < self._next or self._sent >= MAX_DUMPS:
            return
        self._sent += 1
        self._next = now + DUMP_INTERVAL_S
        try:
            self._bus.send(command_message("DUMP", self._sent, int((now - self._start) * 1000)))
        except (can.CanError, serial.SerialException, OSError) as error:
            raise can.CanOperationError(f"could not write to serial: {error}") from error


def _line_advice(counters: telemetry.Counters) -> str:
    """What to check on a line without a BOOT frame."""
    if counters.bytes == 0:
        return (
            "the line is silent: check that the board has power, that its TX wire reaches this "
            "port, and that it runs vgroove's firmware."
        )
    if counters.frames == 0:
        return (
            "nothing that arrives is a frame: check the rate (250000, or 115200 with parameter "
            "baud_select) and that it is a vgroove board."
        )
    return (
        "the board sends, but does not answer the request for its parameters: check the wire from "
        "this computer to its RX pin, or record with --without-boot."
    )


def _from_boot(frames: list[telemetry.Frame]) -> list[telemetry.Frame]:
    return frames[next(k for k, frame in enumerate(frames) if frame.id == telemetry.BOOT) :]


@dataclass
class _Recorder:
    """A recording in progress."""

    bus: ResyncBus
    recording: Recording
    stopped: Callable[[], bool]
    progress: Callable[[Recording], None]

    def run(self, file: RecordingFile) -> None:
        """Fill the file from the board's BOOT frame on; without one the file is deleted."""
        try:
            first_frames = self._wait_for_boot()
        except BaseException:
            file.discard()
            raise
        self._fill(file, first_frames)

    def _wait_for_boot(self) -> list[telemetry.Frame]:
        """Frames from the first BOOT frame on; what came before is only counted.

        VgrooveError when the port is lost or no BOOT frame comes within BOOT_TIMEOUT_S.
        """
        recording, session = self.recording, self.recording.session
        dumps = _DumpRequester(self.bus, FIRST_DUMP_S)
        deadline = time.monotonic() + BOOT_TIMEOUT_S
        before = copy(session.counters)
        while time.monotonic() < deadline:
            if self.stopped():
                raise KeyboardInterrupt
            try:
                dumps.request()
                frames = self.bus.read_frames()
            except can.CanOperationError as error:
                raise VgrooveError(
                    f"{recording.port}: the port was lost before a BOOT frame came ({error})."
                ) from error
            kept = recording.program.select(frames)
            session.needs_boot = not recording.without_boot
            session.feed(kept)
            if session.boot is not None:
                session.counters.begin(before, len(_from_boot(frames)), self.bus.framer.held)
                return _from_boot(kept)
            if recording.without_boot and kept:
                session.counters.begin(before, len(frames), self.bus.framer.held)
                return kept
            before = copy(session.counters)
        raise self._no_board()

    def _no_board(self) -> VgrooveError:
        recording, counters = self.recording, self.recording.session.counters
        received = f"{counters.bytes} bytes, {counters.frames} intact frames"
        return VgrooveError(
            f"{recording.port}: no boot frame within {BOOT_TIMEOUT_S:g} s at {recording.baud} Bd "
            f"({received}): {_line_advice(counters)}"
        )

    def _fill(self, file: RecordingFile, first_frames: list[telemetry.Frame]) -> None:
        """Fill, complete and publish the file, whatever error occurs; the sidecar file states how
        the recording ended.
        """
        started = datetime.now(UTC)
        recording = self.recording
        try:
            for frame in first_frames:
                file.add_frame(frame)
            recording.ended = self._until_end(file)
            file.add_rows(recording.session.take_rows())
            file.finish()
        except (OSError, VgrooveError, MemoryError, KeyboardInterrupt) as error:
            recording.ended = _ended_by(error, file.path)
            _complete(file, file.salvage)
        recording.rows = file.rows
        if file.rows == 0:
            file.discard()
            raise VgrooveError(
                f"{recording.port}: {recording.ended}; no sample was recorded, nothing is written."
            )
        _complete(file, file.publish)
        recording.output = file.path
        _write_sidecar(recording, started)
        _raise_early_end(recording)

    def _until_end(self, file: RecordingFile) -> str:
        """Add frames and rows until the recording ends; returns why it ended."""
        recording, session = self.recording, self.recording.session
        dumps = _DumpRequester(self.bus, DUMP_INTERVAL_S)
        flush_at = last_frame_at = time.monotonic()
        while True:
            try:
                if session.table is None:
                    dumps.request()
                frames = self.bus.read_frames()
                kept = recording.program.select(frames)
                self.bus.write(recording.program.next_bytes())
            except can.CanOperationError:
                return "port lost"
            session.feed(kept)
            for frame in kept:
                file.add_frame(frame)
            now = time.monotonic()
            last_frame_at = now if frames else last_frame_at
            if now >= flush_at:
                flush_at = now + FLUSH_INTERVAL_S
                rows = session.take_rows(session.ready_until())
                file.add_rows(rows)
                recording.take_rows(rows)
                recording.rows = file.rows
                self._show()
            ended = "interrupted" if self.stopped() else _ended(recording, now - last_frame_at)
            if ended:
                return ended

    def _show(self) -> None:
        with suppress(OSError):  # a terminal that has hung up ends no recording
            self.progress(self.recording)


def _ended(recording: Recording, silent_s: float) -> str:
    """Why the recording is at its end; empty while it is not."""
    if recording.session.restarted:
        return "board restarted"
    if recording.seconds is not None and recording.recorded_s >= recording.seconds:
        return "time over"
    if silent_s > recording.max_silence_s:
        return "board silent"
    return recording.program.ended


def _ended_by(error: BaseException, path: Path) -> str:
    """The error that ended a recording, in words."""
    if isinstance(error, KeyboardInterrupt):
        return "interrupted"
    if isinstance(error, VgrooveError):
        return str(error)
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
        return "disk full"
    return f"{path}: cannot be written: {getattr(error, 'strerror', None) or type(error).__name__}"


def _complete(file: RecordingFile, step: Callable[[], None]) -> None:
    """Complete or rename the part file; where that fails, the part file stays and the message
    names it.
    """
    try:
        step()
    except OSError as error:
        raise VgrooveError(
            f"{file.path}: cannot be written: {error.strerror or error}; "
            f"what was recorded is in {file.part}."
        ) from error


def _sidecar(output: Path) -> Path:
    return output.with_name(output.name + ".json")


def _write_sidecar(recording: Recording, started: datetime) -> None:
    """Write board, parameters and losses, which the log file itself does not hold."""
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


def _raise_early_end(recording: Recording) -> None:
    """VgrooveError for an end that the user did not ask for, after the file has been completed."""
    kept = f"{recording.rows} rows until then are in {recording.output}"
    if recording.ended == "disk full":
        raise VgrooveError(f"{recording.output}: the disk is full; {kept}.")
    if recording.ended not in ENDS:
        raise VgrooveError(f"{recording.ended}; {kept}.")
    limited = recording.max_silence_s < float("inf")
    if recording.ended in LOST_ENDS or (recording.ended in EARLY_ENDS and limited):
        of = "" if recording.seconds is None else f" of {recording.seconds:g}"
        raise VgrooveError(
            f"{recording.port}: {recording.ended} after {recording.recorded_s:.1f}{of} s; {kept}."
        )
