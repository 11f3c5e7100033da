"""Files that a recording fills: CSV, MF4, BLF and ASC, each complete even when the disk is full or
the process is killed.
"""

import io
import os
from abc import ABC, abstractmethod
from contextlib import suppress
from datetime import datetime
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from can.io import ASCWriter, BLFWriter
from can.io.blf import FILE_HEADER_SIZE

from vgroove import telemetry
from vgroove.errors import VgrooveError
from vgroove.log import COLUMN_LABELS, COLUMN_UNITS, csv_header, csv_rows
from vgroove.part_file import PartFile, part_of

MF4_ROWS = 200_000  # converted at a time, which bounds the memory


class RecordingFile(ABC):
    """A log that is being written: a hidden part file until it is complete and gets its name.

    `recovered` is the new name of a part file that a killed process had left, else None.
    VgrooveError where another process writes this log.
    """

    recovered: Path | None = None

    def __init__(self, path: Path) -> None:
        self.path = path
        self.part = part_of(path)
        self.rows = 0

    def add_frame(self, frame: telemetry.Frame) -> None:
        """Add an intact frame; called in the order of arrival."""
        del frame

    @abstractmethod
    def add_rows(self, columns: dict[str, np.ndarray]) -> None:
        """Add final rows, (n,) by column name with `time_s`; OSError when the disk is full.

        What is in the part file afterwards can be read even if the process is killed.
        """

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
        """Delete the part file; does nothing after `publish`."""
        with suppress(OSError):
            self.part.unlink()

    @abstractmethod
    def release(self) -> None:
        """Close and unlock the part file; where it has not been published, it stays."""


class LockedFile(RecordingFile):
    """A log whose part file this process has open and locked."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._part = PartFile(path)
        self._file, self.recovered = self._part.file, self._part.recovered
        self._complete_bytes = 0  # bytes from the beginning that are a complete file

    def salvage(self) -> None:
        """Cut the file after its last complete rows or container."""
        if not self._file.closed:
            self._file.truncate(self._complete_bytes)
            self._file.close()

    def publish(self) -> None:
        super().publish()
        self.release()

    def discard(self) -> None:
        if self._part.locked:
            super().discard()
        self.release()

    def release(self) -> None:
        self._file.close()
        self._part.release()


class CsvFile(LockedFile):
    """The log columns, one row for each FAST frame. The header is written with the first rows."""

    def add_rows(self, columns: dict[str, np.ndarray]) -> None:
        header = b"" if self._complete_bytes else csv_header(telemetry.COLUMNS)
        rows = csv_rows(columns["time_s"], [columns[name] for name in telemetry.COLUMNS])
        self._file.write(header + rows)
        self._complete_bytes = self._file.tell()
        self.rows += len(columns["time_s"])

    def finish(self) -> None:
        os.fsync(self._file.fileno())
        self._file.close()


class Mf4File(RecordingFile):
    """The log columns as channels with units, converted by asammdf at the end.

    Until then the rows are in a CSV file, which stays if the conversion fails.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._csv = CsvFile(path.with_name(path.name + ".csv"))
        self.recovered = self._csv.recovered

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
        if self.path == self._csv.path:
            self._csv.publish()
            return
        super().publish()
        self._csv.discard()

    def discard(self) -> None:
        super().discard()
        self._csv.discard()

    def release(self) -> None:
        self._csv.release()


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


class BlfFile(LockedFile):
    """Every intact frame with the board's time, by python-can's writer. After each `add_rows` the
    file is complete: its header states its size and the number of its frames.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._memory = io.BytesIO()  # header, and the containers that are not in the file
        self._writer = BLFWriter(self._memory)
        self._writer.start_timestamp = 0.0

    def add_frame(self, frame: telemetry.Frame) -> None:
        self._writer.on_message_received(frame.message())

    def _append(self) -> None:
        """Write the containers, in one call, then the header."""
        self._writer._flush()
        content = self._memory.getvalue()
        self._memory.seek(0)
        self._memory.truncate()
        self._file.write(content[FILE_HEADER_SIZE:] if self._complete_bytes else content)
        size = self._file.tell()
        self._writer._write_header(size)
        self._file.seek(0)
        self._file.write(self._memory.getvalue())
        self._file.seek(size)
        self._complete_bytes = size

    def add_rows(self, columns: dict[str, np.ndarray]) -> None:
        self._append()
        self.rows += len(columns["time_s"])

    def finish(self) -> None:
        self._append()
        self._file.close()


class AscFile(LockedFile):
    """Every intact frame as a line with the board's time, by python-can's writer. After each
    `add_rows` the file is complete: it ends with END.
    """

    END = b"End TriggerBlock\n"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._text = io.StringIO()
        self._writer = BoardAscWriter(self._text)
        self._lines_bytes = 0  # of the file without END

    def add_frame(self, frame: telemetry.Frame) -> None:
        self._writer.on_message_received(frame.message())

    def _append(self) -> None:
        """Write the lines over the end mark, and the end mark behind them, in one call."""
        text = self._text.getvalue().encode()
        self._text.seek(0)
        self._text.truncate()
        self._file.seek(self._lines_bytes)
        self._file.write(text + self.END)
        self._lines_bytes += len(text)

    def add_rows(self, columns: dict[str, np.ndarray]) -> None:
        self._append()
        self.rows += len(columns["time_s"])

    def finish(self) -> None:
        self._append()
        self._file.close()

    def salvage(self) -> None:
        """Cut the file where it was last complete, and write the end mark there again."""
        if self._file.closed:
            return
        if self._lines_bytes:
            self._file.truncate(self._lines_bytes + len(self.END))
            self._file.seek(self._lines_bytes)
            self._file.write(self.END)
        self._file.close()


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
