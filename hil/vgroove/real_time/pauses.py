"""Pauses of the computer during a run in real time: times at which not even the task of highest
priority ran, one watching program for each processor.
"""

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from vgroove.real_time import pause_watch
from vgroove.real_time.beside_program import start_beside

PROGRAM = Path(pause_watch.__file__)
AFTER_S = 2e-3  # two ticks: the answer to a command before the pause


class Pauses:
    """Times at which the computer stood still. spans: (begin, end) of each in s of the monotonic
    clock, the earliest first.
    """

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
    """Look for pauses on every processor while the block runs. The value is filled when the block
    ends; it is None where the system does not permit real-time priority.
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
    """A pause_watch.py for each processor; none where real-time priority is not permitted."""
    programs: list[subprocess.Popen[str]] = []
    if not hasattr(os, "sched_getaffinity"):
        return programs
    for processor in sorted(os.sched_getaffinity(0)):
        program, first = start_beside(PROGRAM, str(processor))
        programs.append(program)
        if first != pause_watch.READY:
            for started in programs:
                started.communicate()
            return []
    return programs
