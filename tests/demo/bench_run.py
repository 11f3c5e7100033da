"""The run of the demo: the firmware's ELF on the simulated ATmega drives the sealed tool, and its
telemetry is recorded through python-can from a pty.
"""

import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from sealed import DEMO_SECONDS, DEMO_STEPS
from sealed_impact import PRESS_S, SECONDS, TRAVEL

from vgroove.board import AvrBoard
from vgroove.lockstep import LockstepOptions, Profile, Progress, steps
from vgroove.pty_line import PtyLine

REST_S = 0.6  # at rest the board calibrates the offset of its current measurement
REVERSE_AT_S = REST_S + 5.2  # the shaft is at rest when the direction switch moves
TAIL_S = 0.1  # after the last step


@dataclass(frozen=True)
class Recorded:
    """The recorded log and the summary that the recorder printed."""

    log: Path
    summary: str


def trigger_profile() -> Profile:
    """The staircase with reversal as an operator makes it: travel of the trigger, and the direction
    switch moved at standstill.
    """
    travel, before = [(0.0, 0.0)], 0.0
    for time_s, duty in DEMO_STEPS:
        travel += [(time_s + REST_S, before), (time_s + REST_S, abs(duty))]
        before = abs(duty)
    return Profile(travel=travel, reverse=((0.0, 0.0), (REVERSE_AT_S, 1.0)))


@dataclass(frozen=True)
class DemoRun:
    """What the operator does, how long the run lasts in s, and the seed of the analog noise."""

    profile: Profile
    seconds: float
    seed: int


def drive_run(seed: int) -> DemoRun:
    """The run of the drivetrain."""
    return DemoRun(trigger_profile(), REST_S + DEMO_SECONDS + TAIL_S, seed)


def impact_run(seed: int) -> DemoRun:
    """The run of the impact tool: the trigger pulled and held into the joint."""
    press = REST_S + PRESS_S
    travel = [(0.0, 0.0), (press, 0.0), (press, TRAVEL)]
    return DemoRun(Profile(travel=travel), REST_S + SECONDS, seed)


def record_run(
    elf: Path, tool: object, folder: Path, run: DemoRun, progress: Callable[[Progress], None]
) -> Recorded:
    """Run board and lock-step tool while `vgroove record` records the telemetry from the pty.

    RuntimeError when the recorder fails.
    """
    log = folder / "run.csv"
    with PtyLine() as line, AvrBoard(elf) as board:
        recorder = subprocess.Popen(
            [sys.executable, "-m", "vgroove.cli", "record", line.name, "-o", str(log)],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        if not line.wait_for_reader(20.0):
            recorder.kill()
            raise RuntimeError(
                "the recorder did not open the pty: " + (recorder.communicate()[0] or "")
            )
        for now in steps(
            board,
            tool,
            run.profile,
            run.seconds,
            LockstepOptions(line=line, seed=run.seed),
        ):
            progress(now)
        line.drain()
        recorder.terminate()
        output = recorder.communicate(timeout=60)[0]
    if recorder.returncode != 0 or not log.exists():
        raise RuntimeError(f"the recorder ended with {recorder.returncode}: {output}")
    return Recorded(log, output.strip())
