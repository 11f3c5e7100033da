"""The command line `vgroove`: arguments, errors and exit codes; each command calls the module that
does its work.
"""

import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from vgroove.adapt.command import app as adapt_app
from vgroove.control_bench.command import app as control_app
from vgroove.errors import VgrooveError
from vgroove.firmware_replay.command import FirmwarePath
from vgroove.firmware_replay.command import app as firmware_app
from vgroove.gap.batch_command import FailAbove, JunitPath
from vgroove.gap.batch_command import app as batch_app
from vgroove.gap_bench.command import app as blind_set_app
from vgroove.python_can import import_without_asammdf
from vgroove.study.command import app as study_app
from vgroove.terminal import print_line, print_warning, result_console
from vgroove.termination import Terminated
from vgroove.unused_options import refuse_given

if TYPE_CHECKING:
    from rich.table import Table

    from vgroove.gap import DiagnosisOptions
    from vgroove.log import ColumnMap, Log
    from vgroove.run import RunOptions

# The plant starts threads itself, with which BLAS threads would compete. The variable is read when
# numpy is first imported, which a command does.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

app = typer.Typer(no_args_is_help=True, pretty_exceptions_enable=False)
gap_app = typer.Typer(
    no_args_is_help=True, help="Diagnose the gap between a log and its simulation."
)
app.add_typer(gap_app, name="gap")
log_app = typer.Typer(
    no_args_is_help=True, help="Logs: what one holds, whether it can be used, how two differ."
)
app.add_typer(log_app, name="log")
FromS = Annotated[
    float | None,
    typer.Option("--from", metavar="S", help="Use no row before this time of the log, in s."),
]
ToS = Annotated[
    float | None,
    typer.Option("--to", metavar="S", help="Use no row after this time of the log, in s."),
]
rig_app = typer.Typer(no_args_is_help=True, help="Rigs: what the simulation assumes about a tool.")
app.add_typer(rig_app, name="rig")
Joints = Annotated[
    list[Path] | None,
    typer.Option(
        "--joint",
        metavar="FILE",
        help="Impact tool: the joint of a log, a TOML file with the table 'load' alone; given once "
        "for each log, in their order. `vgroove sim` without --log: the joint of the run.",
    ),
]
AsIs = Annotated[
    bool,
    typer.Option("--as-is", help="Use a log whose units, signs or time base look wrong."),
]
Maps = Annotated[
    list[str] | None,
    typer.Option(
        "--map",
        metavar="NAME[:UNIT]=COLUMN",
        help="Read this column of the file as that column of a log, such as "
        "I_motor:mA=current_a; may be repeated.",
    ),
]
MapFile = Annotated[
    Path | None, typer.Option("--map-file", help="TOML file that names the columns of a log.")
]
ExperimentName = Annotated[
    str | None,
    typer.Option("--experiment", help="On a board: a run that can be proposed, such as reversal."),
]
NextPath = Annotated[
    Path | None,
    typer.Option(
        "--next", metavar="VERDICT", help="On a board: the run that this verdict recommends."
    ),
]
ScenarioSeed = Annotated[
    int | None, typer.Option(min=0, max=2**31 - 1, help="Instead of the scenario's seed.")
]
FaultAt = Annotated[
    str | None,
    typer.Option(metavar="NAME@T", help="Inject a fault at the time T in s (docs/faults.md)."),
]
CheckRig = Annotated[
    Path | None, typer.Option("--rig", help="On a board: the rig with which logs are checked.")
]
CheckLogs = Annotated[
    list[Path] | None,
    typer.Option(
        "--log", help="On a board: an earlier log, checked before the run; may be repeated."
    ),
]
bench_app = typer.Typer(
    no_args_is_help=True,
    help="Benchmarks: plant and diagnosis against other software, controllers in simulation.",
)
app.add_typer(bench_app, name="bench")
app.add_typer(study_app, name="study")
app.registered_commands += adapt_app.registered_commands
bench_app.registered_commands += control_app.registered_commands
gap_app.registered_commands += batch_app.registered_commands + blind_set_app.registered_commands
gap_app.registered_commands += firmware_app.registered_commands


def _show_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print_line(Console(), f"vgroove {version('vgroove')}")
        raise typer.Exit


@app.callback()
def vgroove(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version."),
    ] = False,
) -> None:
    """Firmware, plant and gap diagnosis of an impact driver."""
    del version


@bench_app.callback()
def bench() -> None:
    """Benchmarks: plant and diagnosis against other software, controllers in simulation."""


