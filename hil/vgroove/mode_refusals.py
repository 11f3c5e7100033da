"""Sentences about modes whose controllers the board's firmware does not have."""

from collections.abc import Sequence

from vgroove import telemetry
from vgroove.scenario import Command


def refused_modes(commands: Sequence[Command], sent: bytes) -> list[str]:
    """A sentence for each SET_MODE among a run's commands that the board has refused because its
    firmware lacks the mode; `sent`: the bytes that the board has sent.
    """
    acks = (
        telemetry.decode_integers(frame)
        for frame in telemetry.Framer().feed(sent)
        if frame.id == telemetry.ACK
    )
    results = telemetry.value_table("ACK", "ack_result")
    refused = {
        ack["ack_sequence"]
        for ack in acks
        if ack["ack_command"] == telemetry.SET_MODE and results[ack["ack_result"]] == "out_of_range"
    }
    return [
        _sentence(int(command.signals["mode_request"]))
        for number, command in enumerate(commands)
        if command.frame == "SET_MODE" and (number & 0xFF) in refused
    ]


def _sentence(mode: int) -> str:
    name = telemetry.value_table("STATE", "mode").get(mode, str(mode))
    return (
        f"the board has no mode {name}: its firmware holds the controllers of another tool "
        "(VGROOVE_TOOL, docs/firmware.md)"
    )
