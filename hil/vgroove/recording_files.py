"""Files that a recording fills: CSV, MF4, BLF and ASC, each complete even when the disk is full."""

import io
import os
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from can.io import ASCWriter, BLFWriter

from vgroove import telemetry
from vgroove.errors import VgrooveError
from vgroove.log import COLUMN_LABELS, COLUMN_UNITS, csv_header, csv_rows

MF4_ROWS = 200_000  # converted at a time, which bounds the memory
ASC_TAIL_BYTES = 1024  # more than two lines of an ASC file


class RecordingFile(ABC):
    """A log that is being written: a hidden part file until it is complete and gets its name."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.part = path.with_name(f".{path.stem}.part{path.suffix}")
        self.rows = 0

    def add_frame(self, frame: telemetry.Frame) -> None:
        """Add an intact frame; called in the order of arrival."""
        del frame

    @abstractmethod
    def add_rows(self, columns: dict[str, np.ndarray]) -> None:
        """Add final rows, (n,) by column name with `time_s`; OSError when the disk is full."""

    @abstractmethod
    def finish(self) -> None:
        """Complete the part file."""

    @abstractmethod
    def salvage(self) -> None:
        """Complete the part file with what it holds without enlarging it, since the disk is full.

        Afterwards `path` is the name that the file will have.
        """

    def publish(self) -> None:
        """Give the part file its name."""
        os.replace(self.part, self.path)

    def discard(self) -> None:
        """Delete the part file."""
        with suppress(OSError):
            self.part.unlink()

    @contextmanager
    def _discard_on_error(self) -> Iterator[None]:
        try:
            yield
        except OSError:
            self.discard()
            raise


class UnbufferedFile(io.FileIO):
    """A file without a buffer that writes all bytes or raises: bytes that could not be written are
    not tried again on closing.
    """

    def write(self, data: Any) -> int:
        view = memoryview(data).cast("B")
        total = len(view)
        while view:
            view = view[super().write(view) :]
        return total


class CsvFile(RecordingFile):
    """The log columns, one row for each FAST frame."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._file = UnbufferedFile(self.part, "wb")
        with self._discard_on_error():
            self._file.write(csv_header(telemetry.COLUMNS))
        self._complete_bytes = self._file.tell()

    def add_rows(self, columns: dict[str, np.ndarray]) -> None:
        self._file.write(csv_rows(columns["time_s"], [columns[name] for name in telemetry.COLUMNS]))
        self._complete_bytes = self._file.tell()
        self.rows += len(columns["time_s"])

    def finish(self) -> None:
        os.fsync(self._file.fileno())
        self._file.close()

    def salvage(self) -> None:
        if not self._file.closed:
            self._file.truncate(self._complete_bytes)
            self._file.close()


