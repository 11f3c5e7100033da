"""The command `vgroove log check`: reads a log, prints what it holds and the findings against its
use.
"""

from pathlib import Path

from rich.console import Console
from rich.table import Table

from vgroove.errors import VgrooveError
from vgroove.gap.log_check import LogCheck, LogFacts, check_log
from vgroove.log import Log
from vgroove.output import write_json
from vgroove.rig import Rig, read_joints, read_rig
from vgroove.terminal import print_line, print_warning, result_console


def read_tool(rig_path: Path | None, joint_path: Path | None) -> Rig | None:
    """The rig of a log, with the joint of a file where one is named; VgrooveError for a joint
    without a rig.
    """
    if rig_path is None:
        if joint_path is not None:
            raise VgrooveError("--joint needs --rig: it replaces the [load] of a rig")
        return None
    rig = read_rig(rig_path)
    return read_joints([joint_path], rig, 1)[0] if joint_path is not None else rig


def check_file(log: Log, rig: Rig | None, json_path: Path | None, as_is: bool = False) -> None:
    """Check a log; the facts go to stdout, warnings to stderr, with as_is also the findings that
    refuse the log. VgrooveError with these otherwise, after all else is written.
    """
    check = check_log(log, rig)
    if json_path is not None:
        write_json(json_path, check.as_dict())
    print_check(check, log.warnings, result_console(json_path))
    refusals = [finding.text for finding in check.findings if finding.refuses]
    if as_is:
        for text in refusals:
            print_warning(Console(stderr=True), f"{log.source}: {text}")
    elif refusals:
        raise VgrooveError(f"{log.source}: {'; '.join(refusals)}")


def print_check(check: LogCheck, warnings: list[str], out: Console) -> None:
    """Print facts and remarks of a check."""
    for line in fact_lines(check.facts):
        print_line(out, line)
    out.print(column_table(check.facts))
    for finding in check.findings:
        if not finding.refuses:
            print_line(out, finding.text)
    for warning in warnings:
        print_warning(Console(stderr=True), warning)


def fact_lines(facts: LogFacts) -> list[str]:
    """Sentences on a log as a whole."""
    missing = "no missing rows"
    if facts.missing_intervals:
        longest = f"{facts.longest_missing_s:.4g} s"
        missing = f"missing rows in {facts.missing_intervals} intervals, the longest {longest}"
    lines = [
        f"{facts.source}: {facts.rows} rows in {facts.duration_s:.4g} s, median interval "
        f"{facts.interval_s:.4g} s ({facts.rate_hz:.4g} Hz), {missing}",
        f"command: rows are {facts.command_rows} ({facts.command_rows_reason})",
        f"a diagnosis takes about {facts.diagnosis_s:.0f} s of processor time "
        f"({facts.diagnosis_longer})",
    ]
    if facts.unsigned_current:
        lines.append("current_a is unsigned: it is never negative while the drive brakes")
    return lines


def column_table(facts: LogFacts) -> Table:
    """Ranges, units and signs of the columns."""
    table = Table(title="columns", title_justify="left")
    for name in ("column", "unit", "least", "greatest", "sign", "missing"):
        table.add_column(
            name, justify="right" if name in ("least", "greatest", "missing") else "left"
        )
    for name, column in facts.columns.items():
        low, high = ("" if v is None else f"{v:.4g}" for v in (column.low, column.high))
        table.add_row(name, column.unit or "1", low, high, column.sign, str(column.missing))
    return table
