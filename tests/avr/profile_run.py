"""Tape of a duty profile that the host commands while the trigger is pressed; after its end and a
release the trigger sets the duty again.
"""

from equality import TapeBoard
from exercise import SettledSwitches

from vgroove import lockstep
from vgroove.control_bench.runs import front_ends, make_tool, reference
from vgroove.lockstep import Profile
from vgroove.profile_sender import OPEN, ProfileSender
from vgroove.sil import SilBoard

DURATION_S = 1.9
BEGIN_S, LASTS_S = 0.3, 0.8
PULLS = Profile(
    travel=(
        (0, 0),
        (0.35, 0),
        (0.37, 0.7),
        (1.4, 0.7),
        (1.42, 0),
        (1.6, 0),
        (1.62, 0.4),
        (1.85, 0.4),
        (1.87, 0),
    )
)


def stairs(time_s: float) -> float:
    """Duty 0.25, 0.5, 1 (limited by the trigger), open bridge, 0.25."""
    return (0.25, 0.5, 1.0, OPEN, 0.25)[min(int(time_s / 0.16), 4)]


def profile_tape() -> bytes:
    """Tape of a native run."""
    board = TapeBoard(SilBoard(target=1))
    tool = make_tool(reference("slip_60", {}), 3)
    line = ProfileSender(stairs, LASTS_S, BEGIN_S)
    lockstep.run(
        SettledSwitches(board),
        tool,
        PULLS,
        DURATION_S,
        lockstep.LockstepOptions(front=front_ends(), line=line, seed=3),
    )
    return bytes(board.tape)
