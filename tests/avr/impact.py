"""Taped pins of the tool in each mode, impacting (the drill: stalling): each controller through its heavy states, and what the parameters must say."""

from dataclasses import dataclass, field

from equality import TapeBoard

from vgroove import lockstep, telemetry
from vgroove.control_bench.runs import front_ends, make_tool, mode_number, reference
from vgroove.lockstep import Profile
from vgroove.sil import SilBoard

DURATION_S = 1.9
COMMAND_S = 0.2  # the current offset is known by then
PULLS = Profile(travel=((0, 0), (0.35, 0), (0.37, 1.0), (1.45, 1.0), (1.47, 0), (1.55, 0), (1.57, 0.7), (1.8, 0.7), (1.82, 0)))


@dataclass(frozen=True)
class Case:
    """A mode on a joint; `params`: raw values by name, written before the trigger is pulled."""

    mode: str
    joint: str = "locked"
    values: dict[str, float] = field(default_factory=dict)
    params: dict[str, int] = field(default_factory=dict)


CASES = {
    "duty": Case("duty", "slip_60"),
    "sync": Case("sync", "locked", {"supply.voltage_v": 20.5}),
}


def _frames(case: Case) -> list[tuple[float, bytes]]:
    """The commands that choose the mode and its parameters."""
    names = [parameter.name for parameter in telemetry.parameter_list()]
    asked = [("SET_MODE", {"mode_request": mode_number(case.mode)})]
    asked += [("PARAM_WRITE", {"write_index": names.index(name), "write_value": value}) for name, value in case.params.items()]
    frames = []
    for k, (name, signals) in enumerate(asked):
        time_s = COMMAND_S + 0.02 * k
        sequence = f"{name.split('_')[-1].lower()}_sequence"
        frames.append((time_s, telemetry.frame_bytes(telemetry.frame_of_signals(name, round(time_s * 1000), **signals, **{sequence: k + 1}))))
    return frames


def impact_tape(name: str) -> bytes:
    """What the pins saw in a native run of the case."""
    case = CASES[name]
    board = TapeBoard(SilBoard(target=1))
    tool = make_tool(reference(case.joint, case.values), 3)
    lockstep.run(board, tool, PULLS, DURATION_S, front=front_ends(), line=lockstep.Script(_frames(case)), seed=3)
    return bytes(board.tape)
