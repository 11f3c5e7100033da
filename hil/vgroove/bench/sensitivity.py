"""Time and accuracy of a peer over its tolerance, on a finer grid than the one from which its
tolerance is chosen: how sensitive the comparison is to that choice.

A solver without event location reaches an accuracy by chance at some tolerances and misses it at
tighter ones; the grid shows how much the ratio of the times depends on the choice.
"""

import statistics
from collections.abc import Callable
from dataclasses import dataclass

from vgroove.bench.impact_speed import ACCURACY, Figure, Prepare, peer_head, reference_head
from vgroove.bench.impact_tool import SLIPPING
from vgroove.bench.solvers import Peer
from vgroove.bench.timing import seconds_of
from vgroove.progress import Tick

# Factors of the peer's chosen tolerance; with 3e-5 they give 1e-4, 8e-5, 7e-5, 6e-5 ..
STEPS = (10 / 3, 8 / 3, 7 / 3, 2.0, 5 / 3, 4 / 3, 1.0, 2 / 3)
LONG_S = 0.2  # a longer run is timed once
OWN_CALLS = 9  # runs of the plant beside each run of a peer; their median counts


@dataclass(frozen=True)
class ToleranceFigure:
    """A peer at one tolerance: relative error of the head's angle and processor seconds of one
    simulated second; ratio: over the plant's, run in turns with it.
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
    """How often `measure_tolerances` calls `tick`."""
    return len(SLIPPING) * sum(len(peer.tolerances) > 1 for peer in peers)


@dataclass(frozen=True)
class OnJoint:
    """One joint: its case, the plant's run, and the reference of the head's angle."""

    case: str
    own: Callable[[], float]
    head: float


def measure_tolerances(
    own: Prepare, peers: list[Peer], chosen: list[Figure], repeats: int, tick: Tick
) -> list[ToleranceFigure]:
    """Every peer that has more than one tolerance, on every joint."""
    at = {f.name: f.tolerance for f in chosen if f.tolerance is not None}
    found = []
    for case, tool in SLIPPING.items():
        joint = OnJoint(case, own(tool), reference_head(tool))
        for peer in (peer for peer in peers if len(peer.tolerances) > 1):
            found += [at_tolerance(peer, joint, at[peer.name] * step, repeats) for step in STEPS]
            tick(f"{case}: {peer.name} by tolerance")
    return found


def at_tolerance(peer: Peer, joint: OnJoint, tolerance: float, repeats: int) -> ToleranceFigure:
    """A peer at one tolerance, timed in turns with the plant."""
    tool = SLIPPING[joint.case]
    error = abs(peer_head(peer, tool, tolerance) / joint.head - 1.0)
    times: list[float] = []
    ratios: list[float] = []
    for _ in range(repeats):
        own_s = statistics.median(seconds_of(joint.own).cpu for _ in range(OWN_CALLS))
        times.append(seconds_of(lambda: peer_head(peer, tool, tolerance)).cpu)
        ratios.append(times[-1] / own_s)
        if times[-1] > LONG_S:
            break
    return ToleranceFigure(
        peer.name,
        joint.case,
        tolerance,
        peer.tolerance_is,
        float(error),
        bool(error <= ACCURACY),
        statistics.median(times),
        statistics.median(ratios),
    )


def least_ratio(found: list[ToleranceFigure], name: str) -> float | None:
    """Least ratio of a peer over the joints and the tolerances that reach the accuracy on both
    joints; None where there is none.
    """
    rows = [f for f in found if f.name == name]
    passing = {f.tolerance for f in rows} - {f.tolerance for f in rows if not f.reached}
    return min((f.ratio for f in rows if f.tolerance in passing), default=None)
