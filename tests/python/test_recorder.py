"""`vgroove record` as a process on a pty: the firmware's own telemetry in real time, damage,
Ctrl-C, a full disk, a lost port.
"""

import errno
import io
import json
import os
import random
import resource
import select
import signal
import subprocess
import sys
import time
import tty
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path

import can
import numpy as np
import pytest

from telemetry_board import EEPROM_BYTES, Board, PtyBoard, eeprom_set, moving, wait_until
from test_telemetry import damaged
from vgroove import serial_bus, telemetry
from vgroove.errors import VgrooveError
from vgroove.log import log_from_stream, read_log
from vgroove.recorder import Recording, record
from vgroove.recording_files import AscFile, BlfFile, CsvFile, Mf4File
from vgroove.serial_bus import ResyncBus, command_message

ENDINGS = [".csv", ".mf4", ".blf", ".asc"]
HEADER = ",".join(("time_s", *telemetry.COLUMNS))


def start(port: str, output: Path, *options: str, limit: int | None = None) -> subprocess.Popen:
    """Start `vgroove record`; a file larger than `limit` bytes fails as on a full disk."""

    def before() -> None:
        if limit is not None:
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    command = [sys.executable, "-m", "vgroove.cli", "record", port, "-o", str(output), *options]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=before
    )


def wait_for_part(output: Path, size: int) -> None:
    """Wait until the recorder has written `size` bytes."""
    grows = output.with_name(output.name + ".csv") if output.suffix == ".mf4" else output
    part = grows.with_name(f".{grows.stem}.part{grows.suffix}")
    wait_until(
        lambda: part.exists() and part.stat().st_size >= size, f"{part} reaches {size} bytes"
    )


def direct_log(pty: PtyBoard) -> dict[float, tuple]:
    """The rows that the board sent, by time."""
    log = log_from_stream(b"".join(pty.sent), "sent")
    return {
        t: tuple(row)
        for t, row in zip(
            log.time_s.tolist(), np.column_stack(list(log.columns.values())).tolist(), strict=True
        )
    }


# STATE and CONTROL frames arrive after the rows for which their values hold; those of the last rows
# may arrive after the end of a recording.
LATE_ROWS = 60


def same_rows(path: Path, pty: PtyBoard, states_may_lack: bool = False) -> int:
    """Assert that every recorded row was sent with these values; returns the number of rows."""
    log, sent = read_log(path), direct_log(pty)
    got = np.column_stack([log[name] for name in telemetry.COLUMNS])
    expected = np.array([sent[time_s] for time_s in log.time_s.tolist()])
    assert np.allclose(got[:, :5], expected[:, :5], rtol=1e-9, atol=1e-12)
    # while the first STATE frame is delayed, changes of the trigger are not in the first rows
    if not states_may_lack:
        complete = slice(20, -LATE_ROWS)
        assert np.allclose(got[complete, 5:], expected[complete, 5:], rtol=1e-9), np.flatnonzero(
            (got[complete, 5:] != expected[complete, 5:]).any(axis=1)
        )
    return len(log)


@pytest.mark.parametrize("ending", ENDINGS)
def test_records_what_the_board_sent(tmp_path: Path, ending: str) -> None:
    output = tmp_path / f"run{ending}"
    with PtyBoard() as pty:
        process = start(pty.port, output, "--seconds", "1.5")
        _, text = process.communicate(timeout=60)
    assert process.returncode == 0, text
    rows = same_rows(output, pty)
    assert rows >= 1500 and "lost 0, corrupt 0, skipped bytes 0" in text and "abcdef" in text
    side = json.loads((tmp_path / f"run{ending}.json").read_text())
    assert (
        side["boot"]["build_hash"] == 0xABCDEF
        and side["ended"] == "time over"
        and side["rows"] == rows
    )
    assert side["parameters"]["complete"] and side["parameters"]["value"]["trip_a_q9"] == 50.0
    assert side["counters"]["lost"] == 0 and sorted(os.listdir(tmp_path)) == [
        f"run{ending}",
        f"run{ending}.json",
    ]


