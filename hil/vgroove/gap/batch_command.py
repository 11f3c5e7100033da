"""The command `vgroove gap batch`: several diagnoses with one summary."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vgroove.errors import VgrooveError

if TYPE_CHECKING:
    from vgroove.gap.cases import Case, CaseResult

app = typer.Typer()  # its command is one of `vgroove gap`
ERROR_CODE, ABOVE_CODE = 2, 3  # exit codes: a case without a verdict, a gap above --fail-above
JunitPath = Annotated[
    Path | None, typer.Option("--junit", help="Write the outcome as JUnit XML, for pipelines.")
]


def _checked_limit(limit: float | None) -> float | None:
    """Callback of --fail-above; VgrooveError for a limit that no gap could exceed or keep."""
    if limit is not None and not 0.0 <= limit < float("inf"):
        raise VgrooveError(f"--fail-above must be a gap of 0 or more, not {limit:g}")
    return limit


FailAbove = Annotated[
    float | None,
    typer.Option(
        metavar="GAP",
        callback=_checked_limit,
        help="End with exit code 3 where gap.after, what the corrected model leaves, is larger.",
    ),
]


@app.command("batch")
def batch_command(
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar="CASES.toml|DIR...",
            help="TOML files with a table `case` each (name, logs, rig); or folders with rig.toml "
            "and logs, or with such folders.",
        ),
    ],
    json_path: Annotated[
        Path | None, typer.Option("--json", help="Write all verdicts as JSON.")
    ] = None,
    html_path: Annotated[
        Path | None,
        typer.Option(
            "--html", metavar="DIR", help="Write a page for each case, and one that leads to them."
        ),
    ] = None,
    junit_path: JunitPath = None,
    fail_above: FailAbove = None,
) -> None:
    """Diagnose several logs and rigs, one after the other, with one summary. Exit code 2 where a
    case has no verdict, else 3 where one is above --fail-above.
    """
    from vgroove.gap.batch_pages import SUMMARY, batch_pages, prepare_folder
    from vgroove.gap.cases import batch_json, batch_table, junit_text, read_cases
    from vgroove.output import check_outputs, json_text, write_all
    from vgroove.terminal import table_console

    cases = read_cases(paths)
    inputs = [path for case in cases for path in (*case.logs, case.rig)]
    prepare_folder(html_path)
    summary = html_path and html_path / SUMMARY
    check_outputs((json_path, junit_path, summary), dict.fromkeys(inputs))
    results = _with_progress(cases)
    table_console(json_path, junit_path).print(batch_table(results, fail_above).as_rich())
    files = [(json_path, json_text(batch_json(results, fail_above)))] if json_path else []
    files += [(junit_path, junit_text(results, fail_above))] if junit_path else []
    files += batch_pages(results, fail_above, html_path) if html_path else []
    write_all(files)
    raise typer.Exit(_exit_code(results, fail_above))


def _with_progress(cases: "list[Case]") -> "list[CaseResult]":
    from vgroove.gap.cases import diagnose_cases
    from vgroove.gap.stage_shares import StageShare
    from vgroove.progress import step_bar

    shares = [StageShare() for _ in cases]
    with step_bar(len(cases), "cases") as bar:

        def show(number: int, stage: str) -> None:
            share = shares[number].at(stage)
            bar.move_to(number + share, f"{cases[number].name}: {stage}")

        return diagnose_cases(cases, show)


def _exit_code(results: "list[CaseResult]", limit: float | None) -> int:
    from vgroove.gap.cases import NOT_RUN

    if any(one.error == NOT_RUN for one in results):
        return 130
    if any(one.verdict is None for one in results):
        return ERROR_CODE
    return ABOVE_CODE if any(one.exceeds(limit) for one in results) else 0
