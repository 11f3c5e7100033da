"""Injects every fault into runs of every controller on the simulated AVR, at drawn instants, and
writes the table of docs/faults.md: fault_table.py [--check] [--draws N].
"""

import argparse
import re
import sys
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from vgroove import lockstep, telemetry
from vgroove.board import PERIOD_S, AvrBoard, default_elf
from vgroove.faults import FAULTS, FaultyBoard, Injection
from vgroove.html_page import Table
from vgroove.scenario import Scenario, command_messages, make_plant
from vgroove.study.fixed_point import DRILL, MODES, drill_scenario, impact_scenario

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "faults.md"
SEED = 20261125
PULLED_S = 0.3
RELEASE_S = {True: 1.8, False: 1.3}  # drill, impact: fixed_point's scenarios
# Drawn instants: after the run-up, early enough for the 0.5 s of stall_ms before the release.
FROM_S, TO_S = 0.45, 0.55
AT_S = {"trigger_stuck": 0.0, "eeprom_brown_out": 0.1}  # at power-on; at rest, before the trigger
LATE_S = 1.0  # by which the trigger is released later where the shaft first runs down
MIN_STOPPED_S = 0.02  # an open bridge for this long until the release is the end of the drive
RESET_CAUSES = {2: "brown-out", 3: "watchdog"}  # bits of MCUSR in BOOT


@dataclass(frozen=True)
class Outcome:
    """One run with a fault. `opened_ms`: from the fault to the end of the drive, None where it goes
    on until the release; `after_release_ms`: from the release to the open bridge; `named`: faults
    and resets in the telemetry after the fault; `ended_before`: the controller had ended the drive.
    """

    fault: str
    mode: int
    opened_ms: float | None
    after_release_ms: float
    named: tuple[str, ...]
    drove: bool
    ended_before: bool


def scenario_of(mode: int, rng: np.random.Generator) -> Scenario:
    """A drawn run of a controller."""
    volts, travel, seed = rng.uniform(17.0, 20.0), rng.uniform(0.6, 1.0), int(rng.integers(1e9))
    if mode == DRILL:
        return drill_scenario("drill_driver_low", float(rng.uniform(1.0, 6.0)), travel, volts, seed)
    return impact_scenario(mode, str(rng.choice(["m10", "disc_spring"])), travel, volts, seed)


def released_later(scenario: Scenario, late_s: float) -> Scenario:
    """The scenario with the release of the trigger `late_s` later."""
    *held, pulled, end = scenario.profile.travel
    travel = (*held, *((time_s + late_s, value) for time_s, value in (pulled, end)))
    profile = replace(scenario.profile, travel=travel)
    return replace(scenario, duration_s=scenario.duration_s + late_s, profile=profile)


def outcome(name: str, mode: int, draw: int) -> Outcome:
    """Run a drawn scenario of a mode with a fault at a drawn instant."""
    rng = np.random.default_rng([SEED, list(FAULTS).index(name), mode, draw])
    late_s = LATE_S if name == "bridge_fault" else 0.0
    scenario = released_later(scenario_of(mode, rng), late_s)
    at_s = AT_S.get(name, float(rng.uniform(FROM_S, TO_S)))
    injection = Injection(FAULTS[name], at_s)
    elf = default_elf("uno", "drill" if mode == DRILL else "impact")
    board = AvrBoard(elf, seed=scenario.seed, **injection.board_options())
    line = lockstep.Script(command_messages(scenario.commands))
    options = lockstep.LockstepOptions(front=scenario.front_ends(), line=line, seed=scenario.seed)
    with FaultyBoard(board, injection, scenario.seed) as faulty:
        tool = make_plant(scenario.tool, scenario.seed)
        sent = lockstep.run(faulty, tool, scenario.profile, scenario.duration_s, options)
    release_s = RELEASE_S[mode == DRILL] + late_s
    return judged((name, mode), (at_s, release_s), faulty.commands, named_faults(sent, at_s))


