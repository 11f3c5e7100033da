"""Keys of a rig file: which values a key accepts, in words and as a test.

Standard library only: the plant's build reads the catalogue without the package's dependencies.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any


@dataclass(frozen=True)
class Key:
    """One key of a rig: the accepted values in words (a message says "must be ..."), as a test, and
    whether the section needs the key.
    """

    words: str
    holds: Callable[[Any], bool]
    needed: bool = True

    def optional(self) -> "Key":
        """The same key, which a rig may leave out."""
        return replace(self, needed=False)


def is_number(value: Any) -> bool:
    """Whether a TOML value is a finite number; a whole number may be too large for a float."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def number(words: str, holds: Callable[[float], bool]) -> Key:
    """A finite number with a condition."""
    return Key(words, lambda v: is_number(v) and holds(v))


def between(low: float, high: float) -> Key:
    """A number from low to high, both accepted."""
    return number(f"a number from {low:g} to {high:g}", lambda v: low <= v <= high)


def whole(low: int, high: int) -> Key:
    """A whole number from low to high, both accepted."""
    words = f"a whole number from {low} to {high}"
    return Key(words, lambda v: isinstance(v, int) and not isinstance(v, bool) and low <= v <= high)


def choice(*names: str) -> Key:
    """One of the names."""
    return Key("one of " + ", ".join(names), lambda v: v in names)


def flag() -> Key:
    """A truth value."""
    return Key("true or false", lambda v: isinstance(v, bool))


ANY = number("a finite number", lambda v: True)
POSITIVE = number("a number above 0", lambda v: v > 0)
NOT_NEGATIVE = number("a number of at least 0", lambda v: v >= 0)
RELATIVE = number("a number above -1", lambda v: v > -1)
PROBABILITY = number("a number between 0 and 1", lambda v: 0 <= v <= 1)
SKEW = number("a number within +-0.05", lambda v: abs(v) <= 0.05)
