"""The rules of tests/lint by name, applied to every tracked file."""

from collections.abc import Callable
from pathlib import Path

import layout
import python_rules
import rules
import text_rules
from rules import Violation

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
    "metaphors": text_rules.metaphors,
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
