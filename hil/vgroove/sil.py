"""The native firmware as a board: the firmware's C compiled for the host with firmware/hal/sim, in
this process.
"""

from vgroove.board import (
    INPUT_BYTES,
    BoardInputs,
    BoardOutputs,
    pack_inputs,
    unpack_outputs,
)
from vgroove.errors import VgrooveError


def _firmware(**options: object) -> object:
    from vgroove import _core

    if not hasattr(_core, "Firmware"):
        raise VgrooveError(
            "this build of vgroove has no native firmware: run `pip install -e .` in the tree again"
        )
    return _core.Firmware(**options)


class SilBoard:
    """The native firmware, a period at a time; a context manager.

    Only one may exist in a process, because the firmware's state is global. Options: eeprom (1,024
    bytes; absent: erased), reset_cause and target as BOOT reports them, isr_cycles and tick_cycles
    (latencies).
    """

    def __init__(self, **options: object) -> None:
        self.machine = _firmware(**options)
        self._exchange = self.machine.exchange

    def __enter__(self) -> "SilBoard":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def period(self, inputs: BoardInputs) -> BoardOutputs:
        """Advance 510 cycles with `inputs`; the bridge command of the next period and the bytes
        sent in this one.
        """
        return unpack_outputs(self._exchange(pack_inputs(inputs)))

    def periods(self, messages: bytes) -> bytes:
        """As AvrBoard.periods()."""
        machine, outputs = self.machine, bytearray()
        for at in range(0, len(messages), INPUT_BYTES):
            before = (machine.coast, machine.compare, machine.dead_counts)
            outputs += self._exchange(messages[at : at + INPUT_BYTES])
            if (machine.coast, machine.compare, machine.dead_counts) != before:
                break
        return bytes(outputs)

    def eeprom(self) -> bytes:
        """Content of the EEPROM, 1,024 bytes."""
        return self.machine.eeprom

    def close(self) -> None:
        """Does nothing; AvrBoard ends its process here."""


def replay(inputs: bytes, **options: object) -> bytes:
    """Outputs of the native firmware for recorded inputs, complete messages in succession."""
    return _firmware(**options).exchange(inputs)
