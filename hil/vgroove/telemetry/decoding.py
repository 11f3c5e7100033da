"""Decodes frames to physical values with the bit positions and scales of the DBC."""

from functools import cache

import numpy as np

from vgroove.telemetry.frames import Frame
from vgroove.telemetry.signals import database


def decode(frame: Frame) -> dict[str, float]:
    """Physical values of a frame's signals, by cantools."""
    return database().decode_message(frame.id, frame.data, decode_choices=False)


def decode_integers(frame: Frame) -> dict[str, int]:
    """Values of a frame whose signals are all whole numbers."""
    return {name: int(value) for name, value in decode(frame).items()}


def decode_many(name: str, frames: list[Frame]) -> dict[str, np.ndarray]:
    """Physical values of many frames of one kind, arrays (len(frames),) by signal, as `decode`."""
    words = np.frombuffer(b"".join(frame.data for frame in frames), "<u8")
    columns = {}
    for signal in database().get_message_by_name(name).signals:
        mask = np.uint64((1 << signal.length) - 1)
        raw = ((words >> np.uint64(signal.start)) & mask).astype(np.int64)
        if signal.is_signed:
            raw = raw - ((raw >> (signal.length - 1)) << signal.length)
        columns[signal.name] = raw * float(signal.scale) + float(signal.offset)
    return columns


@cache
def bit_field(frame: str, signal: str) -> tuple[int, int]:
    """First bit and mask of an unsigned signal in the little-endian data word of its frame."""
    found = database().get_message_by_name(frame).get_signal_by_name(signal)
    return found.start, (1 << found.length) - 1
