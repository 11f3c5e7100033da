"""The commands `vgroove study ...`: options, progress on stderr, tables on stdout, files into a folder."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

app = typer.Typer(no_args_is_help=True, help="The design's studies: table, JSON and plot of each.")

Folder = Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Folder of the files: page, tables, JSON.")]
JsonPath = Annotated[Path | None, typer.Option("--json", metavar="FILE", help="JSON elsewhere than in the folder.")]
Png = Annotated[bool, typer.Option("--png", help="Draw the page into a PNG as well (needs Chromium).")]
PIPED_WIDTH = 130  # of tables that go into a file or a pipe
Tick = Callable[[str], None]


@contextmanager
def progress(total: int) -> Iterator[Tick]:
    """A bar on stderr that `tick(words)` moves by one; it leaves nothing behind."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=total)
        yield lambda words: bar.update(task, advance=1, description=words)


def finish(study: "Study", places: "Places") -> None:  # noqa: F821
    """Show and write."""
    from vgroove.study.report import write

    console = Console()
    if not console.is_terminal:
        console = Console(width=PIPED_WIDTH)
    for line in study.lines:
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    for table in study.tables:
        console.print(table.as_rich())
    for path in write(study, places):
        console.print(f"written: {path}", highlight=False, markup=False, soft_wrap=True)


@app.callback()
def study() -> None:
    """The design's studies: table, JSON and plot of each."""


@app.command("steps")
def steps_command(
    rig: Annotated[Path | None, typer.Option("--rig", help="Drill driver; without: physics.md section 7 in low gear.")] = None,
    points: Annotated[int, typer.Option(min=2, max=200, help="Fixed steps of the sweep from 10 us to 100 ms.")] = 41,
    tolerance: Annotated[float, typer.Option(help="Local error of the variable-step solver, of each state's size.")] = 1e-6,
    repeats: Annotated[int, typer.Option(min=1, max=50, help="Runs behind each execution time.")] = 5,
    folder: Folder = Path("study"),
    json_path: JsonPath = None,
    png: Png = False,
) -> None:
    """Variable-step history, events and recovery; fixed steps against the reference; execution time per step."""
    from vgroove import _core
    from vgroove.errors import VgrooveError
    from vgroove.rig import read_rig
    from vgroove.study.drill import parameters_of
    from vgroove.study.report import prepare
    from vgroove.study.steps import drill_steps, drill_ticks

    if not 1e-11 <= tolerance <= 1e-2:
        raise VgrooveError(f"--tolerance must be from 1e-11 to 0.01, not {tolerance:g}")
    parameters = parameters_of(read_rig(rig)) if rig else _core.drill_parameters()
    places = prepare("steps", folder, json_path, png)
    with progress(drill_ticks()) as tick:
        study = drill_steps(parameters, points, tolerance, repeats, tick)
    finish(study, places)
