"""`vgroove bench control`: every part of the controllers' bench, as one report."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from vgroove.control_bench import (
    blows,
    blows_drawn,
    bound,
    drill,
    screwing,
    screwing_drawn,
    sync,
    sync_drawn,
    torque,
    torque_adapted,
    torque_drawn,
    vibration,
    vibration_drawn,
)
from vgroove.control_bench.blows_drawn_page import blows_drawn_report
from vgroove.control_bench.blows_page import blows_report
from vgroove.control_bench.drill_page import drill_report
from vgroove.control_bench.jobs import Figures, Job, run_jobs
from vgroove.control_bench.screwing_drawn_page import screwing_drawn_report
from vgroove.control_bench.screwing_page import screwing_report
from vgroove.control_bench.sets import fifth
from vgroove.control_bench.sync_drawn_page import sync_drawn_report
from vgroove.control_bench.sync_page import sync_report
from vgroove.control_bench.torque_drawn_page import ADAPTED, torque_drawn_report
from vgroove.control_bench.torque_page import torque_report
from vgroove.control_bench.vibration_drawn_page import vibration_drawn_report
from vgroove.control_bench.vibration_page import vibration_report
from vgroove.progress import step_bar
from vgroove.result_files import Report, join_reports


@dataclass(frozen=True)
class Choice:
    """How much is run: one half of the cells or both (None), a fifth of them, the number of draws
    of each; the number of worker processes; the folder where finished figures are kept.
    """

    half: str | None = None
    only_fifth: bool = False
    draws: int = 1
    workers: int | None = None
    keep: Path | None = None

    def of(self, cells: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
        """The chosen ones of the cells."""
        chosen = [cell for cell in cells if self.half in (None, cell["set"])]
        return fifth(chosen) if self.only_fifth else chosen


def rows_of(jobs: Sequence[Job], text: str, choice: Choice) -> list[Figures]:
    """The figures of the jobs; a progress bar with `text` is shown on stderr."""
    with step_bar(len(jobs)) as tick:
        return run_jobs(jobs, tick, text, choice.workers, choice.keep)


def blows_part(choice: Choice) -> Report:
    """Blow detection."""
    return blows_report(rows_of(blows.jobs(choice.of(blows.cells())), "blow detection", choice))


def blows_drawn_part(choice: Choice) -> Report:
    """Blow detection on drawn cells."""
    cells = choice.of(blows_drawn.cells(blows_drawn.DRAWS * choice.draws))
    return blows_drawn_report(rows_of(blows_drawn.jobs(cells), "drawn blow detection", choice))


def sync_part(choice: Choice) -> Report:
    """Synchronisation of the reference tool and of drawn tools; cells that are not clean, with the
    reason.
    """
    rows = rows_of(sync.jobs(choice.of(sync.cells())), "synchronisation", choice)
    others = rows_of(sync.jobs(choice.of(sync.other_cells())), "other tools", choice)
    unclean = sync.unclean([*rows, *others])
    searched = rows_of(sync.search_jobs(unclean), "constant duties", choice)
    return sync_report(rows, others, [sync.with_reason(row, searched) for row in unclean])


def screwing_part(choice: Choice) -> Report:
    """Precise screwing."""
    return screwing_report(
        rows_of(screwing.jobs(choice.of(screwing.cells(choice.draws))), "precise screwing", choice)
    )


def vibration_part(choice: Choice) -> Report:
    """Low vibration, beside the bound that a search with full knowledge of the tool finds."""
    cells = choice.of(vibration.cells())
    jobs = vibration.jobs(cells) + ([] if choice.only_fifth else bound.jobs(cells))
    margin = [] if choice.only_fifth else rows_of(vibration.margin_jobs(), "margin", choice)
    return vibration_report(rows_of(jobs, "low vibration", choice), margin)


def torque_part(choice: Choice) -> Report:
    """Torque control."""
    maps = [
        row
        for found in rows_of(torque.map_jobs(), "reachable targets", choice)
        for row in found["map"]
    ]
    cells = choice.of(torque.cells(torque.RUNS * choice.draws))
    return torque_report(rows_of(torque.jobs(cells, maps), "torque control", choice), maps)


def sync_drawn_part(choice: Choice) -> Report:
    """Synchronisation on drawn cells."""
    cells = choice.of(sync_drawn.cells(sync_drawn.DRAWS * choice.draws))
    return sync_drawn_report(rows_of(sync_drawn.jobs(cells), "drawn synchronisation", choice))


def screwing_drawn_part(choice: Choice) -> Report:
    """Precise screwing on drawn screws."""
    cells = choice.of(screwing_drawn.cells(screwing_drawn.DRAWS * choice.draws))
    return screwing_drawn_report(rows_of(screwing_drawn.jobs(cells), "drawn screwing", choice))


def vibration_drawn_part(choice: Choice) -> Report:
    """Low vibration on drawn cells."""
    cells = choice.of(vibration_drawn.cells(vibration_drawn.DRAWS * choice.draws))
    return vibration_drawn_report(rows_of(vibration_drawn.jobs(cells), "drawn vibration", choice))


def torque_drawn_part(choice: Choice) -> Report:
    """Torque control on drawn cells."""
    cells = choice.of(torque_drawn.cells(torque_drawn.DRAWS * choice.draws))
    return torque_drawn_report(rows_of(torque_drawn.jobs(cells), "drawn torque control", choice))


def torque_adapted_part(choice: Choice) -> Report:
    """Torque control of tools of their own."""
    cells = choice.of(torque_adapted.cells(torque_drawn.DRAWS * choice.draws))
    maps = rows_of(torque_adapted.map_jobs(cells), "torque maps", choice)
    jobs = torque_adapted.jobs(cells, maps)
    return torque_drawn_report(rows_of(jobs, "adapted torque control", choice), ADAPTED)


def drill_part(choice: Choice) -> Report:
    """Drill driver."""
    return drill_report(
        rows_of(drill.jobs(choice.of(drill.cells(choice.draws))), "drill driver", choice)
    )


PARTS: dict[str, Callable[[Choice], Report]] = {
    "blows": blows_part,
    "blows_drawn": blows_drawn_part,
    "sync": sync_part,
    "sync_drawn": sync_drawn_part,
    "screwing": screwing_part,
    "screwing_drawn": screwing_drawn_part,
    "vibration": vibration_part,
    "vibration_drawn": vibration_drawn_part,
    "torque": torque_part,
    "torque_drawn": torque_drawn_part,
    "torque_adapted": torque_adapted_part,
    "drill": drill_part,
}


FIXED_PARTS = ("blows", "sync", "vibration")  # their cells are a matrix that nothing is drawn for


def fixed_sentence(parts: Sequence[str]) -> str:
    """A sentence on the named parts whose cells Choice.draws does not change; empty for none."""
    fixed = [name for name in parts if name in FIXED_PARTS]
    return f"the cells of {', '.join(fixed)} are fixed, without random draws" if fixed else ""


def control_bench(parts: Sequence[str], choice: Choice) -> Report:
    """The named parts as one report."""
    report = join_reports(
        "Controllers: every figure with and without", [PARTS[name](choice) for name in parts]
    )
    fixed = fixed_sentence(parts)
    if choice.draws > 1 and fixed:
        report = replace(report, lines=[f"--draws: {fixed}.", *report.lines])
    report.data["set"] = choice.half or "both"
    report.data["fifth"] = choice.only_fifth
    return report
