"""What a board has answered (ACK) to the commands of a run: modes that its firmware does not have,
and commands without an answer, which were lost, or whose answers were.
"""

from collections import Counter
from collections.abc import Sequence

from vgroove import telemetry
from vgroove.scenario import Command

ANSWER_S = 0.2  # in which a board answers; a later command may be under way at the end of a run
NAMED = 5

Answer = dict[str, int]  # integers of one ACK by the names of its signals


def answers_in(sent: bytes) -> list[Answer]:
    """The ACKs among the bytes that a board has sent, in their order."""
    return [
        telemetry.decode_integers(frame)
        for frame in telemetry.Framer().feed(sent)
        if frame.id == telemetry.ACK
    ]


def refused_modes(commands: Sequence[Command], answers: Sequence[Answer]) -> list[str]:
    """A sentence for each SET_MODE among a run's commands that the board has refused because its
    firmware lacks the mode.
    """
    results = telemetry.value_table("ACK", "ack_result")
    refused = {
        answer["ack_sequence"]
        for answer in answers
        if answer["ack_command"] == telemetry.SET_MODE
        and results[answer["ack_result"]] == "out_of_range"
    }
    return [
        _refusal(int(command.signals["mode_request"]))
        for number, command in enumerate(commands)
        if command.frame == "SET_MODE" and (number & 0xFF) in refused
    ]


def _refusal(mode: int) -> str:
    name = telemetry.value_table("STATE", "mode").get(mode, str(mode))
    return (
        f"the board has no mode {name}: its firmware holds the controllers of another tool "
        "(VGROOVE_TOOL, docs/firmware.md)"
    )


def unanswered_text(
    commands: Sequence[Command], answers: Sequence[Answer], duration_s: float
) -> str:
    """A sentence that names the commands without an answer; empty where the board has answered all.
    duration_s: of the run.
    """
    left = Counter((answer["ack_command"], answer["ack_sequence"]) for answer in answers)
    lost = []
    for number, command in enumerate(commands):
        key = (telemetry.FRAME_IDS[command.frame], number & 0xFF)
        left[key] -= 1
        if left[key] < 0 and command.time_s < duration_s - ANSWER_S:
            lost.append(f"{command.frame} at {command.time_s:g} s")
    if not lost:
        return ""
    more = f" and {len(lost) - NAMED} more" if len(lost) > NAMED else ""
    return (
        f"the board has not answered {', '.join(lost[:NAMED])}{more}: the command or its answer "
        "was lost"
    )
