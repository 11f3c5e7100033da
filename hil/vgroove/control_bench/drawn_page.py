"""What the pages of all parts with drawn values have in common."""

from collections.abc import Callable, Sequence
from typing import Any

from vgroove.control_bench.draw import STRATA, seeds_line
from vgroove.control_bench.goals import Goal, part_lines, part_report
from vgroove.control_bench.jobs import Figures
from vgroove.control_bench.sets import by_half
from vgroove.html_page import Table
from vgroove.result_files import Report

ALL = "both"  # the strata of tools together


def summaries(
    rows: Sequence[Figures],
    compare: Callable[[Sequence[Figures], str], Figures],
    strata: Sequence[str] = STRATA,
    without: str | None = None,
) -> list[Figures]:
    """The figures of each stratum, variant and half. compare: from the rows of a stratum and half
    and the name of a variant; without: a variant that is left out.
    """
    found = []
    for stratum in strata:
        chosen = [row for row in rows if stratum in (ALL, row["stratum"])]
        for variant in dict.fromkeys(row["variant"] for row in chosen):
            if variant != without:
                for half, part in by_half(chosen):
                    found.append({"stratum": stratum, "set": half, **compare(part, variant)})
    return found


def drawn_report(
    name: str,
    words: str,
    tables: Sequence[Table],
    goals: Sequence[Goal],
    data: dict[str, Any],
) -> Report:
    """A part with drawn values as a report. name, words: of the part, in data and in sentences;
    data: its figures, with every run as `cells`.
    """
    lines = [*part_lines(goals, data["cells"], words), seeds_line()]
    return part_report(lines, tables, [], {name: data | {"goals": [g.as_dict() for g in goals]}})
