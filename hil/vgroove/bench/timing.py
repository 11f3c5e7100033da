"""Timing for comparisons: everything of one comparison takes turns, so that a busy machine is unfair to nobody; medians."""

import statistics
import time
from collections.abc import Callable
from typing import Any

ROUND_S, MOST_CALLS = 0.05, 50  # a short work is called several times in its round


def seconds_of(work: Callable[[], Any]) -> float:
    """Wall seconds of one call."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def calls_in_round(seconds: float) -> int:
    """Calls of a work that takes so long; a long one is called once."""
    return max(1, min(MOST_CALLS, int(ROUND_S / max(seconds, 1e-9))))


def medians(works: dict[str, Callable[[], Any]], repeats: int, done: Callable[[str], None]) -> dict[str, float]:
    """Median wall seconds of a call of each, over `repeats` rounds after a warm-up; `done` hears each name after its turn."""
    calls = {}
    for name, work in works.items():
        work()
        calls[name] = calls_in_round(seconds_of(work))
    rounds: dict[str, list[float]] = {name: [] for name in works}
    for _ in range(repeats):
        for name, work in works.items():
            rounds[name].append(statistics.median(seconds_of(work) for _ in range(calls[name])))
            done(name)
    return {name: statistics.median(seconds) for name, seconds in rounds.items()}
