"""The table of a page that states whether the firmware of each log is the believed one."""

from collections.abc import Sequence

from vgroove.firmware_replay.kinds import FirmwareResult
from vgroove.page import Table

HEADER = ["log", "firmware", "first tick apart / s", "signal", "logged", "expected"]


def firmware_table(results: Sequence[FirmwareResult]) -> Table:
    """One row for each log: the finding, and the first tick that the believed firmware does not
    give.
    """
    rows = []
    for result in results:
        first = result.first or {}
        found = [first.get(name) for name in ("time_s", "signal", "logged", "expected")]
        rows.append([result.log, result.kind or "as believed", *found])
    return Table("firmware", "Firmware on the measured inputs", HEADER, rows)
