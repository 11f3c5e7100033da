"""`vgroove record`: the recorder with live values on the terminal, ended by Ctrl-C, a terminate
signal or a hang-up.
"""

import math

from rich.console import Console
from rich.live import Live

from vgroove.errors import VgrooveError
from vgroove.live_view import LiveView
from vgroove.recorder import Recording, record
from vgroove.terminal import print_line, print_warning
from vgroove.termination import stop_on_signals


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


def record_with_progress(recording: Recording, plot: bool = False) -> None:
    """Record with live values on the terminal, with `plot` also as curves; VgrooveError as `record`
    raises it, and for `plot` without a terminal.
    """
    console = Console(stderr=True)
    if recording.seconds is not None and not math.isfinite(recording.seconds):
        raise VgrooveError(f"--seconds is a number of seconds, not {recording.seconds:g}")
    if plot and not console.is_terminal:
        raise VgrooveError(
            "--plot draws on the terminal, but stderr is a file or a pipe: leave --plot out, or "
            "run the command in a terminal."
        )
    view = LiveView(plot)
    recording.notify = lambda text: print_warning(console, text)
    with stop_on_signals() as stop:
        if console.is_terminal:
            recording.take_rows = view.add
            with Live(console=console, auto_refresh=False, transient=True) as live:
                record(
                    recording,
                    stop,
                    lambda now: live.update(view.draw(now, console.width), refresh=True),
                )
        else:
            record(recording, stop)
    print_line(console, summary(recording))