def test_a_csv_has_the_columns_of_the_signal_list(tmp_path: Path) -> None:
    output = tmp_path / "run.csv"
    with PtyBoard() as pty:
        start(pty.port, output, "--seconds", "0.5").communicate(timeout=60)
    lines = output.read_text().splitlines()
    assert lines[0] == HEADER and len(lines[1].split(",")) == 14
    log = read_log(output)
    assert set(np.unique(log["coast"])) <= {0.0, 1.0} and np.abs(log["duty"]).max() <= 1.0
    assert (log["duty"][log["coast"] == 1] == 0).all() and (log["coast"] == 1).sum() > 0


@pytest.mark.parametrize(
    ("ending", "number"),
    [*((ending, signal.SIGINT) for ending in ENDINGS), (".csv", signal.SIGTERM)],
)
def test_ctrl_c_leaves_a_complete_file(tmp_path: Path, ending: str, number: signal.Signals) -> None:
    output = tmp_path / f"run{ending}"
    with PtyBoard() as pty:
        process = start(pty.port, output)
        wait_for_part(output, 0 if ending == ".blf" else 20_000)
        time.sleep(0.8)
        process.send_signal(number)
        _, text = process.communicate(timeout=30)
    assert process.returncode == 0, text
    assert same_rows(output, pty) > 300
    assert json.loads((tmp_path / f"run{ending}.json").read_text())["ended"] == "interrupted"


def test_ctrl_c_before_a_board_is_found_writes_nothing(tmp_path: Path) -> None:
    master, slave = os.openpty()
    process = start(os.ttyname(slave), tmp_path / "run.csv")
    assert select.select([master], [], [], 30.0)[0], "the recorder requests a BOOT frame"
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=30)
    os.close(master)
    os.close(slave)
    assert process.returncode == 130 and os.listdir(tmp_path) == []


def test_a_damaged_line_is_survived_and_counted(tmp_path: Path) -> None:
    output, rng = tmp_path / "run.csv", random.Random(5)
    with PtyBoard(damage=lambda data: damaged(data, rng, 5e-4)) as pty:
        process = start(pty.port, output, "--seconds", "2")
        _, text = process.communicate(timeout=60)
    assert process.returncode == 0, text
    rows = same_rows(output, pty, states_may_lack=True)
    counters = json.loads((tmp_path / "run.csv.json").read_text())["counters"]
    log = read_log(output)
    assert counters["lost"] > 0 and counters["skipped_bytes"] > 0
    assert (
        rows == counters["fast"]
        and rows + counters["lost"] == round((log.time_s[-1] - log.time_s[0]) * 1000) + 1
    )


def test_a_running_board_is_requested_to_send_its_boot_frame(tmp_path: Path) -> None:
    with PtyBoard() as pty:
        time.sleep(1.0)
        os.set_blocking(pty._slave, False)
        while True:
            try:
                os.read(pty._slave, 65536)
            except BlockingIOError:
                break
        os.set_blocking(pty._slave, True)
        process = start(pty.port, tmp_path / "run.csv", "--seconds", "0.5")
        _, text = process.communicate(timeout=60)
    assert process.returncode == 0, text
    side = json.loads((tmp_path / "run.csv.json").read_text())
    assert side["parameters"]["complete"] and read_log(tmp_path / "run.csv").time_s[0] > 1.0
    assert ("executed", 0) in pty.board.results


@pytest.mark.parametrize("ending", [".csv", ".blf", ".asc"])
def test_a_full_disk_is_an_error_and_recorded_rows_are_kept(tmp_path: Path, ending: str) -> None:
    output, limit = (
        tmp_path / f"run{ending}",
        {".csv": 60_000, ".blf": 30_000, ".asc": 120_000}[ending],
    )
    with PtyBoard() as pty:
        process = start(pty.port, output, limit=limit)
        _, text = process.communicate(timeout=60)
    assert process.returncode == 2, text
    assert "the disk is full" in text and f"run{ending}" in text and "Traceback" not in text
    assert same_rows(output, pty) > 100 and output.stat().st_size <= limit
    assert sorted(os.listdir(tmp_path)) == [f"run{ending}", f"run{ending}.json"]


