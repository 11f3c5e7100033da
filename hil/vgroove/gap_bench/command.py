"""The command `vgroove gap bench`: which cases, their run with a progress bar, the tables."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from vgroove.errors import VgrooveError

COST_KEYS = ("number", "name", "without", "verdict", "seconds", "cpu_seconds", "memory_mib")


def bench_command(
    half: Annotated[
        str, typer.Option("--set", help="tune: the half that may be looked at; report: the other.")
    ] = "tune",
    count: Annotated[
        int | None,
        typer.Option(min=1, help="Only the first cases of the half, a fair sample of it."),
    ] = None,
    fifth: Annotated[bool, typer.Option("--fifth", help="A fifth of the half.")] = False,
    number: Annotated[
        list[int] | None, typer.Option(help="These cases by number; may be given again.")
    ] = None,
    removed: Annotated[
        bool,
        typer.Option(
            "--removed", help="Single cases once more without their effect in the catalogue."
        ),
    ] = False,
    without: Annotated[
        list[str] | None,
        typer.Option(metavar="ID", help="As --removed, for this effect; may be given again."),
    ] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Cases at a time.")] = 1,
    json_path: Annotated[
        Path | None, typer.Option("--json", help="Write all figures as JSON.")
    ] = None,
    html_path: Annotated[
        Path | None, typer.Option("--html", help="Write one self-contained page.")
    ] = None,
    page: Annotated[
        Path | None, typer.Option(help="Renew the tables in this page (docs/gap_bench.md).")
    ] = None,
) -> None:
    """The blind set: sealed cases of an independent generator, diagnosed one by one (kept, so a run
    resumes), opened and scored.
    """
    from vgroove.gap_bench.report import bench_page, renewed, tables
    from vgroove.output import check_outputs, write_text

    check_outputs((json_path, html_path), ())
    figures = bench(
        half, count, fifth, number or [], removed, without or [], jobs, Console(stderr=True)
    )
    for table in tables(figures):
        Console().print(table.as_rich())
    if json_path:
        write_text(json_path, json.dumps(figures, indent=1) + "\n")
    if html_path:
        write_text(html_path, bench_page(figures))
    if page:
        write_text(page, renewed(page.read_text(encoding="utf-8"), figures))


def bench(
    half: str,
    count: int | None,
    fifth: bool,
    numbers: list[int],
    removed: bool,
    without: list[str],
    jobs: int,
    console: Console,
) -> dict[str, Any]:
    """Run and score; the figures of all tables."""
    from vgroove.gap_bench.cases import BlindSet, find_checkout
    from vgroove.gap_bench.run import run_cases
    from vgroove.gap_bench.score import score

    if half not in ("tune", "report"):
        raise VgrooveError(f"--set is tune or report, not {half}")
    blind = BlindSet(find_checkout(), half)
    wanted = chosen(sorted(blind.names([])), count, fifth, numbers)
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=console,
    )
    with bar:
        task = bar.add_task("cases", total=len(wanted))
        found = run_cases(
            blind,
            [(n, None) for n in wanted],
            jobs,
            lambda step, text: bar.update(task, advance=step, description=text),
        )
        answers = opened(blind, found)
        gone = [
            (n, effect) for n, effect in singles(found, answers) if removed or effect in without
        ]
        bar.reset(task, total=len(gone))
        more = run_cases(
            blind, gone, jobs, lambda step, text: bar.update(task, advance=step, description=text)
        )
    cases = [scored(one, answers) for one in (*found, *more)]
    return {"set": half, "engine": blind.engine(), "cases": len(wanted)} | score(cases)


def chosen(numbers: list[int], count: int | None, fifth: bool, wanted: list[int]) -> list[int]:
    """The numbers of the cases to run; VgrooveError for one that the half has not."""
    unknown = sorted(set(wanted) - set(numbers))
    if unknown:
        raise VgrooveError(f"--number {unknown[0]}: the half has cases 0 to {numbers[-1]}")
    if wanted:
        return sorted(set(wanted))
    return numbers[: count or (len(numbers) // 5 if fifth else len(numbers))]


def opened(blind: Any, found: list[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Answers of the judged cases; who ties with whom is worked out for those that are ambiguous or
    not right.
    """
    answers = blind.answers([one["number"] for one in found])
    doubtful = [
        one["number"]
        for one in found
        if answers[one["name"]]["label"] == "effect" and not scored(one, answers).right
    ]
    return answers | blind.answers(doubtful, with_ties=True)


def singles(
    found: list[dict[str, Any]], answers: dict[str, dict[str, Any]]
) -> list[tuple[int, str]]:
    """(number, its effect) of the single cases."""
    return [
        (one["number"], answers[one["name"]]["ids"][0])
        for one in found
        if answers[one["name"]]["kind"] == "single"
    ]


def scored(one: dict[str, Any], answers: dict[str, dict[str, Any]]) -> Any:
    from vgroove.gap_bench.score import Scored

    return Scored(answer=answers[one["name"]], **{key: one[key] for key in COST_KEYS})
