"""The commands `vgroove study ...`: progress on stderr, tables on stdout, files in a folder."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from vgroove.result_files import Report, ReportFiles

app = typer.Typer(no_args_is_help=True, help="Studies of the tool's design: tables, JSON, plots.")

Folder = Annotated[
    Path,
    typer.Option("-o", "--output", metavar="DIR", help="Folder of the files: page, tables, JSON."),
]
JsonPath = Annotated[
    Path | None,
    typer.Option(
        "--json", metavar="FILE", help="Path of the JSON; without: NAME.json in the folder."
    ),
]
Png = Annotated[
    bool, typer.Option("--png", help="Draw the page into a PNG as well (needs Chromium).")
]


def finish(report: "Report", files: "ReportFiles") -> None:
    """Print the report's sentences and tables, and write its files."""
    from vgroove.result_files import write_report
    from vgroove.terminal import print_line, print_results, table_console

    console = table_console(files.json_path)
    print_results(console, report.lines, report.tables)
    for path in write_report(report, files):
        print_line(console, f"written: {path}")


@app.callback()
def study() -> None:
    """Studies of the tool's design: tables, JSON, plots."""


TOLERANCES = (1e-11, 1e-2)  # least and largest --tolerance
MAX_VOLTAGES = 1000  # of `vgroove study supply`
ImpactRig = Annotated[
    Path | None,
    typer.Option(
        "--rig",
        help="Impact tool; without: the reference set of 18 V class. The study sets its load.",
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
        float, typer.Option(help="Local error of the variable-step solvers, relative to a state.")
    ] = 1e-6,
    repeats: Annotated[
        int, typer.Option(min=1, max=50, help="Runs of which the least time of a step counts.")
    ] = 5,
    folder: Folder = Path("study"),
    json_path: JsonPath = None,
    png: Png = False,
) -> None:
    """Variable step over the impact cycle and the drill driver's run; fixed steps against the
    reference; execution time per step.
    """
    from vgroove.progress import step_bar
    from vgroove.reference.rigs import LOW_GEAR, impact_rig, reference_rig
    from vgroove.result_files import join_reports, prepare_files
    from vgroove.rig import read_rig
    from vgroove.study.drill import parameters_of
    from vgroove.study.steps import Effort, drill_ticks, run_drill_steps
    from vgroove.study.steps_impact import JOINT_COLOURS, impact_steps
    from vgroove.study.steps_page import drill_report

    check_steps(only, tolerance)
    tool = impact_rig(impact)
    parameters = parameters_of(read_rig(rig) if rig else reference_rig(LOW_GEAR))
    files = prepare_files("steps", folder, json_path, png)
    with_drill, with_impact = only != "impact", only != "drill"
    ticks = drill_ticks() * with_drill + len(JOINT_COLOURS) * with_impact
    parts = []
    with step_bar(ticks) as tick:
        if with_impact:
            parts.append(impact_steps(tool, tolerance, tick))
        if with_drill:
            effort = Effort(points, tolerance, repeats)
            parts.append(drill_report(run_drill_steps(parameters, effort, tick)))
    both = "Step sizes: impact cycle and drill driver"
    finish(join_reports(both if only == "both" else parts[0].title, parts), files)


def check_steps(only: str, tolerance: float) -> None:
    """VgrooveError for options of `vgroove study steps` that have no meaning."""
    from vgroove.errors import VgrooveError

    least, most = TOLERANCES
    if not least <= tolerance <= most:
        raise VgrooveError(f"--tolerance must be from {least:g} to {most:g}, not {tolerance:g}")
    if only not in ("drill", "impact", "both"):
        raise VgrooveError(f"--only must be drill, impact or both, not {only}")


