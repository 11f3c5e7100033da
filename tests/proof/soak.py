"""Long runs of the ELF on the simulated AVR against the native firmware, in pieces of a minute:
random triggers, modes, commands and faults of sensors; part of the pieces with the telemetry's
time near 2^32. soak.py [--hours H] [--jobs N]; pieces that are done are kept for the commit.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from vgroove import lockstep, telemetry
from vgroove.board import (
    INPUT_BYTES,
    OUTPUTS,
    default_elf,
    find_board_program,
    read_statistics,
    replay,
    sent_bytes,
)
from vgroove.errors import VgrooveError
from vgroove.lockstep import Profile
from vgroove.reference.joints import REFERENCE_JOINTS
from vgroove.reference.rigs import LOW_GEAR, reference_rig, with_load
from vgroove.scenario import Command, Scenario, command_messages, make_plant, without_board_effects
from vgroove.sil import SilBoard

ROOT = Path(__file__).resolve().parents[2]
PIECE_S = 60.0
HOURS = 10.0
WRAP_EVERY = 4  # of so many pieces one passes 2^32 ms
BEFORE_WRAP_S = 5.0
IMPACT_MODES, DRILL_MODES = (0, 1, 2, 3, 4), (0, 5)
LEAST_TRAVEL = 0.05  # at which the contact is closed
LEAST_STACK_BYTES = 100
COMMANDS = ("DUMP", "PARAM_READ", "SETPOINT")


def wrap_elf(tool: str, folder: Path) -> Path:
    """Build the Uno's ELF of a tool in a folder, with a telemetry clock that starts BEFORE_WRAP_S
    before its wrap at 2^32 ms; the path of the ELF.
    """
    elf = folder / tool / "vgroove.elf"
    if not elf.exists():
        start_ms = 2**32 - round(1000 * BEFORE_WRAP_S)
        options = [f"-DVGROOVE_TOOL={tool}", "-DVGROOVE_MCU=atmega328p"]
        options += ["-DCMAKE_BUILD_TYPE=MinSizeRel", f"-DCMAKE_C_FLAGS=-DAPP_START_MS={start_ms}u"]
        configure = ["cmake", "-S", str(ROOT), "-B", str(elf.parent), "-G", "Ninja", *options]
        toolchain = ["--toolchain", str(ROOT / "cmake/avr-gcc.cmake")]
        quiet = {"check": True, "stdout": subprocess.DEVNULL}
        subprocess.run([*configure, *toolchain], **quiet)
        subprocess.run(["cmake", "--build", str(elf.parent), "--target", "vgroove"], **quiet)
    return elf


def between_ticks(time_s: float) -> float:
    """The time in the middle of its tick: a switch that changes within 500 cycles after a tick is
    seen by one of the boards a tick later (docs/firmware.md, "Equality of native and AVR").
    """
    return 1e-3 * (np.floor(1e3 * time_s) + 0.5)


def drawn_profile(rng: np.random.Generator, duration_s: float) -> Profile:
    """Pulls of the trigger of all lengths, both directions, interruptions of the Hall line, and
    currents that are added before the converter. The contact closes and opens by steps.
    """
    travel, reverse, now = [(0.0, 0.0)], [(0.0, 0.0)], 0.4
    while now < duration_s - 1.0:
        reverse.append((between_ticks(now), float(rng.random() < 0.2)))
        begin = between_ticks(now + rng.uniform(0.05, 0.4))
        end = between_ticks(begin + rng.exponential(1.0) + 0.08)
        level = rng.uniform(0.1, 1.0)
        pulled = [(begin, 0.0), (begin, LEAST_TRAVEL), (begin + 0.03, level)]
        travel += [*pulled, (end - 0.03, level), (end, LEAST_TRAVEL), (end, 0.0)]
        now = end + rng.uniform(0.1, 1.2)
    breaks = [(t, t + rng.uniform(0.002, 0.8)) for t in rng.uniform(1.0, duration_s, 3)]
    added = [(0.0, 0.0)]
    for t in np.sort(rng.uniform(1.0, duration_s - 1.0, 4)):
        level = rng.uniform(-80.0, 80.0)
        added += [(t, 0.0), (t, level), (t + 0.004, level), (t + 0.004, 0.0)]
    return Profile(
        travel=travel,
        reverse=reverse,
        hall_breaks=breaks,
        current_add_a=sorted(added, key=lambda point: point[0]),
    )


def drawn_commands(
    rng: np.random.Generator, modes: tuple[int, ...], duration_s: float
) -> tuple[Command, ...]:
    """Changes of the mode, reads, dumps and setpoints, about one a second."""
    found = []
    for t in np.arange(0.1, duration_s, 1.0) + rng.uniform(
        0.0, 0.8, len(np.arange(0.1, duration_s))
    ):
        if rng.random() < 0.5:
            found.append(Command(t, "SET_MODE", {"mode_request": int(rng.choice(modes))}))
            continue
        frame = str(rng.choice(COMMANDS))
        values: dict[str, float] = {}
        if frame == "PARAM_READ":
            values = {"read_index": int(rng.integers(0, 52))}
        elif frame == "SETPOINT":
            values = {"setpoint_which": 0, "setpoint_value": int(rng.integers(8000, 32768))}
        found.append(Command(t, frame, values))
    return tuple(found)


def piece_scenario(number: int, duration_s: float) -> tuple[str, Scenario]:
    """The tool and the drawn scenario of a piece."""
    rng = np.random.default_rng([20261125, number])
    drill = number % 3 == 2
    volts = {"supply.voltage_v": float(rng.uniform(15.0, 20.5))}
    if drill:
        rig = reference_rig(LOW_GEAR).with_values(volts)
    else:
        joint = REFERENCE_JOINTS[str(rng.choice(["hard_joint", "disc_spring", "m10"]))]
        rig = with_load(reference_rig(), joint.load, volts)
    modes = DRILL_MODES if drill else IMPACT_MODES
    scenario = Scenario(
        rig,
        without_board_effects(rig),
        duration_s,
        drawn_profile(rng, duration_s),
        seed=number + 1,
        commands=drawn_commands(rng, modes, duration_s),
        source=f"piece {number}",
    )
    return ("drill" if drill else "impact"), scenario


def native_run(scenario: Scenario, start_ms: int) -> tuple[bytes, np.ndarray]:
    """Inputs of all periods as a tape, and the native firmware's outputs."""
    board = SilBoard(start_ms=start_ms)
    board.machine.keeps_tape = True
    line = lockstep.Script(command_messages(scenario.commands))
    options = lockstep.LockstepOptions(front=scenario.front_ends(), line=line, seed=scenario.seed)
    tool = make_plant(scenario.tool, scenario.seed)
    lockstep.run(board, tool, scenario.profile, scenario.duration_s, options)
    return board.machine.tape, np.frombuffer(board.machine.given, OUTPUTS)


