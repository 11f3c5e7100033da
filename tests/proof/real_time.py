"""Long runs in real time for `make proof`: streams of telemetry beside a busy processor, and the
exchange of `vgroove hil` with a simulated board. Each result holds the load of the machine.
"""

import os
import resource
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import can
import serial
from can.interfaces.serial.serial_can import SerialBus

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "tests/python"))

from test_lines import received_of  # noqa: E402
from vgroove.real_time import (  # noqa: E402
    RealTimeRun,
    SerialLink,
    run_in_real_time,
    timing_figures,
)
from vgroove.real_time.priority import workers_prioritised  # noqa: E402
from vgroove.real_time.simulated_board import PacedBoard, real_time_elf  # noqa: E402
from vgroove.real_time.tool_ticks import ToolTicks  # noqa: E402
from vgroove.scenario import Scenario  # noqa: E402
from vgroove.serial_bus import ResyncBus  # noqa: E402
from vgroove.study.fixed_point import drill_scenario, impact_scenario  # noqa: E402

Kept = Callable[[Path, str, Callable[[], dict[str, Any]]], dict[str, Any]]
STREAM_S = 600.0
STREAMS = {"250 kBd": 1316, "1 MBd": 5263}  # frames of 19 bytes a second
READERS: dict[str, type[can.BusABC]] = {"python-can": SerialBus, "vgroove": ResyncBus}
READER_S = 20.0
HIL_S = 60.0
MAX_JITTER_S, MAX_LATENCY_TICKS = 0.2e-3, 2  # what the design demands: median, worst
KICKBACK_NM = 40.0
JOINTS = ("hard_joint", "disc_spring", "m10")


def machine() -> dict[str, Any]:
    """Processors, and the load average of the last minute: runnable processes."""
    return {"processors": os.cpu_count(), "load_1min": round(os.getloadavg()[0], 2)}


def stream(rate: int) -> dict[str, Any]:
    """One stream beside a busy process for each processor."""
    before = machine()
    received, line = received_of(rate, STREAM_S)
    return {
        "seconds": STREAM_S,
        "frames_sent": line["sent"],
        "frames_received": received,
        "bytes_lost": line["bytes_lost"],
        "lost": line["sent"] - received,
        "machine": {"before": before, "after": machine()},
    }


def streams(folder: Path, kept: Kept) -> dict[str, Any]:
    """All streams; finished ones are taken from the folder."""
    rows = {
        name: kept(folder, f"stream_{rate}", lambda rate=rate: stream(rate))
        for name, rate in STREAMS.items()
    }
    return {"streams": rows, "lost": sum(row["lost"] for row in rows.values())}


def received_one_by_one(bus: can.BusABC) -> int:
    """Messages that a bus receives until the line hangs up."""
    received = 0
    with suppress(can.CanOperationError, serial.SerialException):
        while True:
            received += bus.recv(timeout=0.1) is not None
    bus.shutdown()
    return received


def reader(kind: str, rate: int) -> dict[str, Any]:
    """Frames sent and received of a stream that a bus of READERS reads with recv(), and the
    processor time of the reading processes per frame in us. rate: frames per s.
    """
    used = {}

    def receive(port: str) -> int:
        bus = READERS[kind](port, baudrate=1_000_000, timeout=0.05)
        begin, children = time.process_time(), resource.getrusage(resource.RUSAGE_CHILDREN)
        received = received_one_by_one(bus)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        used["s"] = time.process_time() - begin + after.ru_utime - children.ru_utime
        used["s"] += after.ru_stime - children.ru_stime
        return received

    received, line = received_of(rate, READER_S, receive)
    return {
        "frames_sent": line["sent"],
        "frames_received": received,
        "us_of_processor_each": round(1e6 * used["s"] / max(received, 1), 1),
    }


def serial_readers() -> dict[str, Any]:
    """Figures of each of STREAMS, received with each of READERS; ratios: for each stream the
    processor time that python-can's bus needs, divided by what this project's bus needs.
    """
    rows = {name: {kind: reader(kind, rate) for kind in READERS} for name, rate in STREAMS.items()}
    theirs, ours = (
        [row[kind]["us_of_processor_each"] for row in rows.values()] for kind in READERS
    )
    ratios = [round(a / b, 2) for a, b in zip(theirs, ours, strict=True)]
    return {"seconds": READER_S, "readers": rows, "ratio_of_processor_time": ratios}


