"""The commands `vgroove study ...`: options, progress on stderr, tables on stdout, files into a
folder.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

app = typer.Typer(no_args_is_help=True, help="The design's studies: table, JSON and plot of each.")

Folder = Annotated[
    Path,
    typer.Option("-o", "--output", metavar="DIR", help="Folder of the files: page, tables, JSON."),
]
JsonPath = Annotated[
    Path | None, typer.Option("--json", metavar="FILE", help="JSON elsewhere than in the folder.")
]
Png = Annotated[
    bool, typer.Option("--png", help="Draw the page into a PNG as well (needs Chromium).")
]
PIPED_WIDTH = 130  # of tables that go into a file or a pipe
Tick = Callable[[str], None]


@contextmanager
def progress(total: int) -> Iterator[Tick]:
    """A bar on stderr that `tick(words)` moves by one; it leaves nothing behind."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
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


ImpactRig = Annotated[
    Path | None,
    typer.Option(
        "--rig",
        help="Impact tool; without: the reference set of 18 V class. Its load is the study's.",
    ),
]
Duty = Annotated[float, typer.Option(min=0.05, max=1.0, help="Duty of the bridge, from rest.")]


@app.command("steps")
def steps_command(
    rig: Annotated[
        Path | None, typer.Option("--rig", help="Drill driver; without: low gear, 18 V.")
    ] = None,
    impact: Annotated[
        Path | None, typer.Option("--impact-rig", help="Impact tool; without: the reference set.")
    ] = None,
    only: Annotated[str, typer.Option(help="drill, impact or both.")] = "both",
    points: Annotated[
        int, typer.Option(min=2, max=200, help="Fixed steps of the sweep from 10 us to 100 ms.")
    ] = 41,
    tolerance: Annotated[
        float, typer.Option(help="Local error of the variable-step solvers, of each state's size.")
    ] = 1e-6,
    repeats: Annotated[
        int, typer.Option(min=1, max=50, help="Runs behind each execution time.")
    ] = 5,
    folder: Folder = Path("study"),
    json_path: JsonPath = None,
    png: Png = False,
) -> None:
    """Variable step over the impact cycle and the drill driver's run; fixed steps against the
    reference; execution time per step.
    """
    from vgroove import _core
    from vgroove.errors import VgrooveError
    from vgroove.rig import read_rig
    from vgroove.study.drill import parameters_of
    from vgroove.study.impact_runs import impact_rig
    from vgroove.study.report import joined, prepare
    from vgroove.study.steps import drill_steps, drill_ticks
    from vgroove.study.steps_impact import LOADS, impact_steps

    if not 1e-11 <= tolerance <= 1e-2:
        raise VgrooveError(f"--tolerance must be from 1e-11 to 0.01, not {tolerance:g}")
    if only not in ("drill", "impact", "both"):
        raise VgrooveError(f"--only must be drill, impact or both, not {only}")
    tool = impact_rig(impact)
    parameters = parameters_of(read_rig(rig)) if rig else _core.drill_parameters()
    places = prepare("steps", folder, json_path, png)
    parts = []
    with progress(drill_ticks() * (only != "impact") + len(LOADS) * (only != "drill")) as tick:
        if only != "drill":
            parts.append(impact_steps(tool, tolerance, tick))
        if only != "impact":
            parts.append(drill_steps(parameters, points, tolerance, repeats, tick))
    titles = {
        "drill": "Step sizes of the drill driver",
        "impact": "Step sizes over the impact cycle",
        "both": "Step sizes: impact cycle and drill driver",
    }
    finish(joined(titles[only], parts), places)


@app.command("supply")
def supply_command(
    rig: ImpactRig = None,
    low_v: Annotated[
        float, typer.Option("--from", min=1.0, max=1000.0, help="Lowest supply voltage.")
    ] = 14.0,
    high_v: Annotated[
        float, typer.Option("--to", min=1.0, max=1000.0, help="Highest supply voltage.")
    ] = 21.0,
    step_v: Annotated[
        float, typer.Option("--step", min=0.001, help="Distance of the voltages.")
    ] = 0.5,
    seconds: Annotated[
        float, typer.Option(min=0.8, max=60.0, help="Length of each run; figures from 0.5 s on.")
    ] = 1.5,
    duty: Duty = 1.0,
    folder: Folder = Path("study"),
    json_path: JsonPath = None,
    png: Png = False,
) -> None:
    """Influence of the supply voltage on impact rate, current, torque and synchronism, on five
    joints.
    """
    from vgroove.errors import VgrooveError
    from vgroove.study.impact_runs import impact_rig
    from vgroove.study.report import prepare
    from vgroove.study.supply import LOADS, supply_study, supply_voltages

    if not high_v > low_v or (high_v - low_v) / step_v > 1000:
        raise VgrooveError(
            f"--from {low_v:g} --to {high_v:g} --step {step_v:g}: this is no range of at most 1,000 voltages"
        )
    tool = impact_rig(rig)
    places = prepare("supply", folder, json_path, png)
    with progress(len(LOADS)) as tick:
        study = supply_study(tool, supply_voltages(low_v, high_v, step_v), seconds, duty, tick)
    finish(study, places)


@app.command("load")
def load_command(
    rig: ImpactRig = None,
    seconds: Annotated[float, typer.Option(min=0.3, max=20.0, help="Length of each run.")] = 1.0,
    folder: Folder = Path("study"),
    json_path: JsonPath = None,
    png: Png = False,
) -> None:
    """Torque over angle of the joints, disc springs, tightening factor, the coupler's effect,
    motion at 50 and 100 % duty.
    """
    from vgroove.study.impact_runs import impact_rig
    from vgroove.study.load import LOAD_TICKS, load_study
    from vgroove.study.report import prepare

    tool = impact_rig(rig)
    places = prepare("load", folder, json_path, png)
    with progress(LOAD_TICKS) as tick:
        study = load_study(tool, seconds, tick)
    finish(study, places)


@app.command("impact")
def impact_command(
    rig: ImpactRig = None,
    joint: Annotated[
        str,
        typer.Option(
            help="locked, hard_joint, slip_60, slip_6, disc_spring, m6, m8, m10; or rig: the rig's own load."
        ),
    ] = "locked",
    seconds: Annotated[
        float,
        typer.Option(min=0.1, max=20.0, help="Length of the run; its last whole cycle is shown."),
    ] = 1.0,
    duty: Duty = 1.0,
    folder: Folder = Path("study"),
    json_path: JsonPath = None,
    png: Png = False,
) -> None:
    """One cycle: hammer displacement, rotation, motor current and speed, with the blow's phases
    marked.
    """
    from vgroove.errors import VgrooveError
    from vgroove.study.impact import impact_study
    from vgroove.study.impact_runs import JOINT_WORDS, JOINTS, impact_rig, with_joint
    from vgroove.study.report import prepare

    tool = impact_rig(rig)
    if joint != "rig" and joint not in JOINTS:
        raise VgrooveError(f"--joint must be one of {', '.join(JOINTS)}, rig, not {joint}")
    tool = tool if joint == "rig" else with_joint(tool, JOINTS[joint])
    places = prepare("impact", folder, json_path, png)
    finish(impact_study(tool, JOINT_WORDS.get(joint, "the rig's own joint"), seconds, duty), places)
