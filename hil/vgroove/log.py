"""Logs: one table of samples over time, from a CSV, a CAN recording, the board, the simulation or a
bench (gap contract, section 1).
"""

import csv
import io
import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from vgroove import telemetry
from vgroove.errors import VgrooveError
from vgroove.output import write_bytes

INPUTS = ("duty", "voltage_v", "current_a")
UNITS = {
    "duty": "", "voltage_v": "V", "supply_v": "V", "current_a": "A", "speed_rpm": "rpm", "position_rad": "rad", "load_nm": "Nm",
    "anvil_torque_nm": "Nm", "anvil_angle_rad": "rad", "hammer_mm": "mm", "coast": "", "trigger": "", "state": "",
    **dict.fromkeys((*telemetry.STATE_COLUMNS, *telemetry.CONTROL_COLUMNS), ""), "blow_period_ms": "ms",
}  # fmt: skip
MEASURED = (
    "voltage_v",
    "supply_v",
    "current_a",
    "speed_rpm",
    "position_rad",
    "anvil_torque_nm",
    "anvil_angle_rad",
    "hammer_mm",
)
USABLE_MIN = 50
UNSIGNED_ROWS_MIN = 20
UNSIGNED_CURRENT_A = 1.0


@dataclass
class Log:
    """Samples over time: `time_s` strictly increasing, `columns` of the same length with NaN where
    a sample is missing.

    `source` names where it came from (for messages), `meta` holds what a recording says of the
    board (boot, parameters, counters).
    """

    time_s: np.ndarray
    columns: dict[str, np.ndarray]
    source: str
    warnings: list[str] = field(default_factory=list)
    meta: dict[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.time_s)

    def __getitem__(self, name: str) -> np.ndarray:
        return self.time_s if name == "time_s" else self.columns[name]

    def __contains__(self, name: object) -> bool:
        return name == "time_s" or name in self.columns

    def require(self, *names: str) -> None:
        """VgrooveError naming the file and the first of `names` that is not there."""
        for name in names:
            if name not in self:
                raise VgrooveError(f"{self.source}: the column {name} is missing.")


def read_log(path: str | os.PathLike[str]) -> Log:
    """Read a CSV, MF4, BLF or ASC log; VgrooveError with file, line and column for everything that
    the contract rejects.
    """
    path = Path(path)
    readers: dict[str, Callable[[Path], Log]] = {
        ".csv": _read_csv,
        ".mf4": _read_mf4,
        ".blf": _read_blf,
        ".asc": _read_asc,
    }
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise VgrooveError(f"{path}: a log ends in .csv, .mf4, .blf or .asc.")
    try:
        _check_ending(path)
        log = reader(path)
    except OSError as error:
        raise VgrooveError(f"{path}: cannot be read: {error.strerror or error}.") from error
    return log


_MAGIC = {".mf4": b"MDF ", ".blf": b"LOGG"}


def _check_ending(path: Path) -> None:
    """The first bytes must be those of the kind that the ending names."""
    ending = path.suffix.lower()
    with path.open("rb") as file:
        head = file.read(4096)
    for kind, magic in _MAGIC.items():
        if (kind == ending) != head.startswith(magic):
            found = (
                f"it is a {kind[1:].upper()} file"
                if head.startswith(magic)
                else "its first bytes are not those of one"
            )
            raise VgrooveError(f"{path}: is not what its ending {ending} says: {found}.")
    if ending in (".csv", ".asc") and b"\0" in head:
        raise VgrooveError(
            f"{path}: is not what its ending {ending} says: it holds binary data (text must be UTF-8)."
        )
    if ending == ".csv" and re.match(rb"date \w+ \w+ ", head):
        raise VgrooveError(f"{path}: is not what its ending .csv says: it is an ASC file.")
    if ending == ".asc" and not re.match(rb"\s*(//.*\s*)*date ", head):
        raise VgrooveError(
            f"{path}: is not what its ending .asc says: an ASC file begins with its date."
        )


def _read_csv(path: Path) -> Log:
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise VgrooveError(
            f"{path}: is not what its ending .csv says: byte {error.start} is not UTF-8 text."
        ) from error
    header, lines, rows = _csv_rows(path, text)
    warnings = _check_header(path, header)
    known = [k for k, name in enumerate(header) if name == "time_s" or name in UNITS]
    underscores = text.find("_", text.find("\n")) >= 0
    cells = list(zip(*rows, strict=True)) or [()] * len(header)
    columns = {header[k]: _numbers(path, header[k], lines, cells[k], underscores) for k in known}
    time_s = columns.pop("time_s")
    return _checked(Log(time_s, columns, str(path), warnings), lines)


