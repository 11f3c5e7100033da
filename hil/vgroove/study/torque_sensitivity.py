"""Error of torque control with a tool whose values differ from those of the map, one value at a
time.

`python -m vgroove.study.torque_sensitivity`
"""

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
from rich.console import Console

from vgroove.control_bench.draw import TOOL_VALUES
from vgroove.control_bench.runs import reference, sil_run
from vgroove.control_bench.torque import REASONS_REFUSED, DriveEnd, reason_of
from vgroove.control_bench.torque_drawn import MAX_SECONDS, MISSED
from vgroove.html_page import Table
from vgroove.reference.joints import REFERENCE_JOINTS
from vgroove.terminal import print_results, table_console

TARGETS_NM = (60.0, 80.0, 100.0, 120.0)
SLOPES = (60.0, 180.0)  # N m/rad: a soft and a hard joint
SHARES = (-0.03, -0.01, 0.01, 0.03)  # of the nominal value
COLUMNS = ("value", "off by", "mean error", "least", "largest", "misses not reported", "of")


def error(name: str, share: float, target_nm: float, slope: float) -> tuple[float, bool]:
    """Error of the torque over the target, and whether the board reported it as reached."""
    load = {**REFERENCE_JOINTS["hard_joint"].load, "slip_slope_nm_per_rad": slope}
    rig = reference(load)
    run = sil_run(
        rig.with_values({name: rig.value(name) * (1.0 + share)}),
        mode="torque",
        params={"torque_target_nm": target_nm},
        duration_s=MAX_SECONDS,
        stop_when=DriveEnd(),
    )
    reached = reason_of(run) not in (*REASONS_REFUSED, "timeout")
    return run.tightened_nm / target_nm - 1.0, reached


def row(name: str, share: float) -> list[Any]:
    """Figures of one value over all targets and slopes."""
    found = [error(name, share, *cell) for cell in product(TARGETS_NM, SLOPES)]
    errors = np.array([value for value, _ in found])
    missed_reported_reached = sum(reached and abs(value) > MISSED for value, reached in found)
    figures = (errors.mean(), errors.min(), errors.max())
    return [
        name,
        f"{100 * share:+g} %",
        *(f"{100 * f:+.1f} %" for f in figures),
        missed_reported_reached,
        len(found),
    ]


def table(names: Sequence[str] = TOOL_VALUES, shares: Sequence[float] = SHARES) -> Table:
    """One row for each value and share."""
    rows = [row(name, share) for name, share in product(names, shares)]
    title = "Error of the torque with one value of the tool off"
    return Table("torque_sensitivity", title, list(COLUMNS), rows)


def main() -> None:
    """Print the table."""
    console: Console = table_console(None, None, piped_width=160)
    print_results(console, [], [table()])


if __name__ == "__main__":
    main()
