"""Units that a file states: in brackets at the end of a name, in a line below the names, or with a
channel; and what tells a unit from a remark (docs/input_format.md).
"""

import re
from dataclasses import dataclass

from vgroove.errors import VgrooveError
from vgroove.log.units_of_columns import (
    ALIASES,
    NUMBER,
    UNITS,
    bare,
    is_unit,
    known_unit,
    own_unit,
    unit_factor,
)

# that a file states for plain numbers
NO_UNIT = ("", "-", "1", "none", "n/a", "unitless", "dimensionless")
BRACKETS = r"[(\[（]([^()\[\]（）]*)[)\]）]"
AT_END = re.compile(rf"(?:\s*{BRACKETS})+\s*$")
BETWEEN_WORDS = re.compile(r"[\s,;_]+")
BETWEEN_PARTS = re.compile(r"[/·*⋅×.]|-(?=[^\W\d])")
MULTIPLE = re.compile(rf"\d+/\d+|{NUMBER.pattern}")
PART = re.compile(r"([^\W\d_]+|[%‰])(?:\^-?\d|-\d)?")
# words, also as endings, that make another quantity of a unit
MEASURES = ("rms", "eff", "peak", "pk", "pp", "ac", "el", "elec", "electrical")
# parts of units that the table of units has no factor for
OTHER_PARTS = {
    *("count", "counts", "cnt", "cts", "tick", "ticks", "pulse", "pulses", "edge", "edges"),
    *("step", "steps", "sample", "samples", "digit", "digits", "bit", "bits", "lsb", "inch"),
    *("lb", "lbf", "oz", "ozf", "kgf", "gf", "kp", "kn", "mn", "kg", "kw", "mw", "wh", "va"),
    *("ah", "mah", "ohm", "degc", "khz", "mhz", "erpm", "lbs", "inc", "incs", "increments"),
    *("inches", "feet", "foot", "grad", "gon"),  # Grad is a degree in German, 0.9 degrees else
}
# words of remarks that leave no doubt of the unit; so do a digit and M1, but not x10
PLAIN_WORDS = {
    *("filtered", "unfiltered", "measured", "actual", "mean", "average", "motor", "shaft"),
    *("output", "input", "left", "right", "front", "rear", "phase", "channel", "sensor"),
}
PLAIN_WORD = re.compile(r"(?!x)[^\W\d_]{1,3}\d{1,2}|\d")
# parts of units in a product; alone they are words or letters of a phase
WORDS = ("in", "ft", "min", "d", "h", "m", "g", "r", "N", "W", "K", "U")
SINGLE_LETTERS = {unit for units in UNITS.values() for unit in units if len(unit) == 1}


@dataclass(frozen=True)
class Stated:
    """A text of a file that states a unit, and what one of it is in the own unit of the column;
    None where that is not known.
    """

    text: str
    factor: float | None


def has_unit(name: str) -> bool:
    """Whether a name of a file states a unit of any column at its end, as in Time (ms)."""
    return any(map(is_unit, _in_brackets(name)))


def unit_in_name(name: str, column: str) -> Stated | None:
    """The unit in the last of the brackets at the end of a name that hold one; None without."""
    found = (stated_unit(text, column) for text in reversed(_in_brackets(name)))
    return next((stated for stated in found if stated), None)


def unit_at_end(name: str, column: str) -> Stated | None:
    """The unit of a column, other than its own one, that a name of a file ends in: time_ms,
    speed_rad_s. None without, for a single letter, which may be anything, and for min, which may be
    a minimum.
    """
    parts = name.split("_") if name != column else []
    ends = ["/".join(parts[-2:])] * (len(parts) > 2) + parts[-1:] * (len(parts) > 1)
    for text in ends:
        written = text in UNITS.get(own_unit(column), {}) or text.lower() in ALIASES
        is_stated = written and len(text) > 1 and text != "min" and not re.search(r"\d", text)
        factor = known_unit(text, column) if is_stated else None
        if factor is not None:
            return Stated(text, factor) if factor != 1.0 else None
    return None


def end_warning(stated: Stated, name: str, column: str, source: str) -> str:
    """A warning of a unit that is read from the end of a name."""
    return (
        f"{source}: the unit of {name!r} is read as {stated.text}, in which the name ends: --map "
        f'"{name}:UNIT={column}" states another one.'
    )


def unit_of_place(text: str, column: str) -> Stated | None:
    """The unit in a place for units alone, where a word is no remark; None for plain numbers."""
    if _is_plain_number(text):
        return None
    return stated_unit(text, column) or Stated(text.strip(), None)


def remark_warning(name: str, column: str, source: str) -> list[str]:
    """A warning of brackets in the name of a column that are read as a remark, unless its words
    leave no doubt of the unit.
    """
    if all(map(_is_plain_remark, re.findall(BRACKETS, name))):
        return []
    return [
        f"{source}: the brackets of {name!r} are read as a remark, the unit as "
        f'{own_unit(column) or 1}: --map "{name}:UNIT={column}" states another one.'
    ]


