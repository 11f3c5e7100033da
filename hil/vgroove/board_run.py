"""`vgroove run --on PORT`: a run of the diagnosis' menu on a real board, recorded as `vgroove
record` records.
"""

import json
from collections.abc import Callable
from pathlib import Path

from rich.console import Console

from vgroove.conductor import Conductor
from vgroove.errors import VgrooveError
from vgroove.gap.next_run.menu import MENU, Course, named, proposed
from vgroove.recorder import Recording, record
from vgroove.recorder_cli import signals_stop, summary
from vgroove.run import RunOptions, progress_bar


def course_of(experiment: str | None, verdict: Path | None) -> Course:
    """The run that the options ask for; VgrooveError where they ask for none, or for two."""
    if (experiment is None) == (verdict is None):
        names = ", ".join(course.name for course in MENU)
        raise VgrooveError(
            f"a board performs one run: --next VERDICT.json, or --experiment with one of {names}"
        )
    if experiment is not None:
        return named(experiment)
    try:
        content = json.loads(verdict.read_text("utf-8"))
    except OSError as error:
        raise VgrooveError(f"{verdict}: cannot be read: {error.strerror or error}") from error
    except ValueError as error:
        raise VgrooveError(f"{verdict}: is no JSON: {error}") from error
    if not isinstance(content, dict):
        raise VgrooveError(f"{verdict}: is not a verdict of `vgroove gap diagnose --json`")
    return proposed(content, str(verdict))


class Operator:
    """Tells the person at the trigger what to do: on a terminal in the bar, else line by line, each
    once.
    """

    def __init__(self, console: Console, conductor: Conductor, bar: Callable[..., None]) -> None:
        self._console, self._conductor, self._bar, self._said = console, conductor, bar, ""

    def __call__(self, recording: Recording) -> None:
        del recording
        hint = self._conductor.hint()
        self._bar(self._conductor.played_s, description=hint)
        if not self._console.is_terminal and hint != self._said:
            self._console.print(hint, highlight=False, markup=False, soft_wrap=True)
        self._said = hint


def run_on_board(options: RunOptions, course: Course, baud: int) -> None:
    """Perform and record; VgrooveError as `record` raises it or with what ended the run,
    KeyboardInterrupt on Ctrl-C: both keep the log.
    """
    if options != RunOptions(options.on, output=options.output):
        raise VgrooveError(
            "--target, --elf, --pty, --real-time, --stats and --eeprom belong to --on sil and --on avr"
        )
    if options.output is None:
        raise VgrooveError("a run on a board is recorded: say where with -o LOG")
    console = Console(stderr=True)
    recording = Recording(options.on, options.output, baud)
    recording.partner = conductor = Conductor(course, recording.session)
    with signals_stop() as stop:
        try:
            with progress_bar(console, conductor.total_s) as bar:
                record(recording, stop, Operator(console, conductor, bar))
        except VgrooveError:
            if stop.wanted and recording.rows == 0:
                raise KeyboardInterrupt from None
            raise
        finally:
            if recording.rows:
                for line in (summary(recording), *conductor.remarks()):
                    console.print(line, highlight=False, markup=False, soft_wrap=True)
    if recording.ended == "interrupted":
        raise KeyboardInterrupt