@bench_app.command("speed")
def bench_speed_command(
    seconds: Annotated[
        int, typer.Option(min=1, help="Length in s of the drivetrain's run, a staircase of duties.")
    ] = 10,
    seed: Annotated[
        int,
        typer.Option(min=0, help="Seed of the staircase and of the tools of the batch."),
    ] = 1,
    repeats: Annotated[
        int, typer.Option(min=1, help="Timed rounds; the figures are their medians.")
    ] = 5,
    json_path: Annotated[
        Path | None, typer.Option("--json", help="Write all figures as JSON.")
    ] = None,
) -> None:
    """Speed of the plant against general-purpose solvers at equal accuracy: impact mode, lock-step,
    batches, drivetrain.
    """
    from vgroove.bench.speed import bench_speed
    from vgroove.bench.speed_tables import speed_tables

    _check_outputs(json_path)
    console = result_console(json_path)
    figures = bench_speed(seconds, seed, repeats, console)
    for table in speed_tables(figures):
        console.print(table)
    _write_json(json_path, figures)


@bench_app.command("trap")
def bench_trap_command(
    seed: Annotated[int, typer.Option(min=0, help="Seed of drive and noise.")] = 1,
    json_path: Annotated[
        Path | None, typer.Option("--json", help="Write all results as JSON.")
    ] = None,
) -> None:
    """A joint whose model lacks its Coulomb friction: which identification methods fit a wrong
    damping, and which find the friction?
    """
    from vgroove.bench.trap import bench_trap, trap_table

    _check_outputs(json_path)
    figures = bench_trap(seed)
    result_console(json_path).print(trap_table(figures))
    _write_json(json_path, figures)


@app.command()
def record(
    port: Annotated[
        str,
        typer.Argument(
            help="Serial port of the board: /dev/ttyACM0, COM3, a pty, or a pyserial URL."
        ),
    ],
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            help="FILE.csv, .mf4, .blf or .asc; board and losses go to FILE.csv.json.",
        ),
    ],
    seconds: Annotated[
        float | None,
        typer.Option(min=0.001, help="Board time to record in s; without: until Ctrl-C."),
    ] = None,
    baud: Annotated[int, typer.Option(min=1, help="Baud rate of the line.")] = 250_000,
    without_boot: Annotated[
        bool,
        typer.Option(
            "--without-boot",
            help="Begin with the first frame: for a line without a wire to the board.",
        ),
    ] = False,
    plot: Annotated[
        bool, typer.Option("--plot", help="Show the last 10 s as curves on the terminal.")
    ] = False,
) -> None:
    """Record the board's telemetry; Ctrl-C ends it with a complete file."""
    from vgroove.record_command import record_with_progress
    from vgroove.recorder import Recording

    record_with_progress(Recording(port, output, baud, seconds, without_boot), plot)


# Parameters of `run` that one kind of run alone has.
SIMULATED_RUN = (
    "seed",
    "target",
    "elf",
    "pty",
    "wait",
    "real_time",
    "stats",
    "eeprom",
    "fault",
)
SCENARIO_OR_RUN = (
    "--on sil and --on avr run a SCENARIO; a board (--on PORT) performs --experiment NAME or "
    "--next VERDICT.json"
)
BOARD_RUN = ("experiment", "next_path", "rig", "logs", "baud")


