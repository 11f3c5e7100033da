"""Rewrites the compound literals of a C file, (Type){.a = x, .b = y}, for a C++ compiler without
designated initialisers (avr-g++ 5.4): designators.py IN.c OUT.cpp.
"""

import re
import sys
from pathlib import Path

LITERAL = re.compile(r"\((?P<type>[A-Z]\w*)\)\s*\{")
DECLARED = re.compile(r"(?P<type>\b[A-Z]\w*) (?P<name>\w+) = \{(?=\s*\.)")


def block_end(text: str, at: int) -> int:
    """Place after the bracket that closes the one at `at`."""
    depth = 0
    for place in range(at, len(text)):
        depth += {"{": 1, "(": 1, "}": -1, ")": -1}.get(text[place], 0)
        if depth == 0:
            return place + 1
    raise SystemExit("a bracket is not closed")


def parts(text: str) -> list[str]:
    """Initialisers of a list, separated at its own commas."""
    found, depth, begin = [], 0, 0
    for place, character in enumerate(text):
        depth += {"{": 1, "(": 1, "}": -1, ")": -1}.get(character, 0)
        if character == "," and depth == 0:
            found.append(text[begin:place])
            begin = place + 1
    return [part.strip() for part in [*found, text[begin:]] if part.strip()]


def without_comments(text: str) -> str:
    """The text without // comments."""
    return re.sub(r"//[^\n]*", "", text)


def as_lambda(kind: str, body: str) -> str:
    """An expression that makes a struct: zeroed, then its members assigned."""
    sets = ""
    for part in parts(body):
        if part in ("0", "{0}"):
            continue
        name, value = re.fullmatch(r"\.(\w+)\s*=\s*(.*)", part, re.DOTALL).groups()
        sets += f" made.{name} = {value};"
    return f"[&]{{ {kind} made = {kind}();{sets} return made; }}()"


def rewritten(text: str) -> str:
    """The text with its compound literals and designated initialisers as lambdas."""
    text = without_comments(text)
    for pattern in (LITERAL, DECLARED):
        match = pattern.search(text)
        while match:
            end = block_end(text, match.end() - 1)
            made = as_lambda(match["type"], text[match.end() : end - 1])
            head = f"{match['type']} {match['name']} = " if pattern is DECLARED else ""
            text = text[: match.start()] + head + made + text[end:]
            match = pattern.search(text)
    return text


if __name__ == "__main__":
    Path(sys.argv[2]).write_text(rewritten(Path(sys.argv[1]).read_text()))
