"""The command `vgroove gap bench`: choice of the cases, their run with a progress bar, the
tables.
"""

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from vgroove.errors import VgrooveError

if TYPE_CHECKING:
    from vgroove.gap_bench.cases import BlindSet
    from vgroove.gap_bench.scored import Scored

app = typer.Typer()  # its command is one of `vgroove gap`
COST_KEYS = ("number", "name", "without", "verdict", "seconds", "cpu_seconds", "memory_mib")
HALVES = ("tune", "report")
REGIMES = ("exact", "hard", "measured")
USUAL_REGIMES = REGIMES[:2]  # without --regime: the cases of simulated logs without disturbances
IMPACT_REGIMES = ("exact", "loose")  # of the hammering tool


@dataclass(frozen=True)
class Request:
    """The cases to run: a half, of it these regimes, and of these the first `count` or a fifth; or
    these numbers, whatever their regime.

    `removed` runs all single cases a second time without their effect in the catalogue, `without`
    those of these effects; `jobs` cases run at a time; impact: the cases of the hammering tool.
    """

    half: str
    count: int | None = None
    fifth: bool = False
    numbers: Sequence[int] = ()
    removed: bool = False
    without: Sequence[str] = ()
    jobs: int = 1
    regimes: Sequence[str] = ()
    impact: bool = False

    @property
    def known_regimes(self) -> tuple[str, ...]:
        """The regimes that the set has."""
        return IMPACT_REGIMES if self.impact else REGIMES

    @property
    def chosen_regimes(self) -> Sequence[str]:
        """The regimes to run."""
        return self.regimes or (IMPACT_REGIMES if self.impact else USUAL_REGIMES)


@app.command("bench")
def bench_command(
    half: Annotated[
        str,
        typer.Option(
            "--set",
            help="tune: the half for development; report: the half for the reported figures.",
        ),
    ] = "tune",
    regime: Annotated[
        list[str] | None,
        typer.Option(
            help="exact, hard or measured (logs with disturbances); may be repeated. "
            "Without it exact and hard. With --impact exact or loose (joint or tool uncertain).",
        ),
    ] = None,
    impact: Annotated[bool, typer.Option("--impact", help="Logs of a hammering tool.")] = False,
    count: Annotated[
        int | None,
        typer.Option(min=1, help="Only the first cases of the half; their order is random."),
    ] = None,
    fifth: Annotated[bool, typer.Option("--fifth", help="The first fifth of the half.")] = False,
    number: Annotated[
        list[int] | None, typer.Option(help="These cases by number; may be repeated.")
    ] = None,
    removed: Annotated[
        bool,
        typer.Option(
            "--removed", help="Single cases a second time without their effect in the catalogue."
        ),
    ] = False,
    without: Annotated[
        list[str] | None,
        typer.Option(metavar="ID", help="As --removed, for this effect; may be repeated."),
    ] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Cases at a time.")] = 1,
    json_path: Annotated[
        Path | None, typer.Option("--json", help="Write all figures as JSON.")
    ] = None,
    html_path: Annotated[
        Path | None, typer.Option("--html", help="Write one self-contained page.")
    ] = None,
    page: Annotated[
        Path | None, typer.Option(help="Replace the tables in this page (docs/gap_bench.md).")
    ] = None,
) -> None:
    """The blind set: sealed cases of an independent generator, diagnosed one by one (kept, so a run
    resumes), opened and scored.
    """
    from vgroove.output import check_outputs

    check_outputs((json_path, html_path), ())
    if page:
        check_page(page)
    request = Request(
        half, count, fifth, number or (), removed, without or (), jobs, regime or (), impact
    )
    figures = run_bench(request, Console(stderr=True))
    _show_and_write(figures, json_path, html_path, page)


def check_page(page: Path) -> None:
    """VgrooveError for a page that cannot be read or has no places for the tables."""
    from vgroove.gap_bench.report import MARKS

    try:
        text = page.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise VgrooveError(f"--page {page}: cannot be read: {error}") from error
    missing = [mark for mark in MARKS if mark not in text]
    if missing:
        raise VgrooveError(f"--page {page}: the mark {missing[0]} is missing")