@app.command()
def run(
    context: typer.Context,
    scenario_path: Annotated[
        Path | None,
        typer.Argument(metavar="[SCENARIO]", help="TOML file: tool, trigger, load, duration."),
    ] = None,
    on: Annotated[
        str,
        typer.Option(
            help="sil: native firmware; avr: the ELF on a simulated ATmega; PORT: a board."
        ),
    ] = "sil",
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Log: FILE.csv, .mf4, .blf or .asc.")
    ] = None,
    seed: ScenarioSeed = None,
    target: Annotated[str, typer.Option(help="Board of --on avr: uno or mega.")] = "uno",
    elf: Annotated[
        Path | None, typer.Option(help="Firmware; without: the one that `make build` makes.")
    ] = None,
    pty: Annotated[
        bool, typer.Option("--pty", help="Put the UART on a pseudo-terminal and print its name.")
    ] = False,
    wait: Annotated[
        bool, typer.Option(help="With --pty: begin when a program has opened it.")
    ] = True,
    real_time: Annotated[
        bool, typer.Option("--real-time", help="Do not run faster than real time.")
    ] = False,
    stats: Annotated[
        Path | None, typer.Option(help="Cycle statistics of --on avr as JSON.")
    ] = None,
    eeprom: Annotated[
        Path | None, typer.Option(help="EEPROM image, read before the run and written after.")
    ] = None,
    fault: FaultAt = None,
    experiment: ExperimentName = None,
    next_path: NextPath = None,
    rig: CheckRig = None,
    logs: CheckLogs = None,
    baud: Annotated[int, typer.Option(min=1, help="Baud rate of the board's line.")] = 250_000,
) -> None:
    """Run a scenario, firmware and simulated tool in lock-step; or perform a run of the diagnosis'
    menu on a board (--on PORT).
    """
    from vgroove.faults import parse_injection
    from vgroove.run import RunOptions

    injection = None if fault is None else parse_injection(fault)
    options = RunOptions(on, target, elf, output, pty, wait, real_time, stats, eeprom, injection)
    if scenario_path is None and on not in ("sil", "avr"):
        none = "a run on a board has none of these, they belong to --on sil and --on avr"
        refuse_given(context, SIMULATED_RUN, none)
        _perform_run(options, (experiment, next_path), baud, (rig, logs or ()))
        return
    refuse_given(context, BOARD_RUN, f"{SCENARIO_OR_RUN}, with --rig, --log and --baud")
    if scenario_path is None:
        raise VgrooveError(SCENARIO_OR_RUN)
    if on == "sil":
        refuse_given(context, ("target", "elf", "stats"), "only a run with --on avr has this")
    if not pty:
        refuse_given(context, ("wait",), "only a run with --pty waits for a program")
    _run_scenario(scenario_path, seed, options)


def _perform_run(
    options: "RunOptions",
    chosen: tuple[str | None, Path | None],
    baud: int,
    checked: tuple[Path | None, Sequence[Path]],
) -> None:
    """Perform a run on a board. chosen: its name or its verdict; checked: rig and earlier logs."""
    from vgroove.board_checks import BoardChecks
    from vgroove.board_run import chosen_profile, run_on_board

    run_on_board(options, chosen_profile(*chosen), baud, BoardChecks.of(*checked))


def _run_scenario(path: Path, seed: int | None, options: "RunOptions") -> None:
    from dataclasses import replace

    from vgroove.run import run_scenario
    from vgroove.scenario import read_scenario

    scenario = read_scenario(path)
    scenario = scenario if seed is None else replace(scenario, seed=seed)
    run_scenario(scenario, options, Console(), Console(stderr=True))


@app.command()
def hil(
    context: typer.Context,
    scenario_path: Annotated[
        Path, typer.Argument(metavar="SCENARIO", help="TOML file: tool, trigger, load, duration.")
    ],
    port: Annotated[
        str | None, typer.Option(help="Serial port of the board: /dev/ttyACM0, COM3, a pty.")
    ] = None,
    bus: Annotated[
        str | None,
        typer.Option(help="Instead: INTERFACE:CHANNEL of python-can, such as socketcan:can0."),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Log: FILE.csv, .mf4, .blf or .asc.")
    ] = None,
    json_path: Annotated[
        Path | None, typer.Option("--json", help="Write the figures of the exchange as JSON.")
    ] = None,
    timing: Annotated[
        Path | None, typer.Option(help="Write the times of every exchange as CSV.")
    ] = None,
    seed: ScenarioSeed = None,
    baud: Annotated[int, typer.Option(min=1, help="Baud rate of --port.")] = 1_000_000,
    kernel_workers: Annotated[
        bool,
        typer.Option(
            "--kernel-workers",
            help="Real-time priority during the run for the threads of the Linux kernel that pass "
            "the port's bytes on (root only).",
        ),
    ] = False,
) -> None:
    """Hardware in the loop: simulate the scenario's tool in real time against a board that runs the
    build for real-time runs (docs/hil.md).
    """
    from dataclasses import replace

    from vgroove.real_time.command import HilOptions, run_hil
    from vgroove.scenario import read_scenario

    if bus is not None and port is None:
        refuse_given(context, ("baud",), "the rate of a bus is that of its interface")
    scenario = read_scenario(scenario_path)
    scenario = scenario if seed is None else replace(scenario, seed=seed)
    options = HilOptions(port, bus, baud, output, json_path, timing, kernel_workers)
    run_hil(scenario, options, Console(stderr=True))


