"""Pauses of the computer during a run in real time: times at which not even the task of highest
priority ran, one watching program for each processor.
"""

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from vgroove.real_time.beside_program import start_beside

PROGRAM = Path(__file__).with_name("pause_watch.py")
# Ticks that the answers to the last commands before a pause take after it
AFTER_S = 2e-3


class Pauses:
    """Begin and end of each pause on the monotonic clock, in s, by time of begin."""

    def __init__(self) -> None:
        self.spans: list[tuple[float, float]] = []

    def explain(self, at_s: float) -> bool:
        """Whether a delay at this time follows from a pause: within it, or not longer after it
        than it lasted, in which the delay is made up.
        """
        return any(begin <= at_s <= end + (end - begin) + AFTER_S for begin, end in self.spans)

    def worst_s(self) -> float:
        """The longest pause; 0 without any."""
        return max((end - begin for begin, end in self.spans), default=0.0)


@contextmanager
def watch_pauses() -> Iterator[Pauses | None]:
    """Watch every processor in the block; the value is complete after it, and None where the
    system does not permit real-time priority.
    """
    pauses, programs = Pauses(), _started()
    try:
        yield pauses if programs else None
    finally:
        for program in programs:
            lines = program.communicate()[0].splitlines()
            spans = (line.split() for line in lines)
            pauses.spans += [(float(begin), float(end)) for begin, end in spans]
        pauses.spans.sort()


def _started() -> list[subprocess.Popen[str]]:
    """The watching programs, all of them or none."""
    programs: list[subprocess.Popen[str]] = []
    if not hasattr(os, "sched_getaffinity"):
        return programs
    for processor in sorted(os.sched_getaffinity(0)):
        program, first = start_beside(PROGRAM, str(processor))
        programs.append(program)
        if first != "ready":
            for started in programs:
                started.communicate()
            return []
    return programs
