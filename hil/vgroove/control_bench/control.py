"""`vgroove bench control`: every part of the controllers' bench, in worker processes, as one study."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vgroove.control_bench import blows, bound, drill, screwing, sync, torque, vibration
from vgroove.control_bench.blows_page import blows_study
from vgroove.control_bench.drill_page import drill_study
from vgroove.control_bench.jobs import Figures, Job, run_jobs
from vgroove.control_bench.screwing_page import screwing_study
from vgroove.control_bench.sets import fifth
from vgroove.control_bench.sync_page import sync_study
from vgroove.control_bench.torque_page import torque_study
from vgroove.control_bench.vibration_page import vibration_study
from vgroove.study.command import progress
from vgroove.study.report import Study, joined


@dataclass(frozen=True)
class Choice:
    """How much is run: one half or both, a fifth of the cells, several draws of each; in how many
    processes; where figures are kept.
    """

    half: str | None = None
    only_fifth: bool = False
    draws: int = 1
    workers: int | None = None
    keep: Path | None = None

    def of(self, cells: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
        """Those of the cells that are asked for."""
        chosen = [cell for cell in cells if self.half in (None, cell["set"])]
        return fifth(chosen) if self.only_fifth else chosen


def rows_of(jobs: Sequence[Job], words: str, choice: Choice) -> list[Figures]:
    """The jobs' figures, with a bar on stderr."""
    with progress(len(jobs)) as tick:
        return run_jobs(jobs, tick, words, choice.workers, choice.keep)


def blows_part(choice: Choice) -> Study:
    """Blow detection."""
    return blows_study(rows_of(blows.jobs(choice.of(blows.cells())), "blow detection", choice))


def sync_part(choice: Choice) -> Study:
    """Synchronisation, of the reference tool and of others; what is not clean, and why."""
    rows = rows_of(sync.jobs(choice.of(sync.cells())), "synchronisation", choice)
    others = rows_of(sync.jobs(choice.of(sync.other_cells())), "other tools", choice)
    unclean = sync.unclean([*rows, *others])
    searched = rows_of(sync.search_jobs(unclean), "constant duties", choice)
    return sync_study(rows, others, [sync.with_reason(row, searched) for row in unclean])


def screwing_part(choice: Choice) -> Study:
    """Precise screwing."""
    return screwing_study(
        rows_of(screwing.jobs(choice.of(screwing.cells(choice.draws))), "precise screwing", choice)
    )


def vibration_part(choice: Choice) -> Study:
    """Low vibration, with what full knowledge could do beside it."""
    cells = choice.of(vibration.cells())
    jobs = vibration.jobs(cells) + ([] if choice.only_fifth else bound.jobs(cells))
    margin = [] if choice.only_fifth else rows_of(vibration.margin_jobs(), "margin", choice)
    return vibration_study(rows_of(jobs, "low vibration", choice), margin)


def torque_part(choice: Choice) -> Study:
    """Torque control."""
    maps = [
        row
        for found in rows_of(torque.map_jobs(), "reachable targets", choice)
        for row in found["map"]
    ]
    cells = choice.of(torque.cells(torque.RUNS * choice.draws))
    return torque_study(rows_of(torque.jobs(cells, maps), "torque control", choice), maps)


def drill_part(choice: Choice) -> Study:
    """Drill driver."""
    return drill_study(
        rows_of(drill.jobs(choice.of(drill.cells(choice.draws))), "drill driver", choice)
    )


PARTS: dict[str, Callable[[Choice], Study]] = {
    "blows": blows_part,
    "sync": sync_part,
    "screwing": screwing_part,
    "vibration": vibration_part,
    "torque": torque_part,
    "drill": drill_part,
}


def control_bench(parts: Sequence[str], choice: Choice) -> Study:
    """The named parts as one study."""
    study = joined(
        "Controllers: every figure with and without", [PARTS[name](choice) for name in parts]
    )
    study.data["set"] = choice.half or "both"
    study.data["fifth"] = choice.only_fifth
    return study
