"""Timing of comparisons: all solvers of a comparison run in turns, so that the load of the machine
affects all alike; the figures are medians.

Wall time is the time to the result; processor time excludes what the machine spends on other
programs.
"""

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from vgroove.progress import Tick

# In its round a short call is repeated for about ROUND_S, at most MAX_CALLS times.
ROUND_S, MAX_CALLS = 0.05, 50


@dataclass(frozen=True)
class Seconds:
    """Wall time of one call, and processor time of all its threads."""

    wall: float
    cpu: float


def seconds_of(work: Callable[[], Any]) -> Seconds:
    """Time one call."""
    wall, cpu = time.perf_counter(), time.process_time()
    work()
    return Seconds(time.perf_counter() - wall, time.process_time() - cpu)


def median_of(samples: list[Seconds]) -> Seconds:
    """Median of the wall times and median of the processor times."""
    return Seconds(
        statistics.median(s.wall for s in samples), statistics.median(s.cpu for s in samples)
    )


def calls_in_round(seconds: float) -> int:
    """Number of calls in a round of a call that takes this many seconds; at least one."""
    return max(1, min(MAX_CALLS, int(ROUND_S / max(seconds, 1e-9))))


def medians(works: dict[str, Callable[[], Any]], repeats: int, tick: Tick) -> dict[str, Seconds]:
    """Median seconds of a call of each work, over `repeats` rounds after a warm-up; `tick` is
    called with the name of a work after its turn.
    """
    calls = {}
    for name, work in works.items():
        work()
        calls[name] = calls_in_round(seconds_of(work).wall)
    rounds: dict[str, list[Seconds]] = {name: [] for name in works}
    for _ in range(repeats):
        for name, work in works.items():
            rounds[name].append(median_of([seconds_of(work) for _ in range(calls[name])]))
            tick(name)
    return {name: median_of(samples) for name, samples in rounds.items()}