@app.command("supply")
def supply_command(
    rig: ImpactRig = None,
    low_v: Annotated[
        float, typer.Option("--from", min=1.0, max=1000.0, help="Lowest supply voltage in V.")
    ] = 14.0,
    high_v: Annotated[
        float, typer.Option("--to", min=1.0, max=1000.0, help="Highest supply voltage in V.")
    ] = 21.0,
    step_v: Annotated[
        float, typer.Option("--step", min=0.001, help="Interval between voltages in V.")
    ] = 0.5,
    seconds: Annotated[
        float,
        typer.Option(min=0.8, max=60.0, help="Length of each run in s; figures from 0.5 s on."),
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
    from vgroove.progress import step_bar
    from vgroove.reference.rigs import impact_rig
    from vgroove.result_files import prepare_files
    from vgroove.study.supply import JOINT_COLOURS, supply_study, supply_voltages

    if not high_v > low_v or (high_v - low_v) / step_v > MAX_VOLTAGES:
        raise VgrooveError(
            f"--from {low_v:g} --to {high_v:g} --step {step_v:g}: this is no range of at most "
            f"{MAX_VOLTAGES:,} voltages"
        )
    tool = impact_rig(rig)
    files = prepare_files("supply", folder, json_path, png)
    with step_bar(len(JOINT_COLOURS)) as tick:
        report = supply_study(tool, supply_voltages(low_v, high_v, step_v), seconds, duty, tick)
    finish(report, files)


@app.command("load")
def load_command(
    rig: ImpactRig = None,
    seconds: Annotated[
        float, typer.Option(min=0.3, max=20.0, help="Length of each run in s.")
    ] = 1.0,
    folder: Folder = Path("study"),
    json_path: JsonPath = None,
    png: Png = False,
) -> None:
    """Torque over angle of the joints, disc springs, tightening factor, the coupler's effect,
    motion at 50 and 100 % duty.
    """
    from vgroove.progress import step_bar
    from vgroove.reference.rigs import impact_rig
    from vgroove.result_files import prepare_files
    from vgroove.study.load import LOAD_TICKS, load_study

    tool = impact_rig(rig)
    files = prepare_files("load", folder, json_path, png)
    with step_bar(LOAD_TICKS) as tick:
        report = load_study(tool, seconds, tick)
    finish(report, files)


@app.command("impact")
def impact_command(
    rig: ImpactRig = None,
    joint: Annotated[
        str,
        typer.Option(
            help="locked, hard_joint, slip_60, slip_6, disc_spring, m6, m8, m10; or rig: the rig's "
            "own load."
        ),
    ] = "locked",
    seconds: Annotated[
        float,
        typer.Option(
            min=0.1, max=20.0, help="Length of the run in s; its last whole cycle is shown."
        ),
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
    from vgroove.reference.joints import REFERENCE_JOINTS
    from vgroove.reference.rigs import impact_rig
    from vgroove.result_files import prepare_files
    from vgroove.study.impact import impact_study
    from vgroove.study.impact_runs import with_joint

    tool = impact_rig(rig)
    if joint != "rig" and joint not in REFERENCE_JOINTS:
        raise VgrooveError(
            f"--joint must be one of {', '.join(REFERENCE_JOINTS)}, rig, not {joint}"
        )
    tool = tool if joint == "rig" else with_joint(tool, joint)
    title = "the rig's own joint" if joint == "rig" else REFERENCE_JOINTS[joint].title
    files = prepare_files("impact", folder, json_path, png)
    finish(impact_study(tool, title, seconds, duty), files)


@app.command("fixed-point")
def fixed_point_command(
    draws: Annotated[
        int, typer.Option(min=0, max=1000, help="Drawn runs of each controller.")
    ] = 200,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the drawn runs.")] = 1,
    repeats: Annotated[
        int, typer.Option(min=1, max=10_000, help="Repetitions for the time on this computer.")
    ] = 100,
    folder: Folder = Path("study"),
    json_path: JsonPath = None,
    png: Png = False,
) -> None:
    """Filters and controllers with fixed point against floating point of the same source: errors,
    state changes, time here, cycles on the simulated AVR.
    """
    from vgroove.progress import step_bar
    from vgroove.result_files import prepare_files
    from vgroove.study.fixed_point import fixed_point_study, study_ticks

    files = prepare_files("fixed_point", folder, json_path, png)
    with step_bar(study_ticks(draws)) as tick:
        report = fixed_point_study(draws, seed, repeats, tick)
    finish(report, files)


@app.command("hil")
def hil_command(
    port: Annotated[
        str | None,
        typer.Option(help="Board with a build for real-time runs; without: a simulated one."),
    ] = None,
    tool: Annotated[
        str, typer.Option(help="impact, drill, or both (simulated boards only).")
    ] = "both",
    pace: Annotated[
        float,
        typer.Option(
            min=0.01, max=1.0, help="Speed of a simulated board's clock; 0.5: half of real time."
        ),
    ] = 1.0,
    seconds: Annotated[
        float | None, typer.Option(min=0.5, max=600.0, help="Length of each run in s.")
    ] = None,
    folder: Folder = Path("study"),
    json_path: JsonPath = None,
    png: Png = False,
) -> None:
    """The tool in real time against a board, compared with lock-step: jitter, execution time of a
    step, late steps, first difference of the logs.
    """
    from vgroove.errors import VgrooveError
    from vgroove.progress import step_bar
    from vgroove.result_files import prepare_files
    from vgroove.study.hil import hil_study, scenarios

    if tool not in ("impact", "drill", "both") or (port and tool == "both"):
        raise VgrooveError("--tool is impact or drill, or both for simulated boards")
    tools = ("impact", "drill") if tool == "both" else (tool,)
    files = prepare_files("hil", folder, json_path, png)
    with step_bar(sum(len(list(scenarios(one))) for one in tools)) as tick:
        report = hil_study(tools, port, pace, seconds, tick)
    finish(report, files)
