"""Tape of a shaft with unequal Hall pitches, which are learned by a calibration run, saved, and
identified again after a stop.
"""

import math
from functools import cache

from vgroove import telemetry
from vgroove.board import CYCLES_PER_PERIOD, BoardInputs, pack_inputs

FIRST_TOP = 255
CONTACT = 1
SHARES = (0.27, 0.23, 0.265, 0.235)
HALL_PITCH = 1  # calibrate_what of CALIBRATE
DURATION_S = 5.5
# (from, rpm): learning needs 256 edges at constant speed; after the stop the index is searched; at
# the last speed there is an edge in most ticks.
SPEEDS = ((0.6, 6000.0), (2.6, 0.0), (3.4, 2500.0), (4.2, 14500.0))
PERIODS_PER_SECOND = 16e6 / CYCLES_PER_PERIOD


def rpm_at(time_s: float) -> float:
    return next((rpm for start, rpm in reversed(SPEEDS) if time_s >= start), 0.0)


def edge_cycles() -> list[int]:
    """CPU cycles of all edges since the first TOP."""
    edges, time_s, pitch = [], SPEEDS[0][0], 0
    while time_s < DURATION_S:
        rpm = rpm_at(time_s)
        if rpm == 0.0:
            time_s += 1e-3
            continue
        edges.append(math.floor(time_s * 16e6))
        time_s += 60.0 / rpm * SHARES[pitch]
        pitch = (pitch + 1) % len(SHARES)
    return edges


def command(name: str, **signals: float) -> bytes:
    return telemetry.frame_bytes(telemetry.frame_of_signals(name, 0, **signals))


@cache
def unequal_pitches_tape() -> bytes:
    """Packed board inputs, one per PWM period: CALIBRATE at rest, then two drives."""
    pulled = [
        rpm_at(k / PERIODS_PER_SECOND + 0.05) > 0.0
        for k in range(int(DURATION_S * PERIODS_PER_SECOND))
    ]
    inputs = [
        BoardInputs((512, 740, 900 if pull else 100, 154), switches=CONTACT if pull else 0)
        for pull in pulled
    ]
    edges: dict[int, list[int]] = {}
    for cycle in edge_cycles():
        edges.setdefault(cycle // CYCLES_PER_PERIOD, []).append(cycle % CYCLES_PER_PERIOD)
    sent = enumerate(command("CALIBRATE", calibrate_what=HALL_PITCH, calibrate_sequence=1))
    received = {int(0.4 * PERIODS_PER_SECOND) + 2 * k: bytes([byte]) for k, byte in sent}
    return b"".join(
        pack_inputs(period._replace(edges=edges.get(k, ()), rx=received.get(k, b"")))
        for k, period in enumerate(inputs)
    )
