"""Timing for comparisons: everything of one comparison takes turns, so that a busy machine is
unfair to nobody; medians.

Wall time is what a user waits; processor time beside it tells how much of that the machine spent on
others.
"""

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

ROUND_S, MOST_CALLS = 0.05, 50  # a short work is called several times in its round


@dataclass(frozen=True)
class Seconds:
    """Of one call: wall, and processor time of all its threads."""

    wall: float
    cpu: float


def seconds_of(work: Callable[[], Any]) -> Seconds:
    wall, cpu = time.perf_counter(), time.process_time()
    work()
    return Seconds(time.perf_counter() - wall, time.process_time() - cpu)


def median_of(samples: list[Seconds]) -> Seconds:
    return Seconds(
        statistics.median(s.wall for s in samples), statistics.median(s.cpu for s in samples)
    )


def calls_in_round(seconds: float) -> int:
    """Calls of a work that takes so long; a long one is called once."""
    return max(1, min(MOST_CALLS, int(ROUND_S / max(seconds, 1e-9))))


def medians(
    works: dict[str, Callable[[], Any]], repeats: int, done: Callable[[str], None]
) -> dict[str, Seconds]:
    """Median seconds of a call of each, over `repeats` rounds after a warm-up; `done` hears each
    name after its turn.
    """
    calls = {}
    for name, work in works.items():
        work()
        calls[name] = calls_in_round(seconds_of(work).wall)
    rounds: dict[str, list[Seconds]] = {name: [] for name in works}
    for _ in range(repeats):
        for name, work in works.items():
            rounds[name].append(median_of([seconds_of(work) for _ in range(calls[name])]))
            done(name)
    return {name: median_of(samples) for name, samples in rounds.items()}
