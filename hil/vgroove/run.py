"""`vgroove run`: a scenario on the native firmware or on the simulated AVR, its log written as
`vgroove record` would have written it.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from vgroove import lockstep, telemetry
from vgroove.board import AvrBoard, default_elf
from vgroove.errors import VgrooveError
from vgroove.output import check_outputs, unwritable, write_bytes
from vgroove.pty_line import PtyLine
from vgroove.recorder import SINKS
from vgroove.scenario import Scenario, command_messages, make_plant
from vgroove.sil import SilBoard

Tell = Callable[[str], None]
EEPROM_BYTES = 1024  # of the native firmware
MCUS = {"uno": "atmega328p", "mega": "atmega2560"}


@dataclass(frozen=True)
class RunOptions:
    """Where and how a scenario runs."""

    on: str = "sil"  # sil | avr
    target: str = "uno"
    elf: Path | None = None
    output: Path | None = None
    pty: bool = False
    wait: bool = True
    real_time: bool = False
    stats: Path | None = None
    eeprom: Path | None = None


def _image(path: Path | None) -> bytes | None:
    if path is None or not path.exists():
        return None
    try:
        image = path.read_bytes()
    except OSError as error:
        raise VgrooveError(f"{path}: cannot be read: {error.strerror or error}") from error
    if len(image) != EEPROM_BYTES:
        raise VgrooveError(f"{path}: an EEPROM image has {EEPROM_BYTES} bytes, not {len(image)}")
    return image


def make_board(options: RunOptions, seed: int) -> AvrBoard | SilBoard:
    """The board that the options name."""
    if options.on == "sil":
        return SilBoard(eeprom=_image(options.eeprom))
    if options.on != "avr":
        raise VgrooveError(
            f"--on is sil or avr, not {options.on}; a board on a port performs --experiment NAME or --next VERDICT.json"
        )
    if options.target not in MCUS:
        raise VgrooveError(f"--target is uno or mega, not {options.target}")
    elf = options.elf or default_elf(options.target)
    return AvrBoard(
        elf, mcu=MCUS[options.target], stats=options.stats, eeprom=options.eeprom, seed=seed
    )


class Both:
    """A scenario's own commands and a pty on one line."""

    def __init__(self, script: lockstep.Script, pty: PtyLine) -> None:
        self._script, self._pty = script, pty

    def send(self, data: bytes) -> None:
        """To the pty."""
        self._pty.send(data)

    def receive(self, time_s: float) -> bytes:
        """From both."""
        return self._script.receive(time_s) + self._pty.receive(time_s)


@contextmanager
def _line(scenario: Scenario, options: RunOptions, announce: Tell) -> Iterator[lockstep.Line]:
    script = lockstep.Script(command_messages(scenario.commands))
    if not options.pty:
        yield script
        return
    with PtyLine() as pty:
        announce(pty.name)
        if options.wait:
            pty.wait_for_reader()
        yield Both(script, pty)
        pty.drain()


@contextmanager
def progress_bar(console: Console, duration_s: float) -> Iterator[Callable[..., None]]:
    """A bar on a terminal; what it yields takes the time in s, and words for `description`."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.1f} / {task.total:.1f} s"),
        TimeElapsedColumn(),
    )
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as progress:
        task = progress.add_task("running", total=duration_s)
        yield lambda time_s, **words: progress.update(task, completed=time_s, **words)


def _drive(
    scenario: Scenario,
    options: RunOptions,
    sent: bytearray,
    announce: Tell,
    show: Callable[[float], None],
) -> None:
    """Run the scenario; `sent` grows with what the board sends, so that an interrupted run leaves
    what it had.
    """
    tool, front, seed = (
        make_plant(scenario.tool, scenario.seed),
        scenario.front_ends(),
        scenario.seed,
    )
    with make_board(options, scenario.seed) as board, _line(scenario, options, announce) as line:
        begin, done = time.monotonic(), 0
        for progress in lockstep.steps(
            board, tool, scenario.profile, scenario.duration_s, front=front, line=line, seed=seed
        ):
            sent += progress.sent[done:]
            done = len(progress.sent)
            show(progress.time_s)
            if options.real_time:
                time.sleep(max(0.0, progress.time_s - (time.monotonic() - begin)))
        if options.eeprom and isinstance(board, SilBoard):  # the AVR bench keeps its image itself
            write_bytes(options.eeprom, board.eeprom())


def write_run(data: bytes, path: Path) -> int:
    """Write what a board sent as .csv, .mf4, .blf or .asc; returns the rows. Nothing appears under
    `path` before it is complete.
    """
    sink_type = SINKS.get(path.suffix.lower())
    if sink_type is None:
        raise VgrooveError(f"{path}: a log ends in .csv, .mf4, .blf or .asc")
    session = telemetry.Session()
    frames = telemetry.Framer(session.counters).feed(data)
    session.feed(frames)
    try:
        sink = sink_type(path)
        try:
            for frame in frames:
                sink.frame(frame)
            sink.block(session.take_rows())
            sink.finish()
            if sink.rows:
                sink.publish()
            return sink.rows
        finally:
            sink.discard()
    except OSError as error:
        raise unwritable(path, error) from error


def run_scenario(scenario: Scenario, options: RunOptions, out: Console, errors: Console) -> None:
    """Run and write; on Ctrl-C the log holds what had been sent until then, and KeyboardInterrupt
    goes on.
    """
    if options.output and options.output.suffix.lower() not in SINKS:
        raise VgrooveError(f"{options.output}: a log ends in .csv, .mf4, .blf or .asc")
    check_outputs(
        (options.output, options.stats, options.eeprom), (scenario.rig_path, Path(scenario.source))
    )
    sent = bytearray()
    begin = time.monotonic()
    try:
        with progress_bar(errors, scenario.duration_s) as show:
            _drive(
                scenario,
                options,
                sent,
                lambda name: out.print(name, highlight=False, soft_wrap=True),
                show,
            )
    finally:
        rows = write_run(bytes(sent), options.output) if options.output and sent else None
    took = time.monotonic() - begin
    speed = f"{scenario.duration_s:g} s simulated in {took:.1f} s ({scenario.duration_s / took:.1f} x real time)"
    errors.print(
        speed + (f", {rows} rows in {options.output}" if rows is not None else ""),
        highlight=False,
        markup=False,
        soft_wrap=True,
    )
