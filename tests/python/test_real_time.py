"""Real-time runs against a board behind a pseudo-terminal: equal to lock-step bit for bit, also
with damaged and lost frames and a late host; the safe state; codecs; figures; the command.
"""

import json
import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import can
import cantools
import numpy as np
import pytest
from rich.console import Console

from real_time_board import PACE, ROOT, BusGateway, ChangedLink, PacedBoard, hil_elf
from vgroove import lockstep, telemetry
from vgroove.board import default_elf
from vgroove.command_answers import answers_in, unanswered_text
from vgroove.errors import VgrooveError
from vgroove.log import log_from_stream
from vgroove.real_time import (
    BusLink,
    Exchange,
    RealTimeRun,
    SerialLink,
    TickInputs,
    command,
    run_in_real_time,
    timing_figures,
)
from vgroove.real_time.command import HilOptions
from vgroove.real_time.figures import (
    LEAST_EXCHANGES,
    clock_sentence,
    fit_clock,
    late_sentence,
    timing_rows,
)
from vgroove.real_time.frames import DRIVE, SENSE_A, drive_of, sense_frames
from vgroove.real_time.tool_ticks import ToolTicks
from vgroove.scenario import Command, Scenario, command_messages, make_plant, read_scenario
from vgroove.sil import SilBoard
from vgroove.telemetry import Frame, frame_bytes, frame_of
from warm_cli import warm_vgroove

DBC = cantools.database.load_file(ROOT / "firmware/hal/inject/hil.dbc", strict=True)
VGROOVE = [sys.executable, "-m", "vgroove.cli"]


def scenario_of(name: str, seconds: float) -> Scenario:
    return replace(read_scenario(ROOT / "scenarios" / f"{name}.toml"), duration_s=seconds)


EARLIER_S = 0.1


def early_impact(seconds: float) -> Scenario:
    """The impact on a hard joint, its trigger pulled EARLIER_S earlier, at 0.2 s: the board at PACE
    takes 2 s for that time, in which the tool rests. The firmware drives the bridge from 0.21 s on;
    it ignores a trigger that is pulled 0.05 s earlier.
    """
    scenario = scenario_of("impact_hard_joint", seconds)
    moved = tuple((max(t - EARLIER_S, 0.0), x) for t, x in scenario.profile.travel)
    return replace(scenario, profile=replace(scenario.profile, travel=moved))


def in_lockstep(scenario: Scenario) -> bytes:
    """Bytes of the native firmware."""
    line = lockstep.Script(command_messages(scenario.commands))
    options = lockstep.LockstepOptions(front=scenario.front_ends(), line=line, seed=scenario.seed)
    tool = make_plant(scenario.tool, scenario.seed)
    return lockstep.run(SilBoard(), tool, scenario.profile, scenario.duration_s, options)


def frames_by_tick(data: bytes, ticks: int) -> list[telemetry.Frame]:
    """Frames up to a tick, except those with figures of the machine (cycles, stack, target)."""
    machine = (telemetry.HEALTH, telemetry.BOOT)
    frames = telemetry.Framer().feed(data)
    return [f for f in frames if f.time_ms <= ticks and f.id not in machine]


def run_in_time(start: Callable[[], RealTimeRun]) -> RealTimeRun:
    """The first of at most three runs in which this machine kept the board waiting for less than
    5 ms of its clock: a busy one may delay the bytes of a pseudo-terminal for longer.
    """
    for _ in range(3):
        run = start()
        if not run.safe_ticks:
            break
    return run


def run_by_port(port: str, scenario: Scenario) -> RealTimeRun:
    link = SerialLink(port)
    try:
        return run_on(link, scenario)
    finally:
        link.close()


def run_on(link: object, scenario: Scenario) -> RealTimeRun:
    run = RealTimeRun()
    ticks = round(scenario.duration_s * 1000)
    run_in_real_time(link, ToolTicks(scenario), ticks, run)
    return run


def assert_equal_to_lockstep(run: RealTimeRun, scenario: Scenario) -> None:
    assert run.safe_ticks == []
    last = round(scenario.duration_s * 1000) - 3  # later frames may be under way at the end
    expected = frames_by_tick(in_lockstep(scenario), last)
    assert frames_by_tick(bytes(run.telemetry), last) == expected
    assert len(expected) > last