def frames_of(data: bytes) -> tuple[list[telemetry.Frame], telemetry.Session]:
    """Frames of a stream, and the session that counts gaps."""
    session = telemetry.Session()
    frames = telemetry.Framer(session.counters).feed(data)
    session.feed(frames)
    return frames, session


def findings(native: np.ndarray, avr: np.ndarray, statistics: dict[str, Any]) -> list[str]:
    """What is wrong with a piece, as sentences."""
    found = []
    if len(native) != len(avr):
        return [f"the AVR ended after {len(avr)} of {len(native)} periods"]
    open_both = (native["coast"] == 1) & (avr["coast"] == 1)
    same = (native["compare"] == avr["compare"]) & (native["dead_counts"] == avr["dead_counts"])
    wrong = np.flatnonzero(~open_both & ~(same & (native["coast"] == avr["coast"])))
    if len(wrong):
        found.append(f"the bridges differ from period {wrong[0]} on")
    (frames_a, _), (frames_b, session) = frames_of(sent_bytes(native)), frames_of(sent_bytes(avr))
    machine = (telemetry.HEALTH, telemetry.BOOT)
    a, b = ([f for f in frames if f.id not in machine] for frames in (frames_a, frames_b))
    differing = next((x for x, y in zip(a, b, strict=False) if x != y), None)
    if differing or abs(len(a) - len(b)) > 1:
        found.append(f"the telemetry differs: {differing}, {len(a)} and {len(b)} frames")
    counters = session.counters
    if counters.lost or counters.not_sent or counters.corrupt or counters.skipped_bytes:
        found.append(f"the telemetry has gaps: {counters}")
    if statistics["resets"] or statistics["odd_periods"]:
        found.append(f"the board was reset {statistics['resets']} times")
    if statistics["stack"]["free_bytes"] < LEAST_STACK_BYTES:
        found.append(f"only {statistics['stack']['free_bytes']} bytes of the stack were never used")
    return found


