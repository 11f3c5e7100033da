"""The simulated AVR as a board: one `vgroove-board` process that runs the ELF and exchanges
messages of fixed size, one for each PWM period.
"""

import json
import os
import shutil
import struct
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from vgroove.errors import VgrooveError

CPU_HZ = 16_000_000
CYCLES_PER_PERIOD = 510
PERIOD_S = CYCLES_PER_PERIOD / CPU_HZ
EDGES_MAX = 8
BYTES_MAX = 4
ADC_CHANNELS = ("current", "bus", "trigger", "temperature")
CURRENT, BUS, TRIGGER, TEMPERATURE = range(len(ADC_CHANNELS))
SWITCH_CONTACT, SWITCH_REVERSE, SWITCH_MODE_SHIFT = 1, 2, 2

_INPUTS = struct.Struct(f"<4H{EDGES_MAX}HBBB{BYTES_MAX}s")  # SimInputs of firmware/hal/sim/sim_io.h
_OUTPUTS = struct.Struct(f"<BhBB{BYTES_MAX}s")  # SimOutputs
# SimInputs and SimOutputs of firmware/hal/sim/sim_io.h as rows of an array
INPUTS = np.dtype(
    [
        ("adc_counts", "<u2", len(ADC_CHANNELS)),
        ("edge_cycle", "<u2", EDGES_MAX),
        ("edge_count", "u1"),
        ("switches", "u1"),
        ("rx_count", "u1"),
        ("rx", "u1", BYTES_MAX),
    ]
)
OUTPUTS = np.dtype(
    [
        ("coast", "u1"),
        ("compare", "<i2"),
        ("dead_counts", "u1"),
        ("tx_count", "u1"),
        ("tx", "u1", BYTES_MAX),
    ]
)
INPUT_BYTES, OUTPUT_BYTES = _INPUTS.size, _OUTPUTS.size
_COUNT = struct.Struct("<H")  # of the messages in a request or an answer
PERIODS_MAX = 0xFFFF
_NO_EDGES = (0,) * EDGES_MAX


class BoardInputs(NamedTuple):
    """Inputs of the board's pins in a period: ADC counts at its end (ADC_CHANNELS), Hall edges by
    cycle 0..509, switches (SWITCH_*), UART bytes.
    """

    adc_counts: tuple[int, int, int, int]
    edges: Sequence[int] = ()
    switches: int = 0
    rx: bytes = b""


class BoardOutputs(NamedTuple):
    """Command of the bridge in the next period (compare value -255..255, dead time in timer counts)
    and the bytes sent in this one.
    """

    coast: bool
    compare: int
    dead_counts: int
    tx: bytes


def pack_inputs(inputs: BoardInputs) -> bytes:
    """The period's message to a board; ValueError for more than 8 edges or 4 bytes in a period."""
    adc_counts, edges, switches, rx = inputs
    count = len(edges)
    if count > EDGES_MAX or len(rx) > BYTES_MAX:
        raise ValueError(
            f"{count} edges and {len(rx)} bytes in one period; at most {EDGES_MAX} and "
            f"{BYTES_MAX} fit"
        )
    padded = (*edges, *_NO_EDGES[count:]) if count else _NO_EDGES
    return _INPUTS.pack(*adc_counts, *padded, count, switches, len(rx), rx)


def is_sent(outputs: np.ndarray) -> np.ndarray:
    """Which places of `tx` (n, BYTES_MAX) hold a byte that a board sent; outputs: (n,) of
    OUTPUTS.
    """
    return np.arange(BYTES_MAX) < outputs["tx_count"][:, None]


def sent_bytes(outputs: np.ndarray) -> bytes:
    """The bytes that a board sent; outputs: (n,) of OUTPUTS. For the tests."""
    return outputs["tx"][is_sent(outputs)].tobytes()


def unpack_answer(messages: bytes) -> list[BoardOutputs]:
    """Outputs in successive periods, from a board's answer of OUTPUT_BYTES for each of them."""
    return [
        BoardOutputs(coast != 0, compare, dead_counts, tx[:count])
        for coast, compare, dead_counts, count, tx in _OUTPUTS.iter_unpack(messages)
    ]


def unpack_outputs(message: bytes) -> BoardOutputs:
    """A board's outputs in one period."""
    (outputs,) = unpack_answer(message)
    return outputs


TOOLS = ("impact", "drill")


def find_board_program() -> Path:
    """Path of vgroove-board: $VGROOVE_BOARD, the newest in the tree's build folders, or PATH."""
    built = sorted(
        (Path(__file__).resolve().parents[2] / "build").glob("*/hil/board/vgroove-board"),
        key=lambda path: path.stat().st_mtime,
    )
    named = os.environ.get("VGROOVE_BOARD")
    if named and not Path(named).is_file():
        raise VgrooveError(f"the variable VGROOVE_BOARD names {named}, which is no file")
    for candidate in (named, *reversed(built), shutil.which("vgroove-board")):
        if candidate:
            return Path(candidate)
    raise VgrooveError(
        "the program vgroove-board is missing: build it with `make build`, or name it in the "
        "variable VGROOVE_BOARD"
    )


