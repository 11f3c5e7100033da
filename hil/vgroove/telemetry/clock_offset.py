"""Recovers the board's time in recordings that keep only time differences.

The CRC covers the time, and it is linear over bits (as every CRC up to a constant), so each frame
restricts the offset between recorded time and board time to one in 256 values.
"""

import itertools
from collections.abc import Iterable
from functools import cache

import numpy as np

from vgroove.telemetry.frames import Frame, frame_crc

SAMPLE_FRAMES = 200  # frames, spread over the recording, with which an offset is tested
SEARCH_FRAMES = 6  # frames that restrict the search: of 2^32 offsets 2^32 / 256^6 fit by chance
SEARCHES = 10  # sets of frames tried, since one damaged frame spoils a search
BLOCKS = 64  # parts of a search, which bounds its memory


@cache
def _time_in_crc() -> tuple[np.ndarray, np.ndarray]:
    """CRC changes (65536,) by the low and the high half of the time, relative to time 0."""
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


def _wanted_change(frame: Frame) -> int:
    """CRC change that the frame's true time must cause."""
    return frame.data[7] ^ frame_crc(0, frame.id, frame.data)


def _fits(frame: Frame, offsets: np.ndarray) -> np.ndarray:
    """Which offsets (ms, modulo 2^32) make the CRC of the frame right."""
    low, high = _time_in_crc()
    times = offsets + np.uint32(frame.time_ms)
    return (low[times & np.uint32(0xFFFF)] ^ high[times >> np.uint32(16)]) == _wanted_change(frame)


def _offsets_that_fit(frames: list[Frame]) -> np.ndarray:
    """All offsets (ms, modulo 2^32) that make the CRC of every one of these frames right."""
    low, high = _time_in_crc()
    # low halves sorted by the CRC change that they cause: 256 of each
    order = np.argsort(low, kind="stable").reshape(256, 256)
    wanted = _wanted_change(frames[0])
    found = []
    for block in np.split(np.arange(1 << 16, dtype=np.uint32), BLOCKS):
        low_halves = order[high[block] ^ wanted].astype(np.uint32)
        offsets = ((block << np.uint32(16))[:, None] | low_halves).ravel()
        offsets = offsets - np.uint32(frames[0].time_ms)
        for frame in frames[1:]:
            offsets = offsets[_fits(frame, offsets)]
        found.append(offsets)
    return np.concatenate(found)


def time_offset(frames: list[Frame], likely: Iterable[int] = (0,)) -> int | None:
    """Offset (ms) from the frames' times to the board's time; None if none fits.

    An offset fits when the CRC of most of SAMPLE_FRAMES frames is right with it. The `likely` ones
    are tried first, then the smallest of all others is taken: high bits of the time that never
    change in the recording are known only up to the 8 bits of the CRC, so the start may be wrong by
    multiples of a minute and more; differences are right.
    """
    sample = frames[:: max(1, len(frames) // SAMPLE_FRAMES)]
    stride = len(sample) // SEARCH_FRAMES
    searched = (
        _offsets_that_fit(sample[first::stride][:SEARCH_FRAMES])
        for first in range(min(stride, SEARCHES))
    )
    for offsets in itertools.chain([np.array(list(likely), np.uint32)], searched):
        votes = sum((_fits(frame, offsets) for frame in sample), np.zeros(len(offsets), int))
        best = votes.max(initial=0)
        if 2 * best > len(sample):
            return int(offsets[votes == best].min())
    return None
