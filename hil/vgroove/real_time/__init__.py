"""Hardware in the loop in real time: the host simulates the tool, a board runs the firmware, and
both exchange sensor counts and bridge commands once a millisecond (docs/hil.md).
"""

from vgroove.real_time.exchange import Exchange, RealTimeRun, run_in_real_time
from vgroove.real_time.figures import timing_figures
from vgroove.real_time.frames import Drive, TickInputs
from vgroove.real_time.link import BusLink, SerialLink

__all__ = [
    "BusLink",
    "Drive",
    "Exchange",
    "RealTimeRun",
    "SerialLink",
    "TickInputs",
    "run_in_real_time",
    "timing_figures",
]
