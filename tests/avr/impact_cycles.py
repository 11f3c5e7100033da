"""Cycles of the controllers on the AVR: `impact_cycles.py [CASE ...]` replays the tapes of
impact.py, without names all of them.
"""

import sys
import tempfile
from pathlib import Path

from equality import differences, sent_bytes
from impact import CASES, impact_tape, random_tape

from vgroove import board, sil
from vgroove.board import read_statistics

ELF = Path(__file__).resolve().parents[2] / "build" / "avr-uno" / "vgroove.elf"


def line(tape: bytes) -> str:
    """Cycles and free stack of a tape, and its first difference to the native firmware."""
    with tempfile.TemporaryDirectory() as folder:
        stats = Path(folder) / "stats.json"
        avr = sent_bytes(board.replay(ELF, tape, stats=stats))
        report = read_statistics(stats)
    control, tick = report["control"], report["tick"]
    found = differences(sent_bytes(sil.replay(tape, target=1)), avr)
    return (
        f"step worst {control['worst_cycles']} mean {control['mean_cycles']:.0f}, "
        f"tick worst {tick['worst_cycles']} mean {tick['mean_cycles']:.0f}, "
        f"stack free {report['stack']['free_bytes']}; {found[0] if found else 'equals native'}"
    )


def main() -> None:
    """Print two lines per case."""
    for name in sys.argv[1:] or CASES:
        sys.stdout.write(
            f"{name:10} impacts: {line(impact_tape(name))}\n"
            f"{name:10} random:  {line(random_tape(name))}\n"
        )


if __name__ == "__main__":
    main()