@app.command()
def flash(
    port: Annotated[str, typer.Argument(help="Serial port of the board: /dev/ttyACM0, COM3.")],
    target: Annotated[str, typer.Option(help="Board: uno or mega.")] = "uno",
    tool: Annotated[
        str, typer.Option(help="Tool: impact or drill; the Mega's firmware drives both.")
    ] = "impact",
    image: Annotated[
        Path | None,
        typer.Option("--hex", help="Hex file; without: the one that `make build` makes."),
    ] = None,
) -> None:
    """Write the firmware through the board's bootloader and read it back (avrdude)."""
    from vgroove.flash import flash as flash_board

    flash_board(port, target, image, tool, lambda line: print_line(Console(stderr=True), line))


WITH_LOG = ("restart_s", "from_s", "to_s", "as_is", "maps", "map_file")


@app.command()
def sim(
    context: typer.Context,
    path: Annotated[
        Path,
        typer.Argument(
            metavar="RIG|SCENARIO",
            help="With --log: a rig; without: a scenario (its travel is the duty), or a rig, "
            "which is run at full trigger.",
        ),
    ],
    log: Annotated[
        list[Path] | None,
        typer.Option("--log", help="Log whose input drives the rig; may be repeated."),
    ] = None,
    json_path: Annotated[
        Path | None, typer.Option("--json", help="Write the figures as JSON.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Write the simulated log as CSV.")
    ] = None,
    restart_s: Annotated[
        float | None,
        typer.Option(
            help="With --log: seconds after which the model restarts from measured states; default "
            "0.25 s, longer for slow loggers and for a speed under a measured current."
        ),
    ] = None,
    seconds: Annotated[
        float | None,
        typer.Option(help="Without --log: length of the run in s, instead of the scenario's."),
    ] = None,
    joint: Joints = None,
    from_s: FromS = None,
    to_s: ToS = None,
    as_is: AsIs = False,
    maps: Maps = None,
    map_file: MapFile = None,
) -> None:
    """Simulate the plant without firmware: a scenario, or a rig at full trigger; with --log, a rig
    driven by the log's input, and its gap on held-out blocks.
    """
    from vgroove.gap import DiagnosisOptions
    from vgroove.log import csv_bytes
    from vgroove.output import json_text, write_all

    if log and output and len(log) != 1:
        raise VgrooveError("-o writes one simulated log: give one --log")
    tool = (path, tuple(joint or ()))
    _check_outputs(json_path, output, inputs=[path, *tool[1], *(log or [])])
    out = result_console(json_path, output)
    if log:
        refuse_given(context, ("seconds",), "only a run without --log has this; use --from, --to")
        columns = _columns(maps, map_file)
        options = DiagnosisOptions(from_s=from_s, to_s=to_s, as_is=as_is, columns=columns)
        figures, simulated, table = _sim_logs(tool, log, options, restart_s)
    else:
        refuse_given(context, WITH_LOG, "only a run with --log has this option")
        figures, simulated, table = _sim_scenario(tool, seconds)
    files = [(json_path, json_text(figures, allow_nan=True))] if json_path else []
    write_all(files + ([(output, csv_bytes(simulated()))] if output else []))
    out.print(table)


def _sim_logs(
    tool: tuple[Path, tuple[Path, ...]],
    logs: list[Path],
    options: "DiagnosisOptions",
    restart_s: float | None,
) -> "tuple[dict[str, Any], Callable[[], Log], Table]":
    """The gap between a tool (its rig, and the files with the joints of the logs) and logs: the
    figures, a function that returns the simulated rows where there is one log, and the table to
    print.
    """
    from vgroove.gap.simulate import compute_gap, gap_table, simulated_log
    from vgroove.gap.stages import read_logs
    from vgroove.rig import read_joints, read_rig

    if restart_s is not None and not 0.0 < restart_s < float("inf"):
        raise VgrooveError(f"--restart-s must be above 0, not {restart_s:g}")
    rig = read_rig(tool[0])
    if restart_s is not None and rig.mechanism["kind"] == "impact":
        raise VgrooveError(
            "--restart-s: statistics of a hammering tool's cycles are compared, and the model is "
            "not restarted: leave the option out"
        )
    options = replace(options, joints=read_joints(tool[1], rig, len(logs)))
    figures, problem = compute_gap(rig, read_logs(logs, rig, options), options, restart_s)
    for warning in figures["warnings"]:
        print_warning(Console(stderr=True), warning)
    return figures, lambda: simulated_log(problem), gap_table(figures)


