"""`vgroove run --on PORT` as a process on a pty, whose other end is the ELF on the simulated
ATmega, or the native firmware where the target does not matter.
"""

import json
import os
import re
import signal
import subprocess
import sys
import tty
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from can.io import BLFReader
from typer.testing import CliRunner

from telemetry_board import ROOT
from test_recorder import wait_for_part
from test_run import VGROOVE
from vgroove import telemetry
from vgroove.board_checks import BoardChecks
from vgroove.cli import app
from vgroove.errors import VgrooveError
from vgroove.gap.next_run.menu import profile_named
from vgroove.log import Log, read_log, write_csv
from vgroove.rig import read_rig

LIMIT_S = 120
STAGED_ROWS = 2  # between the state from which a command follows and the row in which it acts
# The trigger and the state are sent when they change, in different frames of which one fits between
# two rows: one of the two columns may show the release so many rows later.
SLOW_FRAME_ROWS = 2


def start_run(port: str, output: Path, *options: str) -> subprocess.Popen:
    """`vgroove run --on PORT`."""
    command = [
        *VGROOVE,
        "run",
        "--on",
        port,
        "-o",
        str(output),
        *(options or ("--experiment", "hold at heat")),
    ]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


def wait_for(process: subprocess.Popen, words: str) -> None:
    """Wait for a line of the run's stderr that contains `words`."""
    for line in process.stderr:
        if words in line:
            return
    raise AssertionError(f"the run ended with {process.wait()} without the line: {words}")


def wait_for_the_drive(folder: Path) -> None:
    """Wait until the run's log has 60 kB, which it reaches while the bridge drives."""
    wait_for_part(folder / "log.csv", 60_000)


def start_both(
    on: str,
    folder: Path,
    run_s: float,
    *options: str,
    held_s: float = 60.0,
    travel: float = 1.0,
    log: str = "log.csv",
) -> tuple[subprocess.Popen, subprocess.Popen]:
    """Start a board with operator on a pty, which writes the board's own log to direct.blf, and the
    host that performs a run on it and records to `log`.
    """
    arguments = [
        str(Path(__file__).with_name("board_with_operator.py")),
        on,
        str(folder / "direct.blf"),
        *map(str, (run_s, held_s, travel)),
    ]
    board = subprocess.Popen([sys.executable, *arguments], stdout=subprocess.PIPE, text=True)
    return board, start_run(board.stdout.readline().strip(), folder / log, *options)


def error_message(*arguments: str) -> str:
    """The message of the error that `vgroove run` raises for unusable options."""
    with pytest.raises(VgrooveError) as raised:
        CliRunner().invoke(app, ["run", *arguments], catch_exceptions=False)
    return str(raised.value)


def last_answer_s(path: Path) -> float:
    """Time at which the board answered its last command, some ms after its execution."""
    with BLFReader(path) as reader:
        return max(
            message.timestamp for message in reader if message.arbitration_id == telemetry.ACK
        )


def opens_after(path: Path) -> tuple[float, Log]:
    """Time for which the bridge drove after the last answer, and the board's own log; asserts that
    the bridge is open afterwards.
    """
    log = read_log(path)
    drives = (log["coast"] == 0.0) & (log["duty"] != 0.0)
    last = int(np.flatnonzero(drives)[-1])
    assert log["coast"][last + 1 :].all() and len(log) > last + 500
    return float(log.time_s[last]) - last_answer_s(path), log


