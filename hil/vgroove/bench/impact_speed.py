"""Impact mode against general-purpose solvers at equal accuracy: the head's angle after a second,
on joints that slip at 60 N m and with a slope of 700 N m/rad.

A peer runs at the loosest tolerance that reaches the accuracy on both joints, since one tolerance
must serve joints that are unknown beforehand.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vgroove.bench.impact_tool import SLIPPING, ImpactTool, head_rad, rest
from vgroove.bench.own import ROW_S
from vgroove.bench.solvers import Peer
from vgroove.bench.timing import Seconds, medians
from vgroove.progress import Tick

Floats = npt.NDArray[np.float64]
# Makes the call that is timed: one second of a tool, with the head's angle as result
Prepare = Callable[[ImpactTool], Callable[[], float]]

ACCURACY = 1e-3  # largest relative error of the head's angle
ROWS = 1000  # of 1 ms: one simulated second


@dataclass(frozen=True)
class Figure:
    """Median wall and processor seconds of one simulated second, and the relative error of the
    head's angle; reached: the error is within ACCURACY.
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
    """A solver at the tolerance at which it is timed."""

    name: str
    work: Callable[[], float]
    error: float
    tolerance: float | None = None
    tolerance_is: str | None = None


def row_times(rows: int) -> Floats:
    """Times (rows + 1,) of rows of 1 ms."""
    return np.arange(rows + 1) * ROW_S


def reference_head(tool: ImpactTool, rows: int = ROWS) -> float:
    """The head's angle by the reference solver."""
    from vgroove.bench.impact_peers import reference

    return head_rad(reference(row_times(rows), rest(), tool.vector())[-1])


def peer_head(peer: Peer, tool: ImpactTool, tolerance: float) -> float:
    """The head's angle by a peer; NaN where its solver fails."""
    try:
        return head_rad(peer.run(row_times(ROWS), rest(), tool.vector(), tolerance)[-1])
    except RuntimeError:
        return math.nan


def errors_at(peer: Peer, tolerance: float, heads: dict[str, float]) -> dict[str, float]:
    """Relative error of the head's angle on each joint; infinite where the solver fails."""
    errors = {
        case: abs(peer_head(peer, SLIPPING[case], tolerance) / head - 1.0)
        for case, head in heads.items()
    }
    return {case: error if math.isfinite(error) else math.inf for case, error in errors.items()}


def choose(peer: Peer, heads: dict[str, float]) -> dict[str, Choice]:
    """A peer on each joint at the loosest tolerance that reaches ACCURACY on all; where none does,
    at the tolerance of the least error.
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
    """The plant as a choice, with its error."""
    work = prepare(tool)
    return Choice(name, work, float(abs(work() / head - 1.0)))


def measure(owns: dict[str, Prepare], peers: list[Peer], repeats: int, tick: Tick) -> list[Figure]:
    """Every solver on both joints, timed in turns."""
    heads = {case: reference_head(tool) for case, tool in SLIPPING.items()}
    chosen = []
    for peer in peers:
        chosen.append(choose(peer, heads))
        tick(f"tolerance of {peer.name}")
    figures = []
    for case, tool in SLIPPING.items():
        choices = [
            own_choice(name, prepare, tool, heads[case]) for name, prepare in owns.items()
        ] + [by_case[case] for by_case in chosen]
        seconds = medians(
            {c.name: c.work for c in choices},
            repeats,
            lambda name, case=case: tick(f"{case}: {name}"),
        )
        figures += [figure_of(choice, case, seconds[choice.name]) for choice in choices]
    return figures


def figure_of(choice: Choice, case: str, seconds: Seconds) -> Figure:
    """The figure of a timed choice."""
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
    """How often `measure` calls `tick`."""
    return peers + len(SLIPPING) * repeats * (owns + peers)
