"""The progress bar of all commands: it counts steps or seconds, on terminals only."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

Tick = Callable[[str], None]  # one step is done; the text names what is done next


class ProgressBar:
    """A progress bar; calling it is a `Tick`."""

    def __init__(self, progress: Progress, total: float, text: str) -> None:
        self._progress = progress
        self._task = progress.add_task(text, total=total)

    def __call__(self, text: str, steps: int = 1) -> None:
        """Advance by `steps` and show `text` before the bar."""
        self._progress.update(self._task, advance=steps, description=text)

    def move_to(self, done: float, text: str | None = None) -> None:
        """Set the completed amount, in the unit of the total; `text` replaces the shown one."""
        words = {} if text is None else {"description": text}
        self._progress.update(self._task, completed=done, **words)

    def restart(self, total: float) -> None:
        """Begin again at zero with another total."""
        self._progress.reset(self._task, total=total)


@contextmanager
def step_bar(
    total: int, text: str = "", console: Console | None = None, keep: bool = False
) -> Iterator[ProgressBar]:
    """A bar of `total` steps with the estimated time left; on stderr unless `console` is given.

    The bar disappears at the end unless `keep` is set. Nothing is written where the console is not
    a terminal, except the last state of a bar that is kept.
    """
    columns = (MofNCompleteColumn(), TimeRemainingColumn())
    with _bar(columns, console, keep) as progress:
        yield ProgressBar(progress, total, text)


@contextmanager
def seconds_bar(
    total_s: float, text: str = "running", console: Console | None = None
) -> Iterator[ProgressBar]:
    """A bar of seconds (of a simulation or a recording) with the wall time elapsed; use `move_to`.

    On stderr unless `console` is given; nothing is written where that is not a terminal.
    """
    columns = (TextColumn("{task.completed:.1f} / {task.total:.1f} s"), TimeElapsedColumn())
    with _bar(columns, console, keep=False) as progress:
        yield ProgressBar(progress, total_s, text)


@contextmanager
def share_bar(text: str, console: Console | None = None) -> Iterator[ProgressBar]:
    """A bar of a share from 0 to 1 in per cent, with the wall time elapsed; use `move_to`.

    On stderr unless `console` is given; nothing is written where that is not a terminal.
    """
    columns = (TextColumn("{task.percentage:3.0f} %"), TimeElapsedColumn())
    with _bar(columns, console, keep=False) as progress:
        yield ProgressBar(progress, 1.0, text)


def _bar(columns: tuple[ProgressColumn, ...], console: Console | None, keep: bool) -> Progress:
    console = console or Console(stderr=True)
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        *columns,
        console=console,
        transient=not keep,
        disable=not (keep or console.is_terminal),
    )