def _sim_scenario(
    tool: tuple[Path, tuple[Path, ...]], seconds: float | None
) -> "tuple[dict[str, Any], Callable[[], Log], Table]":
    from vgroove.plant_alone import scenario_figures, scenario_table, simulate_scenario
    from vgroove.scenario import read_scenario_or_rig, with_duration, with_joint

    scenario = with_joint(with_duration(read_scenario_or_rig(tool[0]), seconds), tool[1])
    simulated = simulate_scenario(scenario)
    figures = scenario_figures(simulated)
    return figures, lambda: simulated, scenario_table(figures)


def _columns(maps: list[str] | None, map_file: Path | None) -> "ColumnMap":
    from vgroove.log import column_map

    return column_map(maps or (), map_file)


def _write_json(path: Path | None, figures: dict[str, Any]) -> None:
    from vgroove.output import write_json

    if path is not None:
        write_json(path, figures, allow_nan=True)


def _check_outputs(*outputs: Path | None, inputs: Sequence[Path] = ()) -> None:
    from vgroove.output import check_outputs

    check_outputs(outputs, inputs)


@rig_app.callback()
def rig_commands() -> None:
    """Rigs: what the simulation assumes about a tool."""


@rig_app.command("new")
def rig_new(
    output: Annotated[
        Path | None,
        typer.Argument(metavar="[OUT]", help="File to write; without: standard output."),
    ] = None,
    kind: Annotated[
        str,
        typer.Option(help="free, torque, pendulum, hard_joint, disc_spring or wood_screw."),
    ] = "free",
) -> None:
    """Write a complete rig with a comment on each key: replace its values by those of your tool."""
    from vgroove.output import write_text
    from vgroove.rig_template import template_text

    text = template_text(kind)
    if output is None:
        typer.echo(text, nl=False)
        return
    if output.exists():
        raise VgrooveError(f"{output}: exists already: name a new file")
    write_text(output, text)


@log_app.callback()
def log_commands() -> None:
    """Logs: what one holds, whether it can be used, how two differ."""


@log_app.command("check")
def log_check(
    path: Annotated[Path, typer.Argument(metavar="LOG", help="Log to check.")],
    rig: Annotated[
        Path | None, typer.Option("--rig", help="Rig, with whose simulation units are compared.")
    ] = None,
    json_path: Annotated[
        Path | None, typer.Option("--json", help="Write facts and findings as JSON.")
    ] = None,
    as_is: Annotated[
        bool, typer.Option("--as-is", help="Warn of findings that refuse the log; exit code 0.")
    ] = False,
    joint: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Impact tool: the joint of the log, as in a diagnosis."),
    ] = None,
    maps: Maps = None,
    map_file: MapFile = None,
) -> None:
    """Rows, rate, missing rows, ranges and signs of a log; with --rig also its units, the
    convention of its rows, and the time that a diagnosis takes. Exit code 2 for a log that a
    diagnosis would refuse.
    """
    from vgroove.gap.log_check.command import check_file, read_tool
    from vgroove.log import read_log

    _check_outputs(json_path, inputs=[each for each in (path, rig, joint) if each])
    tool = read_tool(rig, joint)
    check_file(read_log(path, _columns(maps, map_file)), tool, json_path, as_is)


@log_app.command("compare")
def log_compare(
    path_a: Annotated[Path, typer.Argument(metavar="A", help="First log.")],
    path_b: Annotated[Path, typer.Argument(metavar="B", help="Log compared with it.")],
    json_path: Annotated[
        Path | None, typer.Option("--json", help="Write all figures as JSON.")
    ] = None,
    html_path: Annotated[
        Path | None, typer.Option("--html", help="Write one self-contained page.")
    ] = None,
    require: Annotated[
        str | None,
        typer.Option(help="equal or explained: exit code 3 where the logs differ more than that."),
    ] = None,
    max_shift_s: Annotated[
        float, typer.Option("--max-shift", metavar="S", help="Largest time offset searched, in s.")
    ] = 0.1,
    maps: Maps = None,
    map_file: MapFile = None,
) -> None:
    """Compare two logs: first difference by column and time, gap of each column, and whether
    resolution or timing explains it.
    """
    from vgroove.log_compare.command import compare_files

    _check_outputs(json_path, html_path, inputs=[path_a, path_b])
    columns = _columns(maps, map_file)
    compare_files((path_a, path_b), columns, (json_path, html_path), require, max_shift_s)


