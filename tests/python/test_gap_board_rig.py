"""The board's rig states what is known of the board: the delay of a command follows from the
timers.
"""

from pathlib import Path

import numpy as np
import pytest

from vgroove.rig import read_rig

RIG = Path(__file__).resolve().parents[2] / "rigs" / "board_18v.toml"
# cycles, docs/architecture.md, "Time on the board"
CLOCK_HZ, TICK, PERIOD, FIRST_TOP, LATE, GUARD = 16e6, 16_000, 510, 255, 256, 250


def delay_cycles(tick: int) -> int:
    """From a tick to the TOP at which its staged command starts: applied with the tick, or 256
    cycles later where TOP is too near.
    """
    to_top = (FIRST_TOP - tick) % PERIOD
    return to_top if to_top >= GUARD else LATE + (FIRST_TOP - tick - LATE) % PERIOD


def test_the_rigs_delay_is_that_of_the_timers() -> None:
    found = [delay_cycles(TICK * (k + 1)) for k in range(PERIOD)]
    assert (min(found), max(found)) == (255, 755)
    assert read_rig(RIG).effects["transport_delay"]["delay_s"] == pytest.approx(
        np.mean(found) / CLOCK_HZ, rel=0.005
    )