def test_the_elf_performs_the_run_of_a_verdict_and_the_log_is_the_boards_own(
    tmp_path: Path,
) -> None:
    course = profile_named("staircase")
    asked = {
        "verdict": "ambiguous",
        "next_experiment": {"profile": course.name, "why": "test", "points": course.points()},
    }
    (tmp_path / "v.json").write_text(json.dumps(asked))
    options = ["--next", str(tmp_path / "v.json"), "--rig", str(ROOT / "rigs/board_18v.toml")]
    board, host = start_both("avr", tmp_path, 6.5, *options)
    _, stderr = host.communicate(timeout=LIMIT_S)
    assert host.returncode == 0, stderr
    assert (
        board.wait(LIMIT_S) == 0
        and "pull the trigger fully" in stderr
        and "ended: run complete" in stderr
    )
    log, direct = read_log(tmp_path / "log.csv"), read_log(tmp_path / "direct.blf")
    rows = np.searchsorted(direct.time_s, log.time_s)
    assert np.array_equal(direct.time_s[rows], log.time_s) and len(log) == pytest.approx(
        4500, abs=60
    )
    assert all(
        np.allclose(direct[name][rows], log[name])
        for name in ("duty", "coast", "current_a", "speed_rpm", "supply_v")
    )
    for start, level in course.points()[1:]:
        at = int(np.searchsorted(log.time_s, log.time_s[0] + start + 0.4))
        assert log["duty"][at] == pytest.approx(level, abs=0.005)
    side = json.loads((tmp_path / "log.csv.json").read_text())
    assert (
        side["counters"]["lost"] == 0
        and side["ended"] == "run complete"
        and side["parameters"]["complete"]
    )


def test_a_killed_host_leaves_the_bridge_open_within_50_ms(tmp_path: Path) -> None:
    board, host = start_both("avr", tmp_path, 5.5)
    wait_for_the_drive(tmp_path)
    host.send_signal(signal.SIGKILL)
    host.wait(LIMIT_S)
    assert board.wait(LIMIT_S) == 0
    after_s, log = opens_after(tmp_path / "direct.blf")
    assert 0.03 < after_s <= 0.051 and log["duty"].max() > 0.1 and log["trigger"][-1] == 1.0, (
        "the trigger was held all the time"
    )


def test_ctrl_c_keeps_the_log_and_stops_the_motor(tmp_path: Path) -> None:
    board, host = start_both("sil", tmp_path, 5.5)
    wait_for_the_drive(tmp_path)
    host.send_signal(signal.SIGINT)
    _, stderr = host.communicate(timeout=LIMIT_S)
    assert host.returncode == 130 and "ended: interrupted" in stderr and "Traceback" not in stderr
    assert board.wait(LIMIT_S) == 0 and opens_after(tmp_path / "direct.blf")[0] <= 0.051
    assert len(read_log(tmp_path / "log.csv")) > 500


def test_the_elf_drives_no_more_than_the_trigger_and_not_without_it(tmp_path: Path) -> None:
    board, host = start_both("avr", tmp_path, 3.5, held_s=2.0, travel=0.6, log="log.blf")
    _, stderr = host.communicate(timeout=LIMIT_S)
    assert (
        host.returncode == 2
        and "rows until then are in" in stderr
        and "the trigger limited the run: at one time it allowed a duty of only 6" in stderr
    )
    assert re.search(r"the trigger was released, [01]\.\d s into the run of 4\.0 s", stderr), stderr
    log = read_log(tmp_path / "log.blf")
    assert len(log) > 700 and 0.5 < log["duty"].max() < 0.7
    assert board.wait(LIMIT_S) == 0
    direct = read_log(tmp_path / "direct.blf")
    drives = (direct["coast"] == 0.0) & (direct["duty"] != 0.0)
    assert drives.any() and direct["duty"].max() < 0.7
    assert (direct["state"][np.flatnonzero(drives) - STAGED_ROWS] == 1.0).all()
    last_drive, last_pulled = (
        np.flatnonzero(rows)[-1] for rows in (drives, direct["trigger"] > 0.0)
    )
    assert last_drive <= last_pulled + STAGED_ROWS + SLOW_FRAME_ROWS


def test_a_lost_port_gives_a_message_and_the_log_is_kept(tmp_path: Path) -> None:
    board, host = start_both("sil", tmp_path, 30.0)
    wait_for_the_drive(tmp_path)
    board.kill()
    _, stderr = host.communicate(timeout=LIMIT_S)
    assert (
        host.returncode == 2
        and "port lost after" in stderr
        and "rows until then are in" in stderr
        and "Traceback" not in stderr
    )
    assert len(read_log(tmp_path / "log.csv")) > 500


