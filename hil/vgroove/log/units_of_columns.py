"""Units that a column of a log may be written in, and the factor to the column's own unit."""

import math
import re

from vgroove.errors import VgrooveError
from vgroove.log.table import COLUMN_UNITS
from vgroove.units import RPM_PER_RAD_S, TURN_RAD

TIME_COLUMN = "time_s"
# own unit of a column -> other units and what one of them is in the own unit
UNITS: dict[str, dict[str, float]] = {
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0},
    "A": {"A": 1.0, "mA": 1e-3, "uA": 1e-6, "kA": 1e3},
    "V": {"V": 1.0, "mV": 1e-3, "kV": 1e3},
    "rpm": {
        "rpm": 1.0,
        "1/min": 1.0,
        "min^-1": 1.0,
        "rad/s": RPM_PER_RAD_S,
        "rad/min": 1.0 / TURN_RAD,
        "deg/s": 1.0 / 6.0,
        "rev/s": 60.0,
        "1/s": 60.0,
        "Hz": 60.0,
        "krpm": 1e3,
    },
    "rad": {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180.0, "rev": TURN_RAD, "turn": TURN_RAD},
    "Nm": {"Nm": 1.0, "mNm": 1e-3, "Nmm": 1e-3, "Ncm": 1e-2, "kNm": 1e3},
    "mm": {"mm": 1.0, "m": 1e3, "um": 1e-3},
    "": {"": 1.0, "1": 1.0, "%": 1e-2},
}
SPELLINGS = str.maketrans({"µ": "u", "μ": "u", "°": "deg", " ": "", "·": "", "*": ""})
# other spellings of units, in small letters
ALIASES = {
    "sec": "s",
    "msec": "ms",
    "usec": "us",
    "u/min": "rpm",
    "r/min": "rpm",
    "rev/min": "rpm",
    "rad/sec": "rad/s",
    "deg/sec": "deg/s",
    "n.m": "Nm",
    "percent": "%",
}
IN_BRACKETS = re.compile(r"[(\[]([^()\[\]]*)[)\]]\s*$")
NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")


def own_unit(column: str) -> str:
    """Unit of a log column; empty for plain numbers."""
    return "s" if column == TIME_COLUMN else COLUMN_UNITS[column]


def known_unit(text: str, column: str) -> float | None:
    """What one of a unit is in the column's own unit; None for an unknown unit."""
    own = own_unit(column)
    units, name = UNITS.get(own, {own: 1.0}), text.strip().translate(SPELLINGS)
    name = ALIASES.get(name.lower(), name)
    if name in units:
        return units[name]
    alike = [factor for unit, factor in units.items() if unit.lower() == name.lower()]
    return alike[0] if len(alike) == 1 else None


def is_unit(text: str) -> bool:
    """Whether a text is a unit of any column."""
    return any(
        known is not None and text.strip()
        for known in (known_unit(text, column) for column in (TIME_COLUMN, *COLUMN_UNITS))
    )


def unit_in_name(name: str) -> str:
    """The unit that a name of a file states at its end, as in Time (ms) or I [mA]; else empty."""
    found = IN_BRACKETS.search(name)
    return found[1] if found and is_unit(found[1]) else ""


def unit_factor(text: str, column: str) -> float:
    """What one of a unit, with a number or a sign before it (-A, 5.6 rpm), is in the column's own
    unit; VgrooveError for an unknown unit.
    """
    text = text.strip()
    plain = known_unit(text, column)
    if plain is not None:
        return plain
    sign = -1.0 if text.startswith("-") else 1.0
    text = text.lstrip("+-").strip()
    unit, number = known_unit(text, column), NUMBER.match(text)
    if unit is None and number:
        unit = known_unit(text[number.end() :] or own_unit(column), column)
        sign *= float(number.group())
    if unit is None or sign == 0.0 or not math.isfinite(sign):
        known = ", ".join(name for name in UNITS.get(own_unit(column), {}) if name)
        raise VgrooveError(
            f"{text!r} is no unit of {column}, which has {known}; a number or - may stand before "
            "it, as in -A or 5.6 rpm"
        )
    return sign * unit
