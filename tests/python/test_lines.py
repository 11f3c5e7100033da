"""Serial lines that fail or are fast, with a real pseudo-terminal: what the recorder says and keeps
where a wire is open, the rate is wrong, frames come twice or the board's clock wraps, and that
nothing is lost beside a busy processor.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import can
import numpy as np
import pytest

from telemetry_board import Board, PtyBoard
from vgroove.log import read_log
from vgroove.serial_bus import ResyncBus
from vgroove.telemetry import FRAME_BYTES

HERE = Path(__file__).resolve().parent
RESULTS = HERE.parents[1] / "docs" / "results"
RECORD = [sys.executable, "-m", "vgroove.cli", "record"]
BUSY = "import time\nend = time.monotonic() + {}\nwhile time.monotonic() < end: pass"


def record(port: str, output: Path, *options: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*RECORD, port, "-o", str(output), *options],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def deaf_board() -> PtyBoard:
    """A board that runs for a while and does not receive: the wire to its RX pin is open."""
    pty = PtyBoard()
    pty.board.run(700)
    pty.board.receive = lambda _: None
    return pty


def test_a_line_without_a_wire_to_the_board_is_named(tmp_path: Path) -> None:
    with deaf_board() as pty:
        done = record(pty.port, tmp_path / "run.csv")
    assert done.returncode == 2
    assert "does not answer the request for its parameters" in done.stderr
    assert "RX pin" in done.stderr and "--without-boot" in done.stderr
    assert "is it a vgroove board" not in done.stderr
    assert os.listdir(tmp_path) == []


def test_such_a_line_can_be_recorded(tmp_path: Path) -> None:
    output = tmp_path / "run.csv"
    with deaf_board() as pty:
        done = record(pty.port, output, "--without-boot", "--seconds", "1.5")
    assert done.returncode == 0, done.stderr
    assert "parameters are not complete" in done.stderr
    log = read_log(output)
    assert len(log) > 1200
    assert set(np.round(np.diff(log.time_s), 6)) == {0.001}
    assert 0.9 < log["duty"].max() <= 1.0  # of the compare value 255


def test_a_silent_line_is_named(tmp_path: Path) -> None:
    master, slave = os.openpty()
    done = record(os.ttyname(slave), tmp_path / "run.csv")
    os.close(master)
    os.close(slave)
    assert done.returncode == 2 and "the line is silent" in done.stderr
    assert "TX wire" in done.stderr


def test_a_wrong_rate_is_named(tmp_path: Path) -> None:
    # at another rate than the sender's the receiver samples other bits: no byte is right
    with PtyBoard(damage=lambda data: bytes((b * 7 + 3) & 0xFF for b in data)) as pty:
        done = record(pty.port, tmp_path / "run.csv", "--baud", "115200")
    assert done.returncode == 2
    assert "nothing that arrives is a frame: check the rate" in done.stderr


def test_frames_that_come_twice_are_counted_and_not_recorded_twice(tmp_path: Path) -> None:
    held = bytearray()

    def twice(data: bytes) -> bytes:
        held.extend(data)
        out = bytearray()
        while len(held) >= FRAME_BYTES:
            frame = bytes(held[:FRAME_BYTES])
            del held[:FRAME_BYTES]
            out += frame * (2 if frame[1] % 50 == 0 and frame[6:8] == b"\x00\x01" else 1)
        return bytes(out)

    output = tmp_path / "run.csv"
    with PtyBoard(damage=twice) as pty:
        done = record(pty.port, output, "--seconds", "2")
    assert done.returncode == 0, done.stderr
    counters = json.loads((tmp_path / "run.csv.json").read_text())["counters"]
    assert counters["corrupt"] > 5 and counters["lost"] == 0
    log = read_log(output)
    assert set(np.round(np.diff(log.time_s), 6)) == {0.001}


def test_a_clock_that_wraps_leaves_no_gap(tmp_path: Path) -> None:
    output = tmp_path / "run.csv"
    pty = PtyBoard()
    pty.board = Board(now_ms=2**32 - 8_000)  # the recorder needs seconds to begin
    with pty:
        done = record(pty.port, output, "--seconds", "9")
    assert done.returncode == 0, done.stderr
    log = read_log(output)
    assert log.time_s[0] < 2**32 / 1000 < log.time_s[-1]
    assert len(log) > 1900 and set(np.round(np.diff(log.time_s), 6)) == {0.001}


@contextmanager
def busy_processors(seconds: float) -> Iterator[None]:
    """A busy process for each processor."""
    command = [sys.executable, "-c", BUSY.format(seconds)]
    busy = [subprocess.Popen(command) for _ in range(os.cpu_count() or 1)]
    try:
        yield
    finally:
        for process in busy:
            process.terminate()
            process.wait()


def received_of(
    frames_per_s: int, seconds: float, receive: Callable[[str], int] | None = None
) -> tuple[int, dict[str, int]]:
    """Frames that a reader gets of a stream beside busy processors, and what the writer lost.
    receive: the reader, from the port to the number of frames until the line hangs up; this
    project's bus if absent.
    """
    command = [sys.executable, str(HERE / "line_writer.py"), str(frames_per_s), str(seconds)]
    writer = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert writer.stdout is not None
    port = writer.stdout.readline().strip()
    with busy_processors(seconds + 30.0):
        received = (receive or received_in_blocks)(port)
    return received, json.loads(writer.stdout.readline())


def received_in_blocks(port: str) -> int:
    """Number of frames that a program receives if it reads every 20 ms what a ResyncBus has."""
    bus, received = ResyncBus(port, baudrate=1_000_000), 0
    with suppress(can.CanOperationError):  # the writer has ended and hung up
        while True:
            received += len(bus.read_frames())
            time.sleep(0.02)
    bus.shutdown()
    return received


@pytest.mark.parametrize(
    "frames_per_s", [pytest.param(1316, marks=pytest.mark.proof), 5263], ids=["250 kBd", "1 MBd"]
)
def test_nothing_is_lost_beside_a_busy_processor(frames_per_s: int) -> None:
    received, line = received_of(frames_per_s, 8.0)
    assert line["bytes_lost"] == 0 and received == line["sent"] == 8 * frames_per_s


def test_the_streams_of_ten_minutes_have_lost_nothing() -> None:
    result = json.loads((RESULTS / "streams.json").read_text("utf-8"))
    assert result["lost"] == 0 and len(result["streams"]) == 2
    for stream in result["streams"].values():
        assert stream["seconds"] == 600.0 and stream["bytes_lost"] == 0
        assert stream["frames_received"] == stream["frames_sent"] >= 600 * 1316
