"""The page of all options, docs/command_options.md, made from the commands themselves:
`python tests/lint/command_options.py` writes it.
"""

import textwrap
from collections.abc import Iterator
from typing import Any

import rules
import typer.main
from text_rules import LINE_LIMIT

from vgroove.cli import app

PAGE = "docs/command_options.md"
HEAD = """# Options of the commands

Written by `python tests/lint/command_options.py` from the help texts of the commands; what each
command is for: [commands](commands.md).
"""


def commands(group: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Name and command of each command of a group and of the groups in it."""
    for part, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, f"{name} {part}")
        elif not command.hidden:
            yield f"{name} {part}", command


def spelling(parameter: Any) -> str:
    """How a parameter is written: `--seed N`, `--wait`/`--no-wait`, `RIG`."""
    if parameter.param_type_name == "argument":
        name = (parameter.metavar or parameter.name).strip("[]{}").upper()
        return f"`{name}`".replace("|", r"\|")
    value = f" {parameter.metavar}" if parameter.metavar else ""
    names = [f"`{name}{value}`" for name in parameter.opts]
    return ", ".join(names) + "".join(f" / `{name}`" for name in parameter.secondary_opts)


def meaning(parameter: Any) -> str:
    """The help of a parameter, and its default."""
    text = " ".join((getattr(parameter, "help", None) or "").split())
    default = parameter.default
    if parameter.required:
        return f"{text} Required."
    if isinstance(default, (str, int, float)) and not isinstance(default, bool):
        return f"{text} Default: {default}."
    return text


def options_of(name: str, command: Any) -> str:
    """The section of a command."""
    text = " ".join((command.help or "").split())
    rows = [
        f"| {spelling(parameter)} | {meaning(parameter)} |"
        for parameter in command.params
        if parameter.name != "help"
    ]
    table = "\n".join(["| option | meaning |", "| --- | --- |", *rows])
    return f"## {name}\n\n{textwrap.fill(text, LINE_LIMIT)}\n\n{table}\n"


def page() -> str:
    """The page as it must be."""
    sections = commands(typer.main.get_command(app), "vgroove")
    return "\n".join([HEAD, *(options_of(*section) for section in sections)])


if __name__ == "__main__":
    (rules.ROOT / PAGE).write_text(page(), encoding="utf-8")
