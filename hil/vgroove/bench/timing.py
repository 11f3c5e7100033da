"""Timing for comparisons: everything of one comparison takes turns, so that a busy machine is unfair to nobody; medians."""

import statistics
import time
from collections.abc import Callable
from typing import Any


def seconds_of(work: Callable[[], Any]) -> float:
    """Wall seconds of one call."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def medians(works: dict[str, Callable[[], Any]], repeats: int, done: Callable[[str], None]) -> dict[str, float]:
    """Median wall seconds of each after one warm-up, `repeats` rounds in which each runs once; `done` hears each name after a run."""
    for work in works.values():
        work()
    rounds: dict[str, list[float]] = {name: [] for name in works}
    for _ in range(repeats):
        for name, work in works.items():
            rounds[name].append(seconds_of(work))
            done(name)
    return {name: statistics.median(seconds) for name, seconds in rounds.items()}
