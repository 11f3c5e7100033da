"""The command `vgroove adapt`."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from vgroove.unused_options import refuse_given

app = typer.Typer()  # its command is one of `vgroove`
IMAGES = (".hex", ".elf")


@app.command("adapt")
def adapt_command(
    context: typer.Context,
    rig: Annotated[Path, typer.Argument(metavar="RIG", help="Rig of the tool: an impact driver.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            help="Write the firmware with the tool's torque map: .hex for `vgroove flash --hex`, "
            ".elf for the simulated board.",
        ),
    ] = None,
    target: Annotated[str, typer.Option(help="Board of -o: uno or mega.")] = "uno",
    port: Annotated[
        str | None,
        typer.Option(help="Write the parameters to the board at this serial port: /dev/ttyACM0."),
    ] = None,
    baud: Annotated[int, typer.Option(help="Rate of --port: 250000 or 115200.")] = 250_000,
    drives: Annotated[
        int,
        typer.Option(min=0, help="Drives on the plant that check the map, 0: no check."),
    ] = 40,
    json_path: Annotated[
        Path | None, typer.Option("--json", help="Write parameters, map and check as JSON.")
    ] = None,
) -> None:
    """Compute setpoints and torque map of the controllers for a tool, check them on the plant, and
    write them to the board.
    """
    from vgroove.adapt.adaptation import adapt, adapt_tables, check
    from vgroove.adapt.firmware_image import adapted_image
    from vgroove.board import default_elf
    from vgroove.board_parameters import check_board, write_parameters
    from vgroove.output import check_outputs, json_text, write_all
    from vgroove.progress import share_bar, step_bar
    from vgroove.rig import read_rig
    from vgroove.terminal import print_line, print_results, table_console

    if not port:
        refuse_given(context, ("baud",), "the rate of --port, which is not given")
    check_outputs((output, json_path), (rig,))
    _check_image(output, target)
    if not output:
        refuse_given(context, ("target",), "the board of -o, which is not given")
    tool = read_rig(rig)
    if port:
        check_board(port, baud)
    with share_bar("torque map") as bar:
        found = adapt(tool, bar.move_to)
    with step_bar(2 * drives, "drives on the plant") as tick:
        compared = check(tool, found, drives, tick) if drives else []
    figures = json_text({**found.as_dict(), "check": compared})
    files: list[tuple[Path, bytes | str]] = [(json_path, figures)] if json_path else []
    if output:
        image = adapted_image(default_elf(target), found.flash_bytes, output.suffix[1:])
        files.append((output, image))
    write_all(files)
    lines = [found.sentence, *found.warnings]
    print_results(table_console(output, json_path), lines, adapt_tables(found, compared))
    if port:
        write_parameters(port, found.parameters, baud)
        print_line(Console(stderr=True), f"{len(found.parameters)} parameters written to {port}.")


def _check_image(output: Path | None, target: str) -> None:
    """VgrooveError, before the long work, where the image cannot be made."""
    from vgroove.adapt.firmware_image import map_in_flash
    from vgroove.board import default_elf
    from vgroove.errors import VgrooveError
    from vgroove.flash import PROGRAMMERS

    if target not in PROGRAMMERS:
        raise VgrooveError(f"--target is uno or mega, not {target}")
    if output is None:
        return
    if output.suffix not in IMAGES:
        raise VgrooveError(f"-o ends in .hex or .elf, not {output.name}")
    map_in_flash(default_elf(target))
