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
from vgroove.command_answers import answers_in, refused_modes, unanswered_text
from vgroove.errors import VgrooveError
from vgroove.faults import FaultyBoard, Injection
from vgroove.output import check_outputs, unwritable, write_bytes
from vgroove.progress import ProgressBar, seconds_bar
from vgroove.pty_line import PtyLine
from vgroove.recorder import recovered_text
from vgroove.recording_files import file_type
from vgroove.scenario import Scenario, command_messages, make_plant
from vgroove.sil import SilBoard
from vgroove.terminal import print_line, print_warning
from vgroove.termination import Terminated, interrupt_on_signals, signals_held

EEPROM_BYTES = 1024  # of the native firmware
WRITE_INTERVAL_S = 0.25  # at which a run's log is written: what a killed run loses at most
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
    injection: Injection | None = None


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


def _tool_of(scenario: Scenario) -> str:
    """Whose firmware drives the scenario's tool: drill for a drill driver, else impact."""
    return "drill" if scenario.tool.mechanism["kind"] == "drill_driver" else "impact"


def make_board(
    options: RunOptions, seed: int, tool: str = "impact"
) -> AvrBoard | SilBoard | FaultyBoard:
    """The board that the options name, with their fault; `tool`: whose controllers its firmware
    needs.
    """
    injection = options.injection
    if injection is None:
        return _sound_board(options, seed, tool)
    if injection.fault.board_option and options.on != "avr":
        raise VgrooveError(
            f"--fault {injection.fault.name} acts on the simulated AVR: add --on avr"
        )
    return FaultyBoard(_sound_board(options, seed, tool), injection, seed)