def test_an_mf4_for_whose_rows_there_is_no_room_stays_as_csv(tmp_path: Path) -> None:
    with PtyBoard() as pty:
        process = start(pty.port, tmp_path / "run.mf4", limit=40_000)
        _, text = process.communicate(timeout=60)
    assert (
        process.returncode == 2
        and "the disk is full" in text
        and "rows until then are in" in text
        and "Traceback" not in text
    ), text
    assert same_rows(tmp_path / "run.mf4.csv", pty) > 200
    assert sorted(os.listdir(tmp_path)) == ["run.mf4.csv", "run.mf4.csv.json"]


@pytest.mark.parametrize(
    "error",
    [
        OSError(errno.ENOSPC, "No space left"),
        MemoryError("no memory"),
        ValueError("a bug of asammdf"),
    ],
)
def test_an_mf4_that_cannot_be_made_stays_as_csv(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    def failing(source: Path, target: Path) -> None:
        target.write_bytes(b"half")
        raise error

    monkeypatch.setattr("vgroove.recording_files.convert_csv_to_mf4", failing)
    with (
        PtyBoard() as pty,
        pytest.raises(
            VgrooveError,
            match=f"run.mf4: the MF4 file could not be made: {error.args[-1]}; .*run.mf4.csv",
        ),
    ):
        record(Recording(pty.port, tmp_path / "run.mf4", seconds=0.5), lambda: False)
    assert same_rows(tmp_path / "run.mf4.csv", pty) >= 500
    assert sorted(os.listdir(tmp_path)) == ["run.mf4.csv", "run.mf4.csv.json"]
    assert json.loads((tmp_path / "run.mf4.csv.json").read_text())["file"] == "run.mf4.csv"


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A separate disk with room for 108 kB; the test is skipped where mounting is not allowed."""
    folder = tmp_path / "disk"
    folder.mkdir()
    if subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=108k", "vgroove-test", folder],
        capture_output=True,
        check=False,
    ).returncode:
        pytest.skip("a small disk can only be mounted by root")
    yield folder
    subprocess.run(["umount", folder], check=True)


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_disk_that_is_really_full_keeps_what_was_recorded(small_disk: Path, ending: str) -> None:
    with PtyBoard() as pty:
        process = start(pty.port, small_disk / f"run{ending}")
        _, text = process.communicate(timeout=60)
    assert process.returncode == 2 and "Traceback" not in text, text
    kept = small_disk / ("run.mf4.csv" if ending == ".mf4" else f"run{ending}")
    assert (
        str(kept) in text.replace("\n", "")
        and "No space left" in text
        or "the disk is full" in text
    )
    assert same_rows(kept, pty) > 300 and {path.name for path in small_disk.iterdir()} <= {
        kept.name,
        f"{kept.name}.json",
    }


def test_a_disk_with_room_for_the_rows_but_not_for_the_mf4_of_them(small_disk: Path) -> None:
    with PtyBoard() as pty:
        process = start(pty.port, small_disk / "run.mf4", "--seconds", "1.2")
        _, text = process.communicate(timeout=60)
    assert (
        process.returncode == 2
        and "the MF4 file could not be made: No space left" in text
        and "Traceback" not in text
    ), text
    assert (
        same_rows(small_disk / "run.mf4.csv", pty) >= 1200 and not (small_disk / "run.mf4").exists()
    )


def test_a_long_mf4_is_converted_in_parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("vgroove.recording_files.MF4_ROWS", 7)
    file, rng = Mf4File(tmp_path / "run.mf4"), np.random.default_rng(1)
    rows = {name: np.round(rng.normal(0, 9, 100), 3) for name in telemetry.COLUMNS} | {
        "time_s": 1.7e9 + np.arange(100) / 1000
    }
    for first in (0, 40):
        file.add_rows(
            {name: values[first : first + 40 + first // 2] for name, values in rows.items()}
        )
    file.finish()
    file.publish()
    log = read_log(tmp_path / "run.mf4")
    assert os.listdir(tmp_path) == ["run.mf4"] and np.array_equal(log.time_s, rows["time_s"])
    assert all(np.array_equal(log[name], rows[name]) for name in telemetry.COLUMNS)


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (OSError(errno.EIO, "Input/output error"), "Input/output error; "),
        (MemoryError(), "MemoryError; "),
        (KeyboardInterrupt(), ""),
    ],
)
def test_recorded_rows_are_kept_whatever_ends_the_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException, words: str
) -> None:
    add_rows = CsvFile.add_rows

    def failing(self: CsvFile, columns: dict[str, np.ndarray]) -> None:
        if self.rows > 300:
            raise error
        add_rows(self, columns)

    monkeypatch.setattr(CsvFile, "add_rows", failing)
    with PtyBoard() as pty:
        recording = Recording(pty.port, tmp_path / "run.csv")
        with pytest.raises(VgrooveError, match=words) if words else nullcontext():
            record(recording, lambda: False)
        assert same_rows(tmp_path / "run.csv", pty) == recording.rows > 300
    assert sorted(os.listdir(tmp_path)) == ["run.csv", "run.csv.json"]


def test_a_name_that_becomes_a_folder_meanwhile_leaves_the_part_file(tmp_path: Path) -> None:
    with PtyBoard() as pty:
        process = start(pty.port, tmp_path / "run.csv", "--seconds", "1")
        wait_for_part(tmp_path / "run.csv", 20_000)
        (tmp_path / "run.csv").mkdir()
        _, text = process.communicate(timeout=60)
        assert (
            process.returncode == 2
            and "what was recorded is in" in text
            and ".run.part.csv" in text
        )
        assert same_rows(tmp_path / ".run.part.csv", pty) >= 1000


def test_a_lost_port_is_an_error_and_the_file_is_complete(tmp_path: Path) -> None:
    output = tmp_path / "run.csv"
    with PtyBoard() as pty:
        process = start(pty.port, output, "--seconds", "60")
        wait_for_part(output, 40_000)
        pty.close()
        _, text = process.communicate(timeout=30)
        assert (
            process.returncode == 2
            and "port lost after" in text
            and "rows until then are in" in text
        )
        assert same_rows(output, pty) > 300


@pytest.mark.parametrize("noise", [b"", bytes(range(256))])
def test_a_port_without_a_board_is_an_error(tmp_path: Path, noise: bytes) -> None:
    master, slave = os.openpty()
    tty.setraw(slave)
    process = start(os.ttyname(slave), tmp_path / "run.csv", "--baud", "115200")
    while process.poll() is None:
        os.write(master, noise)
        time.sleep(0.1)
    _, text = process.communicate(timeout=30)
    os.close(master)
    os.close(slave)
    assert (
        process.returncode == 2
        and "no boot frame within 5 s at 115200 Bd" in text
        and os.listdir(tmp_path) == []
    )


def test_a_board_of_another_protocol_is_an_error(tmp_path: Path) -> None:
    master, slave = os.openpty()
    boot = telemetry.frame_of_signals(
        "BOOT", 5, protocol_version=9, duty_full_scale=255, fast_divider=1
    )
    process = start(os.ttyname(slave), tmp_path / "run.csv")
    while process.poll() is None:  # opening the port discards bytes received before
        os.write(master, telemetry.frame_bytes(boot))
        time.sleep(0.1)
    _, text = process.communicate(timeout=30)
    os.close(master)
    os.close(slave)
    assert (
        process.returncode == 2
        and "telemetry protocol 9, this vgroove decodes 2" in text
        and os.listdir(tmp_path) == []
    )


@pytest.mark.parametrize("port", ["/dev/ttyNoSuchPort", "COM99"])
def test_a_missing_port_is_an_error(tmp_path: Path, port: str) -> None:
    process = start(port, tmp_path / "run.csv")
    _, text = process.communicate(timeout=30)
    assert (
        process.returncode == 2
        and f"{port}: the port cannot be opened" in text
        and "Traceback" not in text
    )


def test_an_unknown_ending_or_an_unwritable_folder_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(VgrooveError, match="ends in .csv, .mf4, .blf or .asc"):
        record(Recording("none", tmp_path / "run.txt"), lambda: True)
    with (
        PtyBoard() as pty,
        pytest.raises(VgrooveError, match="run.csv: cannot be written: the folder"),
    ):
        record(Recording(pty.port, tmp_path / "none" / "run.csv"), lambda: False)


def test_a_board_that_restarts_ends_the_recording_with_a_complete_file(tmp_path: Path) -> None:
    output = tmp_path / "run.csv"
    with PtyBoard() as pty:
        process = start(pty.port, output)
        wait_for_part(output, 40_000)
        before = pty.board
        pty.board = Board()
        _, text = process.communicate(timeout=30)
    assert process.returncode == 0 and "ended: board restarted" in text and before is not pty.board
    log = read_log(output)
    assert (np.diff(log.time_s) > 0).all() and len(log) > 300


def test_a_disk_that_takes_part_of_a_block_keeps_whole_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = CsvFile(tmp_path / "run.csv")
    rows = {name: np.zeros(10) for name in ("time_s", *telemetry.COLUMNS)}
    file.add_rows(rows)
    whole = file.part.stat().st_size

    def full(data: object) -> int:
        io.FileIO.write(file._file, bytes(data)[:5])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(file._file, "write", full)
    with pytest.raises(OSError, match="No space"):
        file.add_rows(rows)
    assert file.part.stat().st_size > whole
    file.salvage()
    assert file.part.stat().st_size == whole and file.rows == 10


def test_python_cans_bus_survives_damage(tmp_path: Path) -> None:
    """recv delivers every intact frame, as a can.Notifier or a viewer would call it, where
    python-can's own bus raises.
    """
    eeprom_set(b"\xff" * EEPROM_BYTES)
    board = Board()
    clean = board.run(100, moving(board))
    broken = clean[:100] + b"\xaa\x01" + clean[100:700] + clean[705:]
    master, slave = os.openpty()
    bus = ResyncBus(os.ttyname(slave))
    os.write(master, broken)
    messages = []
    while (message := bus.recv(0.2)) is not None:
        messages.append(message)
    bus.send(command_message("DUMP", 1, 1234))
    sent = os.read(master, 100)
    bus.shutdown()
    os.close(master)
    os.close(slave)
    intact = telemetry.Framer().feed(broken)
    assert [telemetry.frame_from_message(m) for m in messages] == intact and len(intact) > 90
    assert bus.framer.counters.skipped_bytes == len(broken) - 19 * len(intact)
    assert len(sent) == 19 and sent[17] == telemetry.frame_crc(1234, 515, sent[10:17])


def test_a_bus_reads_as_soon_as_it_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    """However long the reading process takes to start."""
    monkeypatch.setattr(serial_bus, "PUMP", "import time; time.sleep(0.7)\n" + serial_bus.PUMP)
    eeprom_set()
    board = Board()
    sent = board.run(20, moving(board))
    master, slave = os.openpty()
    bus = ResyncBus(os.ttyname(slave))
    os.write(master, sent)
    first = bus.recv(0.3)
    bus.shutdown()
    os.close(master)
    os.close(slave)
    assert telemetry.frame_from_message(first) == telemetry.Framer().feed(sent)[0]


def test_a_reading_process_that_ends_at_its_start_is_an_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(serial_bus, "PUMP", "raise SystemExit(1)")
    master, slave = os.openpty()
    with pytest.raises(can.CanInitializationError, match="ended at its start"):
        ResyncBus(os.ttyname(slave))
    os.close(master)
    os.close(slave)


def test_raw_recording_keeps_the_time_that_the_crc_covers(tmp_path: Path) -> None:
    eeprom_set()
    board = Board(now_ms=2**31)
    frames = telemetry.Framer().feed(board.run(300, moving(board)))
    for ending, kind in ((".blf", BlfFile), (".asc", AscFile)):
        file = kind(tmp_path / f"run{ending}")
        for frame in frames:
            file.add_frame(frame)
        file.finish()
        file.publish()
        log = read_log(tmp_path / f"run{ending}")
        assert log.time_s[0] == (2**31 + 1) / 1000 and len(log) == 300 and log.warnings == []


@pytest.mark.parametrize(
    "name", ["SET_MODE", "PARAM_READ", "PARAM_WRITE", "DUMP", "CALIBRATE", "SETPOINT", "PROFILE"]
)
def test_commands_leave_with_the_time_that_their_crc_covers(name: str) -> None:
    for time_ms in (0, 1, 1001, 999_999, 86_400_000, 2**32 - 1):
        message = command_message(name, 5, time_ms)
        assert int(message.timestamp * 1000) == time_ms
        assert (
            message.data[7]
            == telemetry.frame_crc(time_ms, message.arbitration_id, bytes(message.data))
            and message.data[6] == 5
        )