def default_elf(target: str = "uno", tool: str = "impact") -> Path:
    """Path of the firmware that `make build` makes for a target, uno or mega, and a tool, impact or
    drill. The Mega's holds the controllers of both.
    """
    if tool not in TOOLS:
        raise VgrooveError(f"the tool of a firmware is impact or drill, not {tool}")
    build = "avr-uno-drill" if (target, tool) == ("uno", "drill") else f"avr-{target}"
    return Path(__file__).resolve().parents[2] / "build" / build / "vgroove.elf"


def _checked_elf(elf: Path) -> Path:
    if not Path(elf).is_file():
        raise VgrooveError(
            f"there is no firmware at {elf}: build it with `make build`, or name another with --elf"
        )
    return Path(elf)


def _failure_message(errors: bytes, code: int) -> str:
    """What vgroove-board reported: its first message on stderr, else all of stderr, else its exit
    code.
    """
    lines = errors.decode(errors="replace").splitlines()
    prefix = "vgroove-board: "
    messages = [line.removeprefix(prefix) for line in lines if line.startswith(prefix)]
    if messages:
        return messages[0]
    return " ".join(lines) or f"vgroove-board ended without a message (exit code {code})"


def _arguments(elf: Path, mcu: str, options: dict[str, object]) -> list[str]:
    command = [str(find_board_program()), str(_checked_elf(elf)), "--mcu", mcu]
    for name, value in options.items():
        if value is not None:
            command += ["--" + name.replace("_", "-"), str(value)]
    return command


class AvrBoard:
    """Runs an ELF on a simulated ATmega, one or several PWM periods a call; a context manager.

    Options are those of vgroove-board (docs/bench.md): eeprom (image file, read and written), stats
    (file), seed, cut, brown_out, least_dead, reset_cause, boot_r2. Raises VgrooveError when
    vgroove-board or the ELF is missing, when the ELF does not fit the part, or when the run stops
    on an error.
    """

    def __init__(self, elf: Path, *, mcu: str = "atmega328p", **options: object) -> None:
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115  lives as long as the process
        self._process = subprocess.Popen(
            [*_arguments(elf, mcu, options), "--stretches"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            start_new_session=True,
        )
        self._to_board_fd = self._process.stdin.fileno()
        self._from_board_fd = self._process.stdout.fileno()

    def __enter__(self) -> "AvrBoard":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def period(self, inputs: BoardInputs) -> BoardOutputs:
        """Advance 510 cycles with `inputs`; the bridge command of the next period and the bytes
        sent in this one.
        """
        return unpack_outputs(self.periods(pack_inputs(inputs)))

    def periods(self, messages: bytes) -> bytes:
        """Advance at most PERIODS_MAX periods with inputs in succession (pack_inputs). The outputs
        end with the first that changes the command of the bridge: the tool's measurements in later
        periods, and so their inputs, depend on it.
        """
        count, rest = divmod(len(messages), INPUT_BYTES)
        if rest or not 0 < count <= PERIODS_MAX:
            raise ValueError(
                f"periods: 1 to {PERIODS_MAX} whole messages, not {count} and {rest} bytes"
            )
        try:
            os.write(self._to_board_fd, _COUNT.pack(count) + messages)
        except BrokenPipeError:
            raise self._failure() from None
        (answered,) = _COUNT.unpack(self._read(_COUNT.size))
        return self._read(answered * OUTPUT_BYTES)

    def _read(self, size: int) -> bytes:
        data = b""
        while len(data) < size:
            part = os.read(self._from_board_fd, size - len(data))
            if not part:
                raise self._failure()
            data += part
        return data

    def _failure(self) -> VgrooveError:
        self._process.wait()
        self._errors.seek(0)
        return VgrooveError(_failure_message(self._errors.read(), self._process.returncode))

    def close(self) -> None:
        """End the run, whereupon vgroove-board writes its EEPROM and statistics files."""
        if self._process.stdin and not self._process.stdin.closed:
            self._process.stdin.close()
            self._process.stdout.close()
            self._process.wait()
            self._errors.close()


def replay(elf: Path, inputs: bytes, *, mcu: str = "atmega328p", **options: object) -> bytes:
    """Outputs of a board for recorded inputs, complete messages in succession, without a plant."""
    done = subprocess.run(
        _arguments(elf, mcu, options), input=inputs, capture_output=True, check=False
    )
    if done.returncode != 0:
        raise VgrooveError(_failure_message(done.stderr, done.returncode))
    return done.stdout


def read_statistics(path: Path) -> dict:
    """Report of vgroove-board on cycles, stack, UART, EEPROM and bridge (keys in docs/bench.md).
    For the tests.
    """
    return json.loads(Path(path).read_text())
