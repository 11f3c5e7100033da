"""Units that a column of a log may be written in, and the factor to the column's own unit."""

import math
import re

from vgroove.errors import VgrooveError
from vgroove.log.table import COLUMN_UNITS, INPUTS, MEASURED
from vgroove.units import RPM_PER_RAD_S, TURN_RAD

TIME_COLUMN = "time_s"
# columns whose unit a diagnosis needs; the others are states, flags and counts
WITH_UNIT = {TIME_COLUMN, *INPUTS, *MEASURED, "load_nm"}
# International yard and pound agreement of 1959, and standard gravity of ISO 80000-3
INCH_M, POUND_FORCE_N, GRAVITY_M_S2 = 0.0254, 4.4482216152605, 9.80665
# own unit of a column -> other units and what one of them is in the own unit
UNITS: dict[str, dict[str, float]] = {
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "d": 86_400.0},
    "A": {"A": 1.0, "dA": 0.1, "cA": 1e-2, "mA": 1e-3, "uA": 1e-6, "kA": 1e3},
    "V": {"V": 1.0, "dV": 0.1, "cV": 1e-2, "mV": 1e-3, "uV": 1e-6, "kV": 1e3},
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
    "Nm": {
        "Nm": 1.0,
        "dNm": 0.1,
        "cNm": 1e-2,
        "mNm": 1e-3,
        "uNm": 1e-6,
        "Nmm": 1e-3,
        "Ncm": 1e-2,
        "kNm": 1e3,
        "lbf·in": POUND_FORCE_N * INCH_M,
        "lbf·ft": POUND_FORCE_N * 12.0 * INCH_M,
        "ozf·in": POUND_FORCE_N * INCH_M / 16.0,
        "kgf·cm": GRAVITY_M_S2 * 1e-2,
    },
    "mm": {"mm": 1.0, "m": 1e3, "cm": 10.0, "um": 1e-3},
    "": {"": 1.0, "1": 1.0, "%": 1e-2, "‰": 1e-3},
}
UNITS["ms"] = {unit: 1e3 * factor for unit, factor in UNITS["s"].items()}
SPELLINGS = str.maketrans(
    {"µ": "u", "μ": "u", "°": "deg", "％": "%", "⁻": "^-", "¹": "1"} | dict.fromkeys(" ·*⋅×", "")
)
# unit: its other spellings, in small letters
OTHER_SPELLINGS = {
    "s": ("sec", "secs", "second", "seconds", "sek"),
    "ms": ("msec", "msecs", "millisecond", "milliseconds"),
    "us": ("usec", "usecs", "microsecond", "microseconds"),
    "ns": ("nsec", "nsecs", "nanosecond", "nanoseconds"),
    "min": ("mins", "minute", "minutes"),
    "h": ("hr", "hrs", "hour", "hours"),
    "d": ("day", "days"),
    "A": ("amp", "amps", "ampere", "amperes"),
    "mA": ("mamp", "mamps", "milliamp", "milliamps"),
    "V": ("volt", "volts", "vdc"),
    "mV": ("mvdc",),
    "rpm": (
        "u/min",
        "upm",
        "r/min",
        "t/min",
        "t/mn",
        "tr/min",
        "tr/mn",
        "rev/min",
        "umdr/min",
        "umdr./min",
        "об/мин",
        "min-1",
    ),
    "krpm": ("1000/min", "x1000rpm"),
    "rad/s": ("rad/sec", "rads^-1", "rads-1"),
    "deg/s": ("deg/sec", "degs^-1"),
    "rev/s": ("rps", "turn/s", "turns/s", "u/s"),
    "1/s": ("s^-1", "s-1"),
    "rad": ("radian", "radians"),
    "deg": ("degs", "degree", "degrees"),
    "rev": ("revs", "revolution", "revolutions", "rotation", "rotations"),
    "turn": ("turns",),
    "Nm": (
        "n.m",
        "n-m",
        "newtonmetre",
        "newtonmetres",
        "newtonmeter",
        "newtonmeters",
        "newton-metre",
        "newton-metres",
        "newton-meter",
        "newton-meters",
    ),
    "lbf·in": (
        *("lbf.in", "lbf-in", "lbin", "lb-in", "lbsin", "lbs-in"),
        *("inlbf", "in-lbf", "inlb", "in-lb", "inlbs", "in-lbs"),
    ),
    "lbf·ft": (
        *("lbf.ft", "lbf-ft", "lbft", "lb-ft", "lbsft", "lbs-ft"),
        *("ftlbf", "ft-lbf", "ftlb", "ft-lb", "ftlbs", "ft-lbs"),
    ),
    "ozf·in": ("ozf.in", "ozf-in", "ozin", "oz-in", "inoz", "in-oz"),
    "kgf·cm": ("kgf.cm", "kgf-cm", "kgcm", "kg.cm", "kg-cm"),
    "%": ("percent", "pct", "prozent", "proz"),
    "‰": ("permille",),
    "1": ("p.u.", "pu", "ratio"),
}
ALIASES = {other: unit for unit, others in OTHER_SPELLINGS.items() for other in others}
ALIASES |= {other.removesuffix("."): unit for other, unit in ALIASES.items()}
NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")


def own_unit(column: str) -> str:
    """Unit of a log column; empty for plain numbers."""
    return "s" if column == TIME_COLUMN else COLUMN_UNITS[column]


def known_unit(text: str, column: str) -> float | None:
    """What one of a unit is in the column's own unit; None for an unknown unit."""
    own, name = own_unit(column), _spelt(text)
    units = {_spelt(unit): factor for unit, factor in UNITS.get(own, {own: 1.0}).items()}
    name = _spelt(ALIASES.get(name.lower(), name))
    if name in units:
        return units[name]
    alike = [factor for unit, factor in units.items() if unit.lower() == name.lower()]
    return alike[0] if len(alike) == 1 else None


def bare(text: str) -> str:
    """A text without brackets around it and without a dot at its end: [A], sec."""
    return text.strip("()[]（） ").removesuffix(".")


def _spelt(unit: str) -> str:
    """A bare unit without spaces and signs of multiplication, in the letters of the table."""
    return bare(unit).translate(SPELLINGS)


def is_unit(text: str) -> bool:
    """Whether a text is a unit of any column."""
    return any(
        known is not None and text.strip()
        for known in (known_unit(text, column) for column in (TIME_COLUMN, *COLUMN_UNITS))
    )


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
