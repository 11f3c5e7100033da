"""A program that records when a processor stood still. It sleeps for a millisecond at a time with a
high real-time priority: it wakes late only if the computer itself did not run (hypervisor,
firmware, power management). Imports the standard library alone, so that it starts at once.

Ends when its standard input is closed, and prints a line for each pause: begin and end on the
monotonic clock in s.
"""

import gc
import os
import select
import sys
import time

PRIORITY = 50  # of SCHED_FIFO, above everything that takes part in a run
PERIOD_S = 1e-3
READY = "ready"
LEAST_PAUSE_S = 0.5e-3  # a tool's inputs have about twice this time to spare


def watch(processor: int) -> None:
    """Print `ready`, watch a processor, then print its pauses."""
    os.sched_setaffinity(0, {processor})
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    gc.disable()
    sys.stdout.write(f"{READY}\n")
    sys.stdout.flush()
    pauses = []
    due_s = time.monotonic()
    while True:
        due_s += PERIOD_S
        if select.select([sys.stdin], [], [], max(0.0, due_s - time.monotonic()))[0]:
            break
        now_s = time.monotonic()
        if now_s - due_s > LEAST_PAUSE_S:
            pauses.append((due_s, now_s))
            due_s = now_s
    sys.stdout.writelines(f"{begin_s} {end_s}\n" for begin_s, end_s in pauses)


if __name__ == "__main__":
    watch(int(sys.argv[1]))
