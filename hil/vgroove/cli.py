"""Command line: each command's work is done in the module it names; here stand only arguments, errors and exit codes."""

import os
import sys

import typer
from rich.console import Console

from vgroove.errors import VgrooveError

app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)
gap_app = typer.Typer(no_args_is_help=True, help="Diagnose the gap between a log and its simulation.")
app.add_typer(gap_app, name="gap")


def main() -> None:
    """Run the command line; a VgrooveError becomes its sentence on stderr and exit code 2, Ctrl-C exit code 130."""
    try:
        app()
    except VgrooveError as error:
        Console(stderr=True).print(f"vgroove: {error}", style="red", highlight=False, markup=False, soft_wrap=True)
        sys.exit(2)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