@pytest.mark.parametrize(
    ("name", "seconds"),
    [("impact_hard_joint", 0.45), ("drill_kickback", 0.5), ("stress", 0.65)],
)
def test_a_run_has_the_frames_of_lock_step(name: str, seconds: float) -> None:
    make = early_impact if name == "impact_hard_joint" else partial(scenario_of, name)
    scenario = make(seconds)
    with PacedBoard(hil_elf("drill" if "drill" in name else "impact")) as board:
        run = run_in_time(lambda: run_by_port(board.port, scenario))
    assert_equal_to_lockstep(run, scenario)
    assert len(run.exchanges) == round(1000 * seconds)


def test_a_second_run_begins_with_a_fresh_board() -> None:
    scenario = early_impact(0.26)
    with PacedBoard(hil_elf()) as board:
        for _ in range(2):
            run = run_in_time(lambda: run_by_port(board.port, scenario))
            assert_equal_to_lockstep(run, scenario)


def test_damaged_and_lost_frames_change_nothing() -> None:
    scenario = scenario_of("impact_hard_joint", 0.42)
    rng = random.Random(3)

    def damage(frames: list[Frame]) -> list[Frame]:
        out = []
        for frame in frames:
            if rng.random() < 0.02 and frame.time_ms:
                data = bytearray(frame.data)
                data[rng.randrange(8)] ^= 1 << rng.randrange(8)
                frame = frame._replace(data=bytes(data))
            out.append(frame)
        return out

    def lose_answers(frames: list[Frame]) -> list[Frame]:
        return [f for f in frames if f.id != DRIVE or f.time_ms == 0 or rng.random() > 0.02]

    with PacedBoard(hil_elf()) as board:
        link = ChangedLink(SerialLink(board.port), damage, lose_answers)
        run = run_in_time(lambda: run_on(link, scenario))
        link.close()
    assert run.sent_again > 5
    assert_equal_to_lockstep(run, scenario)


def test_a_command_that_is_lost_on_the_line_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    to_sync = Command(0.05, "SET_MODE", {"mode_request": 1})
    scenario = replace(scenario_of("spin_up", 0.26), commands=(to_sync,))

    def lose(frames: list[Frame]) -> list[Frame]:
        return [frame for frame in frames if frame.id != telemetry.SET_MODE]

    monkeypatch.setattr(
        command, "SerialLink", lambda port, baud: ChangedLink(SerialLink(port, baud), lose)
    )
    with PacedBoard(hil_elf()) as board:
        options = HilOptions(board.port, output=tmp_path / "hil.csv")
        with pytest.raises(VgrooveError, match=r"not answered SET_MODE at 0\.05 s"):
            command.run_hil(scenario, options, Console(stderr=True))
    assert (tmp_path / "hil.csv").is_file()
    assert unanswered_text(scenario.commands, answers_in(in_lockstep(scenario)), 0.26) == ""


def test_a_late_host_changes_nothing_and_is_named() -> None:
    scenario = scenario_of("impact_hard_joint", 0.42)

    def late(frames: list[Frame]) -> list[Frame]:
        if frames and frames[0].time_ms in (100, 400):
            time.sleep(0.06)  # 3 ms of a board at a twentieth of the wall clock
        return frames

    with PacedBoard(hil_elf()) as board:
        link = ChangedLink(SerialLink(board.port), to_board=late)
        run = run_in_time(lambda: run_on(link, scenario))
        link.close()
    assert_equal_to_lockstep(run, scenario)
    figures = timing_figures(run)
    ticks = [step["tick"] for step in figures["late_steps"]]
    assert {100, 400} <= set(ticks)
    assert figures["held_ticks"] >= 2
    assert "100 (+" in late_sentence(figures)


def answers(link: SerialLink, seconds: float) -> list[object]:
    found, end = [], time.monotonic() + seconds
    while time.monotonic() < end:
        found += [drive_of(f) for f in link.receive(0.01) if f.id == DRIVE]
    return found


