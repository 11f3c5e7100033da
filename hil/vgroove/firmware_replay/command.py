"""The command `vgroove gap firmware`, and the section `firmware` of a verdict."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from vgroove.firmware_replay.kinds import FirmwareResult
    from vgroove.log import ColumnMap
    from vgroove.rig import Rig

app = typer.Typer()  # its command is one of `vgroove gap`
SCHEMA = "vgroove.firmware/2"
FirmwarePath = Annotated[
    Path | None,
    typer.Option(
        "--firmware",
        metavar="FILE",
        help="JSON file with mode and EEPROM parameters that the board is assumed to have: replay "
        "the firmware on the logs' rows and add the section `firmware` to the verdict.",
    ),
]


def firmware_results(
    logs: Sequence[Path], firmware_path: Path, columns: "ColumnMap"
) -> "list[FirmwareResult]":
    """Results of the replay of log files; VgrooveError for files that cannot be replayed."""
    from vgroove.firmware_replay.assumed_firmware import read_assumed_firmware
    from vgroove.firmware_replay.kinds import judge_firmware
    from vgroove.log import read_log

    assumed = read_assumed_firmware(firmware_path)
    return [judge_firmware(read_log(path, columns), assumed) for path in logs]


def with_closed_loops(
    results: "Sequence[FirmwareResult]",
    logs: Sequence[Path],
    firmware_path: Path,
    columns: "ColumnMap",
    tools: "Sequence[tuple[Rig, Rig]]",
) -> "list[FirmwareResult]":
    """The results with the closed loop of each log; tools: of each the rig, and the corrected one.
    VgrooveError for a rig that cannot be simulated with a board.
    """
    from vgroove.firmware_replay.assumed_firmware import read_assumed_firmware
    from vgroove.firmware_replay.closed_loop import closed_loop
    from vgroove.log import read_log

    assumed = read_assumed_firmware(firmware_path)
    return [
        replace(result, closed_loop=closed_loop(read_log(path, columns), *pair, assumed))
        for result, path, pair in zip(results, logs, tools, strict=True)
    ]


def firmware_section(results: "Sequence[FirmwareResult]") -> dict[str, Any]:
    """Section `firmware` of a verdict: `firmware` where the firmware of a log differs from the
    assumed one, else `none`.
    """
    verdict = "firmware" if any(result.kind for result in results) else "none"
    logs = [result.as_dict() for result in results]
    return {"schema": SCHEMA, "verdict": verdict, "logs": logs}


@app.command("firmware")
def firmware_command(
    logs: Annotated[
        list[Path], typer.Argument(metavar="LOG...", help="Telemetry of a board from its start on.")
    ],
    assumed: Annotated[
        Path,
        typer.Option(
            "--firmware",
            metavar="FILE",
            help="JSON file with mode and EEPROM parameters that the board is assumed to have.",
        ),
    ],
    json_path: Annotated[
        Path | None, typer.Option("--json", help="Write the result as JSON.")
    ] = None,
) -> None:
    """Run the native firmware on the measured inputs of logs and compare its duty with the logged
    one: name the first tick at which they differ, and whether another parameter, a later change of
    state, a late bridge or another build is the cause.
    """
    from vgroove.log import NO_MAP
    from vgroove.output import check_outputs, write_json
    from vgroove.terminal import print_results, result_console

    check_outputs((json_path,), (*logs, assumed))
    results = firmware_results(logs, assumed, NO_MAP)
    if json_path is not None:
        write_json(json_path, firmware_section(results))
    lines = [line for result in results for line in result.summary()]
    print_results(result_console(json_path), lines, ())
