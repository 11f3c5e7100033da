"""Impact mode against general-purpose solvers at equal accuracy: the screw's angle after a second, slipping at 60 N m and slope 700."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vgroove.bench.impact_tool import SLIPPING, ImpactTool, head_rad, rest
from vgroove.bench.solvers import Peer
from vgroove.bench.timing import medians

Floats = npt.NDArray[np.float64]
HeadOf = Callable[[ImpactTool, int], float]  # tool, rows of 1 ms -> the head's angle at the end
Done = Callable[[str], None]

ACCURACY = 1e-3  # of the head's angle
ROWS = 1000


@dataclass(frozen=True)
class Figure:
    """Median wall seconds of one simulated second and the error of the head's angle; reached: the error is within ACCURACY."""

    name: str
    case: str
    seconds: float
    head_error: float
    reached: bool
    tolerance: float | None = None
    tolerance_is: str | None = None


@dataclass(frozen=True)
class Choice:
    """A solver at the tolerance at which it will be timed."""

    name: str
    work: Callable[[], float]
    error: float
    tolerance: float | None = None
    tolerance_is: str | None = None


def row_times(rows: int) -> Floats:
    return np.arange(rows + 1) * 1e-3


def reference_head(tool: ImpactTool, rows: int = ROWS) -> float:
    """The head's angle at the tightest tolerance."""
    from vgroove.bench.impact_peers import reference

    return head_rad(reference(row_times(rows), rest(), tool.vector())[-1])


def peer_head(peer: Peer, tool: ImpactTool, tolerance: float) -> float:
    """NaN where the solver gives up."""
    try:
        return head_rad(peer.run(row_times(ROWS), rest(), tool.vector(), tolerance)[-1])
    except RuntimeError:
        return math.nan


def choose(peer: Peer, tool: ImpactTool, head: float) -> Choice:
    """The loosest tolerance that reaches ACCURACY; where none does, the one that comes nearest."""
    tried: list[Choice] = []
    for tolerance in peer.tolerances:
        error = abs(peer_head(peer, tool, tolerance) / head - 1.0)
        work = _head_work(peer, tool, tolerance)
        tried.append(Choice(peer.name, work, error if math.isfinite(error) else math.inf, tolerance, peer.tolerance_is))
        if tried[-1].error <= ACCURACY:
            return tried[-1]
    return min(tried, key=lambda choice: choice.error)


def _head_work(peer: Peer, tool: ImpactTool, tolerance: float) -> Callable[[], float]:
    return lambda: peer_head(peer, tool, tolerance)


def own_choice(name: str, head_of: HeadOf, tool: ImpactTool, head: float) -> Choice:
    return Choice(name, lambda: head_of(tool, ROWS), abs(head_of(tool, ROWS) / head - 1.0))


def measure(owns: dict[str, HeadOf], peers: list[Peer], repeats: int, done: Done) -> list[Figure]:
    """Every solver on both joints, each timed in turn with the others."""
    figures = []
    for case, tool in SLIPPING.items():
        head = reference_head(tool)
        choices = [own_choice(name, head_of, tool, head) for name, head_of in owns.items()]
        for peer in peers:
            choices.append(choose(peer, tool, head))
            done(f"{case}: tolerance of {peer.name}")
        seconds = medians({c.name: c.work for c in choices}, repeats, lambda name, case=case: done(f"{case}: {name}"))
        figures += [Figure(c.name, case, seconds[c.name] / (ROWS * 1e-3), c.error, c.error <= ACCURACY, c.tolerance, c.tolerance_is)
                    for c in choices]
    return figures


def runs_of(owns: int, peers: int, repeats: int) -> int:
    """How often `measure` calls `done`."""
    return len(SLIPPING) * (peers + repeats * (owns + peers))
