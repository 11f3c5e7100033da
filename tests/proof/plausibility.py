"""False trips and detection of a wrong current sensor (firmware/app/faults.c, balance.c), native
firmware: drawn runs of every controller with a drawn tool, without a fault and with each fault of a
sensor. plausibility.py [--runs N] [--faulty N] [--first N] [--jobs N]
"""

import argparse
import json
import sys
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from vgroove import lockstep
from vgroove.control_bench.runs import front_ends
from vgroove.faults import FAULTS, FaultyBoard, Injection
from vgroove.reference.joints import REFERENCE_JOINTS
from vgroove.scenario import Command, Scenario, command_messages, make_plant
from vgroove.sil import SilBoard
from vgroove.study.fixed_point import DRILL, MODES, drill_scenario, impact_scenario
from vgroove.telemetry import parameter_list

sys.path.append(str(Path(__file__).resolve().parents[1] / "avr"))

from fault_table import RELEASE_S, judged, named_faults  # noqa: E402

RUNS, FAULTY_RUNS = 600, 120
SENSOR_FAULTS = ("current_stuck", "current_offset", "adc_reference")
NAMED = "sensor_lost"
FAULT_S = (0.45, 0.8)  # after the start of the ramp, before the release
OPEN_S = 0.5  # by which a run goes on after the release, for what an open bridge shows
# Tool: relative to the reference. The resistance of a copper winding is 1.4 at 125 C.
CONSTANT, RESISTANCE, INERTIA, FRICTION = (0.9, 1.05), (0.9, 1.45), (0.9, 1.1), (0.7, 1.5)
PACK_OHM, VOLTS, TRAVEL = (0.0, 0.2), (16.0, 20.5), (0.3, 1.0)
REVERSE_SHARE = 0.15
QUIET_SHARE = 1 / 3  # of runs without noise: what a simulator without noise shows
NOISE = (0.5, 2.0)  # relative to the sensors of the reference drive
MOVED_SHARE = 0.5  # of runs whose trigger moves during the first drive
MOVES, MOVE_S = 7, (0.004, 0.03)  # most of these moves, and their duration
RAMPED_SHARE = 0.5  # of runs whose release ramps down
AGAIN_S, HELD_S = (0.03, 0.4), (0.05, 0.6)  # pause before the trigger is pulled again, and how long
JAMS_NM = (15.0, 40.0)  # of the drill driver in low gear, beside loads of 0 to 12 N m


@dataclass(frozen=True)
class Run:
    """A drawn run. number: mode, tool and scenario are drawn from it; fault: name of the injected
    fault, empty without one.
    """

    number: int
    fault: str = ""


def drawn_tool(scenario: Scenario, rng: np.random.Generator) -> Scenario:
    """The scenario with a drawn tool."""
    motor = scenario.tool.as_dict()["motor"]
    spans = {
        "torque_constant_nm_per_a": CONSTANT,
        "resistance_ohm": RESISTANCE,
        "inertia_kg_m2": INERTIA,
        "coulomb_nm": FRICTION,
    }
    values = {f"motor.{key}": float(motor[key] * rng.uniform(*span)) for key, span in spans.items()}
    values["supply.resistance_ohm"] = float(rng.uniform(*PACK_OHM))
    return replace(scenario, tool=scenario.tool.with_values(values))


def drawn_scenario(number: int) -> tuple[int, Scenario]:
    """Mode and scenario of a run: the modes in turn; joint, load, trigger, direction, bus voltage
    and tool are drawn.
    """
    rng, mode = np.random.default_rng([20261126, number]), number % len(MODES)
    volts, travel, seed = rng.uniform(*VOLTS), rng.uniform(*TRAVEL), int(rng.integers(1e9))
    if mode == DRILL:
        gear = str(rng.choice(["drill_driver_low", "drill_driver_high"]))
        load_nm = float(rng.choice([rng.uniform(0.0, 12.0), *JAMS_NM]))
        scenario = drill_scenario(gear, load_nm, travel, volts, seed)
    else:
        joint = str(rng.choice(list(REFERENCE_JOINTS)))
        scenario = impact_scenario(mode, joint, travel, volts, seed)
    profile = scenario.profile
    if rng.random() < REVERSE_SHARE:
        profile = replace(profile, reverse=((0.0, 1.0),))
    duration_s = scenario.duration_s + OPEN_S
    return mode, drawn_tool(replace(scenario, profile=profile, duration_s=duration_s), rng)


def moved_trigger(
    travel: tuple[tuple[float, float], ...], rng: np.random.Generator
) -> tuple[tuple[float, float], ...]:
    """Points (time in s, level) of the trigger's travel, with changes to random levels during the
    first pull.
    """
    (*pulled, begin), end = travel[:3], travel[3]
    times = np.sort(rng.uniform(begin[0], end[0] - MOVE_S[1], int(rng.integers(1, MOVES + 1))))
    points, level = [*pulled, begin], begin[1]
    for time_s in times:
        if time_s > points[-1][0]:
            points.append((float(time_s), level))
            level = float(rng.uniform(*TRAVEL))
            points.append((float(time_s + rng.uniform(*MOVE_S)), level))
    return (*points, (end[0], level), *travel[4:])


