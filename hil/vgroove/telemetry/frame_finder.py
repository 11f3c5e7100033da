"""Finds intact frames in a stream of bytes and counts what is damaged."""

import struct
from collections.abc import Collection
from dataclasses import dataclass, fields

from vgroove.telemetry.frames import END, FRAME_BYTES, LENGTH, START, Frame, frame_crc
from vgroove.telemetry.signals import OUTBOUND

LENGTH_AT, TIME_AT, DATA_AT = 5, 1, 10  # positions of bytes in a frame


@dataclass
class Counters:
    """Received, lost and damaged frames: bytes = 19 * frames + skipped_bytes + `Framer.held`."""

    bytes: int = 0
    frames: int = 0
    skipped_bytes: int = 0  # of no intact frame
    # frames of the right form with a wrong CRC, an impossible time or an impossible counter
    corrupt: int = 0
    fast: int = 0
    lost: int = 0  # FAST frames that were sent between two received ones
    not_sent: int = 0  # ticks for which the board itself sent no FAST frame
    before_boot: int = 0  # frames before the first BOOT, ignored
    restarts: int = 0

    def begin(self, before: "Counters", frames: int, held: int) -> None:
        """Count from the BOOT frame on: `frames` including it, and `held` bytes after them.

        Damage counted up to `before` is not part of the recording.
        """
        self.frames = frames
        self.skipped_bytes -= before.skipped_bytes
        self.corrupt -= before.corrupt
        self.bytes = FRAME_BYTES * frames + self.skipped_bytes + held

    def as_dict(self) -> dict[str, int]:
        """For the sidecar file."""
        return {item.name: getattr(self, item.name) for item in fields(self)}


class Framer:
    """Finds intact frames in a stream of bytes; after damage it continues at the next start byte
    within the bytes received. A frame with an id that is not in `ids` counts as damaged.
    """

    def __init__(self, counters: Counters | None = None, ids: Collection[int] = OUTBOUND) -> None:
        self.counters, self._ids = counters or Counters(), ids
        self._held = bytearray()

    @property
    def held(self) -> int:
        """Number of bytes that may become a frame."""
        return len(self._held)

    def feed(self, data: bytes) -> list[Frame]:
        """Frames that are complete with these bytes."""
        self.counters.bytes += len(data)
        self._held += data
        frames: list[Frame] = []
        at = self._next_start(0)
        while len(self._held) - at >= FRAME_BYTES:
            frame = self._frame_at(at)
            if frame is None:
                self.counters.skipped_bytes += 1
                at = self._next_start(at + 1)
            else:
                frames.append(frame)
                at = self._next_start(at + FRAME_BYTES)
        at = self._skip_wrong_length(at)
        del self._held[:at]
        self.counters.frames += len(frames)
        return frames

    def _next_start(self, at: int) -> int:
        """Position of the next start byte from `at` on, or the end; counts the bytes skipped."""
        found = self._held.find(START, at)
        found = len(self._held) if found < 0 else found
        self.counters.skipped_bytes += found - at
        return found

    def _skip_wrong_length(self, at: int) -> int:
        """Skip start bytes of an incomplete frame whose length byte is already wrong."""
        held = self._held
        while len(held) - at > LENGTH_AT and held[at + LENGTH_AT] != LENGTH:
            self.counters.skipped_bytes += 1
            at = self._next_start(at + 1)
        return at

    def _frame_at(self, at: int) -> Frame | None:
        held = self._held
        if held[at + LENGTH_AT] != LENGTH or held[at + FRAME_BYTES - 1] != END:
            return None
        time_ms, _, frame_id = struct.unpack_from("<IBI", held, at + TIME_AT)
        data = bytes(held[at + DATA_AT : at + DATA_AT + LENGTH])
        if frame_crc(time_ms, frame_id, data) != data[7] or frame_id not in self._ids:
            self.counters.corrupt += 1
            return None
        return Frame(time_ms, frame_id, data)
