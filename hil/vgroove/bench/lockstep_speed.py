"""Impact mode in lock-step with a 1 ms controller: the plant advances a millisecond, the controller
sees it and commands the next.
"""

from collections.abc import Callable
from dataclasses import dataclass

from vgroove import _core
from vgroove.bench.impact_speed import ROWS, Figure
from vgroove.bench.impact_tool import ImpactTool
from vgroove.bench.own import impact_parameters

ROW_S = 1e-3
# the controller looks at every row and never has to act: the same run as without it
OVERSPEED_RAD_S = 1e9


@dataclass(frozen=True)
class LockstepFigure:
    """Processor seconds of one simulated second alone and in lock-step, one solver; extra = share
    that lock-step costs more.
    """

    name: str
    case: str
    alone_s: float
    lockstep_s: float
    extra: float


def own_lockstep(tool: ImpactTool) -> Callable[[], float]:
    """A second of the tool from rest, a compiled controller every millisecond, as firmware and the
    peer's are; gives the head's angle.
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
    """Lock-step against alone, by case, from figures measured in turn; names: solver -> (alone,
    lock-step).
    """
    seconds = {(f.name, f.case): f.cpu_seconds for f in figures}
    found = []
    for name, (alone, lockstep) in names.items():
        for case in dict.fromkeys(f.case for f in figures):
            if (alone, case) in seconds and (lockstep, case) in seconds:
                a, b = seconds[alone, case], seconds[lockstep, case]
                found.append(LockstepFigure(name, case, a, b, b / a - 1.0))
    return found