def repeated(scenario: Scenario, pulls: tuple[tuple[float, float], ...]) -> Scenario:
    """A scenario of HIL_S with the trigger's points (s, travel) of a second in each second."""
    travel = tuple((k + at, value) for k in range(int(HIL_S)) for at, value in pulls)
    profile = replace(scenario.profile, travel=travel)
    return replace(scenario, duration_s=HIL_S, profile=profile)


def hil_scenarios() -> dict[str, tuple[str, Scenario]]:
    """Name -> tool and scenario: the impact driver on each kind of joint, pulled for half of each
    second, and the drill driver whose bit is jammed in each second.
    """
    pulls = ((0.0, 0.0), (0.3, 0.0), (0.35, 1.0), (0.85, 1.0), (0.9, 0.0))
    found: dict[str, tuple[str, Scenario]] = {}
    for joint in JOINTS:
        found[f"impact_{joint}"] = (
            "impact",
            repeated(impact_scenario(0, joint, 1.0, 18.0, 1), pulls),
        )
    drill = repeated(drill_scenario("drill_driver_low", 0.0, 1.0, 18.0, 1), pulls)
    jams = ((0.0, 0.0), (0.65, 0.0), (0.7, KICKBACK_NM), (0.95, KICKBACK_NM), (0.96, 0.0))
    load = tuple((k + at, nm) for k in range(int(HIL_S)) for at, nm in jams)
    profile = replace(drill.profile, load_nm=load)
    found["drill_kickback"] = ("drill", replace(drill, profile=profile))
    return found


def hil_run(tool: str, scenario: Scenario) -> dict[str, Any]:
    """The figures of one run against a simulated board at the pace of the wall clock."""
    run, before = RealTimeRun(), machine()
    with PacedBoard(real_time_elf(tool), 1.0) as board:
        link = SerialLink(board.port)
        try:
            ticks = round(1000 * scenario.duration_s)
            with workers_prioritised():
                run_in_real_time(link, ToolTicks(scenario), ticks, run)
        finally:
            link.close()
    figures = timing_figures(run)
    jitter = {name: round(1e3 * value, 4) for name, value in figures["jitter_s"].items()}
    late = figures["late_steps"]
    unexplained = [step for step in late if not step["pause_of_computer"]]
    pauses = figures["pauses_of_computer"] or {"count": 0, "worst_s": 0.0}
    in_time = figures["frames_damaged"] == 0 and figures["jitter_s"]["median"] < MAX_JITTER_S
    return {
        "ticks": figures["exchanges"],
        "frames_damaged": figures["frames_damaged"],
        "sent_again": figures["sent_again"],
        "jitter_ms": jitter,
        "latency_ticks": figures["latency_ticks"],
        "late_steps": len(late),
        "late_steps_without_pause_of_computer": len(unexplained),
        "pauses_of_computer": {
            "count": pauses["count"],
            "worst_ms": round(1e3 * pauses["worst_s"], 2),
        },
        "waited_ms": figures["held_ticks"],
        "bridge_opened": len(run.safe_ticks),
        "real_time_priority": figures["real_time_priority"],
        "machine": {"before": before, "after": machine()},
        "goals_met": in_time
        and figures["sent_again"] == 0
        and figures["latency_ticks"]["worst"] <= MAX_LATENCY_TICKS,
        "goals_met_without_pauses_of_computer": in_time and not unexplained,
    }


def hil(folder: Path, kept: Kept) -> dict[str, Any]:
    """All runs of a minute; finished ones are taken from the folder."""
    rows = {
        name: kept(folder, f"hil_{name}", lambda tool=tool, run=run: hil_run(tool, run))
        for name, (tool, run) in hil_scenarios().items()
    }
    goals = ("goals_met", "goals_met_without_pauses_of_computer")
    return {"runs": rows, **{goal: sum(row[goal] for row in rows.values()) for goal in goals}}
