"""Frames of the exchange with a board (firmware/hal/inject/hil.dbc): inputs of a tick as SENSE
frames, the bridge command as DRIVE frame. Their time field holds the number of the tick.
"""

import struct
from dataclasses import dataclass
from typing import NamedTuple

from vgroove.telemetry import Frame, frame_of

BAUD = 1_000_000
SENSE_A, SENSE_B, SENSE_EDGES, DRIVE = 128, 129, 130, 131
SAMPLES_MAX, EDGES_MAX = 8, 3
SAMPLE_BITS, HALF = 10, 4  # four samples a frame
FLAG_COAST, FLAG_LATER, FLAG_SAFE, FLAG_IDLE = 1, 2, 4, 8
TICK_S = 1e-3
CLOCK_COUNT_S = 4e-6  # of Timer2: 64 cycles

_DRIVE = struct.Struct("<BhBBBB")


class TickInputs(NamedTuple):
    """What the firmware takes in one tick: ADC counts in the order of conversion, switches
    (SWITCH_*), cycles of the Hall edges since the tick before (1..16,000).
    """

    tick: int
    samples: tuple[int, ...]
    switches: int = 0
    edges: tuple[int, ...] = ()


@dataclass(frozen=True)
class Drive:
    """Bridge command of a tick, which acts from the next tick on (`later`: 256 cycles after it).

    `safe`: the board has opened the bridge because inputs were missing; `idle`: no run has begun.
    `clock_tick` (modulo 256) and `clock_count` (steps of 4 us) are the board's clock when the tick
    began.
    """

    tick: int
    coast: bool
    compare: int
    dead_counts: int
    later: bool = False
    safe: bool = False
    idle: bool = False
    clock_tick: int = 0
    clock_count: int = 0


def _packed(samples: tuple[int, ...]) -> bytes:
    """Up to four samples of 10 bits, little endian, in five bytes."""
    bits = sum(sample << (SAMPLE_BITS * k) for k, sample in enumerate(samples))
    return bits.to_bytes(5, "little")


def sense_frames(inputs: TickInputs) -> list[Frame]:
    """The frames of a tick's inputs; ValueError for more samples or edges than they hold."""
    tick, samples, switches, edges = inputs
    if len(samples) > SAMPLES_MAX or len(edges) > EDGES_MAX:
        raise ValueError(f"{len(samples)} samples and {len(edges)} edges in one tick")
    low = bytes([tick & 0xFF])
    counts = bytes([switches | len(samples) << 4])
    frames = [
        frame_of(tick, SENSE_A, _packed(samples[:HALF]) + counts + low),
        frame_of(tick, SENSE_B, _packed(samples[HALF:]) + bytes([len(edges)]) + low),
    ]
    if edges:
        padded = (*edges, 0, 0)[:EDGES_MAX]
        frames.append(frame_of(tick, SENSE_EDGES, struct.pack("<3H", *padded) + low))
    return frames


def drive_of(frame: Frame) -> Drive:
    """The content of an intact DRIVE frame."""
    flags, compare, dead, clock_tick, clock_count, _ = _DRIVE.unpack(frame.data[:7])
    return Drive(
        frame.time_ms,
        bool(flags & FLAG_COAST),
        compare,
        dead,
        bool(flags & FLAG_LATER),
        bool(flags & FLAG_SAFE),
        bool(flags & FLAG_IDLE),
        clock_tick,
        clock_count,
    )
