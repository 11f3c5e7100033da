"""The native firmware as a board: the same C, linked with the lock-step machine of
firmware/hal/sim, in this process.
"""

from vgroove.board import BoardInputs, BoardOutputs, pack_inputs, unpack_outputs
from vgroove.errors import VgrooveError


def _firmware(**options: object) -> object:
    from vgroove import _core

    if not hasattr(_core, "Firmware"):
        raise VgrooveError(
            "this build of vgroove has no native firmware: run `pip install -e .` in the tree again"
        )
    return _core.Firmware(**options)


class SilBoard:
    """The native firmware, a period at a time; a context manager. One at a time: the firmware's
    state is the process's.

    Options: eeprom (1,024 bytes; absent: erased), reset_cause and target as BOOT reports them,
    isr_cycles and tick_cycles (latencies).
    """

    def __init__(self, **options: object) -> None:
        self.machine = _firmware(**options)
        self._exchange = self.machine.exchange

    def __enter__(self) -> "SilBoard":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def period(self, inputs: BoardInputs) -> BoardOutputs:
        """Advance 510 cycles with `inputs`; the gates in force in the next period and the bytes
        sent in this one.
        """
        return unpack_outputs(self._exchange(pack_inputs(inputs)))

    def eeprom(self) -> bytes:
        """The EEPROM as it is now."""
        return self.machine.eeprom

    def close(self) -> None:
        """Nothing to end; for symmetry with AvrBoard."""


def replay(inputs: bytes, **options: object) -> bytes:
    """Answers of the native firmware to recorded inputs, whole messages one after the other."""
    return _firmware(**options).exchange(inputs)
