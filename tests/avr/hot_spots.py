"""Cycles of the longest tick by function: `hot_spots.py ELF [SCENARIO]` runs a scenario on the
bench and lists the functions by cycles.

Link-time optimisation inlines most of a tick into main; an ELF built with
-DCMAKE_C_FLAGS=-fno-inline shows the functions.
"""

import argparse
import bisect
import subprocess
import tempfile
from collections import Counter
from pathlib import Path

from vgroove import lockstep
from vgroove.board import AvrBoard, read_statistics
from vgroove.scenario import command_messages, make_plant, read_scenario

STRESS = Path(__file__).resolve().parents[2] / "scenarios" / "stress.toml"


def symbols(elf: Path) -> list[tuple[int, str]]:
    """(address, name) of the ELF's code symbols, in ascending order."""
    listing = subprocess.run(
        ["avr-nm", "-n", str(elf)], capture_output=True, text=True, check=True
    ).stdout
    rows = [
        (int(address, 16), kind, name)
        for address, kind, name in (line.split() for line in listing.splitlines())
    ]
    return [
        (address, name)
        for address, kind, name in rows
        if kind in "tTwW" and address < 0x800000 and name != "__stack"
    ]


def by_function(table: Path, elf: Path) -> tuple[Counter[str], Counter[str]]:
    """Cycles by function: of the whole run, and of the longest tick."""
    rows = [tuple(map(int, line.split())) for line in table.read_text().splitlines()]
    known = symbols(elf)
    starts = [address for address, _ in known]
    everything, worst = Counter(), Counter()
    for address, total, tick in rows:
        name = known[bisect.bisect_right(starts, address) - 1][1]
        everything[name] += total
        worst[name] += tick
    return everything, worst


def main() -> None:
    """Run the scenario and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("elf", type=Path)
    parser.add_argument("scenario", type=Path, nargs="?", default=STRESS)
    parser.add_argument("--mcu", default="atmega328p")
    arguments = parser.parse_args()
    scenario = read_scenario(arguments.scenario)
    with tempfile.TemporaryDirectory() as folder:
        table, stats = Path(folder) / "profile", Path(folder) / "stats"
        with AvrBoard(arguments.elf, mcu=arguments.mcu, profile=table, stats=stats) as board:
            lockstep.run(
                board,
                make_plant(scenario.tool, 1),
                scenario.profile,
                scenario.duration_s,
                lockstep.LockstepOptions(
                    front=scenario.front_ends(),
                    line=lockstep.Script(command_messages(scenario.commands)),
                ),
            )
        everything, worst = by_function(table, arguments.elf)
        report = read_statistics(stats)
    head = f"{'function':32}{'worst tick':>12}{'whole run':>14}   worst tick {report['tick']}"
    print(head)  # noqa: T201
    for name, cycles in sorted(worst.items(), key=lambda item: -item[1])[:25]:
        print(f"{name:32}{cycles:12}{everything[name]:14}")  # noqa: T201


if __name__ == "__main__":
    main()