@gap_app.command("diagnose")
def gap_diagnose(
    logs: Annotated[
        list[Path], typer.Argument(metavar="LOG...", help="Logs of one tool, diagnosed together.")
    ],
    rig: Annotated[
        Path, typer.Option("--rig", help="Rig file: the parameters of the simulated tool.")
    ],
    json_path: Annotated[
        Path | None, typer.Option("--json", help="Write the verdict as JSON.")
    ] = None,
    html_path: Annotated[
        Path | None, typer.Option("--html", help="Write one self-contained page.")
    ] = None,
    out_rig: Annotated[
        Path | None,
        typer.Option(
            "--out-rig", help="Write the rig with fitted parameters and selected effects."
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the bootstrap.")] = 0,
    without: Annotated[
        list[str] | None,
        typer.Option(
            "--without", metavar="ID", help="Leave an effect out of the catalogue; may be repeated."
        ),
    ] = None,
    joint: Joints = None,
    from_s: FromS = None,
    to_s: ToS = None,
    as_is: AsIs = False,
    maps: Maps = None,
    map_file: MapFile = None,
    junit_path: JunitPath = None,
    fail_above: FailAbove = None,
    firmware: FirmwarePath = None,
) -> None:
    """Find where logs and simulation differ, which effect the simulation lacks, and how much that
    effect reduces the gap.
    """
    from vgroove.gap import DiagnosisOptions
    from vgroove.gap.command import InputPaths, OutputPaths, diagnose_files

    outputs = OutputPaths(json_path, html_path, out_rig, junit_path, fail_above)
    columns, ids = _columns(maps, map_file), tuple(without or ())
    options = DiagnosisOptions(seed, ids, from_s=from_s, to_s=to_s, as_is=as_is, columns=columns)
    diagnose_files(InputPaths(logs, rig, tuple(joint or ()), firmware), outputs, options)


@gap_app.command("emps")
def gap_emps(
    directory: Annotated[
        Path,
        typer.Argument(metavar="DIR", help="Folder with log.csv and rig.toml of the EMPS axis."),
    ],
    json_path: Annotated[
        Path | None, typer.Option("--json", help="Write all figures as JSON.")
    ] = None,
) -> None:
    """Force errors of the EMPS benchmark axis as the model grows: mass, + viscous, + Coulomb, +
    offset, + directional viscous friction.
    """
    _check_outputs(json_path)
    from vgroove.gap.emps import emps_figures, emps_tables

    figures = emps_figures(directory)
    for table in emps_tables(figures):
        result_console(json_path).print(table)
    _write_json(json_path, figures)


@app.command()
def effects(
    effect_id: Annotated[
        str | None, typer.Argument(metavar="[ID]", help="Show one effect in full.")
    ] = None,
    json_path: Annotated[Path | None, typer.Option("--json", help="Write all entries.")] = None,
    markdown: Annotated[
        bool, typer.Option("--markdown", help="Print the table of docs/spec/gap.md.")
    ] = False,
) -> None:
    """List the effects of the catalogue, or show one: equation, parameters, necessary channels."""
    from vgroove.gap.catalogue.listing import effect_lines, effect_rows, list_lines, markdown_table

    _check_outputs(json_path)
    lines = effect_lines(effect_id) if effect_id else list_lines()
    _write_json(json_path, {"schema": "vgroove.effects/1", "effects": effect_rows()})
    for line in markdown_table().splitlines() if markdown else lines:
        print_line(result_console(json_path), line)


def _drop_standard_output() -> None:
    """Let what is left for standard output, which cannot be written, go nowhere."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def main() -> None:
    """Run the command line. Exit codes: 2 after a VgrooveError or where a file or standard output
    cannot be written, with a sentence on stderr; 1 where the reader of standard output has closed
    it; 130 after Ctrl-C; 128 + N where signal N ended a run.
    """
    import_without_asammdf()
    try:
        app()
    except VgrooveError as error:
        print_line(Console(stderr=True), f"vgroove: {error}", style="red")
        sys.exit(2)
    except BrokenPipeError:
        _drop_standard_output()
        sys.exit(1)
    except OSError as error:
        _drop_standard_output()
        what = error.filename or "standard output"
        print_line(
            Console(stderr=True), f"vgroove: {what}: {error.strerror or error}.", style="red"
        )
        sys.exit(2)
    except (KeyboardInterrupt, SystemExit) as ended:
        if not _by_ctrl_c(ended):
            raise
        print_line(Console(stderr=True), "vgroove: ended by Ctrl-C.")
        sys.exit(130)
    except Terminated as signalled:
        sys.exit(signalled.exit_code)


def _by_ctrl_c(error: BaseException | None) -> bool:
    """Whether Ctrl-C caused an exception: typer turns it into a SystemExit."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


if __name__ == "__main__":
    main()
