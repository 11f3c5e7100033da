"""Loads a page in an installed Chromium: its elements after the scripts have run, the messages of
its console, and the addresses that it loaded.
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
const names = performance.getEntriesByType('resource').map(entry => entry.name)
document.body.dataset.loaded = JSON.stringify(names)}, 1000))</script>"""


@dataclass(frozen=True)
class Seen:
    """A loaded page: its elements as HTML, lines of its console, addresses that it loaded."""

    dom: str
    console: list[str]
    loaded: list[str]


def need_chromium() -> str:
    """Path of the browser; skips the test where none is installed."""
    try:
        return find_chromium()
    except VgrooveError:
        pytest.skip("Chromium is not installed")


def seen(page: Path) -> Seen:
    """Load a page file in the browser."""
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
    assert loaded, "the page's scripts did not end in time"
    return Seen(
        done.stdout, re.findall(r".*CONSOLE.*", done.stderr), json.loads(unescape(loaded[1]))
    )
