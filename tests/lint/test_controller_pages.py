"""A controller's page shows its states as a diagram, all those of its header and no others, and its
waveforms.
"""

import re
from pathlib import Path

import pytest
import rules

PAGES = rules.ROOT / "docs" / "controllers"
FIRMWARE = rules.ROOT / "firmware" / "controllers"
LIST = rules.ROOT / "firmware" / "app" / "control_list.h"
CONTROLLERS = re.findall(r"^    X\(\w+, (\w+),", LIST.read_text(encoding="utf-8"), re.MULTILINE)
DIAGRAM = re.compile(r"```mermaid\nstateDiagram-v2\n(.*?)```", re.DOTALL)
ARROW = re.compile(r"^\s*(\w+|\[\*\]) --> (\w+|\[\*\])(?:: \S.*)?$")


def states_of_header(name: str) -> set[str]:
    """Of the enum whose name ends in State or Phase, without the prefix."""
    text = re.sub(r"//[^\n]*", "", (FIRMWARE / f"{name}.h").read_text(encoding="utf-8"))
    body = re.search(r"typedef enum \{([^}]*)\} \w+(?:State|Phase);", text)
    assert body, name
    return {
        entry.strip().removeprefix(f"{name.upper()}_")
        for entry in body[1].split(",")
        if entry.strip()
    }


def states_of_page(text: str) -> set[str]:
    """Of the diagram, every one of whose lines is an arrow or its direction."""
    diagrams = DIAGRAM.findall(text)
    assert len(diagrams) == 1, "one diagram of states"
    found: set[str] = set()
    for line in diagrams[0].strip().splitlines():
        arrow = ARROW.match(line)
        assert arrow or line.strip().startswith("direction "), line
        found |= set(arrow.groups()) if arrow else set()
    return found - {"[*]"}


@pytest.mark.parametrize("name", CONTROLLERS)
def test_diagram_has_the_states_of_the_header(name: str) -> None:
    assert states_of_page((PAGES / f"{name}.md").read_text(encoding="utf-8")) == states_of_header(
        name
    )


def test_a_forgotten_state_is_seen() -> None:
    text = (PAGES / "sync.md").read_text(encoding="utf-8")
    assert states_of_page(re.sub(r".*SEEK.*\n", "", text)) != states_of_header("sync")


@pytest.mark.parametrize("page", sorted(PAGES.glob("*.md")), ids=lambda p: p.stem)
def test_every_page_shows_its_waveforms(page: Path) -> None:
    image = page.parent / f"../images/control_{page.stem}.svg"
    assert f"(../images/{image.name})" in page.read_text(encoding="utf-8") and image.is_file()
    assert image.stat().st_size < 110_000, "small enough for a page"
