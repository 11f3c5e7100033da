"""The table of a page that states whether the firmware of each log is the assumed one."""

from collections.abc import Sequence

from vgroove.firmware_replay.closed_loop import ClosedLoop
from vgroove.firmware_replay.kinds import FirmwareResult
from vgroove.html_page import Table

HEADER = [
    "log",
    "firmware",
    "first tick apart / s",
    "signal",
    "logged",
    "expected",
    "closed loop with the rig",
    "with the corrected rig",
]


def firmware_table(results: Sequence[FirmwareResult]) -> Table:
    """One row for each log: the finding, the first tick that the assumed firmware does not give,
    and where the log leaves the firmware's closed loop with the simulated tool.
    """
    rows = []
    for result in results:
        first = result.first or {}
        found = [first.get(name) for name in ("time_s", "signal", "logged", "expected")]
        rows.append([result.log, result.kind or "as assumed", *found, *_loop(result.closed_loop)])
    return Table("firmware", "Firmware on the measured inputs, and in closed loop", HEADER, rows)


def _loop(found: ClosedLoop | None) -> list[str]:
    """The two cells on the closed loop."""
    if found is None:
        return ["", ""]
    cells = [found.nominal, *([found.corrected] if found.is_corrected else [])]
    words = ["within" if one is None else f"{one.time_s:.4g} s, {one.signal}" for one in cells]
    return [*words, ""][:2]