def drawn_front(scenario: Scenario, number: int) -> lockstep.FrontEnds:
    """The board's sensors with drawn noise, or none where the scenario has none."""
    share = float(np.random.default_rng([20261128, number]).uniform(*NOISE))
    noisy = front_ends(scenario.noise)
    return replace(
        noisy,
        current_noise_a=share * noisy.current_noise_a,
        supply_noise_v=share * noisy.supply_noise_v,
    )


def used_by_hand(scenario: Scenario, number: int) -> Scenario:
    """The scenario with a drawn release mode, moves of the trigger in a share MOVED_SHARE of the
    runs, up to three further pulls soon after the release, and sensors without noise in a share
    QUIET_SHARE.
    """
    rng = np.random.default_rng([20261127, number])
    travel, now = list(scenario.profile.travel), scenario.profile.travel[-1][0]
    for _ in range(int(rng.integers(0, 4))):
        begin = now + rng.uniform(*AGAIN_S)
        now = begin + rng.uniform(*HELD_S)
        level = rng.uniform(*TRAVEL)
        travel += [(begin, 0.0), (begin + 0.02, level), (now, level), (now + 0.02, 0.0)]
        now += 0.02
    index = [parameter.name for parameter in parameter_list()].index("release_mode")
    ramped = int(rng.random() < RAMPED_SHARE)
    write = Command(0.1, "PARAM_WRITE", {"write_index": index, "write_value": ramped})
    if rng.random() < MOVED_SHARE:
        travel = list(moved_trigger(tuple(travel), rng))
    return replace(
        scenario,
        profile=replace(scenario.profile, travel=tuple(travel)),
        duration_s=max(scenario.duration_s, now + OPEN_S),
        commands=(*scenario.commands, write),
        noise=bool(rng.random() >= QUIET_SHARE),
    )


def outcome(run: Run) -> dict[str, Any]:
    """Faults that the telemetry names after the fault, and when the drive ended after it in ms
    (None: it went on until the release).
    """
    mode, scenario = drawn_scenario(run.number)
    if not run.fault:
        scenario = used_by_hand(scenario, run.number)
    at_s = float(np.random.default_rng([run.number, 5]).uniform(*FAULT_S)) if run.fault else 0.0
    board: Any = SilBoard()
    if run.fault:
        board = FaultyBoard(board, Injection(FAULTS[run.fault], at_s), scenario.seed)
    options = lockstep.LockstepOptions(
        front=drawn_front(scenario, run.number),
        line=lockstep.Script(command_messages(scenario.commands)),
        seed=scenario.seed,
    )
    tool = make_plant(scenario.tool, scenario.seed)
    sent = lockstep.run(board, tool, scenario.profile, scenario.duration_s, options)
    row = {"number": run.number, "mode": MODES[mode], "named": named_faults(sent, at_s)}
    if run.fault:
        times_s = at_s, RELEASE_S[mode == DRILL]
        found = judged((run.fault, mode), times_s, board.commands, row["named"])
        row |= {"ended_ms": found.opened_ms, "ended_before": found.ended_before}
    return row


def without_fault(rows: Iterable[dict[str, Any]]) -> dict[str, Any]:
    """Figures of the runs without a fault: how many there are, in how many the telemetry names each
    fault, and count and numbers of those in which it names NAMED: these are false trips.
    """
    rows = list(rows)
    named = Counter(name for row in rows for name in row["named"])
    false = [row["number"] for row in rows if NAMED in row["named"]]
    return {"runs": len(rows), "named": dict(named), "false_trips": len(false), "numbers": false}


def with_fault(rows: Iterable[dict[str, Any]]) -> dict[str, Any]:
    """Of runs with a fault: how many drives it ended before the release of the trigger, after what
    time in ms, which modes drove on, and in how many runs the telemetry names NAMED.
    """
    mine = [row for row in rows if not row["ended_before"]]
    ended = [row["ended_ms"] for row in mine if row["ended_ms"] is not None]
    goes_on = [row for row in mine if row["ended_ms"] is None]
    return {
        "runs": len(mine),
        "ended": len(ended),
        "median_ms": round(float(np.median(ended)), 1) if ended else None,
        "worst_ms": round(max(ended), 1) if ended else None,
        "goes_on": dict(Counter(row["mode"] for row in goes_on)),
        "named_in_drive_or_after": sum(NAMED in row["named"] for row in mine),
    }


def plausibility(runs: int, faulty: int, jobs: int, first: int = 0) -> dict[str, Any]:
    """Figures of all runs, from number `first` on, without a fault and with each fault. The runs
    are distributed over processes, because a process holds one instance of the native firmware.
    """
    with ProcessPoolExecutor(jobs) as pool:
        of = partial(pool.map, outcome, chunksize=4)
        found: dict[str, Any] = {
            "without_fault": without_fault(of([Run(first + n) for n in range(runs)])),
        }
        for fault in SENSOR_FAULTS:
            found[fault] = with_fault(of([Run(first + n, fault) for n in range(faulty)]))
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=RUNS)
    parser.add_argument("--faulty", type=int, default=FAULTY_RUNS)
    parser.add_argument("--first", type=int, default=0, help="number of the first run")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    found = plausibility(options.runs, options.faulty, options.jobs, options.first)
    sys.stdout.write(json.dumps(found, indent=1) + "\n")
    return int(found["without_fault"]["false_trips"] > 0)


if __name__ == "__main__":
    raise SystemExit(main())
