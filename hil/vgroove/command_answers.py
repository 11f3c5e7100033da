"""Commands of a run that the board has not answered: they, or their answers, were lost."""

from collections import Counter
from collections.abc import Sequence

from vgroove import telemetry
from vgroove.scenario import Command

ANSWER_S = 0.2  # in which a board answers; a later command may be under way at the end of a run
NAMED = 5


def unanswered_text(commands: Sequence[Command], sent: bytes, duration_s: float) -> str:
    """A sentence that names the commands without an ACK among the bytes `sent` by the board; empty
    where it has answered all. duration_s: of the run.
    """
    acks = Counter(
        (ack["ack_command"], ack["ack_sequence"])
        for frame in telemetry.Framer().feed(sent)
        if frame.id == telemetry.ACK and (ack := telemetry.decode_integers(frame))
    )
    lost = []
    for number, command in enumerate(commands):
        key = (telemetry.FRAME_IDS[command.frame], number & 0xFF)
        acks[key] -= 1
        if acks[key] < 0 and command.time_s < duration_s - ANSWER_S:
            lost.append(f"{command.frame} at {command.time_s:g} s")
    if not lost:
        return ""
    more = f" and {len(lost) - NAMED} more" if len(lost) > NAMED else ""
    return (
        f"the board has not answered {', '.join(lost[:NAMED])}{more}: the command or its answer "
        "was lost"
    )
