"""Lines and tables on the terminal: file names and numbers are printed as they are, unwrapped."""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from vgroove.output import STDOUT

if TYPE_CHECKING:  # it loads plotly
    from vgroove.html_page import Table

PIPED_WIDTH = 130  # columns of a table that goes into a file or a pipe


def print_line(console: Console, text: str, style: str | None = None) -> None:
    """Print a text as it is: no markup, no emoji for names between colons, no highlighting, no line
    breaks added.
    """
    console.print(text, style=style, highlight=False, markup=False, emoji=False, soft_wrap=True)


def print_warning(console: Console, text: str) -> None:
    """Print a warning of the program, in yellow on a terminal."""
    print_line(console, f"vgroove: {text}", style="yellow")


def result_console(*outputs: Path | None) -> Console:
    """Where a command prints its results: stdout, or stderr where stdout is one of its files."""
    return Console(stderr=STDOUT in outputs)


def table_console(*outputs: Path | None, piped_width: int = PIPED_WIDTH) -> Console:
    """As result_console; where that is not a terminal, wide enough (columns) that tables are not
    squeezed.
    """
    console = result_console(*outputs)
    return console if console.is_terminal else Console(width=piped_width, stderr=console.stderr)


def print_results(console: Console, lines: Iterable[str], tables: Iterable["Table"]) -> None:
    """Print sentences, then tables."""
    for line in lines:
        print_line(console, line)
    for table in tables:
        console.print(table.as_rich())
