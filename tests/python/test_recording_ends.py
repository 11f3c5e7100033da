"""Recordings and runs that end abruptly, as real processes: killed, terminated, hung up, two at a
time on one file.
"""

import fcntl
import os
import re
import signal
import subprocess
import sys
import termios
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from telemetry_board import PtyBoard, wait_until
from test_recorder import ENDINGS, direct_log, start, wait_for_part
from test_run import short_scenario, start_on_pty
from vgroove.log import read_log
from vgroove.part_file import PartFile, part_of

ALL_BUT_S = 1.0  # what a killed process may lose


def growing(output: Path) -> Path:
    """The part file that holds the rows of a recording."""
    return part_of(output.with_name(output.name + ".csv") if output.suffix == ".mf4" else output)


def kept_name(output: Path) -> Path:
    """The name that the part file of a killed process gets."""
    rows = output.with_name(output.name + ".csv") if output.suffix == ".mf4" else output
    return rows.with_stem(rows.stem + ".recovered-1")


def wait_for_size(path: Path, size: int) -> None:
    """Wait until a file has `size` bytes."""
    wait_until(lambda: path.exists() and path.stat().st_size > size, f"{path} has {size} bytes")


def sent_until_s(pty: PtyBoard) -> float:
    """Board time in s of the last row that the board has sent."""
    return max(direct_log(pty))


def test_a_killed_recorder_leaves_all_but_the_last_second_in_every_format(tmp_path: Path) -> None:
    outputs = [tmp_path / f"run{ending}" for ending in ENDINGS]
    with ExitStack() as stack:
        boards = [stack.enter_context(PtyBoard()) for _ in outputs]
        recorders = [start(b.port, o) for b, o in zip(boards, outputs, strict=True)]
        for output in outputs:
            wait_for_size(growing(output), 20_000)
        lost_s = []
        for board, recorder in zip(boards, recorders, strict=True):
            recorder.kill()
            end_s = sent_until_s(board)
            recorder.communicate(timeout=30)
            lost_s.append(end_s)
        for k, output in enumerate(outputs):
            log, sent = read_log(growing(output)), direct_log(boards[k])
            lost_s[k] -= log.time_s[-1]
            assert len(log) > 200 and np.all(np.diff(log.time_s) < 0.0015)
            assert set(log.time_s.tolist()) <= set(sent)
        assert max(lost_s) < ALL_BUT_S, dict(zip(ENDINGS, lost_s, strict=True))
        before = {output: growing(output).read_bytes() for output in outputs}
        again = [start(b.port, o, "--seconds", "0.3") for b, o in zip(boards, outputs, strict=True)]
        for output, recorder in zip(outputs, again, strict=True):
            _, text = recorder.communicate(timeout=60)
            assert recorder.returncode == 0, text
            assert f"what it recorded is in {kept_name(output)}" in text
            assert kept_name(output).read_bytes() == before[output]
            assert len(read_log(output)) >= 300 and not growing(output).exists()


def test_a_second_recorder_of_one_file_is_refused(tmp_path: Path) -> None:
    output = tmp_path / "run.csv"
    with PtyBoard() as first, PtyBoard() as other:
        recorder = start(first.port, output)
        wait_for_part(output, 5_000)
        second = start(other.port, output, "--seconds", "0.5")
        _, text = second.communicate(timeout=60)
        recorder.send_signal(signal.SIGINT)
        _, first_text = recorder.communicate(timeout=30)
    assert second.returncode == 2 and "Traceback" not in text
    assert f"{output}: another process records to this file" in text
    assert recorder.returncode == 0, first_text
    assert set(read_log(output).time_s.tolist()) <= set(direct_log(first))
    assert sorted(os.listdir(tmp_path)) == ["run.csv", "run.csv.json"]


def test_a_left_part_file_is_numbered_and_an_empty_one_is_deleted(tmp_path: Path) -> None:
    output = tmp_path / "run.csv"
    for number, content in enumerate(("first", "second"), 1):
        part_of(output).write_text(content)
        part = PartFile(output)
        assert part.recovered == tmp_path / f"run.recovered-{number}.csv"
        assert part.recovered.read_text() == content
        part.release()
        part.path.unlink()
    part_of(output).touch()
    assert PartFile(output).recovered is None


def on_terminal(command: list[str]) -> tuple[subprocess.Popen, int]:
    """A process with a terminal of its own, as its session's leader, and the terminal's master."""
    master, slave = os.openpty()

    def take_terminal() -> None:
        fcntl.ioctl(0, termios.TIOCSCTTY, 0)

    process = subprocess.Popen(
        command,
        stdin=slave,
        stdout=slave,
        stderr=slave,
        start_new_session=True,
        preexec_fn=take_terminal,
    )
    os.close(slave)
    return process, master


def test_a_terminal_that_is_closed_keeps_the_recording(tmp_path: Path) -> None:
    output = tmp_path / "run.csv"
    with PtyBoard() as pty:
        command = [sys.executable, "-m", "vgroove", "record", pty.port, "-o", str(output)]
        recorder, terminal = on_terminal(command)
        wait_for_part(output, 20_000)
        os.close(terminal)
        assert recorder.wait(30) == 0
    assert len(read_log(output)) > 200
    assert '"ended": "interrupted"' in (tmp_path / "run.csv.json").read_text()
    assert sorted(os.listdir(tmp_path)) == ["run.csv", "run.csv.json"]


def test_a_lost_port_is_an_error_without_a_limit_of_time_too(tmp_path: Path) -> None:
    output = tmp_path / "run.csv"
    with PtyBoard() as pty:
        recorder = start(pty.port, output)
        wait_for_part(output, 20_000)
        pty.close()
        _, text = recorder.communicate(timeout=30)
    assert recorder.returncode == 2, text
    assert re.search(rf"port lost after [\d.]+ s; \d+ rows until then are in {output}", text)
    assert len(read_log(output)) > 100


@pytest.mark.parametrize(
    ("number", "ending"),
    [(signal.SIGTERM, ".csv"), (signal.SIGHUP, ".mf4"), (signal.SIGKILL, ".asc")],
)
def test_a_run_that_is_ended_keeps_its_log(
    tmp_path: Path, number: signal.Signals, ending: str
) -> None:
    output, part = tmp_path / f"cut{ending}", growing(tmp_path / f"cut{ending}")
    process, port = start_on_pty(
        "sil", short_scenario(tmp_path, 600.0), "-o", str(output), "--real-time"
    )
    reader = os.open(port, os.O_RDONLY | os.O_NOCTTY)
    deadline = time.monotonic() + 60
    while not (part.exists() and part.stat().st_size > 40_000) and time.monotonic() < deadline:
        os.read(reader, 4096)
    process.send_signal(number)
    os.close(reader)
    _, text = process.communicate(timeout=60)
    if number == signal.SIGKILL:
        assert len(read_log(part)) > 200
        return
    assert process.returncode == 128 + number and "Traceback" not in text
    rows = len(read_log(output))
    assert rows > 200 and f"interrupted: {rows} rows in {output}" in text
    assert {path.name for path in tmp_path.iterdir()} == {"short.toml", output.name}
