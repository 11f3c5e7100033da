"""A program that gives real-time priority to worker threads of the Linux kernel (kworker), also to
those that start later. Such a thread copies the bytes between a serial port's driver and its
reader. Imports the standard library alone.

Prints `ready`, or why it cannot. Ends when its standard input is closed, also by the end of the
process that started it, and gives the threads their former priority back.
"""

import os
import select
import sys
from contextlib import suppress
from pathlib import Path

PRIORITY = 15  # of SCHED_FIFO: above the host's exchange, below a simulated board
PREFIX = "kworker/u"  # threads of the work queues that belong to no processor
PERIOD_S = 0.05
READY, NOT_PERMITTED, NO_WORKERS = "ready", "not permitted", "no workers"


def workers() -> list[int]:
    """Process numbers of the kernel's unbound workers."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if (folder / "comm").read_text().startswith(PREFIX):
                found.append(int(folder.name))
    return found


def prioritise(processes: list[int], before: dict[int, tuple[int, object]]) -> None:
    """Give real-time priority to the processes that do not have it, and store the policy and
    parameters that each had in `before`.
    """
    for process in processes:
        # a worker may have ended since it was listed
        with suppress(ProcessLookupError):
            policy = os.sched_getscheduler(process)
            if policy != os.SCHED_FIFO:
                before[process] = policy, os.sched_getparam(process)
                os.sched_setscheduler(process, os.SCHED_FIFO, os.sched_param(PRIORITY))


def main() -> None:
    """Keep the workers at their priority until standard input ends."""
    before: dict[int, tuple[int, object]] = {}
    found = workers()
    try:
        prioritise(found, before)
        sys.stdout.write(f"{READY if found else NO_WORKERS}\n")
        sys.stdout.flush()
        while found and not select.select([sys.stdin], [], [], PERIOD_S)[0]:
            prioritise(workers(), before)
    except PermissionError:
        sys.stdout.write(f"{NOT_PERMITTED}\n")
    finally:
        for process, (policy, parameters) in before.items():
            with suppress(OSError):
                os.sched_setscheduler(process, policy, parameters)


if __name__ == "__main__":
    main()
