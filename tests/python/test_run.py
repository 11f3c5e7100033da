"""`vgroove run`: determinism, the pty read by python-can's logger and viewer and by `vgroove
record`, Ctrl-C, unusable options, the lock-step interface.
"""

import errno
import fcntl
import os
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

from vgroove import lockstep, recording_files, telemetry
from vgroove.board import BoardInputs, BoardOutputs, default_elf
from vgroove.cli import app
from vgroove.errors import VgrooveError
from vgroove.log import read_log
from vgroove.pty_line import PtyLine
from vgroove.rig import read_rig
from vgroove.run import RunLog
from vgroove.scenario import make_plant, without_board_effects
from vgroove.sil import SilBoard
from warm_cli import warm_vgroove

ROOT = Path(__file__).resolve().parents[2]
SCENARIO = ROOT / "scenarios" / "spin_up.toml"
SHOWN = (b"0x100", b"0x101", b"0x102")  # FAST, STATE, BOOT
VGROOVE = [sys.executable, "-m", "vgroove.cli"]


def elf() -> Path:
    """Path of the Uno's ELF that `make build` makes."""
    path = Path(os.environ.get("VGROOVE_UNO_ELF", default_elf()))
    assert path.is_file(), f"there is no {path}: run `make build`"
    return path


def board_options(on: str) -> list[str]:
    return ["--on", on, *(["--elf", str(elf())] if on == "avr" else [])]


def short_scenario(folder: Path, duration_s: float) -> Path:
    """The scenario spin_up with another duration."""
    text = (
        SCENARIO.read_text()
        .replace("duration_s = 3.0", f"duration_s = {duration_s}")
        .replace("../rigs", str(ROOT / "rigs"))
    )
    path = folder / "short.toml"
    path.write_text(text)
    return path


def vgroove(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*VGROOVE, *map(str, arguments)], capture_output=True, text=True, timeout=120, check=False
    )


@pytest.mark.parametrize("on", ["sil", "avr"])
def test_a_run_is_deterministic_and_the_seed_matters(on: str, tmp_path: Path) -> None:
    scenario = short_scenario(tmp_path, 1.0)
    logs = []
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        path = tmp_path / f"{name}.csv"
        done = vgroove("run", scenario, *board_options(on), "-o", path, "--seed", seed)
        assert done.returncode == 0, done.stderr
        logs.append(path.read_bytes())
    assert logs[0] == logs[1] != logs[2]
    log = read_log(tmp_path / "a.csv")
    assert len(log) >= 998
    assert log["speed_rpm"][-50:].mean() > 14000
    assert log["duty"].max() == 1.0


@pytest.mark.parametrize("ending", ["mf4", "blf", "asc"])
def test_other_endings_hold_the_same_rows(ending: str, tmp_path: Path) -> None:
    scenario = short_scenario(tmp_path, 0.6)
    for suffix in ("csv", ending):
        assert warm_vgroove("run", scenario, "-o", tmp_path / f"log.{suffix}").returncode == 0
    csv, other = read_log(tmp_path / "log.csv"), read_log(tmp_path / f"log.{ending}")
    assert len(csv) == len(other)
    assert (csv["current_a"] == other["current_a"]).all() and (
        csv["speed_rpm"] == other["speed_rpm"]
    ).all()


def start_on_pty(on: str, scenario: Path, *options: str) -> tuple[subprocess.Popen[str], str]:
    """A run that waits for a reader of its pty, and the pty's name."""
    command = [*VGROOVE, "run", str(scenario), *board_options(on), "--pty", *options]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    return process, process.stdout.readline().strip()


@pytest.mark.parametrize("on", ["sil", "avr"])
def test_python_can_logger_reads_the_pty_unchanged(on: str, tmp_path: Path) -> None:
    process, port = start_on_pty(on, short_scenario(tmp_path, 1.0))
    output = tmp_path / "can.csv"
    command = [
        sys.executable,
        "-m",
        "can.logger",
        "-i",
        "serial",
        "-c",
        port,
        "--bus-kwargs",
        "baudrate=250000",
        "-f",
        str(output),
    ]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as logger:
        process.wait(60)
        logger.send_signal(signal.SIGINT)
        logger.wait(90)
    rows = output.read_text().splitlines()[1:]
    fast = [row for row in rows if row.split(",")[1] == "0x100"]
    assert len(fast) >= 998
    counters = {row.split(",")[1] for row in rows}
    assert {"0x100", "0x101", "0x102"} <= counters