def test_the_board_opens_the_bridge_5_ms_after_the_last_inputs() -> None:
    scenario = early_impact(0.35)  # the trigger is pulled
    with PacedBoard(hil_elf()) as board:
        link = SerialLink(board.port)
        run = run_in_time(lambda: run_on(link, scenario))
        silent = answers(link, 1.0)
        link.close()
    assert not run.safe_ticks
    *driven, safe = silent[: next(k for k, d in enumerate(silent) if d.safe) + 1]
    last = max(driven, key=lambda drive: drive.tick)  # an answer may have been repeated after it
    assert not last.coast and last.compare > 0
    assert safe.coast and safe.tick == last.tick
    waited_ms = (safe.clock_tick - last.clock_tick) % 256
    assert waited_ms == 5


def test_a_host_that_is_too_late_is_told_and_the_fault_is_in_the_log(tmp_path: Path) -> None:
    scenario = scenario_of("impact_hard_joint", 0.62)

    def late(frames: list[Frame]) -> list[Frame]:
        if frames and frames[0].time_ms == 450:
            time.sleep(0.3)  # 15 ms of the board
        return frames

    with PacedBoard(hil_elf()) as board:
        link = ChangedLink(SerialLink(board.port), to_board=late)
        run = run_on(link, scenario)
        link.close()
    assert any(abs(tick - 449) <= 2 for tick in run.safe_ticks)
    states = [
        telemetry.decode(f)
        for f in telemetry.Framer().feed(bytes(run.telemetry))
        if f.id == telemetry.STATE
    ]
    overrun = next(k for k, v in telemetry.value_table("STATE", "faults").items() if v == "overrun")
    assert any(int(state["faults"]) & overrun for state in states)
    log = log_from_stream(bytes(run.telemetry), "hil")
    after = log.time_s > 0.46
    assert (log["coast"][after] == 1).all() and after.sum() > 100


def test_a_bus_of_python_can_carries_a_run() -> None:
    scenario = early_impact(0.3)
    with (
        PacedBoard(hil_elf()) as board,
        can.Bus(interface="virtual", channel="hil") as bus,
        BusGateway(board.port, bus),
    ):
        link = BusLink("virtual:hil")
        run = run_in_time(lambda: run_on(link, scenario))
        link.close()
    assert_equal_to_lockstep(run, scenario)


@pytest.mark.parametrize("spec", ["virtual", ":can0", "nothing:can0", "serial:0", "socketcand:a"])
def test_an_unusable_bus_is_named(spec: str) -> None:
    with pytest.raises(VgrooveError, match="bus"):
        BusLink(spec)


def test_an_empty_name_of_a_port_is_named(tmp_path: Path) -> None:
    scenario = ROOT / "scenarios/spin_up.toml"
    log = tmp_path / "run.csv"
    for arguments in (("hil", scenario, "--port", ""), ("record", "", "-o", log)):
        done = warm_vgroove(*arguments)
        assert done.returncode == 2
        assert "the name of the port is empty" in done.stderr


def test_frames_are_those_of_the_dbc() -> None:
    rng = np.random.default_rng(4)
    for _ in range(200):
        samples = tuple(int(v) for v in rng.integers(0, 1024, rng.integers(0, 9)))
        edges = tuple(int(v) for v in rng.integers(1, 16001, rng.integers(0, 4)))
        tick, switches = int(rng.integers(0, 2**32)), int(rng.integers(0, 16))
        frames = sense_frames(TickInputs(tick, samples, switches, edges))
        assert len(frames) == (3 if edges else 2)
        signals = {}
        for frame in frames:
            assert frame.time_ms == tick
            signals |= DBC.decode_message(frame.id, frame.data)
        padded = (*samples, *(0,) * 8)[:8]
        assert tuple(signals[f"sample_{k}"] for k in range(8)) == padded
        assert signals["sample_count"] == len(samples) and signals["switches"] == switches
        assert signals["edge_count"] == len(edges) and signals["sense_a_tick"] == tick & 0xFF
        if edges:
            assert tuple(signals[f"edge_cycle_{k}"] for k in range(len(edges))) == edges


