"""What the controllers cost on the ELF: `impact_cycles.py [CASE ...]` replays the impact tapes of impact.py; without names all of them."""

import sys
import tempfile
from pathlib import Path

from equality import differences, sent_bytes
from impact import CASES, impact_tape

from vgroove import board, sil
from vgroove.board import read_statistics

ROOT = Path(__file__).resolve().parents[2]


def main() -> None:
    """A line a case."""
    elf = ROOT / "build" / "avr-uno" / "vgroove.elf"
    with tempfile.TemporaryDirectory() as folder:
        for name in sys.argv[1:] or CASES:
            tape, stats = impact_tape(name), Path(folder) / "stats.json"
            avr = sent_bytes(board.replay(elf, tape, stats=stats))
            said = read_statistics(stats)
            control, tick = said["control"], said["tick"]
            found = differences(sent_bytes(sil.replay(tape, target=1)), avr)
            sys.stdout.write(f"{name}: step worst {control['worst_cycles']} mean {control['mean_cycles']:.0f}, tick worst {tick['worst_cycles']} mean "
                             f"{tick['mean_cycles']:.0f}, stack free {said['stack']['free_bytes']}; {found[0] if found else 'equals native'}\n")


if __name__ == "__main__":
    main()
