"""A board's end of a serial line that does not wait: line_writer.py FRAMES_PER_S SECONDS prints the
name of a pseudo-terminal, waits for its reader, sends frames at that rate, loses what the reader's
buffer does not take, and prints the numbers of frames sent and of bytes lost.
"""

import json
import os
import select
import sys
import time
import tty
from contextlib import suppress

from vgroove import telemetry

SLICE_S = 0.002
SETTLE_S = 0.5  # a serial library discards what arrives while it opens the port


def frame_bytes(number: int, per_ms: float) -> bytes:
    """Frame of a stream with one FAST frame a millisecond, the others STATE."""
    time_ms = int(number / per_ms)
    first = number == 0 or int((number - 1) / per_ms) != time_ms
    if first:
        frame = telemetry.frame_of(time_ms, telemetry.FAST, bytes(6) + bytes([time_ms % 16 << 4]))
    else:
        frame = telemetry.frame_of(time_ms, telemetry.STATE, bytes([time_ms & 0xFF]) + bytes(6))
    return telemetry.frame_bytes(frame)


def wait_for_reader(master: int) -> None:
    """Return when a program has opened the other end."""
    poll = select.poll()
    poll.register(master, select.POLLOUT)
    while poll.poll(0)[0][1] & select.POLLHUP:
        time.sleep(0.01)
    time.sleep(SETTLE_S)


def main() -> None:
    rate, seconds = float(sys.argv[1]), float(sys.argv[2])
    stream = [frame_bytes(number, rate / 1000) for number in range(int(rate * seconds))]
    with suppress(OSError):  # a UART is not delayed by other programs
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(20))
    master, slave = os.openpty()
    tty.setraw(slave)
    name = os.ttyname(slave)
    os.close(slave)
    os.set_blocking(master, False)
    sys.stdout.write(name + "\n")
    sys.stdout.flush()
    wait_for_reader(master)
    begin, sent, lost = time.monotonic(), 0, 0
    while sent < len(stream):
        due = min(len(stream), int((time.monotonic() - begin) * rate))
        data = b"".join(stream[sent:due])
        try:
            lost += len(data) - os.write(master, data)
        except BlockingIOError:
            lost += len(data)
        sent = due
        time.sleep(SLICE_S)
    time.sleep(1.0)
    sys.stdout.write(json.dumps({"sent": sent, "bytes_lost": lost}) + "\n")


if __name__ == "__main__":
    main()