def test_a_bridge_command_is_that_of_the_dbc() -> None:
    values = {
        "drive_flags": 6,
        "drive_compare": -200,
        "drive_dead_counts": 16,
        "clock_tick": 250,
        "clock_count": 4 * 77,
        "drive_tick": 0x34,
        "drive_crc": 0,
    }
    data = DBC.encode_message("DRIVE", values, strict=False)
    drive = drive_of(frame_of(0x1234, DRIVE, data))
    assert (drive.tick, drive.compare, drive.dead_counts) == (0x1234, -200, 16)
    assert (drive.coast, drive.later, drive.safe, drive.idle) == (False, True, True, False)
    assert (drive.clock_tick, drive.clock_count) == (250, 77)


def test_too_many_samples_or_edges_are_refused() -> None:
    with pytest.raises(ValueError, match="9 samples"):
        sense_frames(TickInputs(1, (0,) * 9))
    with pytest.raises(ValueError, match="4 edges"):
        sense_frames(TickInputs(1, (), 0, (1, 2, 3, 4)))


def made_run(held: dict[int, int], drift: float, ticks: int = 5000) -> RealTimeRun:
    """A run whose board clock drifts and waits `held` ms before some ticks."""
    rng, run, clock_ms = np.random.default_rng(5), RealTimeRun(), 0
    for tick in range(1, ticks + 1):
        clock_ms += 1 + held.get(tick, 0)
        board_s = clock_ms * 1e-3
        received_s = 100.0 + board_s * (1.0 + drift) + 4e-4 + rng.exponential(5e-5)
        run.exchanges.append(Exchange(tick, received_s, received_s + 1e-4, 6e-5, board_s))
    return run


@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_a_run_that_ends_after_some_exchanges_writes_what_it_has(
    count: int, tmp_path: Path
) -> None:
    run = made_run({}, 0.0, count)
    options = HilOptions("port", json_path=tmp_path / "a.json")
    figures = command._write(run, options, Console(stderr=True))
    assert (tmp_path / "a.json").is_file() == bool(figures) == (count == LEAST_EXCHANGES)


def test_drift_and_offset_of_the_clocks_are_estimated() -> None:
    figures = timing_figures(made_run({700: 3}, drift=35e-6))
    assert figures["clock"]["drift_ppm"] == pytest.approx(35.0, abs=1.0)
    assert figures["clock"]["offset_s"] == pytest.approx(100.0004, abs=5e-6)
    rows = np.array(timing_rows(made_run({}, 35e-6).exchanges, figures["clock"]))
    assert np.median(np.abs(rows[:, 4])) < 1e-4
    assert np.ptp(rows[:, 3] - rows[:, 2]) == pytest.approx(5.0 * 35e-6, rel=0.05)


@pytest.mark.parametrize(
    ("ticks", "drift", "tolerance"),
    [(200, 1.0 / 0.3 - 1.0, 1e-4), (255, 0.0, 4e-5), (1000, 0.01, 5e-6), (5000, 0.01, 1e-6)],
)
def test_the_drift_of_a_short_run_and_a_large_drift_are_estimated(
    ticks: int, drift: float, tolerance: float
) -> None:
    clock = timing_figures(made_run({}, drift, ticks))["clock"]
    assert clock["drift"] == pytest.approx(drift, abs=tolerance)


def test_one_late_exchange_does_not_move_the_clock() -> None:
    run = made_run({}, drift=0.0)
    host = np.array([e.received_s for e in run.exchanges])
    board = np.array([e.board_s for e in run.exchanges])
    host[1000:1400] += 0.004
    assert abs(fit_clock(host, board).drift) < 1e-6


def test_waits_and_latency_are_counted() -> None:
    figures = timing_figures(made_run({700: 3, 900: 1}, 0.0))
    assert figures["held_ticks"] == 4
    assert figures["late_steps"] == [
        {"tick": 700, "held_ticks": 3, "pause_of_computer": False},
        {"tick": 900, "held_ticks": 1, "pause_of_computer": False},
    ]
    assert figures["latency_ticks"]["median"] == 2 and figures["latency_ticks"]["worst"] == 5
    assert figures["period_s"]["median"] == pytest.approx(1e-3, abs=1e-5)
    assert figures["jitter_s"]["worst"] == pytest.approx(3e-3, abs=5e-4)


