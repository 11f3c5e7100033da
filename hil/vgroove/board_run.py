"""`vgroove run --on PORT`: performs a run that the diagnosis can propose (gap/next_run/menu.py) on
a real board, recorded as `vgroove record` records.
"""

import json
from pathlib import Path

from rich.console import Console

from vgroove.board_checks import BoardChecks
from vgroove.errors import VgrooveError
from vgroove.gap.next_run.menu import MENU, RunProfile, profile_from_verdict, profile_named
from vgroove.guided_run import GuidedRun
from vgroove.progress import ProgressBar, seconds_bar
from vgroove.record_command import summary
from vgroove.recorder import Recording, record
from vgroove.run import RunOptions
from vgroove.terminal import print_line, print_warning
from vgroove.termination import stop_on_signals


def chosen_profile(experiment: str | None, verdict: Path | None) -> RunProfile:
    """The run that the options name; VgrooveError where they name none, or two."""
    if (experiment is None) == (verdict is None):
        names = ", ".join(profile.name for profile in MENU)
        raise VgrooveError(
            f"a board performs one run: --next VERDICT.json, or --experiment with one of {names}"
        )
    if experiment is not None:
        return profile_named(experiment)
    try:
        content = json.loads(verdict.read_text("utf-8"))
    except OSError as error:
        raise VgrooveError(f"{verdict}: cannot be read: {error.strerror or error}") from error
    except ValueError as error:
        raise VgrooveError(f"{verdict}: is no JSON: {error}") from error
    if not isinstance(content, dict):
        raise VgrooveError(f"{verdict}: is not a verdict of `vgroove gap diagnose --json`")
    return profile_from_verdict(content, str(verdict))


NO_CHECKS = BoardChecks()


class OperatorPrompt:
    """Shows the operator's instructions: in the progress bar on a terminal; elsewhere each new
    instruction is printed as a line.
    """

    def __init__(self, console: Console, run: GuidedRun, bar: ProgressBar) -> None:
        self._console, self._run, self._bar, self._shown = console, run, bar, ""

    def __call__(self, recording: Recording) -> None:
        """Show the current instruction; called by the recorder as its progress."""
        del recording
        instruction = self._run.instruction()
        self._bar.move_to(self._run.driven_s, instruction)
        if not self._console.is_terminal and instruction != self._shown:
            print_line(self._console, instruction)
        self._shown = instruction


def run_on_board(
    options: RunOptions, profile: RunProfile, baud: int, checks: BoardChecks = NO_CHECKS
) -> None:
    """Perform and record a run, and check the log.

    Raises VgrooveError as `record` does, or with the reason why the run ended early or a diagnosis
    would refuse the log, and KeyboardInterrupt on Ctrl-C; the rows recorded until then are kept.
    """
    if options.output is None:
        raise VgrooveError("a run on a board is recorded: name the log file with -o LOG")
    console = Console(stderr=True)
    recording = Recording(options.on, options.output, baud)
    recording.program = run = GuidedRun(profile, recording.session)
    recording.notify = lambda text: print_warning(console, text)
    with stop_on_signals() as stop:
        try:
            with seconds_bar(run.total_s, console=console) as bar:
                record(recording, stop, OperatorPrompt(console, run, bar))
        except VgrooveError:
            if stop.received and recording.rows == 0:
                raise KeyboardInterrupt from None
            raise
        finally:
            if recording.rows:
                for line in (summary(recording), *run.remarks()):
                    print_line(console, line)
    if recording.ended == "interrupted":
        raise KeyboardInterrupt
    for warning in checks.warnings_of(recording.output):
        print_warning(console, warning)
