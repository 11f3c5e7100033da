"""What a command does on Ctrl-C, a terminate signal and a hang-up of its terminal."""

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

ENDING = ("SIGTERM", "SIGHUP")  # Windows has no SIGHUP


class Terminated(BaseException):
    """A terminate signal or a hang-up. It is no KeyboardInterrupt, for which typer chooses the exit
    code.
    """

    def __init__(self, number: int) -> None:
        super().__init__()
        self.exit_code = 128 + number


class StopRequest:
    """True, when called, after the first Ctrl-C, terminate signal or hang-up."""

    def __init__(self) -> None:
        self.received = False

    def __call__(self) -> bool:
        return self.received

    def on_signal(self, number: int, frame: FrameType | None) -> None:
        """Signal handler."""
        del number, frame
        self.received = True


@contextmanager
def stop_on_signals() -> Iterator[StopRequest]:
    """A callable that is true after the first Ctrl-C, terminate signal or hang-up in the block."""
    stop = StopRequest()
    with _handled(("SIGINT", *ENDING), stop.on_signal):
        yield stop


@contextmanager
def interrupt_on_signals() -> Iterator[None]:
    """A terminate signal or a hang-up in the block raises Terminated."""

    def on_signal(number: int, frame: FrameType | None) -> None:
        del frame
        raise Terminated(number)

    with _handled(ENDING, on_signal):
        yield


@contextmanager
def signals_held() -> Iterator[None]:
    """Signals that arrive in the block are handled after it."""
    held = {_number(name) for name in ("SIGINT", *ENDING) if hasattr(signal, name)}
    before = signal.pthread_sigmask(signal.SIG_BLOCK, held)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _number(name: str) -> signal.Signals:
    return signal.Signals[name]


@contextmanager
def _handled(
    names: tuple[str, ...], handler: Callable[[int, FrameType | None], None]
) -> Iterator[None]:
    """Handles signals in the block, but those that the process was started to ignore (nohup). After
    a hang-up the terminal cannot be written: its output is dropped from then on.
    """
    terminals = [handle for handle in (0, 1, 2) if os.isatty(handle)]

    def on_signal(number: int, frame: FrameType | None) -> None:
        if number == getattr(signal, "SIGHUP", None):
            _drop_output(terminals)
        handler(number, frame)

    before = {}
    for number in (_number(name) for name in names if hasattr(signal, name)):
        if signal.getsignal(number) != signal.SIG_IGN:
            before[number] = signal.signal(number, on_signal)
    try:
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)


def _drop_output(handles: list[int]) -> None:
    null = os.open(os.devnull, os.O_RDWR)
    for handle in handles:
        os.dup2(null, handle)
    os.close(null)