class Ended(NamedTuple):
    """A run of the command that ended early: exit code, reason in its JSON file, output."""

    code: int
    reason: str
    out: str
    errors: str


def vgroove(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*VGROOVE, *map(str, arguments)], capture_output=True, text=True, timeout=120, check=False
    )


def command_in_time(*arguments: object) -> subprocess.CompletedProcess[str]:
    """As run_in_time, for the command."""
    for _ in range(3):
        done = vgroove(*arguments)
        if done.returncode == 0 or "the host was late" not in done.stderr:
            break
    return done


def short(folder: Path, seconds: float) -> Path:
    path = folder / "short.toml"
    text = (ROOT / "scenarios/impact_hard_joint.toml").read_text()
    text = text.replace("../rigs", str(ROOT / "rigs"))
    path.write_text(text.replace("duration_s = 2.0", f"duration_s = {seconds}"))
    return path


def test_the_command_writes_log_figures_and_times(tmp_path: Path) -> None:
    scenario = short(tmp_path, 0.5)
    with PacedBoard(hil_elf()) as board:
        done = command_in_time(
            "hil",
            scenario,
            "--port",
            board.port,
            "-o",
            tmp_path / "hil.csv",
            "--json",
            tmp_path / "hil.json",
            "--timing",
            tmp_path / "times.csv",
        )
    assert done.returncode == 0, done.stderr
    assert "from command to answer in ticks" in done.stdout
    figures = json.loads((tmp_path / "hil.json").read_text())
    assert figures["schema"] == "vgroove.hil/1" and figures["exchanges"] == 500
    assert figures["planned_exchanges"] == 500 and figures["ended"] == "complete"
    assert "exchanges in" not in done.stderr
    assert set(figures["jitter_s"]) == {"median", "99 %", "99.9 %", "worst"}
    assert len((tmp_path / "times.csv").read_text().splitlines()) == 501
    assert vgroove("run", scenario, "-o", tmp_path / "sil.csv").returncode == 0
    compared = vgroove("log", "compare", tmp_path / "sil.csv", tmp_path / "hil.csv")
    assert "equal bit for bit" in compared.stdout.splitlines()[1], compared.stdout


def test_a_board_with_the_build_for_tools_is_named() -> None:
    with PacedBoard(default_elf(), 1.0) as board, pytest.raises(VgrooveError) as error:
        run_on(SerialLink(board.port, 1_000_000), scenario_of("impact_hard_joint", 0.5))
    assert "flash the build for real-time runs" in str(error.value)


def test_a_silent_line_is_named(tmp_path: Path) -> None:
    with PacedBoard(hil_elf()) as board:
        scenario = short(tmp_path, 0.5)
        assert vgroove("hil", scenario).returncode == 2
        both = vgroove("hil", scenario, "--port", board.port, "--bus", "virtual:x")
        assert both.returncode == 2 and "either --port" in both.stderr
        # While it is open, no other test can get a pty with the same number.
        held = os.open(board.port, os.O_RDWR | os.O_NOCTTY)
    gone = vgroove("hil", scenario, "--port", board.port)
    os.close(held)
    assert gone.returncode == 2 and "cannot be opened" in gone.stderr


def test_a_port_in_use_is_named_and_the_first_run_goes_on(tmp_path: Path) -> None:
    scenario, second = scenario_of("impact_hard_joint", 0.36), []
    commands = (
        ["hil", short(tmp_path, 0.5), "--port"],
        ["record", "-o", tmp_path / "second.csv", "--baud", "250000"],
    )

    with PacedBoard(hil_elf()) as board:
        link = SerialLink(board.port)

        def start_second() -> None:
            second.extend(vgroove(*command, board.port) for command in commands)

        thread = threading.Thread(target=start_second)
        thread.start()
        run = run_in_time(lambda: run_on(link, scenario))
        thread.join()
        link.close()
        SerialLink(board.port).close()
    assert_equal_to_lockstep(run, scenario)
    assert [done.returncode for done in second] == [2, 2]
    for done in second:
        assert f"{board.port}: the port is in use by another program" in done.stderr