def test_python_can_viewer_shows_the_pty_unchanged(tmp_path: Path) -> None:
    process, port = start_on_pty("sil", short_scenario(tmp_path, 3.0), "--real-time")
    terminal, slave = os.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 120, 0, 0))
    command = [
        sys.executable,
        "-m",
        "can.viewer",
        "-i",
        "serial",
        "-c",
        port,
        "--bus-kwargs",
        "baudrate=250000",
    ]
    shown = bytearray()
    with subprocess.Popen(
        command, stdin=slave, stdout=slave, stderr=slave, env={**os.environ, "TERM": "xterm"}
    ) as viewer:
        os.close(slave)
        end = time.monotonic() + 60
        while not all(name in shown for name in SHOWN) and time.monotonic() < end:
            shown += os.read(terminal, 4096) if select.select([terminal], [], [], 0.2)[0] else b""
        os.write(terminal, b"q")
        process.wait(60)
        viewer.kill()
    os.close(terminal)
    assert [name for name in SHOWN if name not in shown] == [], bytes(shown[-500:])


def test_recorder_on_the_pty_gives_the_log_of_the_run(tmp_path: Path) -> None:
    scenario = short_scenario(tmp_path, 1.0)
    direct, recorded = tmp_path / "direct.csv", tmp_path / "recorded.csv"
    process, port = start_on_pty("avr", scenario, "-o", str(direct))
    done = vgroove("record", port, "-o", recorded, "--seconds", 0.9)
    assert done.returncode == 0, done.stderr
    process.wait(60)
    a, b = read_log(direct), read_log(recorded)
    rows = min(len(a), len(b))
    assert rows >= 890
    assert (a["current_a"][:rows] == b["current_a"][:rows]).all() and (
        a["time_s"][:rows] == b["time_s"][:rows]
    ).all()


def test_a_slow_reader_loses_nothing() -> None:
    with PtyLine() as line:
        reader = os.open(line.name, os.O_RDONLY | os.O_NOCTTY)
        sent, got = bytes(range(256)) * 256, bytearray()
        pid = os.fork()
        if pid == 0:
            line.send(sent)
            os._exit(0)
        while len(got) < len(sent):
            time.sleep(0.001)
            got += os.read(reader, 1000)
        os.waitpid(pid, 0)
        os.close(reader)
    assert bytes(got) == sent


def test_commands_that_the_board_has_not_answered_are_named(tmp_path: Path) -> None:
    head = (ROOT / "scenarios/spin_up.toml").read_text().replace("../rigs", str(ROOT / "rigs"))
    reads = "".join(
        f'[[command]]\ntime_s = 0.3\nframe = "PARAM_READ"\nread_index = {k}\n' for k in range(9)
    )
    several, one = tmp_path / "several.toml", tmp_path / "one.toml"
    several.write_text(f"{head}\n{reads}")
    one.write_text(f"{head}\n{reads[: reads.index('[[', 1)]}")
    done = warm_vgroove("run", several)
    assert done.returncode == 0
    assert "has not answered PARAM_READ at 0.3 s" in done.stderr and "and 1 more" in done.stderr
    assert "not answered" not in warm_vgroove("run", one).stderr


def test_a_reader_gets_whole_frames_only() -> None:
    frame = telemetry.frame_bytes(telemetry.frame_of(5, telemetry.FAST, bytes(7)))
    with PtyLine() as line:
        reader = os.open(line.name, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
        got = []
        for part in (b"\x01" + frame[:7], frame[7:] + frame[:18], frame[18:]):
            line.send(part)
            time.sleep(0.05)
            got.append(os.read(reader, 100))
        os.close(reader)
    assert got == [b"\x01", frame, frame]


def test_without_a_reader_bytes_are_dropped_and_nothing_blocks() -> None:
    with PtyLine() as line:
        assert not line.has_reader()
        assert not line.wait_for_reader(0.05)
        line.send(bytes(100_000))
        assert line.dropped == 100_000
        reader = os.open(line.name, os.O_RDWR | os.O_NOCTTY)
        assert line.has_reader()
        os.write(reader, b"\x03\x04\r\n\x11")  # the terminal is raw: no byte is a control character
        time.sleep(0.05)
        assert line.receive() == b"\x03\x04\r\n\x11"
        os.close(reader)


def test_ctrl_c_leaves_a_valid_log_and_exits_130(tmp_path: Path) -> None:
    output = tmp_path / "cut.csv"
    process, port = start_on_pty(
        "sil", short_scenario(tmp_path, 600.0), "-o", str(output), "--real-time"
    )
    reader, seen = os.open(port, os.O_RDONLY | os.O_NOCTTY), 0
    while seen < 20_000:
        seen += len(os.read(reader, 4096))
    process.send_signal(signal.SIGINT)
    os.close(reader)
    assert process.wait(90) == 130
    assert len(read_log(output)) > 100
    assert {path.name for path in tmp_path.iterdir()} == {"short.toml", "cut.csv"}


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--on", "real"], "--on is sil or avr"),
        (["--on", "avr", "--elf", "none.elf"], "no firmware at none.elf"),
        (["--on", "avr", "--target", "nano"], "--target is uno or mega"),
        (["-o", "log.txt"], "ends in .csv, .mf4, .blf or .asc"),
        (["-o", "no/such/folder/log.csv"], "cannot be written"),
    ],
)
def test_unusable_options_are_errors_with_a_message(
    arguments: list[str], sentence: str, tmp_path: Path
) -> None:
    done = warm_vgroove("run", short_scenario(tmp_path, 0.1), *arguments)
    assert done.returncode == 2
    assert sentence in done.stderr
    assert "Traceback" not in done.stderr