def piece(number: int, folder: Path, duration_s: float = PIECE_S) -> dict[str, Any]:
    """Run one piece on both; its figures and findings."""
    tool, scenario = piece_scenario(number, duration_s)
    wraps = number % WRAP_EVERY == 0
    start_ms = 2**32 - round(1000 * BEFORE_WRAP_S) if wraps else 0
    begin = time.monotonic()
    tape, native = native_run(scenario, start_ms)
    elf = wrap_elf(tool, folder) if wraps else default_elf("uno", tool)
    with tempfile.TemporaryDirectory() as temporary:
        stats = Path(temporary) / "stats.json"
        try:
            avr = np.frombuffer(replay(elf, tape, stats=stats, seed=number), OUTPUTS)
        except VgrooveError as error:
            return {"piece": number, "findings": [str(error)]}
        statistics = read_statistics(stats)
    assert len(tape) == INPUT_BYTES * len(native)
    return {
        "piece": number,
        "seconds": scenario.duration_s,
        "tool": tool,
        "wraps": wraps,
        "driven_share": float((native["coast"] == 0).mean()),
        "stack_free_bytes": statistics["stack"]["free_bytes"],
        "took_s": time.monotonic() - begin,
        "findings": findings(native, avr, statistics),
    }


def piece_alone(number: int, folder: Path) -> dict[str, Any]:
    """One piece in a process of its own: the native firmware exists once in a process."""
    command = [sys.executable, __file__, "--piece", str(number), "--folder", str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        return {"piece": number, "findings": [f"it ended with {done.returncode}: {done.stderr}"]}
    return json.loads(done.stdout)


def soak(
    hours: float,
    folder: Path,
    jobs: int,
    kept: Callable[[Path, str, Callable[[], dict[str, Any]]], dict[str, Any]],
) -> dict[str, Any]:
    """All pieces of so many hours; finished ones are taken from the folder. VgrooveError where
    vgroove-board is missing, without which every piece fails.
    """
    find_board_program()
    count = round(3600 * hours / PIECE_S)
    for tool in ("impact", "drill"):
        wrap_elf(tool, folder)
    with ThreadPoolExecutor(jobs) as pool:
        rows = list(
            pool.map(
                lambda k: kept(folder, f"soak_{k}", lambda: piece_alone(k, folder)), range(count)
            )
        )
    return summary(rows)


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Figures of all pieces, and every finding."""
    whole = [row for row in rows if "seconds" in row]
    return {
        "hours": sum(row["seconds"] for row in whole) / 3600,
        "pieces": len(rows),
        "passing_2_32_ms": sum(row["wraps"] for row in whole),
        "driven_share": float(np.mean([row["driven_share"] for row in whole])),
        "least_stack_free_bytes": min(row["stack_free_bytes"] for row in whole),
        "simulated_per_real_time": sum(r["seconds"] for r in whole)
        / sum(r["took_s"] for r in whole),
        "findings": [f"piece {row['piece']}: {text}" for row in rows for text in row["findings"]],
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=HOURS)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--piece", type=int)
    parser.add_argument("--folder", type=Path, help="Of the pieces; build/soak/COMMIT if absent.")
    options = parser.parse_args()
    from proof import commit, kept

    folder = options.folder or ROOT / "build" / "soak" / commit()
    if options.piece is not None:
        sys.stdout.write(json.dumps(piece(options.piece, folder)) + "\n")
        return 0
    found = soak(options.hours, folder, options.jobs, kept)
    sys.stdout.write(json.dumps(found, indent=1) + "\n")
    return int(bool(found["findings"]))


if __name__ == "__main__":
    raise SystemExit(main())
