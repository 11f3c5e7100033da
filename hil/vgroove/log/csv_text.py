"""Text of a CSV file: its compression, and its encoding, which is UTF-8, UTF-16 with a byte order
mark, or else Windows-1252, in which programs of western Europe and America write µ, ° and ä.
"""

import codecs
import gzip
from dataclasses import dataclass
from io import TextIOWrapper
from pathlib import Path
from typing import IO

from vgroove.errors import VgrooveError

BLOCK_BYTES = 1 << 20  # that are checked at once
UTF_16_MARKS = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
WINDOWS = "cp1252"


@dataclass(frozen=True)
class CsvText:
    """A CSV file, its encoding, a number that it has at most as lines, and a warning of an encoding
    that its bytes do not state (empty: none).
    """

    path: Path
    encoding: str
    most_lines: int
    warning: str = ""

    def open(self) -> TextIOWrapper:
        """The text of the file, with its line ends."""
        return TextIOWrapper(_open(self.path), encoding=self.encoding, newline="")


def csv_text(path: Path) -> CsvText:
    """The text of a file, all of which is decoded once; VgrooveError where no encoding fits."""
    with _open(path) as file:
        marked = file.read(2) in UTF_16_MARKS
    encoding = "utf-16" if marked else "utf-8-sig"
    try:
        return CsvText(path, encoding, _count_lines(path, encoding))
    except _NotInEncoding as error:
        at = error.at
        if marked:
            raise VgrooveError(f"{path}: is damaged UTF-16 text, in byte {at}.") from error
        try:
            most_lines = _count_lines(path, WINDOWS)
        except _NotInEncoding:
            raise VgrooveError(
                f"{path}: its content does not match its ending .csv: byte {at} is not UTF-8 text: "
                "save the file in the encoding UTF-8 (Excel: CSV UTF-8)."
            ) from error
        sign = error.byte.decode(WINDOWS)
    warning = f"{path}: is not UTF-8: read as Windows-1252, in which byte {at} is {sign!r}."
    return CsvText(path, WINDOWS, most_lines, warning)


class _NotInEncoding(Exception):
    """A byte of a file, at a number of bytes from its begin, that no encoding of it allows."""

    def __init__(self, at: int, byte: bytes) -> None:
        super().__init__(f"byte {at}")
        self.at, self.byte = at, byte


def _open(path: Path) -> IO[bytes]:
    return gzip.open(path, "rb") if path.suffix.lower() == ".gz" else path.open("rb")


def _count_lines(path: Path, encoding: str) -> int:
    """A number that the file has at most as lines; _NotInEncoding for the first byte that is none
    of the encoding.
    """
    decoder, done, ends = codecs.getincrementaldecoder(encoding)(), 0, 0
    with _open(path) as file:
        while True:
            block, (pending, _) = file.read(BLOCK_BYTES), decoder.getstate()
            try:
                decoder.decode(block, final=not block)
            except UnicodeDecodeError as error:
                byte = error.object[error.start : error.start + 1]
                raise _NotInEncoding(done - len(pending) + error.start, byte) from error
            if not block:
                return ends + 1
            done, ends = done + len(block), ends + block.count(b"\n") + block.count(b"\r")
