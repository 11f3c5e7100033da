"""The overviews name what the tree holds: modules of the package, folders of the tests, commands
and their options.
"""

import re
from collections.abc import Iterable

import command_options
import pytest
import rules
import typer.main

from vgroove.cli import app

UNNAMED = ("__init__", "__main__", "__pycache__")


def section(path: str, heading: str) -> str:
    """The section of a page below a heading."""
    text = (rules.ROOT / path).read_text(encoding="utf-8")
    return re.split(r"^## ", text.split(f"## {heading}\n", 1)[1], maxsplit=1, flags=re.MULTILINE)[0]


def children(folder: str) -> set[str]:
    """Names of the tracked modules and folders directly in a folder, without `.py`."""
    paths = (path for path in rules.repository_paths() if path.startswith(f"{folder}/"))
    parts = [path.removeprefix(f"{folder}/").split("/") for path in paths]
    names = {p[0].removesuffix(".py") for p in parts if len(p) > 1 or p[0].endswith(".py")}
    return names - set(UNNAMED)


def not_named(names: Iterable[str], text: str) -> list[str]:
    """Names that a text does not hold in backticks."""
    return sorted(name for name in names if f"`{name}`" not in text)


def test_the_architecture_names_every_module_of_the_package() -> None:
    text = section("docs/architecture.md", "Modules of the Python package")
    assert not_named(children("hil/vgroove"), text) == []


def test_the_architecture_names_no_module_that_is_missing() -> None:
    table = section("docs/architecture.md", "Modules of the Python package")
    rows = [line.split("|")[1] for line in table.splitlines()[2:] if line.startswith("| `")]
    named = set(re.findall(r"`(\w+)`", "".join(rows)))
    assert named - children("hil/vgroove") == set()


def test_the_readme_names_every_folder_of_the_tests() -> None:
    row = next(
        line for line in section("README.md", "The tree").splitlines() if "| `tests/` |" in line
    )
    folders = {name for name in children("tests") if (rules.ROOT / "tests" / name).is_dir()}
    assert not_named(folders, row) == []


def test_the_page_of_options_is_that_of_the_commands() -> None:
    written = (rules.ROOT / command_options.PAGE).read_text(encoding="utf-8")
    assert written == command_options.page(), "python tests/lint/command_options.py writes it"


def test_the_overview_of_the_commands_names_every_command() -> None:
    page = (rules.ROOT / "docs/commands.md").read_text(encoding="utf-8")
    # `vgroove study supply|steps` stands for two commands
    named = {
        f"{head}{last}"
        for found in re.findall(r"`(vgroove [^`]*)`", page)
        for head, tail in [
            re.match(r"((?:vgroove|gap|log|rig|bench|study| )*)(\S*)", found).groups()
        ]
        for last in tail.replace("\\|", "|").split("|")
    }
    commands = command_options.commands(typer.main.get_command(app), "vgroove")
    assert {name for name, _ in commands} - named == set()


@pytest.mark.parametrize(("text", "found"), [("`sil`, `board`", []), ("sil, `board`", ["sil"])])
def test_a_name_that_is_missing_is_found(text: str, found: list[str]) -> None:
    assert not_named(["sil", "board"], text) == found
