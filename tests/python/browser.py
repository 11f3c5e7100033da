"""A page in a real Chromium: its elements after the scripts have run, what its console said, and
what it loaded besides itself.
"""

import json
import re
import subprocess
from dataclasses import dataclass
from html import unescape
from pathlib import Path

import pytest

from vgroove.chromium import find_chromium
from vgroove.errors import VgrooveError

WATCH = """<script>addEventListener('load', () => setTimeout(() => {
document.body.dataset.loaded = JSON.stringify(performance.getEntriesByType('resource').map(entry => entry.name))}, 1000))</script>"""


@dataclass(frozen=True)
class Seen:
    """What a browser made of a page."""

    dom: str
    console: list[str]
    loaded: list[str]


def need_chromium() -> str:
    """The browser; the test is skipped where there is none."""
    try:
        return find_chromium()
    except VgrooveError:
        pytest.skip("no Chromium here")


def seen(page: Path) -> Seen:
    """The page as a browser sees it."""
    watched = page.with_name(f"watched_{page.name}")
    watched.write_text(
        page.read_text(encoding="utf-8").replace("</head>", WATCH + "</head>", 1), encoding="utf-8"
    )
    command = [
        need_chromium(),
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--enable-logging=stderr",
        "--virtual-time-budget=8000",
        "--dump-dom",
        watched.resolve().as_uri(),
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    loaded = re.search(r'data-loaded="([^"]*)"', done.stdout)
    assert loaded, "the page's scripts have not come to their end"
    return Seen(
        done.stdout, re.findall(r".*CONSOLE.*", done.stderr), json.loads(unescape(loaded[1]))
    )