def ended_run(folder: Path, end: Callable[[PacedBoard, subprocess.Popen[str]], object]) -> Ended:
    """A run of 60 s of the board's clock that is ended after 6 s of the host's."""
    output, json_path = folder / "hil.csv", folder / "hil.json"
    with PacedBoard(hil_elf(), 0.3) as board:
        command = [*VGROOVE, "hil", short(folder, 60.0), "--port", board.port, "-o", output]
        host = subprocess.Popen(
            [*map(str, command), "--json", str(json_path)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        time.sleep(6.0)
        end(board, host)
        out, errors = host.communicate(timeout=30)
    figures = json.loads(json_path.read_text())
    assert len(output.read_text().splitlines()) > 50
    assert figures["planned_exchanges"] == 60_000 and 50 < figures["exchanges"] < 10_000
    ended, count = figures["ended"], figures["exchanges"]
    assert f"{ended}: {count} of 60000 exchanges in {output}, {json_path}" in errors
    return Ended(host.returncode, ended, out, errors)


def test_a_board_that_falls_silent_ends_the_run_with_what_it_sent(tmp_path: Path) -> None:
    done = ended_run(tmp_path, lambda board, _: board.stop())
    assert done.code == 2
    assert "was lost" in done.errors or "no command since tick" in done.errors
    assert done.reason in ("port lost", "board silent")


def test_a_board_that_restarts_ends_the_run_and_is_named() -> None:
    run, reset_cycle = RealTimeRun(), str(16_000 * 400)
    with PacedBoard(hil_elf(), 0.3, "--brown-out", reset_cycle) as board:
        link = SerialLink(board.port)
        with pytest.raises(VgrooveError, match="has restarted after tick") as error:
            run_in_real_time(link, ToolTicks(scenario_of("impact_hard_joint", 0.6)), 600, run)
        link.close()
    assert error.value.reason == "board restarted"
    assert 50 < len(run.exchanges) < 400


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_an_interrupted_run_is_marked_and_keeps_what_was_sent(
    tmp_path: Path, number: signal.Signals, code: int
) -> None:
    done = ended_run(tmp_path, lambda _, host: host.send_signal(number))
    assert (done.code, done.reason) == (code, "interrupted")
    assert "Traceback" not in done.errors
    assert "the board's clock runs at 0.30 of the host's" in done.out and "ppm" not in done.out


@pytest.mark.parametrize(
    ("drift", "text"),
    [
        (35e-6, "the board's clock is 35.0 ppm slower than the host's"),
        (-35e-6, "the board's clock is 35.0 ppm faster than the host's"),
        (-0.09, "the board's clock is 98901.1 ppm faster than the host's"),
        (1.0 / 0.3 - 1.0, "the board's clock runs at 0.30 of the host's"),
        (1.0 / 1.5 - 1.0, "the board's clock runs at 1.50 of the host's"),
    ],
)
def test_a_rate_that_no_oscillator_has_is_named_as_a_rate(drift: float, text: str) -> None:
    clock = {"drift": drift, "drift_ppm": 1e6 * drift, "residual_s": 1e-5}
    assert text in clock_sentence(clock)


def test_the_start_frame_is_one_of_sense_a() -> None:
    assert frame_bytes(frame_of(0, SENSE_A, bytes(7)))[6] == 128


def test_the_study_compares_real_time_with_lock_step(tmp_path: Path) -> None:
    done = vgroove(
        "study", "hil", "--tool", "drill", "--pace", PACE, "--seconds", "0.6", "-o", tmp_path
    )
    assert done.returncode == 0, done.stderr
    rows = json.loads((tmp_path / "hil.json").read_text())["rows"]
    assert [row["run"] for row in rows] == ["drill, load of 6 N m", "drill, kickback"]
    for row in rows:
        assert row["ticks"] == 600 and row["latency"] == 2 and row["damaged"] == 0
        assert row["equal_rows"] == row["rows"] > 590 or row["safe"], row
    assert "kickback" in (tmp_path / "hil.html").read_text()


def test_a_port_needs_one_tool(tmp_path: Path) -> None:
    done = vgroove("study", "hil", "--port", "/dev/ttyX", "-o", tmp_path)
    assert done.returncode == 2 and "--tool is impact or drill" in done.stderr
