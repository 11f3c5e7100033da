"""Files that do not follow a rule of tests/lint: pending.txt, lines `rule path`. The list can only
shrink; `python tests/lint/pending.py` drops the lines that have become needless.
"""

import sys
from collections.abc import Callable
from pathlib import Path

import layout
import python_rules
import rules
import text_rules
from rules import Violation

LIST = Path(__file__).with_name("pending.txt")
HEAD = """\
# TEMPORARY: files that do not follow a rule yet, as lines `rule path`. The list can only shrink:
# `python tests/lint/pending.py` drops what has become needless, and a test refuses such lines.
"""
TREE = rules.repository_files()
TRACKED = frozenset(rules.repository_paths())
SPECIFICATION = {
    Path(path).stem: text for path, text in TREE.items() if path.startswith("docs/spec/")
}

Rule = Callable[[str, str], list[Violation]]


def cited(path: str, text: str) -> list[Violation]:
    """All wrong citations of a file."""
    return [
        *text_rules.untracked_citations(path, text, TRACKED),
        *text_rules.outside_citations(path, text),
        *text_rules.wrong_sections(path, text, SPECIFICATION),
    ]


def of_python(rule: Rule) -> Rule:
    """The rule restricted to Python files: it finds nothing in others."""
    return lambda path, text: rule(path, text) if path.endswith(".py") else []


def long_functions(path: str, text: str) -> list[Violation]:
    """Long functions of a file that is not generated."""
    return [] if path.startswith(layout.GENERATED) else rules.long_functions(path, text)


RULES: dict[str, Rule] = {
    "length": long_functions,
    "columns": text_rules.long_lines,
    "citation": cited,
    "history": text_rules.history_words,
    "person": text_rules.first_person,
    "stages": of_python(python_rules.stage_violations),
    "arguments": of_python(python_rules.many_arguments),
    "attributes": of_python(python_rules.literal_attributes),
}


def broken(name: str) -> list[Violation]:
    """All violations of one rule in the tracked files."""
    if name == "ruff":
        return [
            Violation(path, 1, "ruff format would change it")
            for path in layout.unformatted_python()
        ]
    return [v for path, text in TREE.items() for v in RULES[name](path, text)]


NAMES = (*RULES, "ruff")


def listed() -> set[tuple[str, str]]:
    """Pairs (rule, path) of pending.txt; empty where the file is gone."""
    if not LIST.exists():
        return set()
    lines = LIST.read_text(encoding="utf-8").splitlines()
    return {tuple(line.split(maxsplit=1)) for line in lines if line and not line.startswith("#")}


def write(pairs: set[tuple[str, str]]) -> None:
    """Write the list; nothing pending leaves no file."""
    text = "".join(f"{rule} {path}\n" for rule, path in sorted(pairs))
    if text:
        LIST.write_text(HEAD + text, encoding="utf-8")
    else:
        LIST.unlink(missing_ok=True)


def main() -> None:
    """Drop needless lines; `--fill` lists all that is broken (once, when a rule is introduced)."""
    found = {(name, v.path) for name in NAMES for v in broken(name)}
    write(found if "--fill" in sys.argv else found & listed())


if __name__ == "__main__":
    main()