def _csv_rows(path: Path, text: str) -> tuple[list[str], list[int], list[list[str]]]:
    """Header, and the line number and cells of each row that is not blank."""
    lines, rows = [], []
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        for row in reader:
            if row:
                lines.append(reader.line_num)
                rows.append(row)
    except csv.Error as error:
        raise VgrooveError(f"{path}: line {reader.line_num}: is not CSV: {error}.") from error
    if not rows:
        raise VgrooveError(f"{path}: line 1: no header: the file is empty.")
    header = [cell.strip() for cell in rows[0]]
    for line, row in zip(lines[1:], rows[1:], strict=True):
        if len(row) != len(header):
            raise VgrooveError(
                f"{path}: line {line}: has {len(row)} cells, the header has {len(header)} columns."
            )
    return header, lines[1:], rows[1:]


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _check_header(path: Path, header: list[str]) -> list[str]:
    """Warnings for columns that are ignored; the header must name time, an input and something
    measured, each once.
    """
    if any(_is_number(name) for name in header):
        number = next(k for k, name in enumerate(header) if _is_number(name))
        raise VgrooveError(
            f"{path}: line 1, column {number + 1}: no header: {header[number]} is a number, not a name."
        )
    if len(header) == 1 and re.search(r"[;\t]", header[0]):
        raise VgrooveError(f"{path}: line 1: columns must be separated by commas.")
    for name in header:
        if name and header.count(name) > 1:
            raise VgrooveError(
                f"{path}: line 1: the column {name} appears {header.count(name)} times."
            )
    _check_columns(str(path), header)
    return [
        f"{path}: line 1: the unknown column {name or '(no name)'} is ignored."
        for name in header
        if name not in (*UNITS, "time_s")
    ]


def _check_columns(source: str, names: Iterable[str]) -> None:
    names = set(names)
    if "time_s" not in names:
        raise VgrooveError(f"{source}: line 1: the required column time_s is missing.")
    if not names & set(INPUTS):
        raise VgrooveError(
            f"{source}: line 1: a required column is missing: one input of {', '.join(INPUTS)}."
        )
    if not any(names & (set(MEASURED) - {given}) for given in names & set(INPUTS)):
        raise VgrooveError(
            f"{source}: line 1: a required column is missing: a measured signal besides the input, such as speed_rpm."
        )


def _numbers(
    path: Path, name: str, lines: list[int], cells: Sequence[str], underscores: bool
) -> np.ndarray:
    """Cells of a column as floats, empty ones as NaN; VgrooveError for the first one that is no
    number or infinite.
    """
    try:
        if underscores:
            raise ValueError  # float() would take 1_0 for 10
        values = np.fromiter(map(float, cells), float, len(cells))
    except ValueError:
        values = np.array(
            [_number(path, name, line, cell) for line, cell in zip(lines, cells, strict=True)],
            float,
        )
    infinite = np.isinf(values)
    if infinite.any():
        at = int(np.argmax(infinite))
        raise VgrooveError(
            f"{path}: line {lines[at]}, column {name}: {cells[at].strip()} is infinite."
        )
    return values


def _number(path: Path, name: str, line: int, cell: str) -> float:
    if not cell.strip():
        return float("nan")
    if "_" in cell or not _is_number(cell):
        raise VgrooveError(f"{path}: line {line}, column {name}: {cell!r} is not a number.")
    return float(cell)


def _checked(log: Log, lines: list[int] | None = None) -> Log:
    """The laws of every log: time increases, enough usable samples, nothing infinite; `lines` of a
    text file for the messages.
    """
    place = (lambda k: f"line {lines[k]}") if lines else (lambda k: f"sample {k + 1}")
    bad = ~np.isfinite(log.time_s)
    if bad.any():
        raise VgrooveError(
            f"{log.source}: {place(int(np.argmax(bad)))}, column time_s: the time is missing."
        )
    still = np.diff(log.time_s) <= 0
    if still.any():
        at = int(np.argmax(still)) + 1
        values = f"{log.time_s[at]:.10g} s after {log.time_s[at - 1]:.10g} s"
        raise VgrooveError(
            f"{log.source}: {place(at)}, column time_s: time does not increase ({values})."
        )
    for name, values in log.columns.items():
        if np.isinf(values).any():
            raise VgrooveError(
                f"{log.source}: {place(int(np.argmax(np.isinf(values))))}, column {name}: an infinite value."
            )
    usable = _usable(log)
    if usable < USABLE_MIN:
        raise VgrooveError(
            f"{log.source}: {usable} usable samples, at least {USABLE_MIN} are needed."
        )
    log.warnings += _doubts(log)
    return log


