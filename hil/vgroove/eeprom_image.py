"""An EEPROM with parameters of the firmware by name, for a simulated board."""

import struct
from collections.abc import Mapping

from vgroove import telemetry
from vgroove.errors import VgrooveError

EEPROM_BYTES, SLOT_ADDRESS = 1024, 16  # firmware/app/param_store.h


class AbsentError(VgrooveError):
    """This firmware has no such mode or parameter."""


def mode_number(mode: str | int) -> int:
    """Number of a mode by its name in the signal list; AbsentError for an unknown name."""
    numbers = {name: number for number, name in telemetry.value_table("STATE", "mode").items()}
    if isinstance(mode, str) and mode not in numbers:
        raise AbsentError(f"this firmware has no mode {mode}; it has {', '.join(numbers)}")
    return numbers[mode] if isinstance(mode, str) else mode


def parameter(name: str) -> telemetry.Parameter:
    """A parameter by its name, in any case, with or without its suffix _qN; AbsentError for an
    unknown name.
    """
    for entry in telemetry.parameter_list():
        if entry.name in (name.lower(), f"{name.lower()}_q{entry.q}"):
            return entry
    raise AbsentError(f"this firmware has no parameter {name}")


def eeprom_image(params: Mapping[str, float]) -> bytes:
    """The bytes of an EEPROM whose first parameter slot holds the default values, except for those
    given in `params`, by name and in their physical units.

    Raises AbsentError for an unknown parameter, VgrooveError for a value outside its range.
    """
    entries = telemetry.parameter_list()
    values = {entry.name: entry.default for entry in entries}
    for name, value in params.items():
        entry = parameter(name)
        raw = round(value * 2**entry.q)
        if not entry.minimum <= raw <= entry.maximum:
            low, high = entry.minimum / 2**entry.q, entry.maximum / 2**entry.q
            raise VgrooveError(f"{entry.name} is {low:g} to {high:g} {entry.unit}, not {value:g}")
        values[entry.name] = raw
    version = max(entry.version for entry in entries)
    slot = struct.pack(f"<BBH{len(entries)}h", version, len(entries), 1, *values.values())
    slot += struct.pack("<H", telemetry.crc16(slot))
    return (bytes([255]) * SLOT_ADDRESS + slot).ljust(EEPROM_BYTES, bytes([255]))
