"""A page may quote a measured figure only as <!--result FILE:KEY-->VALUE<!--end-->, and the value
must stand in docs/results. KEY|FORMAT writes it in a format of Python, such as .1% or .3g.
"""

import json
import re
import sys
from pathlib import Path

import pytest
import rules

RESULTS = rules.ROOT / "docs" / "results"
QUOTE = re.compile(r"<!--result ([\w.]+):([\w.]+)(?:\|([+.\w%]+))?-->(.*?)<!--end-->", re.DOTALL)
PAGES = [*sorted(rules.ROOT.glob("*.md")), *sorted((rules.ROOT / "docs").rglob("*.md"))]


def value_of(name: str, key: str, spec: str, folder: Path = RESULTS) -> str:
    """The figure in FOLDER/NAME.json at a dotted key, as a page writes it; spec: its format, or
    empty.
    """
    value = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
    for part in key.split("."):
        value = value[int(part)] if isinstance(value, list) else value[part]
    if spec:
        return format(value, spec).replace("%", " %")
    return f"{value:g}" if isinstance(value, float) else str(value)


def wrong_quotes(text: str, folder: Path = RESULTS) -> list[str]:
    quotes = [
        (name, key, quoted.strip(), value_of(name, key, spec, folder))
        for name, key, spec, quoted in QUOTE.findall(text)
    ]
    return [
        f"{name}:{key} is {value}, quoted as {quoted}"
        for name, key, quoted, value in quotes
        if quoted != value
    ]


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(rules.ROOT)))
def test_pages_quote_the_results(page: Path) -> None:
    assert wrong_quotes(page.read_text(encoding="utf-8")) == []


def test_a_wrong_quote_is_caught(tmp_path: Path) -> None:
    (tmp_path / "demo.json").write_text(
        json.dumps({"right": 19, "runs": [{"gap": 1.5}], "share": 0.98231}), encoding="utf-8"
    )
    share = "<!--result demo:share|.1%-->{}<!--end-->"
    assert wrong_quotes(share.format("98.2 %"), tmp_path) == []
    assert len(wrong_quotes(share.format("98.3 %"), tmp_path)) == 1
    assert (
        wrong_quotes(
            "<!--result demo:right-->19<!--end--> <!--result demo:runs.0.gap-->1.5<!--end-->",
            tmp_path,
        )
        == []
    )
    assert len(wrong_quotes("<!--result demo:right-->20<!--end-->", tmp_path)) == 1


def test_the_page_of_results_is_up_to_date() -> None:
    sys.path.insert(0, str(rules.ROOT / "tests" / "proof"))
    import results_page

    assert results_page.PAGE.read_text(encoding="utf-8") == results_page.page(), (
        "run `python tests/proof/results_page.py`"
    )


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(rules.ROOT)))
def test_links_of_a_page_lead_somewhere(page: Path) -> None:
    links = [
        link.split("#")[0]
        for link in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8"))
        if "://" not in link
    ]
    assert [link for link in links if link and not (page.parent / link).exists()] == []
