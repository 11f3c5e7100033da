"""Cycles of the controllers on the AVR: `impact_cycles.py [CASE ...]` replays the tapes of
impact.py, without names all of them.
"""

import sys
import tempfile
from pathlib import Path

from builds import BUILDS, RUNS, Build
from equality import differences, sent_bytes
from impact import impact_tape, random_tape

from vgroove import board, sil
from vgroove.board import read_statistics

ROOT = Path(__file__).resolve().parents[2]


def line(tape: bytes, build: Build) -> str:
    """Cycles and free stack of a tape on a build, and its first difference to native."""
    elf = ROOT / "build" / build.folder / "vgroove.elf"
    with tempfile.TemporaryDirectory() as folder:
        stats = Path(folder) / "stats.json"
        avr = sent_bytes(board.replay(elf, tape, mcu=build.mcu, stats=stats))
        report = read_statistics(stats)
    control, tick = report["control"], report["tick"]
    found = differences(sent_bytes(sil.replay(tape, target=1)), avr)
    return (
        f"step worst {control['worst_cycles']} mean {control['mean_cycles']:.0f}, "
        f"tick worst {tick['worst_cycles']} mean {tick['mean_cycles']:.0f}, "
        f"stack free {report['stack']['free_bytes']}; {found[0] if found else 'equals native'}"
    )


def main() -> None:
    """Print two lines for each case and build that has its mode."""
    for name, key in RUNS:
        if sys.argv[1:] and name not in sys.argv[1:]:
            continue
        build = BUILDS[key]
        sys.stdout.write(
            f"{name:17} {build.mcu:10} impacts: {line(impact_tape(name), build)}\n"
            f"{name:17} {build.mcu:10} random:  {line(random_tape(name), build)}\n"
        )


if __name__ == "__main__":
    main()
