"""Priority of a run in real time over the other work of the host."""

import gc
import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from vgroove.errors import VgrooveError

# Priorities of SCHED_FIFO; a simulated board has 20 (hil/board/real_time.cpp): a real one is not
# delayed by the host.
HOST_PRIORITY, WORKER_PRIORITY = 10, 15
WORKER_PREFIX = "kworker/u"  # threads of the work queues that belong to no processor


@contextmanager
def undisturbed() -> Iterator[bool]:
    """No garbage collection and, where permitted, real-time priority (SCHED_FIFO) in the block;
    the value states the latter.
    """
    with ExitStack() as stack:
        prioritised = False
        if hasattr(os, "sched_setscheduler"):
            with suppress(OSError):
                _set_fifo(0, HOST_PRIORITY)
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
    """Real-time priority in the block for the threads of the Linux kernel that pass a terminal's
    bytes on. VgrooveError: not permitted, or another system.
    """
    before = {}
    try:
        for process in _workers():
            # a worker may have ended since it was listed
            with suppress(ProcessLookupError):
                before[process] = os.sched_getscheduler(process), os.sched_getparam(process)
                _set_fifo(process, WORKER_PRIORITY)
        yield
    except PermissionError as error:
        raise VgrooveError(
            "--kernel-workers: this user may not change the priority of the kernel's threads: run "
            "as root, or without the option"
        ) from error
    finally:
        for process, (policy, parameters) in before.items():
            with suppress(OSError):
                os.sched_setscheduler(process, policy, parameters)


def _workers() -> list[int]:
    """Process numbers of the kernel's unbound workers. VgrooveError: a system without them."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if (folder / "comm").read_text().startswith(WORKER_PREFIX):
                found.append(int(folder.name))
    if not found:
        raise VgrooveError(
            "--kernel-workers: this system shows no worker threads of a Linux kernel: run without "
            "the option"
        )
    return found


def _set_fifo(process: int, priority: int) -> None:
    os.sched_setscheduler(process, os.SCHED_FIFO, os.sched_param(priority))
