"""The terminal side of a recording: progress, counters, Ctrl-C."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from rich.console import Console
from rich.live import Live
from rich.table import Table

from vgroove.recorder import Recording, record


class _Stop:
    """Becomes true with the first Ctrl-C or terminate signal."""

    def __init__(self) -> None:
        self.wanted = False

    def __call__(self) -> bool:
        return self.wanted

    def on_signal(self, number: int, frame: FrameType | None) -> None:
        """Signal handler."""
        del number, frame
        self.wanted = True


@contextmanager
def signals_stop() -> Iterator[_Stop]:
    """A callable that is true from the first Ctrl-C or terminate signal on."""
    stop = _Stop()
    before = {
        number: signal.signal(number, stop.on_signal) for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _counters(recording: Recording) -> Table:
    """One line of figures."""
    counters = recording.session.counters
    table = Table.grid(padding=(0, 2))
    damage = counters.lost + counters.corrupt
    table.add_row(
        f"[bold]{recording.output.name}[/]",
        f"{recording.recorded_s:8.1f} s",
        f"{counters.fast} samples",
        f"[{'red' if damage else 'green'}]{counters.lost} lost, {counters.corrupt} corrupt, {counters.skipped_bytes} B skipped[/]",
    )
    return table


def summary(recording: Recording) -> str:
    """What was recorded and what was lost, in two lines."""
    counters, boot = recording.session.counters, recording.session.boot or {}
    lines = [
        f"{recording.output}: {recording.rows} rows, {recording.recorded_s:.1f} s, ended: {recording.ended}",
        f"frames {counters.frames}, lost {counters.lost}, corrupt {counters.corrupt}, skipped bytes {counters.skipped_bytes}, "
        f"firmware {boot.get('build_hash', 0):06x}",
    ]
    if recording.session.table is None:
        lines.append("the parameters are not complete: the board did not answer DUMP")
    return "\n".join(lines)


def record_with_progress(port: str, output: Path, seconds: float | None, baud: int) -> None:
    """Record with a line of counters on the terminal; VgrooveError as `record` raises it."""
    console = Console(stderr=True)
    recording = Recording(port, output, baud, seconds)
    with signals_stop() as stop:
        if console.is_terminal:
            with Live(console=console, auto_refresh=False, transient=True) as live:
                record(recording, stop, lambda now: live.update(_counters(now), refresh=True))
        else:
            record(recording, stop)
    console.print(summary(recording), highlight=False, markup=False, soft_wrap=True)