def judged(
    run: tuple[str, int],
    times_s: tuple[float, float],
    commands: list[int | None],
    named: tuple[str, ...],
) -> Outcome:
    """Outcome of a run of (fault, mode). times_s: of the fault and of the release of the trigger;
    commands: compare value of each PWM period, None for an open bridge.
    """
    at_s, release_s = times_s
    driven = np.array([command is not None for command in commands])
    time_s = np.arange(len(driven)) * PERIOD_S
    last = time_s[driven & (time_s < release_s)]
    last_s = float(last[-1]) + PERIOD_S if len(last) else 0.0
    stopped = last_s < release_s - MIN_STOPPED_S
    tail = time_s[driven & (time_s >= release_s)]
    after_ms = 1e3 * (float(tail[-1]) + PERIOD_S - release_s) if len(tail) else 0.0
    return Outcome(
        *run,
        max(0.0, 1e3 * (last_s - at_s)) if stopped else None,
        after_ms,
        named,
        bool(driven[time_s >= at_s].any()),
        stopped and 0.0 < last_s < at_s - MIN_STOPPED_S,
    )


def named_faults(sent: bytes, at_s: float) -> tuple[str, ...]:
    """Faults of STATE and reset causes of BOOT in the telemetry after the fault."""
    names, found = telemetry.value_table("STATE", "faults"), []
    frames, begun = telemetry.Framer().feed(sent), False
    for frame in frames:
        if frame.id == telemetry.BOOT:
            cause = telemetry.decode_integers(frame)["reset_cause"]
            found += [text for bit, text in RESET_CAUSES.items() if cause >> bit & 1]
            begun = begun or frame.time_ms < 50 and bool(found)
        elif frame.id == telemetry.STATE and (begun or frame.time_ms >= 1e3 * at_s):
            bits = telemetry.decode_integers(frame)["faults"]
            found += [text for bit, text in names.items() if bits & bit]
    return tuple(dict.fromkeys(found))


def table(outcomes: Iterable[Outcome]) -> Table:
    """The table of the page: a row for each fault."""
    header = (
        "fault",
        "what happens",
        "runs",
        "end of the drive after the fault in ms, median",
        "worst",
        "drives on until the release",
        "bridge open after the release in ms, worst",
        "named in the log",
    )
    rows = []
    for name, fault in FAULTS.items():
        mine = [o for o in outcomes if o.fault == name and not o.ended_before]
        opened = [o.opened_ms for o in mine if o.opened_ms is not None]
        named = list(dict.fromkeys(text for o in mine for text in o.named))
        rows.append(
            (
                f"`{name}`",
                fault.text,
                len(mine),
                round(float(np.median(opened)), 1) if opened else None,
                round(max(opened), 1) if opened else None,
                sum(o.opened_ms is None for o in mine),
                round(max((o.after_release_ms for o in mine if o.opened_ms is None), default=0), 1),
                ", ".join(named) or "-",
            )
        )
    return Table("faults", "", header, rows)


def all_outcomes(draws: int) -> list[Outcome]:
    """Every fault in every mode, `draws` times."""
    found = []
    for name in FAULTS:
        for mode in range(len(MODES)):
            found += [outcome(name, mode, draw) for draw in range(draws)]
        sys.stderr.write(f"{name}\n")
    return found


def page_text(shown: Table) -> str:
    """The page with a new table between its markers."""
    marks = re.compile(r"(<!-- fault table -->\n).*?(\n<!-- end of table -->)", re.DOTALL)
    return marks.sub(lambda m: m[1] + shown.as_markdown() + m[2], PAGE.read_text("utf-8"))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="compare, write nothing")
    parser.add_argument("--draws", type=int, default=2)
    options = parser.parse_args()
    text = page_text(table(all_outcomes(options.draws)))
    if options.check:
        return int(text != PAGE.read_text("utf-8"))
    PAGE.write_text(text, "utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
