"""The firmware's telemetry and parameters, compiled for the host, as a board that tests step tick
by tick, or that runs in real time on a pty.
"""

import ctypes
import os
import shutil
import subprocess
import tempfile
import threading
import time
import tty
from collections.abc import Callable
from functools import cache
from pathlib import Path

from vgroove import telemetry

ROOT = Path(__file__).resolve().parents[2]
SOURCES = [
    "tests/unit/telemetry/shim.c",
    "firmware/telemetry/telemetry_signals.c",
    "firmware/telemetry/telemetry.c",
    "firmware/telemetry/command.c",
    "firmware/app/param_store.c",
    "firmware/app/param_command.c",
    "firmware/core/crc.c",
    "firmware/core/divide.c",
]
EEPROM_BYTES = 1024


def _c_type(signal: object) -> type:
    width = next(width for width in (8, 16, 32) if signal.length <= width)
    return getattr(ctypes, f"c_{'' if signal.is_signed else 'u'}int{width}")


def struct_of(name: str) -> type[ctypes.Structure]:
    """The C struct of a message as the generator lays it out: every signal but the CRC, in the
    order of the bits.
    """
    signals = sorted(
        (s for s in telemetry.database().get_message_by_name(name).signals if s.start != 56),
        key=lambda s: s.start,
    )
    return type(
        f"Telemetry_{name}",
        (ctypes.Structure,),
        {"_fields_": [(s.name, _c_type(s)) for s in signals]},
    )


Boot, Fast, State, Control, Health, ParamTable = (
    struct_of(name) for name in ("BOOT", "FAST", "STATE", "CONTROL", "HEALTH", "PARAM_TABLE")
)


class Params(ctypes.Structure):
    """TelemetryParams."""

    _fields_ = [
        ("value", ctypes.POINTER(ctypes.c_int16)),
        ("count", ctypes.c_uint8),
        ("table", ParamTable),
    ]


class Inputs(ctypes.Structure):
    """TelemetryInputs."""

    _fields_ = [
        ("now_ms", ctypes.c_uint32),
        ("state", State),
        ("control", Control),
        ("health", Health),
        ("params", Params),
        ("hold_slow", ctypes.c_bool),
        ("hold_state", ctypes.c_bool),
    ]


class Store(ctypes.Structure):
    """ParamStore."""

    _fields_ = [
        ("value", ctypes.c_int16 * len(telemetry.parameter_list())),
        ("generation", ctypes.c_uint16),
        ("crc16", ctypes.c_uint16),
        ("slot", ctypes.c_uint8),
        ("step", ctypes.c_uint8),
        ("status", ctypes.c_uint8),
    ]