def test_ctrl_c_before_the_run_has_begun_leaves_nothing(tmp_path: Path) -> None:
    board, host = start_both("sil", tmp_path, 30.0, held_s=0.0)  # the trigger is not pulled
    wait_for(host, "pull the trigger fully and hold it")
    host.send_signal(signal.SIGINT)
    _, stderr = host.communicate(timeout=LIMIT_S)
    board.kill()
    board.wait()
    assert host.returncode == 130 and "Traceback" not in stderr
    assert [name for name in os.listdir(tmp_path) if "log" in name] == []


def test_a_port_without_a_board_gives_a_message(tmp_path: Path) -> None:
    master, slave = os.openpty()
    tty.setraw(slave)
    host = start_run(os.ttyname(slave), tmp_path / "log.csv")
    _, stderr = host.communicate(timeout=LIMIT_S)
    os.close(master)
    os.close(slave)
    assert (
        host.returncode == 2 and "no boot frame within 5 s" in stderr and os.listdir(tmp_path) == []
    )


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (
            ["--on", "/dev/ttyNone", "-o", "log.csv"],
            "one run: --next VERDICT.json, or --experiment with one of staircase, reversal",
        ),
        (
            ["--on", "/dev/ttyNone", "-o", "log.csv", "--experiment", "waltz"],
            "there is no run waltz; the menu has staircase",
        ),
        (["--on", "/dev/ttyNone", "--experiment", "reversal"], "name the log file with -o LOG"),
        (
            ["--on", "/dev/ttyNone", "--experiment", "reversal", "-o", "log.csv"],
            "/dev/ttyNone: the port cannot be opened",
        ),
        (
            ["--on", "/dev/ttyNone", "--experiment", "reversal", "-o", "log.csv", "--real-time"],
            "belong to --on sil and --on avr",
        ),
        (
            ["--on", "/dev/ttyNone", "--next", "none.json", "-o", "log.csv"],
            "none.json: cannot be read",
        ),
        (
            ["--on", "/dev/ttyNone", "--experiment", "reversal", "-o", "log.csv", "--seed", "3"],
            "a run on a board has none",
        ),
        (["--on", "avr", "--experiment", "reversal"], "run a SCENARIO"),
        ([], "run a SCENARIO"),
    ],
)
def test_unusable_options_give_a_message(arguments: list[str], sentence: str) -> None:
    assert sentence in error_message(*arguments)


def test_logs_are_checked_before_and_after_a_run(tmp_path: Path) -> None:
    case = ROOT / "tests/data/practice/practice_001"
    log, rig, wrong = read_log(case / "log.csv"), str(case / "rig.toml"), tmp_path / "wrong.csv"
    write_csv(replace(log, columns={**log.columns, "current_a": 1e3 * log["current_a"]}), wrong)
    board = ["--on", "/dev/ttyNone", "--experiment", "reversal", "-o", str(tmp_path / "new.csv")]
    assert "current_a:mA=current_a" in error_message(*board, "--rig", rig, "--log", str(wrong))
    assert "add --rig" in error_message(*board, "--log", str(wrong))
    good = error_message(*board, "--rig", rig, "--log", str(case / "log.csv"))
    assert "the port cannot be opened" in good
    checks = BoardChecks(read_rig(case / "rig.toml"))
    assert checks.warnings_of(case / "log.csv") == []
    with pytest.raises(VgrooveError, match="is recorded, but a diagnosis would refuse it"):
        checks.warnings_of(wrong)


def test_a_file_that_is_no_verdict_gives_a_message(tmp_path: Path) -> None:
    none = '{"verdict": "none", "next_experiment": null}'
    for text, sentence in (
        ("{", "is no JSON"),
        ("[]", "is not a verdict"),
        (none, "asks for no further run"),
    ):
        (tmp_path / "v.json").write_text(text)
        assert sentence in error_message(
            "--on",
            "/dev/ttyNone",
            "--next",
            str(tmp_path / "v.json"),
            "-o",
            str(tmp_path / "log.csv"),
        )