def _usable(log: Log) -> int:
    """Samples with an input and something measured besides it."""
    usable = np.zeros(len(log), bool)
    for given in (name for name in INPUTS if name in log):
        others = [np.isfinite(log[name]) for name in MEASURED if name in log and name != given]
        if others:
            usable |= np.isfinite(log[given]) & np.any(others, axis=0)
    return int(usable.sum())


def _doubts(log: Log) -> list[str]:
    """What a log is accepted with, but should be known."""
    found = []
    if "duty" in log and np.nanmax(np.abs(log["duty"]), initial=0.0) > 1 + 1e-6:
        found.append(
            f"{log.source}: column duty: the greatest magnitude is {np.nanmax(np.abs(log['duty'])):.4g}, not within -1..1."
        )
    if current_is_unsigned(log):
        found.append(
            f"{log.source}: column current_a: never negative while the drive brakes or reverses, so it is unsigned."
        )
    return found


def current_is_unsigned(log: Log) -> bool:
    """True where the current should be negative for a while (reverse drive, or brake from forward)
    and never is.
    """
    if not all(name in log for name in ("duty", "current_a", "speed_rpm")):
        return False
    duty, current, speed = log["duty"], log["current_a"], log["speed_rpm"]
    shut = log["coast"] == 0 if "coast" in log else np.ones(len(log), bool)
    braked = shut & (duty <= 0) & (speed > 0)
    reversed_ = shut & (duty < 0) & (speed <= 0)
    rows = (braked | reversed_) & (np.abs(current) > UNSIGNED_CURRENT_A)
    return bool(
        rows.sum() >= UNSIGNED_ROWS_MIN and np.nanmin(current) > -0.02 * np.nanmax(np.abs(current))
    )


def log_from_frames(
    frames: Iterable[telemetry.Frame], source: str, needs_boot: bool = False
) -> Log:
    """Intact frames to a log, unchecked (it may be short)."""
    session = telemetry.Session(needs_boot=needs_boot)
    session.feed(frames)
    return log_from_session(session, source)


def log_from_stream(data: bytes, source: str) -> Log:
    """The bytes that a board sent, from its start on, to a log; unchecked (it may be short), damage
    is in meta['counters'].
    """
    session = telemetry.Session()
    session.feed(telemetry.Framer(session.counters).feed(data))
    return log_from_session(session, source)


def log_from_session(session: telemetry.Session, source: str) -> Log:
    """All rows that a session holds."""
    columns = session.take_rows()
    return Log(columns.pop("time_s"), columns, source, meta=session.metadata())


