"""Impact mode in lock-step with a controller of 1 ms: the plant advances a tick, then the
controller reads its speed and sets the duty of the next tick.
"""

from collections.abc import Callable
from dataclasses import dataclass

from vgroove import _core
from vgroove.bench.impact_speed import ROWS, Figure
from vgroove.bench.impact_tool import ImpactTool
from vgroove.bench.own import ROW_S, impact_parameters

# The controller cuts the duty above this speed: never, so that the run is the one without it
OVERSPEED_RAD_S = 1e9


@dataclass(frozen=True)
class LockstepFigure:
    """Processor seconds of one simulated second of a solver alone and in lock-step; extra is the
    relative increase.
    """

    name: str
    case: str
    alone_s: float
    lockstep_s: float
    extra: float


def own_lockstep(tool: ImpactTool) -> Callable[[], float]:
    """A call that runs a second of the tool from rest with a compiled controller (as the firmware
    and the peer's controllers are) and returns the head's angle.
    """
    theta = impact_parameters(tool)
    return lambda: _core.ImpactPlant(theta, load_kind="hard_joint", mode="fast").governed(
        ROWS, ROW_S, tool.duty, OVERSPEED_RAD_S
    )


def own_lockstep_in_python(tool: ImpactTool) -> Callable[[], float]:
    """The same with a controller in Python."""
    theta = impact_parameters(tool)

    def run() -> float:
        plant = _core.ImpactPlant(theta, load_kind="hard_joint", mode="fast")
        duty = tool.duty
        for _ in range(ROWS):
            speed = plant.advance(ROW_S, duty).speed_rad_s
            duty = 0.0 if speed > OVERSPEED_RAD_S else tool.duty
        return plant.head_rad

    return run


def pairs(figures: list[Figure], names: dict[str, tuple[str, str]]) -> list[LockstepFigure]:
    """Lock-step against alone for each case, from figures timed in turns; `names` are the solvers'
    names of the figures (alone, lock-step).
    """
    seconds = {(f.name, f.case): f.cpu_seconds for f in figures}
    found = []
    for name, (alone, lockstep) in names.items():
        for case in dict.fromkeys(f.case for f in figures):
            if (alone, case) in seconds and (lockstep, case) in seconds:
                a, b = seconds[alone, case], seconds[lockstep, case]
                found.append(LockstepFigure(name, case, a, b, b / a - 1.0))
    return found
