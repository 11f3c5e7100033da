"""`vgroove record`: the recorder with counters on the terminal, ended by Ctrl-C, a terminate signal
or a hang-up.
"""

from pathlib import Path

from rich.console import Console
from rich.live import Live
from rich.table import Table

from vgroove.recorder import Recording, record
from vgroove.signals import stop_on_signals
from vgroove.terminal import print_line, print_warning


def _counters(recording: Recording) -> Table:
    """One line: file, board time, rows, losses."""
    counters = recording.session.counters
    table = Table.grid(padding=(0, 2))
    colour = "red" if counters.lost + counters.corrupt else "green"
    losses = f"{counters.lost} lost, {counters.corrupt} corrupt, {counters.skipped_bytes} B skipped"
    table.add_row(
        f"[bold]{recording.output.name}[/]",
        f"{recording.recorded_s:8.1f} s",
        f"{counters.fast} samples",
        f"[{colour}]{losses}[/]",
    )
    return table


def summary(recording: Recording) -> str:
    """What was recorded and what was lost, in two or three lines."""
    counters, boot = recording.session.counters, recording.session.boot or {}
    length = f"{recording.rows} rows, {recording.recorded_s:.1f} s"
    lines = [
        f"{recording.output}: {length}, ended: {recording.ended}",
        f"frames {counters.frames}, lost {counters.lost}, corrupt {counters.corrupt}, "
        f"skipped bytes {counters.skipped_bytes}, firmware {boot.get('build_hash', 0):06x}",
    ]
    if recording.session.table is None:
        lines.append("the parameters are not complete: the board did not answer DUMP")
    return "\n".join(lines)


def record_with_progress(
    port: str, output: Path, seconds: float | None, baud: int, without_boot: bool = False
) -> None:
    """Record with a line of counters on the terminal; VgrooveError as `record` raises it."""
    console = Console(stderr=True)
    recording = Recording(port, output, baud, seconds, without_boot)
    recording.notify = lambda text: print_warning(console, text)
    with stop_on_signals() as stop:
        if console.is_terminal:
            with Live(console=console, auto_refresh=False, transient=True) as live:
                record(recording, stop, lambda now: live.update(_counters(now), refresh=True))
        else:
            record(recording, stop)
    print_line(console, summary(recording))
