"""Tape of a board whose dead time is changed before it drives at small duties, at which one of the
two compare values of leg A lies at the end of the timer's range.
"""

from functools import cache

from unequal_pitches import PERIODS_PER_SECOND, command

from vgroove import telemetry
from vgroove.board import BoardInputs, pack_inputs

DEAD_COUNTS = 60
CONTACT = 1
COMMAND_S, PULL_S, STEP_S = 0.3, 0.5, 0.08
RELEASED = 100
TRIGGER_COUNTS = (130, 160, 200, 260, 880, 900, 1000)  # duties of 4 % to full


@cache
def dead_time_tape() -> bytes:
    """Packed board inputs, one per PWM period."""
    names = [parameter.name for parameter in telemetry.parameter_list()]
    write = command(
        "PARAM_WRITE",
        write_index=names.index("dead_time_count"),
        write_value=DEAD_COUNTS,
        write_sequence=1,
    )
    received = {int(COMMAND_S * PERIODS_PER_SECOND) + 2 * n: byte for n, byte in enumerate(write)}
    inputs = []
    for k in range(int((PULL_S + STEP_S * len(TRIGGER_COUNTS)) * PERIODS_PER_SECOND)):
        step = int((k / PERIODS_PER_SECOND - PULL_S) // STEP_S)
        trigger = TRIGGER_COUNTS[step] if step >= 0 else RELEASED
        byte = bytes([received[k]]) if k in received else b""
        switches = CONTACT if step >= 0 else 0
        inputs.append(pack_inputs(BoardInputs((520, 740, trigger, 154), [], switches, byte)))
    return b"".join(inputs)
