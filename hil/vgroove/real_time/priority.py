"""Priority of a run in real time over the other work of the host."""

import gc
import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from vgroove.errors import VgrooveError
from vgroove.real_time import worker_priority
from vgroove.real_time.beside_program import start_beside

# Of SCHED_FIFO; a simulated board has 20 (hil/board/real_time.cpp): a real one is not delayed by
# the host.
HOST_PRIORITY = 10
WORKER_PROGRAM = Path(worker_priority.__file__)
REFUSALS = {
    worker_priority.NOT_PERMITTED: "this user may not change the priority of the kernel's threads: "
    "run as root",
    worker_priority.NO_WORKERS: "this system shows no worker threads of a Linux kernel: run on "
    "Linux",
}


@contextmanager
def undisturbed() -> Iterator[bool]:
    """Run the block without garbage collection and, where the system permits it, with real-time
    priority (SCHED_FIFO). The value states whether it was permitted.
    """
    with ExitStack() as stack:
        prioritised = False
        if hasattr(os, "sched_setscheduler"):
            with suppress(OSError):
                os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(HOST_PRIORITY))
                stack.callback(os.sched_setscheduler, 0, os.SCHED_OTHER, os.sched_param(0))
                prioritised = True
        gc.collect()
        gc.freeze()
        gc.disable()
        stack.callback(gc.unfreeze)
        stack.callback(gc.enable)
        yield prioritised


@contextmanager
def workers_prioritised() -> Iterator[None]:
    """Run the block with real-time priority for the worker threads of the Linux kernel, which copy
    the bytes of serial ports. VgrooveError: not permitted, or not Linux.
    """
    program, answer = start_beside(WORKER_PROGRAM)
    try:
        if answer != worker_priority.READY:
            reason = REFUSALS.get(answer, f"{WORKER_PROGRAM.name} has failed: run it by hand")
            raise VgrooveError(f"--kernel-workers: {reason}, or without the option")
        yield
    finally:
        program.communicate()
