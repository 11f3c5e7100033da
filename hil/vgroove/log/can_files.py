"""BLF, ASC and MF4 logs: recorded CAN frames, or (MF4) channels."""

import io
import re
import traceback
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from vgroove import telemetry
from vgroove.errors import VgrooveError
from vgroove.log.column_map import NO_MAP, ColumnMap
from vgroove.log.mf4_channels import log_from_channels
from vgroove.log.raw_columns import mapped
from vgroove.log.table import Log, checked
from vgroove.log.telemetry_log import log_from_session
from vgroove.python_can import mf4_files

QUARTER_HOUR_MS = 15 * 60 * 1000  # time zones differ by multiples of it
TIME_ZONES = range(-56, 57)  # -14 h to +14 h in quarters of an hour


def read_blf(path: Path, columns: ColumnMap = NO_MAP) -> Log:
    """Read a BLF recording; VgrooveError where it is damaged or holds no telemetry."""
    from can.io import BLFReader

    with _named_damage(path, "BLF"), BLFReader(path) as reader:
        messages = list(reader)
        if reader.object_count > len(messages):
            raise ValueError(
                f"its header counts {reader.object_count} objects, {len(messages)} can be read"
            )
        size = path.stat().st_size
        if reader.file_size not in (0, size) and size < reader.file_size:
            raise ValueError(f"its header states {reader.file_size} bytes, it has {size}")
    return mapped(_log_from_messages(path, messages), columns)


def read_asc(path: Path, columns: ColumnMap = NO_MAP) -> Log:
    """Read an ASC recording; VgrooveError where it is damaged or holds no telemetry."""
    from can.io import ASCReader

    text = path.read_text("utf-8", errors="replace")
    with _named_damage(path, "ASC"):
        if "end triggerblock" not in text[-200:].lower():
            raise ValueError("its end is missing")
        with ASCReader(io.StringIO(text), relative_timestamp=True) as reader:
            messages = list(reader)
    return mapped(_log_from_messages(path, messages, _asc_offsets(text)), columns)


def read_mf4(path: Path, columns: ColumnMap = NO_MAP) -> Log:
    """Read an MF4 file of CAN frames or of channels; VgrooveError where it is damaged."""
    from asammdf import MDF

    with _named_damage(path, "MF4"), MDF(str(path)) as mdf:
        if "CAN_DataFrame" in mdf.channels_db:
            return mapped(_log_from_messages(path, _mf4_messages(path)), columns)
        return log_from_channels(path, mdf, columns)


@contextmanager
def _named_damage(path: Path, kind: str) -> Iterator[None]:
    """Turns any exception that a third-party reader raises on damaged bytes into a VgrooveError."""
    try:
        yield
    except (VgrooveError, OSError, MemoryError):
        raise
    except Exception as error:
        _close_half_made(error)
        raise VgrooveError(
            f"{path}: is a damaged or truncated {kind} file: {error or type(error).__name__}."
        ) from error


def _close_half_made(error: Exception) -> None:
    """Mark the objects of asammdf whose constructor raised `error` as closed: their destructor
    would close them, which fails on attributes that they lack and prints a traceback.
    """
    for frame, _ in traceback.walk_tb(error.__traceback__):
        made = frame.f_locals.get("self")
        if type(made).__module__.startswith("asammdf.") and hasattr(made, "_closed"):
            made._closed = True


def _telemetry_frames(messages: Iterable[Any]) -> list[telemetry.Frame]:
    """Messages of the form of telemetry frames; their CRC is not checked."""
    return [
        telemetry.Frame(
            round(message.timestamp * 1000) & 0xFFFFFFFF,
            message.arbitration_id,
            bytes(message.data),
        )
        for message in messages
        if message.arbitration_id in telemetry.OUTBOUND
        and len(message.data) == telemetry.LENGTH
        and not message.is_error_frame
    ]


def _log_from_messages(path: Path, messages: Iterable[Any], likely_ms: Iterable[int] = (0,)) -> Log:
    """A CAN recording decoded with the signal list. Where the file keeps only time differences, the
    board's time is recovered from the CRCs, `likely_ms` offsets first.
    """
    frames, likely_ms = _telemetry_frames(messages), list(likely_ms)
    offset = telemetry.time_offset(frames, likely_ms) or 0
    frames = [frame._replace(time_ms=(frame.time_ms + offset) & 0xFFFFFFFF) for frame in frames]
    intact = [frame for frame in frames if telemetry.frame_crc(*frame) == frame.data[7]]
    if not intact:
        raise VgrooveError(
            f"{path}: holds no intact telemetry frame of a vgroove board "
            f"({len(frames)} frames with its ids): decode those of another device by its own DBC, "
            "and write the signals as channels of an MF4 file or as CSV."
        )
    session, left_out = _longest_run(intact)
    session.counters.frames = len(intact)
    session.counters.corrupt += len(frames) - len(intact)
    log = log_from_session(session, str(path))
    if offset not in likely_ms:
        log.warnings.append(
            f"{path}: keeps only time differences: the start of time_s may not be the board's."
        )
    log.warnings += _session_warnings(session, log, left_out)
    return checked(log)


def _longest_run(frames: list[telemetry.Frame]) -> tuple[telemetry.Session, int]:
    """The run of the board with the most rows, the first of equal ones, and the number of rows of
    the other runs: a restart of the board ends a run.
    """
    runs = [telemetry.Session(needs_boot=False)]
    for before, frame in zip([None, *frames], frames, strict=False):
        runs[-1].feed([frame])
        if runs[-1].restarted:
            # a frame other than BOOT is confirmed as a restart by the one after it
            first = [before, frame] if before and frame.id != telemetry.BOOT else [frame]
            runs.append(telemetry.Session(needs_boot=False))
            runs[-1].feed(first)
    longest = max(runs, key=lambda run: run.counters.fast)
    return longest, sum(run.counters.fast for run in runs) - longest.counters.fast


def _session_warnings(session: telemetry.Session, log: Log, left_out: int) -> list[str]:
    """Losses of a recording, and its rows that were left out because the board restarted."""
    found, counters, path = [], session.counters, log.source
    if counters.corrupt or counters.lost:
        found.append(
            f"{path}: {counters.corrupt} frames are corrupt, {counters.lost} FAST frames were lost."
        )
    if session.boot is None:
        found.append(f"{path}: holds no BOOT frame: duty 1 is taken as compare value 255.")
    if left_out:
        found.append(
            f"{path}: {telemetry.BOARD_RESTARTED}: the longest run is read, {left_out} rows of "
            "others are left out."
        )
    return found


def _asc_offsets(text: str) -> list[int]:
    """Likely offsets (ms) of an ASC file: python-can writes times since the first frame, and that
    frame's time as a local date with unpadded milliseconds. A date in another language or form
    gives none.
    """
    match = re.search(
        r"Begin Triggerblock \w+ (\w+ \d+ \d+:\d+:\d+)\.(\d+) (\d+)", text, re.IGNORECASE
    )
    if match is None:
        return [0]
    try:
        moment = datetime.strptime(f"{match[1]} {match[3]}", "%b %d %H:%M:%S %Y")
    except ValueError:
        return [0]
    moment = moment.replace(tzinfo=UTC)
    start_ms = round(moment.timestamp()) * 1000 + int(match[2])
    return [0, *((start_ms + zone * QUARTER_HOUR_MS) & 0xFFFFFFFF for zone in TIME_ZONES)]


def _mf4_messages(path: Path) -> list[Any]:
    with mf4_files().MF4Reader(path) as reader:
        return list(reader)
