"""How a peer's time and accuracy depend on its tolerance: a grid finer than the one its tolerance
is chosen from, each run beside ours.

A solver that knows no events reaches an accuracy by luck at some tolerances and misses it at
tighter ones; the grid shows how far the ratio rests on the choice.
"""

import statistics
from collections.abc import Callable
from dataclasses import dataclass

from vgroove.bench.impact_speed import ACCURACY, Done, Figure, Prepare, peer_head, reference_head
from vgroove.bench.impact_tool import SLIPPING
from vgroove.bench.solvers import Peer
from vgroove.bench.timing import seconds_of

# times the peer's own tolerance: 1e-4, 8e-5, 7e-5 .. for 3e-5
STEPS = (10 / 3, 8 / 3, 7 / 3, 2.0, 5 / 3, 4 / 3, 1.0, 2 / 3)
LONG_S = 0.2  # a run beyond that is timed once


@dataclass(frozen=True)
class Sensitivity:
    """A peer at one tolerance: error of the head's angle and processor seconds of a second; ratio:
    over ours, run in turn with it.
    """

    name: str
    case: str
    tolerance: float
    tolerance_is: str
    head_error: float
    reached: bool
    cpu_seconds: float
    ratio: float


def runs_of(peers: list[Peer]) -> int:
    """How often `measure_sensitivity` calls `done`."""
    return len(SLIPPING) * sum(len(peer.tolerances) > 1 for peer in peers)


def measure_sensitivity(
    own: Prepare, peers: list[Peer], chosen: list[Figure], repeats: int, done: Done
) -> list[Sensitivity]:
    """Every peer that has more than one tolerance, on every joint."""
    at = {f.name: f.tolerance for f in chosen if f.tolerance is not None}
    found = []
    for case, tool in SLIPPING.items():
        work, head = own(tool), reference_head(tool)
        for peer in peers:
            if len(peer.tolerances) > 1:
                found += [
                    _one(peer, case, at[peer.name] * step, work, head, repeats) for step in STEPS
                ]
                done(f"{case}: {peer.name} by tolerance")
    return found


def _one(
    peer: Peer, case: str, tolerance: float, own: Callable[[], float], head: float, repeats: int
) -> Sensitivity:
    tool = SLIPPING[case]
    error = abs(peer_head(peer, tool, tolerance) / head - 1.0)
    times: list[float] = []
    ratios: list[float] = []
    for _ in range(repeats):
        ours = statistics.median(seconds_of(own).cpu for _ in range(9))
        times.append(seconds_of(lambda: peer_head(peer, tool, tolerance)).cpu)
        ratios.append(times[-1] / ours)
        if times[-1] > LONG_S:
            break
    return Sensitivity(
        peer.name,
        case,
        tolerance,
        peer.tolerance_is,
        float(error),
        bool(error <= ACCURACY),
        statistics.median(times),
        statistics.median(ratios),
    )


def least_ratio(found: list[Sensitivity], name: str) -> float | None:
    """A peer's time over ours at its cheapest tolerance that reaches the accuracy on both joints,
    the joint that is nearest.
    """
    rows = [f for f in found if f.name == name]
    passing = {f.tolerance for f in rows} - {f.tolerance for f in rows if not f.reached}
    return min((f.ratio for f in rows if f.tolerance in passing), default=None)
