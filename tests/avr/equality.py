"""Processor-in-the-loop equality: the inputs of a board's pins are recorded once and replayed into
two boards, whose telemetry is compared signal by signal. A tape is such a recording: the packed
BoardInputs of each PWM period.
"""

from dataclasses import dataclass

import numpy as np

from vgroove import board, telemetry
from vgroove.board import PERIOD_S, BoardInputs, BoardOutputs, pack_inputs
from vgroove.lockstep import Board

GATES = ["coast", "compare", "dead_counts"]  # of board.OUTPUTS

# Signals that depend on the machine: the host has no cycles and no stack, and the hash identifies
# the build.
OF_THE_MACHINE = {"worst_tick_cycles", "stack_free_bytes", "build_hash", "target"}


class TapeBoard:
    """A board that records the inputs of its pins."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self.tape = bytearray()

    def period(self, inputs: BoardInputs) -> BoardOutputs:
        """One recorded PWM period."""
        self.tape += pack_inputs(inputs)
        return self._board.period(inputs)


@dataclass(frozen=True)
class Difference:
    """First difference of one signal."""

    field: str
    time_ms: int
    native: object
    avr: object

    def __str__(self) -> str:
        return f"{self.field} at {self.time_ms} ms: native {self.native}, AVR {self.avr}"


def periods_of(outputs: bytes) -> np.ndarray:
    """Outputs of a board, one per PWM period: (n,) of board.OUTPUTS."""
    return np.frombuffer(outputs, board.OUTPUTS)


def sent_bytes(outputs: bytes) -> bytes:
    """UART bytes in the outputs of a board."""
    return board.sent_bytes(periods_of(outputs))


def bridge_differences(native: np.ndarray, avr: np.ndarray) -> list[Difference]:
    """PWM periods in which the bridges of two boards differ: open or not, and the compare value
    and dead time while driving. native, avr: (n,) of board.OUTPUTS.
    """
    a, b = native[GATES], avr[GATES]
    assert len(a) == len(b), f"{len(a)} periods of the native board, {len(b)} of the AVR"
    both_open = (a["coast"] != 0) & (b["coast"] != 0)
    return [
        Difference("bridge", round(1000.0 * n * PERIOD_S), tuple(a[n]), tuple(b[n]))
        for n in np.flatnonzero((a != b) & ~both_open).tolist()
    ]


def _masked(frame: telemetry.Frame) -> dict[str, float]:
    return {
        name: value
        for name, value in telemetry.decode(frame).items()
        if name not in OF_THE_MACHINE and not name.endswith("_crc")
    }


def differences(native: bytes, avr: bytes) -> list[Difference]:
    """First difference of each signal between two streams, in order of time; empty when all frames
    are equal bit for bit.
    """
    first: dict[str, Difference] = {}
    frames = [telemetry.Framer().feed(stream) for stream in (native, avr)]
    for a, b in zip(*frames, strict=False):
        if (a.id, a.time_ms) != (b.id, b.time_ms):
            first.setdefault(
                "frame", Difference("frame", a.time_ms, (a.id, a.time_ms), (b.id, b.time_ms))
            )
            break
        if a.data == b.data:
            continue
        fields, others = _masked(a), _masked(b)
        for name, value in fields.items():
            if value != others[name]:
                first.setdefault(name, Difference(name, a.time_ms, value, others[name]))
    counts = [len(stream) for stream in frames]
    if not first and abs(counts[0] - counts[1]) > 1:  # the last frame may be incomplete
        first["frames"] = Difference("number of frames", 0, *counts)
    return sorted(first.values(), key=lambda difference: difference.time_ms)


def damaged(stream: bytes) -> int:
    """Number of bytes that belong to no intact frame."""
    counters = telemetry.Counters()
    telemetry.Framer(counters).feed(stream)
    return counters.corrupt + counters.skipped_bytes
