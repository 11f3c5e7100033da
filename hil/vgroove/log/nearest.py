"""Columns of a file whose names are near that of a log column, for messages."""

import difflib
import re
from collections.abc import Iterable

# words that people name a quantity by, besides the column's own name
WORDS = {
    "time_s": ("time", "t", "timestamp", "seconds", "zeit"),
    "duty": ("duty", "pwm", "dutycycle", "throttle", "tastgrad"),
    "voltage_v": ("voltage", "u", "v", "u_motor", "motor voltage", "spannung"),
    "supply_v": ("supply", "bus", "battery", "u_bat", "vbus"),
    "current_a": ("current", "i", "i_motor", "motor current", "strom"),
    "speed_rpm": ("speed", "rpm", "omega", "n", "motor speed", "drehzahl"),
    "position_rad": ("position", "angle", "theta", "encoder", "winkel"),
    "load_nm": ("load", "torque", "moment"),
}
# words that are parts of longer names alone
PART_WORDS = {
    "time_s": ("stamp", "micros", "millis", "ms", "us"),
    "current_a": ("curr",),
    "speed_rpm": ("velocity", "vel", "erpm", "spd"),
}
# words that are parts of names of other quantities too: which voltage, whose torque, what of the
# encoder
WHOLE_WORDS = {"voltage", "spannung", "torque", "moment", "encoder"}
MIN_LIKENESS = 0.6  # of difflib's ratio, for a name to be shown
MIN_PROPOSED = 0.75  # the same, for a name that is proposed beside the missing column
WORD_LIKENESS = 0.8  # of a name that holds one of the words, as /motor/cmd/duty or PwmDuty
MIN_WORD = 3  # letters of such a word
# parts of a name: words in small letters, with a capital letter, in capital letters
PARTS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[^\W\d_A-Z]+")
SHOWN = 8  # names that are listed where none is near


def nearest_columns(column: str, names: Iterable[str], count: int = 3) -> list[str]:
    """At most `count` of the names that are most like a log column, the most likely first."""
    score = {name: _likeness(column, name) for name in names if name}
    near = sorted((n for n in score if score[n] >= MIN_LIKENESS), key=lambda n: -score[n])
    return near[:count]


def _likeness(column: str, name: str) -> float:
    """Largest ratio of difflib.SequenceMatcher of a name, without a unit in brackets, to the words
    of a column; more than WORD_LIKENESS where a part of the name is one of them.
    """
    stated = re.sub(r"[\[(].*?[\])]", "", name).strip()
    words = (column, *WORDS.get(column, ()))
    ratio = max(difflib.SequenceMatcher(None, stated.lower(), word).ratio() for word in words)
    long = {word for word in words if len(word) >= MIN_WORD} - WHOLE_WORDS
    parts = {part.lower() for part in PARTS.findall(stated)}
    if parts & (long | set(PART_WORDS.get(column, ()))):
        return max(ratio, WORD_LIKENESS + (1.0 - WORD_LIKENESS) * ratio)
    return ratio


def hint(columns: Iterable[str], names: Iterable[str], found: Iterable[str] = ()) -> str:
    """A sentence on the columns of a file that may be those which are missing, and the options that
    read all columns of the file whose names are near to one of a log that is not among `found`.
    """
    names, found = [name for name in names if name], list(found)
    for column in columns:
        near = nearest_columns(column, names)
        if near:
            options = proposed_options(column, near[0], names, found)
            return (
                f" The nearest columns of the file are {', '.join(near)}: if it is one of them, "
                f"say {' '.join(options)}."
            )
    if not names:
        return f" The file has no column besides {', '.join(sorted(found))}." if found else ""
    listed = ", ".join(names[:SHOWN]) + (", ..." if len(names) > SHOWN else "")
    text = f' The columns of the file are {listed}: name them by --map "NAME:UNIT=COLUMN"'
    if "time_s" in columns:
        text += (
            "; a column that counts the rows gives the times by the interval as its unit, as in "
            '"N:0.001 s=time_s"'
        )
    return f"{text}."


def proposed_options(
    column: str, name: str, names: list[str], found: Iterable[str] = ()
) -> list[str]:
    """The options --map that read `name` as a missing column, then each further name as the log
    column, none of `found`, that it is most like; UNIT stands where the name states none.
    """
    chosen, open_columns = {column: name}, set(WORDS) - set(found)
    pairs = ((_likeness(c, n), c, n) for c in sorted(open_columns) for n in names)
    for likeness, other, near in sorted(pairs, key=lambda pair: -pair[0]):
        if likeness >= MIN_PROPOSED and other not in chosen and near not in chosen.values():
            chosen[other] = near
    return [f'--map "{_written(name)}={column}"' for column, name in chosen.items()]


def _written(name: str) -> str:
    """NAME:UNIT of an option, or NAME where the name states its unit."""
    from vgroove.log.stated_units import has_unit

    if has_unit(name):
        return f"{name}:" if ":" in name else name
    return f"{name}:UNIT"
