"""Tape of a tool at full speed whose host sends commands at every phase of the tick while the
trigger changes.
"""

from functools import cache

from unequal_pitches import PERIODS_PER_SECOND, command

from vgroove import telemetry
from vgroove.board import CYCLES_PER_PERIOD, BoardInputs, pack_inputs

CONTACT = 1
DURATION_S = 6.0
EDGES_PER_TURN = 4
TURN_CYCLES = 60 * 16e6 / 15900  # 15,900 rpm
DRIVE_S, COMMANDS_S = 0.4, 0.8
BYTE_PERIODS = 640 / CYCLES_PER_PERIOD  # bytes at 250 kBd, without a pause
# 39 to 65 ms between two pairs of commands, so that all phases of a tick occur.
GAPS_PERIODS = tuple(40 * 31 + 67 * k for k in (0, 5, 1, 9, 3, 12, 7, 2, 11, 4, 8, 6, 10))
TRAVEL_PERIODS = 157  # 5 ms: the trigger changes, a STATE frame is always pending


def commands() -> list[tuple[int, bytes]]:
    """(period, bytes) of pairs of commands: PARAM_READ, then SETPOINT or a PARAM_WRITE that is
    refused because the tool is driven.
    """
    pairs, at = [], int(COMMANDS_S * PERIODS_PER_SECOND)
    while at < (DURATION_S - 0.1) * PERIODS_PER_SECOND:
        k = len(pairs)
        second = (
            command(
                "SETPOINT",
                setpoint_which=0,
                setpoint_value=32767,
                setpoint_sequence=(2 * k + 1) % 256,
            )
            if k % 2
            else command(
                "PARAM_WRITE", write_index=3, write_value=8192, write_sequence=(2 * k + 1) % 256
            )
        )
        pairs.append(
            (at, command("PARAM_READ", read_index=k % 20, read_sequence=2 * k % 256) + second)
        )
        at += GAPS_PERIODS[k % len(GAPS_PERIODS)]
    return pairs


@cache
def command_load_tape(edges_per_turn: int = EDGES_PER_TURN) -> bytes:
    """Packed board inputs, one per PWM period."""
    received: dict[int, bytes] = {}
    for start, pair in commands():
        for n, byte in enumerate(pair):
            at = start + int(n * BYTE_PERIODS)
            received[at] = received.get(at, b"") + bytes([byte])
    inputs, edge = [], DRIVE_S * 16e6
    for k in range(int(DURATION_S * PERIODS_PER_SECOND)):
        edges = []
        while edge < (k + 1) * CYCLES_PER_PERIOD:
            edges.append(int(edge) - k * CYCLES_PER_PERIOD)
            edge += TURN_CYCLES / edges_per_turn
        driven = k > (DRIVE_S - 0.05) * PERIODS_PER_SECOND
        travel = 700 + 60 * (k // TRAVEL_PERIODS % 3) if driven else 100
        inputs.append(
            pack_inputs(
                BoardInputs(
                    (520, 740, travel, 154),  # ADC counts: 1 A, 18.5 V, trigger, 25 degC
                    edges,
                    CONTACT if driven else 0,
                    received.get(k, b""),
                )
            )
        )
    return b"".join(inputs)


def answered(stream: bytes) -> int:
    """Number of ACK frames in the stream."""
    return sum(frame.id == telemetry.ACK for frame in telemetry.Framer().feed(stream))
