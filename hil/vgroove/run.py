"""`vgroove run`: a scenario on the native firmware or on the simulated AVR, with the log that
`vgroove record` would have written.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from vgroove import lockstep, telemetry
from vgroove.board import AvrBoard, default_elf
from vgroove.errors import VgrooveError
from vgroove.output import check_outputs, unwritable, write_bytes
from vgroove.progress import ProgressBar, seconds_bar
from vgroove.pty_line import PtyLine
from vgroove.recording_files import file_type
from vgroove.scenario import Scenario, command_messages, make_plant
from vgroove.sil import SilBoard
from vgroove.terminal import print_line

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


def _eeprom_image(path: Path | None) -> bytes | None:
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
        return SilBoard(eeprom=_eeprom_image(options.eeprom))
    if options.on != "avr":
        raise VgrooveError(
            f"--on is sil or avr, not {options.on}; a board on a port performs --experiment NAME "
            "or --next VERDICT.json"
        )
    if options.target not in MCUS:
        raise VgrooveError(f"--target is uno or mega, not {options.target}")
    elf = options.elf or default_elf(options.target)
    return AvrBoard(
        elf, mcu=MCUS[options.target], stats=options.stats, eeprom=options.eeprom, seed=seed
    )


class ScriptAndPty:
    """The board's line with two senders: the scenario's commands and the reader of a pty."""

    def __init__(self, script: lockstep.Script, pty: PtyLine) -> None:
        self._script, self._pty = script, pty

    def send(self, data: bytes) -> None:
        """Bytes of the board, to the pty."""
        self._pty.send(data)

    def receive(self, time_s: float) -> bytes:
        """Bytes for the board, from both."""
        return self._script.receive(time_s) + self._pty.receive(time_s)


@contextmanager
def _line(
    scenario: Scenario, options: RunOptions, announce: Callable[[str], None]
) -> Iterator[lockstep.Line]:
    script = lockstep.Script(command_messages(scenario.commands))
    if not options.pty:
        yield script
        return
    with PtyLine() as pty:
        announce(pty.name)
        if options.wait:
            pty.wait_for_reader()
        yield ScriptAndPty(script, pty)
        pty.drain()


def _run_in_lockstep(
    scenario: Scenario, options: RunOptions, sent: bytearray, out: Console, bar: ProgressBar
) -> None:
    """Run the scenario. `sent` grows with the bytes of the board, so that an interrupted run leaves
    those sent until then.
    """
    tool = make_plant(scenario.tool, scenario.seed)
    front = scenario.front_ends()
    with (
        make_board(options, scenario.seed) as board,
        _line(scenario, options, lambda name: print_line(out, name)) as line,
    ):
        begin, done = time.monotonic(), 0
        for now in lockstep.steps(
            board,
            tool,
            scenario.profile,
            scenario.duration_s,
            lockstep.LockstepOptions(front=front, line=line, seed=scenario.seed),
        ):
            sent += now.sent[done:]
            done = len(now.sent)
            bar.move_to(now.time_s)
            if options.real_time:
                time.sleep(max(0.0, now.time_s - (time.monotonic() - begin)))
        if options.eeprom and isinstance(board, SilBoard):  # vgroove-board writes its image itself
            write_bytes(options.eeprom, board.eeprom())


def write_run(data: bytes, path: Path) -> int:
    """Write the bytes of a board as .csv, .mf4, .blf or .asc, whole or not at all; returns the
    number of rows.
    """
    create = file_type(path)
    session = telemetry.Session()
    frames = telemetry.Framer(session.counters).feed(data)
    session.feed(frames)
    try:
        file = create(path)
        try:
            for frame in frames:
                file.add_frame(frame)
            file.add_rows(session.take_rows())
            file.finish()
            if file.rows:
                file.publish()
            return file.rows
        finally:
            file.discard()
    except OSError as error:
        raise unwritable(path, error) from error


def run_scenario(scenario: Scenario, options: RunOptions, out: Console, errors: Console) -> None:
    """Run a scenario and write its log. On Ctrl-C (KeyboardInterrupt) the log holds what the board
    had sent until then.
    """
    if options.output:
        file_type(options.output)
    check_outputs(
        (options.output, options.stats, options.eeprom), (scenario.rig_path, Path(scenario.source))
    )
    sent, rows = bytearray(), None
    begin = time.monotonic()
    try:
        with seconds_bar(scenario.duration_s, console=errors) as bar:
            _run_in_lockstep(scenario, options, sent, out, bar)
    finally:
        if options.output and sent:
            rows = write_run(bytes(sent), options.output)
    took = time.monotonic() - begin
    speed = f"{scenario.duration_s / took:.1f} x real time"
    written = f", {rows} rows in {options.output}" if rows is not None else ""
    print_line(errors, f"{scenario.duration_s:g} s simulated in {took:.1f} s ({speed}){written}")
