"""`vgroove hil`: a scenario in real time against a board, with its log, the figures and the times
of the exchange.
"""

import csv
import io
import json
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

from vgroove.command_answers import answers_in, refused_modes, unanswered_text
from vgroove.errors import VgrooveError
from vgroove.html_page import Table
from vgroove.output import check_outputs, write_all
from vgroove.progress import seconds_bar
from vgroove.real_time.exchange import COMPLETE, RealTimeRun, run_in_real_time
from vgroove.real_time.figures import (
    LEAST_EXCHANGES,
    clock_sentence,
    late_sentence,
    timing_figures,
    timing_rows,
)
from vgroove.real_time.frames import TICK_S
from vgroove.real_time.link import BusLink, Link, RunEnded, SerialLink
from vgroove.real_time.priority import workers_prioritised
from vgroove.real_time.tool_ticks import ToolTicks
from vgroove.recording_files import file_type
from vgroove.run import RunLog
from vgroove.scenario import Scenario
from vgroove.terminal import print_line, print_warning, table_console
from vgroove.termination import Terminated, interrupt_on_signals

TIMING_HEADER = (
    "tick",
    "received_s",
    "board_clock_s",
    "board_clock_corrected_s",
    "delay_s",
    "step_s",
)
ROWS = (
    ("period of the exchange in ms", "period_s", 1e3),
    ("jitter: its distance from its median, in ms", "jitter_s", 1e3),
    ("execution time of the tool's step in ms", "step_s", 1e3),
    ("from command to answer in ticks", "latency_ticks", 1.0),
)


@dataclass(frozen=True)
class HilOptions:
    """Options of `vgroove hil`: the board's line (either `port` or `bus`), the files to write,
    and whether the kernel's worker threads get real-time priority.
    """

    port: str | None = None
    bus: str | None = None
    baud: int = 1_000_000
    output: Path | None = None
    json_path: Path | None = None
    timing: Path | None = None
    kernel_workers: bool = False


@contextmanager
def _link(options: HilOptions) -> Iterator[Link]:
    if (options.port is None) == (options.bus is None):
        raise VgrooveError("name the board's line: either --port PORT or --bus INTERFACE:CHANNEL")
    link = BusLink(options.bus) if options.port is None else SerialLink(options.port, options.baud)
    try:
        yield link
    finally:
        link.close()


def run_hil(scenario: Scenario, options: HilOptions, errors: Console) -> None:
    """Run a scenario against a board and write its files, also where the run ends early.

    VgrooveError: no board, a lost line, or inputs so late that the board has opened the bridge.
    """
    if options.output:
        file_type(options.output)
    outputs = (options.output, options.json_path, options.timing)
    check_outputs(outputs, (scenario.rig_path, Path(scenario.source)))
    run, ticks = RealTimeRun(), round(scenario.duration_s / TICK_S)
    with interrupt_on_signals():
        try:
            with _link(options) as link, seconds_bar(scenario.duration_s, console=errors) as bar:
                tool = ToolTicks(scenario)
                with workers_prioritised() if options.kernel_workers else nullcontext():
                    run_in_real_time(link, tool, ticks, run, lambda k: bar.move_to(k * TICK_S))
        except (VgrooveError, KeyboardInterrupt, Terminated) as error:
            run.ended = _reason(error)
            _write(run, options, errors)
            raise
    figures = _write(run, options, errors)
    answers = answers_in(bytes(run.telemetry))
    for sentence in refused_modes(scenario.commands, answers):
        print_warning(errors, sentence)
    if unanswered := unanswered_text(scenario.commands, answers, scenario.duration_s):
        raise VgrooveError(
            f"{unanswered} on the line, so that the log may not be that of the scenario; check the "
            "line, and send commands at least 20 ms apart"
        )
    if run.safe_ticks:
        at = ", ".join(f"{tick * TICK_S:g}" for tick in run.safe_ticks[:5])
        raise VgrooveError(
            f"the host was late by 5 ms or more after {at} s, and the board opened the bridge: the "
            "log is not that of the scenario; end other programs or use another computer "
            f"({late_sentence(figures)})"
        )


def _reason(error: BaseException) -> str:
    """Why a run ended before its last exchange."""
    if isinstance(error, RunEnded):
        return error.reason
    return "error" if isinstance(error, VgrooveError) else "interrupted"


def _print_end(run: RealTimeRun, options: HilOptions, errors: Console) -> None:
    """Print why an incomplete run ended and how many of its exchanges are in its files."""
    if run.ended == COMPLETE or len(run.exchanges) < LEAST_EXCHANGES:
        return
    paths = (options.output, options.json_path, options.timing)
    files = ", ".join(str(path) for path in paths if path)
    text = f"{run.ended}: {len(run.exchanges)} of {run.planned} exchanges"
    print_line(errors, f"{text} in {files}" if files else text)


def _write(run: RealTimeRun, options: HilOptions, errors: Console) -> dict[str, Any]:
    """Write log, figures and times; print the figures. Returns these."""
    if options.output and run.telemetry:
        log = RunLog(options.output)
        log.add(bytes(run.telemetry))
        print_line(errors, f"{log.close()} rows in {options.output}")
        if log.restart_text:
            print_warning(errors, log.restart_text)
    _print_end(run, options, errors)
    if len(run.exchanges) < LEAST_EXCHANGES:
        return {}
    figures = timing_figures(run)
    files = []
    if options.json_path:
        content = {"schema": "vgroove.hil/1", **figures}
        files.append((options.json_path, json.dumps(content, indent=1) + "\n"))
    if options.timing:
        files.append((options.timing, _timing_csv(run, figures)))
    write_all(files)
    console = table_console(options.json_path, options.timing)
    console.print(_table(figures).as_rich())
    for line in _lines(figures):
        print_line(console, line)
    return figures


def _timing_csv(run: RealTimeRun, figures: dict[str, Any]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(TIMING_HEADER)
    for tick, *times in timing_rows(run.exchanges, figures["clock"]):
        writer.writerow([tick, *(f"{value:.6f}" for value in times)])
    return text.getvalue()


def _table(figures: dict[str, Any]) -> Table:
    header = ("quantity", *figures["period_s"])
    rows = [
        [text, *(factor * value for value in figures[key].values())] for text, key, factor in ROWS
    ]
    return Table("timing", f"Exchange of {figures['exchanges']} ticks", header, rows)


def _lines(figures: dict[str, Any]) -> list[str]:
    priority = "with" if figures["real_time_priority"] else "without"
    return [
        f"{late_sentence(figures)}; the board waited for {figures['held_ticks']} ms altogether "
        f"({priority} real-time priority)",
        f"damaged frames {figures['frames_damaged']}, bytes of no frame "
        f"{figures['bytes_skipped']}, inputs sent again {figures['sent_again']} times",
        clock_sentence(figures["clock"]),
    ]