class RecordingBoard:
    """A board that records its inputs and always outputs the same drive."""

    def __init__(self) -> None:
        self.inputs: list[BoardInputs] = []

    def period(self, inputs: BoardInputs) -> BoardOutputs:
        self.inputs.append(inputs)
        return BoardOutputs(False, -51, 2, b"\x55" if len(self.inputs) == 3 else b"")


class RecordingTool:
    """A tool that records its commands and always returns the same measurements."""

    def __init__(self) -> None:
        self.commands: list[tuple[bool, float, float, float]] = []

    def period(
        self, coast: bool, duty: float, dead: float, load_nm: float
    ) -> tuple[float, float, list[int]]:
        self.commands.append((coast, duty, dead, load_nm))
        return 10.0, 18.0, [7]


def test_loop_joins_board_and_tool_by_the_interface() -> None:
    board, tool = RecordingBoard(), RecordingTool()
    sent = lockstep.run(board, tool, lockstep.Profile(load_nm=((0, 0.5),)), 0.01)
    assert sent == b"\x55"
    # before the board's first output the gates are open
    assert tool.commands[0] == (True, 0.0, 0.0, 0.5)
    assert tool.commands[1] == (False, -51 / 255, 1 / 255, 0.5)
    assert board.inputs[0].adc_counts[:2] == (512 + 80, 720)
    assert list(board.inputs[0].edges) == [7]


def test_broken_hall_line_hides_edges() -> None:
    board = RecordingBoard()
    lockstep.run(board, RecordingTool(), lockstep.Profile(hall_breaks=((0.002, 0.004),)), 0.01)
    hidden = [k * 510 / 16e6 for k, inputs in enumerate(board.inputs, 1) if not inputs.edges]
    assert len(hidden) == pytest.approx(0.002 * 16e6 / 510, abs=1)
    assert min(hidden) >= 0.002 and max(hidden) < 0.004


def test_an_eeprom_image_survives_the_native_run(tmp_path: Path) -> None:
    scenario, image = short_scenario(tmp_path, 1.0), tmp_path / "eeprom.bin"
    assert warm_vgroove("run", scenario, "--eeprom", image).returncode == 0
    assert image.read_bytes() == b"\xff" * 1024, "a run without a write leaves it erased"
    text = (
        scenario.read_text()
        + '[[command]]\ntime_s = 0.3\nframe = "PARAM_WRITE"\nwrite_index = 13\nwrite_value = 98\n'
    )
    scenario.write_text(
        text.replace("[0.3, 0.0], [0.5, 1.0], [2.0, 1.0], [2.1, 0.0]", "[2.1, 0.0]")
    )
    assert warm_vgroove("run", scenario, "--eeprom", image).returncode == 0
    assert image.read_bytes() != b"\xff" * 1024
    image.write_bytes(b"\xff" * 5)
    refused = warm_vgroove("run", scenario, "--eeprom", image)
    assert refused.returncode == 2 and "1024 bytes, not 5" in refused.stderr


def board_bytes() -> bytes:
    """What the native firmware sends in a short run."""
    with SilBoard() as board:
        tool = make_plant(without_board_effects(read_rig(ROOT / "rigs" / "board_18v.toml")), 1)
        return lockstep.run(board, tool, lockstep.Profile(), 0.4)


@pytest.mark.parametrize("ending", [".csv", ".mf4"])
def test_a_log_that_cannot_be_completed_keeps_its_rows(
    ending: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = RunLog(tmp_path / f"run{ending}")
    log.add(board_bytes())
    if ending == ".mf4":
        monkeypatch.setattr(recording_files, "convert_csv_to_mf4", fails_for_memory)
    else:
        monkeypatch.setattr(recording_files.CsvFile, "finish", fails_for_space)
    kept = tmp_path / ("run.mf4.csv" if ending == ".mf4" else "run.csv")
    with pytest.raises(VgrooveError, match=rf"rows are in {re.escape(str(kept))}"):
        log.close()
    assert len(read_log(kept)) > 100
    assert not [path for path in tmp_path.iterdir() if "part" in path.name]


def fails_for_memory(*_: object) -> None:
    raise MemoryError


def fails_for_space(*_: object) -> None:
    raise OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--fault", "hall_open@5"], "--fault hall_open at 5 s is after the end of the run"),
        (["--fault", ""], "there is no fault ; the nearest known one is"),
        (["--seed", str(2**64)], "Invalid value for '--seed'"),
    ],
)
def test_what_a_run_would_ignore_is_refused(
    options: list[str], sentence: str, tmp_path: Path
) -> None:
    found = CliRunner().invoke(app, ["run", str(short_scenario(tmp_path, 0.2)), *options])
    assert found.exit_code != 0
    assert sentence in " ".join(f"{found.output} {found.exception}".replace("│", " ").split())
