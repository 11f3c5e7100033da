"""Impact mode against general-purpose solvers at equal accuracy: the screw's angle after a second,
slipping at 60 N m and slope 700.

A peer runs at the loosest tolerance that reaches the accuracy on both joints: its user does not
know the joint beforehand.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vgroove.bench.impact_tool import SLIPPING, ImpactTool, head_rad, rest
from vgroove.bench.solvers import Peer
from vgroove.bench.timing import Seconds, medians

Floats = npt.NDArray[np.float64]
# what is timed: a second of the tool, giving its head's angle
Prepare = Callable[[ImpactTool], Callable[[], float]]
Done = Callable[[str], None]

ACCURACY = 1e-3  # of the head's angle
ROWS = 1000  # of 1 ms: one simulated second


@dataclass(frozen=True)
class Figure:
    """Median seconds (wall and processor) of one simulated second and the error of the head's
    angle; reached: within ACCURACY.
    """

    name: str
    case: str
    seconds: float
    cpu_seconds: float
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


def errors_at(peer: Peer, tolerance: float, heads: dict[str, float]) -> dict[str, float]:
    """Relative error of the head's angle by joint, infinite where the solver gives up."""
    errors = {
        case: abs(peer_head(peer, SLIPPING[case], tolerance) / head - 1.0)
        for case, head in heads.items()
    }
    return {case: error if math.isfinite(error) else math.inf for case, error in errors.items()}


def choose(peer: Peer, heads: dict[str, float]) -> dict[str, Choice]:
    """By joint, at the loosest tolerance that reaches ACCURACY on all; where none does, at the one
    that comes nearest.
    """
    tried: list[tuple[float, dict[str, float]]] = []
    for tolerance in peer.tolerances:
        tried.append((tolerance, errors_at(peer, tolerance, heads)))
        if max(tried[-1][1].values()) <= ACCURACY:
            break
    tolerance, errors = min(tried, key=lambda one: max(max(one[1].values()), ACCURACY))
    return {
        case: Choice(
            peer.name,
            _head_work(peer, SLIPPING[case], tolerance),
            error,
            tolerance,
            peer.tolerance_is,
        )
        for case, error in errors.items()
    }


def _head_work(peer: Peer, tool: ImpactTool, tolerance: float) -> Callable[[], float]:
    return lambda: peer_head(peer, tool, tolerance)


def own_choice(name: str, prepare: Prepare, tool: ImpactTool, head: float) -> Choice:
    work = prepare(tool)
    return Choice(name, work, float(abs(work() / head - 1.0)))


def measure(owns: dict[str, Prepare], peers: list[Peer], repeats: int, done: Done) -> list[Figure]:
    """Every solver on both joints, each timed in turn with the others."""
    heads = {case: reference_head(tool) for case, tool in SLIPPING.items()}
    chosen = []
    for peer in peers:
        chosen.append(choose(peer, heads))
        done(f"tolerance of {peer.name}")
    figures = []
    for case, tool in SLIPPING.items():
        choices = [
            own_choice(name, prepare, tool, heads[case]) for name, prepare in owns.items()
        ] + [by_case[case] for by_case in chosen]
        seconds = medians(
            {c.name: c.work for c in choices},
            repeats,
            lambda name, case=case: done(f"{case}: {name}"),
        )
        figures += [figure_of(choice, case, seconds[choice.name]) for choice in choices]
    return figures


def figure_of(choice: Choice, case: str, seconds: Seconds) -> Figure:
    reached = bool(choice.error <= ACCURACY)
    return Figure(
        choice.name,
        case,
        seconds.wall,
        seconds.cpu,
        choice.error,
        reached,
        choice.tolerance,
        choice.tolerance_is,
    )


def runs_of(owns: int, peers: int, repeats: int) -> int:
    """How often `measure` calls `done`."""
    return peers + len(SLIPPING) * repeats * (owns + peers)