def _log_from_messages(path: Path, messages: Iterable[Any], likely_ms: Iterable[int] = (0,)) -> Log:
    """A CAN recording through the signal list; where the file kept only time differences the CRCs
    tell the board's time.
    """
    session = telemetry.Session(needs_boot=False)
    frames = [
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
    likely_ms = list(likely_ms)
    offset = telemetry.time_offset(frames, likely_ms) or 0
    frames = [frame._replace(time_ms=(frame.time_ms + offset) & 0xFFFFFFFF) for frame in frames]
    intact = [frame for frame in frames if telemetry.frame_crc(*frame) == frame.data[7]]
    session.counters.frames = len(intact)
    session.counters.corrupt = len(frames) - len(intact)
    if not intact:
        raise VgrooveError(
            f"{path}: holds no intact telemetry frame of a vgroove board ({len(frames)} frames with its ids)."
        )
    session.feed(intact)
    log = log_from_session(session, str(path))
    if offset not in likely_ms:
        log.warnings.append(
            f"{path}: keeps only time differences: the start of time_s may not be the board's."
        )
    counters = session.counters
    if counters.corrupt or counters.lost:
        log.warnings.append(
            f"{path}: {counters.corrupt} frames are corrupt, {counters.lost} FAST frames were lost."
        )
    if session.boot is None:
        log.warnings.append(f"{path}: holds no BOOT frame: duty 1 is taken as compare value 255.")
    if session.restarted:
        log.warnings.append(
            f"{path}: {telemetry.RESTARTED} at {log.time_s[-1] if len(log) else 0:.3f} s, what follows is left out."
        )
    return _checked(log)


@contextmanager
def _damage_named(path: Path, kind: str) -> Iterator[None]:
    """Whatever a third-party reader raises on damaged bytes becomes a sentence."""
    try:
        yield
    except (VgrooveError, OSError, MemoryError):
        raise
    except Exception as error:
        raise VgrooveError(
            f"{path}: is a damaged or truncated {kind} file: {error or type(error).__name__}."
        ) from error


def _read_blf(path: Path) -> Log:
    from can.io import BLFReader

    with _damage_named(path, "BLF"), BLFReader(path) as reader:
        messages = list(reader)
        if reader.object_count > len(messages):
            raise ValueError(
                f"its header counts {reader.object_count} objects, {len(messages)} can be read"
            )
        size = path.stat().st_size
        if reader.file_size not in (0, size) and size < reader.file_size:
            raise ValueError(f"its header states {reader.file_size} bytes, it has {size}")
    return _log_from_messages(path, messages)


def _read_asc(path: Path) -> Log:
    from can.io import ASCReader

    text = path.read_text("utf-8", errors="replace")
    with _damage_named(path, "ASC"):
        if "end triggerblock" not in text[-200:].lower():
            raise ValueError("its end is missing")
        with ASCReader(io.StringIO(text), relative_timestamp=True) as reader:
            messages = list(reader)
    return _log_from_messages(path, messages, _asc_offsets(text))


def _asc_offsets(text: str) -> list[int]:
    """Likely offsets: python-can writes times since the first frame and that frame's time as a
    local date, milliseconds without padding.
    """
    match = re.search(
        r"Begin Triggerblock \w+ (\w+ \d+ \d+:\d+:\d+)\.(\d+) (\d+)", text, re.IGNORECASE
    )
    if match is None:
        return [0]
    moment = datetime.strptime(f"{match[1]} {match[3]}", "%b %d %H:%M:%S %Y").replace(tzinfo=UTC)
    start_ms = round(moment.timestamp()) * 1000 + int(match[2])
    quarter_ms = 15 * 60 * 1000
    return [0, *((start_ms + k * quarter_ms) & 0xFFFFFFFF for k in range(-56, 57))]


def _read_mf4(path: Path) -> Log:
    from asammdf import MDF

    with _damage_named(path, "MF4"), MDF(str(path)) as mdf:
        if "CAN_DataFrame" in mdf.channels_db:
            return _log_from_messages(path, _mf4_messages(path))
        return _mf4_channels(path, mdf)


def _mf4_messages(path: Path) -> list[Any]:
    from can.io import MF4Reader

    with MF4Reader(path) as reader:
        return list(reader)


def _mf4_channels(path: Path, mdf: Any) -> Log:
    """Channels that carry the contract's names, on the time base of the group that holds most of
    them.
    """
    places = {name: mdf.channels_db[name] for name in UNITS if name in mdf.channels_db}
    groups = [group for entries in places.values() for group, _ in entries]
    _check_columns(str(path), {"time_s", *places} if groups else set())
    base = max(set(groups), key=groups.count)
    time_s = np.asarray(mdf.get_master(base), float)
    log = Log(time_s, {}, str(path))
    for name, entries in places.items():
        own = next((entry for entry in entries if entry[0] == base), None)
        if own is None:
            log.warnings.append(f"{path}: the channel {name} has another time base and is ignored.")
            continue
        samples = mdf.get(name, *own).samples
        if samples.dtype.kind not in "biuf":
            raise VgrooveError(f"{path}: column {name}: its samples are not numbers.")
        log.columns[name] = samples.astype(float)
    known = {*UNITS, "time_s", "time", "t"}
    log.warnings += [
        f"{path}: the unknown column {name} is ignored."
        for name in mdf.channels_db
        if name not in known
    ]
    _check_columns(str(path), {"time_s", *log.columns})
    return _checked(log)


def csv_header(names: Iterable[str]) -> bytes:
    """First line of a CSV log."""
    return (",".join(["time_s", *names]) + "\n").encode()


def csv_rows(time_s: np.ndarray, columns: Iterable[np.ndarray]) -> bytes:
    """Rows of a CSV log: time to the last bit (stamps since 1970 need 17 digits), the rest to 12
    digits, missing samples as NaN.
    """
    table = [np.asarray(column, float).tolist() for column in (time_s, *columns)]
    line = "%r" + ",%.12g" * (len(table) - 1) + "\n"
    return "".join(line % row for row in zip(*table, strict=True)).replace("nan", "NaN").encode()


def write_csv(log: Log, path: str | os.PathLike[str]) -> None:
    """Write a log as CSV, whole or not at all; VgrooveError when it cannot be written."""
    write_bytes(path, csv_header(log.columns) + csv_rows(log.time_s, log.columns.values()))