class Mf4File(RecordingFile):
    """The log columns as channels with units, converted by asammdf at the end.

    Until then the rows are in a CSV file, which stays if the conversion fails.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._csv = CsvFile(path.with_name(path.name + ".csv"))

    def add_rows(self, columns: dict[str, np.ndarray]) -> None:
        self._csv.add_rows(columns)
        self.rows = self._csv.rows

    def finish(self) -> None:
        self._csv.finish()
        try:
            convert_csv_to_mf4(self._csv.part, self.part)
        except Exception as error:  # any error of asammdf: the rows are in the CSV file
            reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
            raise VgrooveError(f"{self.path}: the MF4 file could not be made: {reason}") from error

    def salvage(self) -> None:
        self._csv.salvage()
        with suppress(OSError):
            self.part.unlink()
        self.path, self.part = self._csv.path, self._csv.part

    def publish(self) -> None:
        super().publish()
        self._csv.discard()

    def discard(self) -> None:
        super().discard()
        self._csv.discard()


def convert_csv_to_mf4(source: Path, target: Path) -> None:
    """Convert a CSV log of this package to MF4, MF4_ROWS rows at a time; without rows to an empty
    file.
    """
    from asammdf import MDF, Signal

    def channel(name: str, time_s: np.ndarray, values: np.ndarray) -> Signal:
        unit, label = COLUMN_UNITS[name], COLUMN_LABELS[name]
        return Signal(values, time_s, unit=unit, name=name, comment=label)

    with MDF(version="4.10") as mdf, source.open(encoding="ascii") as file:
        names = file.readline().strip().split(",")[1:]
        while lines := list(islice(file, MF4_ROWS)):
            time_s, *columns = np.loadtxt(lines, delimiter=",", ndmin=2).T
            if mdf.groups:
                more = [(np.ascontiguousarray(values), None) for values in (time_s, *columns)]
                mdf.extend(0, more)
                continue
            pairs = zip(names, columns, strict=True)
            mdf.append([channel(name, time_s, v) for name, v in pairs], comment="vgroove record")
        mdf.save(target, overwrite=True)


class BoardAscWriter(ASCWriter):
    """python-can's ASC writer with the board's own time, which the CRC of a frame covers, instead
    of the time since the first frame.
    """

    def __init__(self, file: Any, **kwargs: Any) -> None:
        super().__init__(file, **kwargs)
        self.file.write(f"Begin Triggerblock {self._format_header_datetime(datetime.now())}\n")
        self.header_written = True
        self.log_event("Start of measurement", 0.0)


class BlfFile(RecordingFile):
    """Every intact frame with the board's time, by python-can's writer."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._file = UnbufferedFile(self.part, "wb")
        with self._discard_on_error():
            self._writer = BLFWriter(self._file)
        self._writer.start_timestamp = 0.0
        self._complete = (self._file.tell(), 0)

    def add_frame(self, frame: telemetry.Frame) -> None:
        self._writer.on_message_received(frame.message())

    def add_rows(self, columns: dict[str, np.ndarray]) -> None:
        self._writer._flush()
        self._complete = (self._file.tell(), self._writer.object_count)
        self.rows += len(columns["time_s"])

    def finish(self) -> None:
        self._writer.stop()

    def salvage(self) -> None:
        """Cut the file after its last complete container and rewrite the header in place."""
        complete_bytes, self._writer.object_count = self._complete
        self._writer._buffer, self._writer._buffer_size = [], 0
        self._file.truncate(complete_bytes)
        self._file.seek(complete_bytes)
        self._writer.stop()


class AscFile(RecordingFile):
    """Every intact frame as a line with the board's time, by python-can's writer."""

    END = b"End TriggerBlock\n"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._file = UnbufferedFile(self.part, "wb")
        self._text = io.StringIO()
        self._writer = BoardAscWriter(self._text)

    def add_frame(self, frame: telemetry.Frame) -> None:
        self._writer.on_message_received(frame.message())

    def _write_lines(self) -> None:
        text = self._text.getvalue()
        self._text.seek(0)
        self._text.truncate()
        self._file.write(text.encode())

    def add_rows(self, columns: dict[str, np.ndarray]) -> None:
        self._write_lines()
        self.rows += len(columns["time_s"])

    def finish(self) -> None:
        self._write_lines()
        self._file.write(self.END)
        self._file.close()

    def salvage(self) -> None:
        """Cut the file after the last line that leaves room for the end mark."""
        size = self._file.tell()
        self._file.close()
        with self.part.open("rb+") as file:
            file.seek(max(0, size - ASC_TAIL_BYTES))
            tail = file.read()
            cut = size - len(tail) + tail[: -len(self.END)].rfind(b"\n") + 1
            file.truncate(cut)
            file.seek(cut)
            file.write(self.END)


FILE_TYPES: dict[str, type[RecordingFile]] = {
    ".csv": CsvFile,
    ".mf4": Mf4File,
    ".blf": BlfFile,
    ".asc": AscFile,
}


def file_type(path: Path) -> type[RecordingFile]:
    """The kind of file that the ending names; VgrooveError for another ending."""
    found = FILE_TYPES.get(path.suffix.lower())
    if found is None:
        raise VgrooveError(f"{path}: a log ends in .csv, .mf4, .blf or .asc.")
    return found