@cache
def library() -> ctypes.CDLL:
    """The firmware as a shared library; warnings fail the build, undefined behaviour aborts."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    assert compiler, "a C compiler is needed"
    target = Path(tempfile.mkdtemp(prefix="vgroove-shim-")) / "shim.so"
    checks = [
        "-Wall",
        "-Wextra",
        "-Wconversion",
        "-Wsign-conversion",
        "-Werror",
        "-fsanitize=undefined",
        "-fno-sanitize-recover=all",
    ]
    subprocess.run(
        [
            compiler,
            "-std=c11",
            "-O1",
            "-shared",
            "-fPIC",
            *checks,
            "-Ifirmware",
            "-o",
            target,
            *SOURCES,
        ],
        cwd=ROOT,
        check=True,
    )
    loaded = ctypes.CDLL(str(target))
    loaded.shim_board_store.restype = ctypes.POINTER(Store)
    loaded.shim_board_bytes.restype = ctypes.c_size_t
    loaded.shim_board_parser.restype = ctypes.c_void_p
    for name in ("shim_crc16", "shim_eeprom_writes"):
        getattr(loaded, name).restype = ctypes.c_uint32
    loaded.param_set.restype = loaded.param_saving.restype = ctypes.c_bool
    return loaded


def eeprom_set(content: bytes = b"\xff" * EEPROM_BYTES) -> None:
    """Content of the (one) EEPROM; clears a planned power failure."""
    library().shim_eeprom_set(content)


def eeprom_get() -> bytes:
    """Content of the EEPROM."""
    buffer = ctypes.create_string_buffer(EEPROM_BYTES)
    library().shim_eeprom_get(buffer)
    return buffer.raw


class Board:
    """One board: set `fast`, `state`, `health` and call tick()."""

    def __init__(self, fast_divider: int = 1, baud_select: int = 0, now_ms: int = 0) -> None:
        self.lib = library()
        self._memory = ctypes.create_string_buffer(self.lib.shim_board_bytes())
        boot = Boot(
            build_hash=0xABCDEF,
            duty_full_scale=255,
            fast_divider=fast_divider,
            reset_cause=1,
            target=0,
        )
        self.lib.shim_board_init(self._memory, ctypes.byref(boot), ctypes.c_uint8(baud_select))
        self.inputs = Inputs(now_ms=now_ms)
        self.fast = Fast()
        self._out = ctypes.create_string_buffer(64)
        self._received = bytearray()
        self.results: list[tuple[str, int]] = []

    @property
    def store(self) -> Store:
        """The parameter store."""
        return self.lib.shim_board_store(self._memory).contents

    def tick(self, idle: bool = True) -> bytes:
        """One millisecond: received bytes are taken, then the bytes of this tick come back."""
        self.inputs.now_ms = (self.inputs.now_ms + 1) & 0xFFFFFFFF
        self._take(idle)
        count = self.lib.shim_board_tick(
            self._memory, ctypes.byref(self.inputs), ctypes.byref(self.fast), self._out
        )
        return self._out.raw[:count]

    def receive(self, data: bytes) -> None:
        """Bytes that the line brings."""
        self._received += data

    def _take(self, idle: bool) -> None:
        result = ctypes.c_uint8()
        while self._received:
            kind = self.lib.shim_board_receive(
                self._memory,
                ctypes.c_uint8(self._received[0]),
                ctypes.c_bool(idle),
                ctypes.byref(result),
            )
            if kind == 3:
                return
            del self._received[0]
            if kind:
                self.results.append(("executed" if kind == 1 else "answered", result.value))

    def run(self, ticks: int, each: Callable[[int], None] = lambda _: None) -> bytes:
        """Bytes of many ticks; `each(k)` sets the inputs of tick k."""
        sent = bytearray()
        for k in range(ticks):
            each(k)
            sent += self.tick()
        return bytes(sent)


def moving(board: Board) -> Callable[[int], None]:
    """Inputs that differ from tick to tick, so that a test detects a row at a wrong time."""

    def each(k: int) -> None:
        fast, state = board.fast, board.inputs.state
        fast.current_a, fast.speed_rpm = (k * 37) % 20000 - 5000, (k * 11) % 30000 - 10000
        fast.duty_compare, fast.supply_v = (-512 if k % 100 < 5 else k % 511 - 255), 700 + k % 50
        state.trigger, state.state = min(255, (k // 20) % 300), (k // 400) % 4

    return each


def wait_until(condition: Callable[[], bool], what: str, seconds: float = 60.0) -> None:
    """Poll until the condition holds; AssertionError naming `what` when it does not within the
    time.
    """
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, f"not within {seconds:g} s: {what}"
        time.sleep(0.02)


class PtyBoard:
    """A board on a pty in real time: 1,000 ticks a second times `rate`, commands are answered;
    `damage` changes the bytes that it sends.
    """

    def __init__(
        self, damage: Callable[[bytes], bytes] = lambda data: data, rate: float = 1.0
    ) -> None:
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)
        eeprom_set()
        self.board = Board()
        self._damage, self._rate = damage, rate
        self.sent: list[bytes] = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> "PtyBoard":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop and hang up."""
        self._stop.set()
        self._thread.join()
        for descriptor in (self._master, self._slave):
            try:
                os.close(descriptor)
            except OSError:
                pass

    def _run(self) -> None:
        start, k, each = time.monotonic(), 0, moving(self.board)
        while not self._stop.wait(0.005):
            try:
                self.board.receive(os.read(self._master, 4096))
            except BlockingIOError:
                pass
            data = bytearray()
            for _ in range(int((time.monotonic() - start) * 1000 * self._rate) - k):
                each(k)
                data += self.board.tick()
                k += 1
            self.sent.append(bytes(data))
            self._write(self._damage(bytes(data)))

    def _write(self, data: bytes) -> None:
        while data and not self._stop.is_set():
            try:
                data = data[os.write(self._master, data) :]
            except BlockingIOError:
                time.sleep(0.002)