def _show_and_write(
    figures: dict[str, Any], json_path: Path | None, html_path: Path | None, page: Path | None
) -> None:
    """Print the tables; write all files or none."""
    from vgroove.gap_bench.report import bench_page, renewed, tables
    from vgroove.output import json_text, write_all
    from vgroove.terminal import result_console

    for table in tables(figures):
        result_console(json_path, html_path).print(table.as_rich())
    files = []
    if json_path:
        files.append((json_path, json_text(figures, allow_nan=True)))
    if html_path:
        files.append((html_path, bench_page(figures)))
    if page:
        files.append((page, renewed(page.read_text(encoding="utf-8"), figures)))
    write_all(files)


def run_bench(request: Request, console: Console) -> dict[str, Any]:
    """Run and score the cases; the figures of all tables. The progress bar goes to `console`."""
    from vgroove.gap.catalogue import BY_ID
    from vgroove.gap_bench.cases import BlindSet, find_checkout
    from vgroove.gap_bench.run import run_cases
    from vgroove.gap_bench.score import score
    from vgroove.progress import step_bar

    if request.half not in HALVES:
        raise VgrooveError(f"--set is {' or '.join(HALVES)}, not {request.half}")
    strange = sorted(set(request.without) - set(BY_ID))
    if strange:
        near = difflib.get_close_matches(strange[0], BY_ID, 1, 0.0)[0]
        raise VgrooveError(f"--without {strange[0]}: no effect has this id; the nearest is {near}")
    some = [name for name, one in (("--count", request.count), ("--fifth", request.fifth)) if one]
    some += ["--number"] if request.numbers else []
    if len(some) > 1:
        raise VgrooveError(f"{' and '.join(some)}: give one of them")
    unknown = sorted(set(request.regimes) - set(request.known_regimes))
    if unknown:
        raise VgrooveError(f"--regime is {', '.join(request.known_regimes)}, not {unknown[0]}")
    blind = BlindSet(find_checkout(), request.half, request.impact)
    regimes = () if request.numbers else request.chosen_regimes
    numbers = chosen(sorted(blind.names(regimes=regimes)), request)
    with step_bar(len(numbers), "cases", console, keep=True) as bar:
        found = run_cases(blind, [(n, None) for n in numbers], request.jobs, bar)
        answers = opened(blind, found)
        removals = [
            (number, effect)
            for number, effect in singles(found, answers)
            if request.removed or effect in request.without
        ]
        bar.restart(len(removals))
        found += run_cases(blind, removals, request.jobs, bar)
    cases = [scored(one, answers) for one in found]
    return {
        "set": request.half,
        "impact": request.impact,
        "engine": blind.engine(),
        "cases": len(numbers),
    } | score(cases)


def chosen(numbers: list[int], request: Request) -> list[int]:
    """The requested ones of the half's numbers; VgrooveError for a number that it lacks."""
    unknown = sorted(set(request.numbers) - set(numbers))
    if unknown:
        raise VgrooveError(f"--number {unknown[0]}: the half has cases 0 to {numbers[-1]}")
    if request.numbers:
        return sorted(set(request.numbers))
    fifth = len(numbers) // 5 if request.fifth else len(numbers)
    return numbers[: request.count or fifth]


def opened(blind: "BlindSet", found: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Answers of the diagnosed cases by name; ties are computed for the cases that are not
    right.
    """
    answers = blind.answers([one["number"] for one in found])
    doubtful = [
        one["number"]
        for one in found
        if answers[one["name"]]["label"] == "effect" and not scored(one, answers).right
    ]
    return answers | blind.answers(doubtful, with_ties=True)


def singles(
    found: Sequence[Mapping[str, Any]], answers: Mapping[str, dict[str, Any]]
) -> list[tuple[int, str]]:
    """(number, effect) of the single cases."""
    return [
        (one["number"], answers[one["name"]]["ids"][0])
        for one in found
        if answers[one["name"]]["kind"] == "single"
    ]


def scored(one: Mapping[str, Any], answers: Mapping[str, dict[str, Any]]) -> "Scored":
    """A verdict with its answer."""
    from vgroove.gap_bench.scored import Scored

    return Scored(answer=answers[one["name"]], **{key: one[key] for key in COST_KEYS})