def _is_plain_remark(text: str) -> bool:
    """Whether a text in brackets is a remark that leaves no doubt of the unit: of known words,
    digits, and single letters behind them.
    """
    if _is_plain_number(text):
        return True
    first, *others = [word for word in BETWEEN_WORDS.split(text.lower()) if word] or [text]
    return _is_plain_word(first) and all(len(w) == 1 or _is_plain_word(w) for w in others)


def _is_plain_word(word: str) -> bool:
    return word in PLAIN_WORDS or bool(PLAIN_WORD.fullmatch(word))


def _is_plain_number(text: str) -> bool:
    """Whether a text states that a column holds plain numbers."""
    return bare(text).lower() in NO_UNIT


def stated_unit(text: str, column: str) -> Stated | None:
    """The unit of a column that a text states; None for plain numbers and for a remark.

    A unit is one of the column's, with a remark behind it or none; one of the column's with a
    number before it, which may be a range, or behind a remark; and a text of nothing but parts of
    units.
    """
    text = text.strip()
    if _is_plain_number(text):
        return None
    words = [word for word in BETWEEN_WORDS.split(text) if word] or [text]
    factor = known_unit(text, column)
    if factor is None and not any(map(_is_unit_word, words[1:])):
        factor = known_unit(words[0], column)
    if factor is not None:
        return Stated(text, factor)
    number = MULTIPLE.match(text)
    unit = text[number.end() :] if number else ""
    if unit and not unit.startswith("/"):
        return Stated(text, None) if known_unit(unit, column) else None
    return Stated(text, None) if _is_scaled(words, column) or _is_unit_text(words) else None


def _is_scaled(words: list[str], column: str) -> bool:
    """Whether one of the words is a unit of the column other than its own one."""
    return any(known_unit(word, column) not in (None, 1.0) for word in words)


def _is_unit_text(words: list[str]) -> bool:
    """Whether words are nothing but parts of units and measures."""
    parts = [word for word in words if not _is_measure(word)]
    return bool(parts) and parts[0] not in WORDS and all(map(_is_of_unit, parts))


def needed_factor(stated: Stated, name: str, column: str, source: str) -> float:
    """The factor of a stated unit; VgrooveError that says how to state it where it is not known."""
    if stated.factor is not None:
        return stated.factor
    text, own = stated.text, own_unit(column)
    factor = f"FACTOR {own}".strip()
    where, written = f", FACTOR being what one {text} is in {own or 'shares of 1'}", factor
    if _is_multiple(text, column):
        where, written = "", text
    raise VgrooveError(
        f"{source}: column {name}: {column} is not read in {text!r}: state the unit by "
        f'--map "{name}:{written}={column}"{where}; or by --map "{name}:{own or 1}={column}" if '
        f"{text!r} is a remark or a range."
    )


def _is_multiple(text: str, column: str) -> bool:
    """Whether --map reads a text as a number and a unit."""
    try:
        return bool(unit_factor(text, column))
    except VgrooveError:
        return False


def refuse_contradiction(
    stated: Stated, named: Stated, name: str, column: str, source: str
) -> None:
    """VgrooveError where the unit of a file and that in the name of its column differ."""
    if stated.factor != named.factor:
        raise VgrooveError(
            f"{source}: column {name}: its name states the unit {named.text!r}, the line of units "
            f"or the channel states {stated.text!r}: say which of them holds, as in "
            f'--map "{name}:{named.text}={column}".'
        )


def _in_brackets(name: str) -> list[str]:
    """The texts of the brackets that a name ends in."""
    end = AT_END.search(name)
    return re.findall(BRACKETS, end.group()) if end else []


def _is_unit_word(word: str) -> bool:
    """Whether a word behind a unit belongs to it."""
    return _is_measure(word) or _is_unit_text([word])


def _is_measure(word: str) -> bool:
    return word.lower().strip(".") in MEASURES


def _is_of_unit(word: str) -> bool:
    """Whether a word is nothing but parts of units: counts/s, lbf·in, Arms."""
    spelt = word.replace("°", "deg").replace("⁻", "^-").replace("¹", "1").replace("²", "^2")
    parts = [part for part in BETWEEN_PARTS.split(spelt) if part and not part.isdigit()]
    return bool(parts) and all(map(_is_part, parts))


def _is_part(text: str) -> bool:
    found = PART.fullmatch(text)
    if not found:
        return False
    part = found[1]
    part = part.removesuffix(next((m for m in MEASURES if part.endswith(m)), ""))
    if len(part) == 1:
        return part in SINGLE_LETTERS or part in WORDS
    return part in WORDS or is_unit(part) or part.lower() in OTHER_PARTS