def _sound_board(options: RunOptions, seed: int, tool: str) -> AvrBoard | SilBoard:
    if options.on == "sil":
        return SilBoard(eeprom=_eeprom_image(options.eeprom))
    if options.on != "avr":
        raise VgrooveError(
            f"--on is sil or avr, not {options.on}; a board on a port performs --experiment NAME "
            "or --next VERDICT.json"
        )
    if options.target not in MCUS:
        raise VgrooveError(f"--target is uno or mega, not {options.target}")
    elf = options.elf or default_elf(options.target, tool)
    more = options.injection.board_options() if options.injection else {}
    return AvrBoard(
        elf,
        mcu=MCUS[options.target],
        stats=options.stats,
        eeprom=options.eeprom,
        seed=seed,
        **more,
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
    scenario: Scenario, options: RunOptions, log: "RunLog | None", out: Console, bar: ProgressBar
) -> bytes:
    """Run the scenario and return what the board has sent. The log grows while the board sends, so
    that an interrupted run leaves what was sent until then.
    """
    tool = make_plant(scenario.tool, scenario.seed)
    front = scenario.front_ends()
    with (
        make_board(options, scenario.seed, _tool_of(scenario)) as board,
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
            if log is not None:
                log.add(now.sent[done:])
            done = len(now.sent)
            bar.move_to(now.time_s)
            if options.real_time:
                time.sleep(max(0.0, now.time_s - (time.monotonic() - begin)))
        native = board.board if isinstance(board, FaultyBoard) else board
        if options.eeprom and isinstance(native, SilBoard):  # vgroove-board writes its image itself
            write_bytes(options.eeprom, native.eeprom())
    return bytes(now.sent)


class RunLog:
    """The log of a run, which grows while the board sends: .csv, .mf4, .blf or .asc.

    VgrooveError where another process writes it or it cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._session = telemetry.Session()
        self._framer = telemetry.Framer(self._session.counters)
        self._bytes, self._write_at, self._closed = bytearray(), 0.0, False
        with self._named_error():
            self._file = file_type(path)(path)
        self.recovered = self._file.recovered

    @contextmanager
    def _named_error(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise unwritable(self._path, error) from error

    def add(self, data: bytes) -> None:
        """Add bytes of the board; they are written every WRITE_INTERVAL_S."""
        self._bytes += data
        if time.monotonic() >= self._write_at:
            self._write_at = time.monotonic() + WRITE_INTERVAL_S
            with self._named_error(), signals_held():
                self._write(last=False)

    def _write(self, last: bool) -> None:
        frames = self._framer.feed(bytes(self._bytes))
        self._bytes.clear()
        for frame in frames:
            self._session.feed([frame])
            if not self._session.restarted:
                self._file.add_frame(frame)
        self._file.add_rows(self._session.take_rows(None if last else self._session.ready_until()))

    @property
    def restart_text(self) -> str:
        """What a restart of the board has left out of the log; empty without one."""
        if self._session.restarted:
            at_s = self._session.last_ms / 1000
            return f"{telemetry.BOARD_RESTARTED} at {at_s:g} s: what follows is not in the log"
        if self._session.counters.restarts:
            return f"{telemetry.BOARD_RESTARTED}: what it sent before is not in the log"
        return ""

    def close(self) -> int:
        """Complete the file and return its number of rows; a file without rows is deleted. Where
        the file cannot be completed, the rows in it are kept, and VgrooveError names that file.
        """
        if self._closed:
            return self._file.rows
        with signals_held():
            self._closed = True
            try:
                with self._named_error():
                    self._write(last=True)
                    self._file.finish()
            except (VgrooveError, MemoryError) as error:
                reason = (str(error) or f"{self._path}: out of memory").rstrip(".")
                raise VgrooveError(f"{reason}; {self._salvaged()}") from error
            with self._named_error():
                return self._publish()

    def _publish(self) -> int:
        """Give the part file its name, or delete it where it has no rows; returns their number."""
        if self._file.rows:
            self._file.publish()
        self._file.discard()
        return self._file.rows

    def _salvaged(self) -> str:
        """Keep the rows that the file holds; where they are."""
        try:
            self._file.salvage()
            rows = self._publish()
        except OSError:
            self._file.release()
            return f"what was received is in {self._file.part}"
        return f"{rows} rows are in {self._file.path}" if rows else "no row was written"


@contextmanager
def _run_log(path: Path | None, errors: Console) -> Iterator[RunLog | None]:
    """The log of a run; on any end of the block it holds what the board had sent until then."""
    if path is None:
        yield None
        return
    log = RunLog(path)
    if log.recovered:
        print_warning(errors, recovered_text(path, log.recovered))
    try:
        yield log
    except (KeyboardInterrupt, Terminated):
        rows = log.close()
        print_line(errors, f"interrupted: {rows} rows in {path}" if rows else "interrupted")
        raise
    except BaseException:
        log.close()
        raise


def _check_fault(scenario: Scenario, injection: Injection | None) -> None:
    """VgrooveError for a fault that would come after the end of the run."""
    if injection and injection.at_s >= scenario.duration_s:
        raise VgrooveError(
            f"--fault {injection.fault.name} at {injection.at_s:g} s is after the end of the run, "
            f"{scenario.duration_s:g} s"
        )


def run_scenario(scenario: Scenario, options: RunOptions, out: Console, errors: Console) -> None:
    """Run a scenario and write its log. On Ctrl-C, a terminate signal or a hang-up
    (KeyboardInterrupt, Terminated) the log holds what the board had sent until then.
    """
    if options.output:
        file_type(options.output)
    check_outputs(
        (options.output, options.stats, options.eeprom), (scenario.rig_path, Path(scenario.source))
    )
    _check_fault(scenario, options.injection)
    begin, written = time.monotonic(), ""
    with interrupt_on_signals(), _run_log(options.output, errors) as log:
        with seconds_bar(scenario.duration_s, console=errors) as bar:
            sent = _run_in_lockstep(scenario, options, log, out, bar)
        if log is not None:
            written = f", {log.close()} rows in {options.output}"
            if log.restart_text:
                print_warning(errors, log.restart_text)
    answers = answers_in(sent)
    for sentence in refused_modes(scenario.commands, answers):
        print_warning(errors, sentence)
    if unanswered := unanswered_text(scenario.commands, answers, scenario.duration_s):
        print_warning(errors, unanswered)
    took = time.monotonic() - begin
    speed = f"{scenario.duration_s / took:.1f} x real time"
    print_line(errors, f"{scenario.duration_s:g} s simulated in {took:.1f} s ({speed}){written}")
