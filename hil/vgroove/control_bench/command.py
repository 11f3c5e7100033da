"""The commands `vgroove bench control` (tables on the terminal, JSON, page) and
`vgroove bench figures`.
"""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from vgroove.unused_options import refuse_given

app = typer.Typer()  # its commands are those of `vgroove bench`
HALVES = ("both", "tune", "report")
PLATFORMS = ("sil", "avr")
PIPED_WIDTH = 200  # columns of a table that goes into a file or a pipe


def check_parts(parts: Sequence[str], known: Sequence[str]) -> None:
    """VgrooveError for a part that does not exist."""
    from vgroove.errors import VgrooveError

    unknown = [name for name in parts if name not in known]
    if unknown:
        raise VgrooveError(f"--part must be one of {', '.join(known)}, not {unknown[0]}")


def check_choice(context: typer.Context, parts: Sequence[str], half: str, on: str) -> None:
    """VgrooveError for an unknown half or platform, and for options without effect: on the ELF, or
    on the named parts.
    """
    from vgroove.control_bench.control import fixed_sentence
    from vgroove.errors import VgrooveError

    if half not in HALVES or on not in PLATFORMS:
        raise VgrooveError(
            f"--set is one of {', '.join(HALVES)}, --on sil or avr; not {half}, {on}"
        )
    if on == "avr":
        refuse_given(context, ("half", "only_fifth", "draws"), "the drives on the ELF are fixed")
    if fixed := fixed_sentence(parts):
        refuse_given(context, ("draws",), fixed)


def processor_s() -> float:
    """Processor time in s of this process and of its children that have ended."""
    used = os.times()
    return used.user + used.system + used.children_user + used.children_system


@app.command("control")
def control_command(
    context: typer.Context,
    part: Annotated[
        list[str] | None,
        typer.Option(
            "--part",
            help="blows, blows_drawn, sync, sync_drawn, screwing, screwing_drawn, vibration, "
            "vibration_drawn, torque, torque_drawn, torque_adapted, drill; may be repeated. "
            "Without: all.",
        ),
    ] = None,
    half: Annotated[
        str,
        typer.Option("--set", help="Half of the cells: tune (for development), report, or both."),
    ] = "both",
    on: Annotated[
        str,
        typer.Option(
            help="sil: native firmware; avr: a subset of drives on the ELF, whose decisions are "
            "compared with those of sil."
        ),
    ] = "sil",
    only_fifth: Annotated[bool, typer.Option("--fifth", help="Every fifth cell.")] = False,
    draws: Annotated[
        int,
        typer.Option(
            min=1,
            help="Draws of each scattered cell, times the usual number; refused for a named part "
            "whose cells are fixed (blows, sync, vibration).",
        ),
    ] = 1,
    json_path: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write every figure as JSON.")
    ] = None,
    html_path: Annotated[
        Path | None,
        typer.Option("--html", metavar="FILE", help="Write tables and plots as one page."),
    ] = None,
) -> None:
    """Controllers against no control: synchronism, screwing, vibration, torque, drill driver, blow
    detection, in SIL.
    """
    from vgroove.control_bench.avr import avr_bench
    from vgroove.control_bench.control import PARTS, Choice, control_bench
    from vgroove.output import check_outputs, json_text, write_all
    from vgroove.terminal import print_line, print_results, table_console

    parts = part or list(PARTS)
    check_parts(parts, list(PARTS))
    check_choice(context, part or (), half, on)
    check_outputs((json_path, html_path))
    began_s = processor_s()
    choice = Choice(None if half == "both" else half, only_fifth, draws)
    report = avr_bench(parts) if on == "avr" else control_bench(parts, choice)
    console = table_console(json_path, html_path, piped_width=PIPED_WIDTH)
    print_results(console, report.lines, report.tables)
    print_line(console, f"{processor_s() - began_s:.0f} s of processor time.")
    files = [(json_path, json_text(report.data))] if json_path else []
    files += [(html_path, report.page().as_html())] if html_path else []
    write_all(files)


@app.command("figures")
def figures_command(
    folder: Annotated[Path, typer.Argument(help="Where the figures go, e.g. docs/images.")],
    part: Annotated[
        list[str] | None,
        typer.Option(
            "--part",
            help="blows, sync, screwing, vibration, torque or drill; may be repeated. "
            "Without: all.",
        ),
    ] = None,
) -> None:
    """Waveforms of the controllers' pages as SVG: the same drives with and without control,
    in SIL.
    """
    from vgroove.control_bench.figures import WAVES, write_figures
    from vgroove.terminal import print_line

    parts = part or list(WAVES)
    check_parts(parts, list(WAVES))
    for path in write_figures(parts, folder):
        print_line(Console(), f"written: {path}")
