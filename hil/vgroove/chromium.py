"""Draws with an installed Chromium: a page as PNG, a figure as SVG."""

import html
import re
import shutil
import subprocess
import tempfile
from pathlib import Path
from urllib.parse import unquote

import plotly.graph_objects as go
from plotly.offline import get_plotlyjs

from vgroove.errors import VgrooveError
from vgroove.html_page import PAGE_WIDTH
from vgroove.output import write_text

CHROMIUM = ("chromium", "chromium-browser", "google-chrome", "chrome")
CHROMIUM_LIMIT_S = 120
# Simulated time for which the page's scripts run before the picture is taken
PAGE_SCRIPTS_MS, FIGURE_SCRIPTS_MS = 8_000, 20_000
WINDOW_MARGIN = 60  # CSS pixels beside the page, for its padding


def find_chromium() -> str:
    """Path of the browser; VgrooveError when none is installed."""
    found = next((path for path in map(shutil.which, CHROMIUM) if path), None)
    if found is None:
        raise VgrooveError(
            f"--png needs Chromium to draw the page, and none of {', '.join(CHROMIUM)} is installed"
        )
    return found


def draw(chromium: str, text: str, png_path: Path, height: int) -> None:
    """Write the PNG of a page, given as HTML, at two pixels for each CSS pixel."""
    part, source = (
        png_path.with_name(f".{png_path.name}.part.{ending}") for ending in ("png", "html")
    )
    write_text(source, text)
    command = [
        chromium,
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--hide-scrollbars",
        "--force-device-scale-factor=2",
        f"--window-size={PAGE_WIDTH + WINDOW_MARGIN},{height}",
        f"--virtual-time-budget={PAGE_SCRIPTS_MS}",
        f"--screenshot={part}",
        source.resolve().as_uri(),
    ]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=CHROMIUM_LIMIT_S, check=False
        )
        if done.returncode != 0 or not part.is_file():
            raise VgrooveError(
                f"{png_path}: {chromium} drew no picture (exit code {done.returncode})"
            )
        part.replace(png_path)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise VgrooveError(f"{png_path}: {chromium} drew no picture: {error}") from error
    finally:
        part.unlink(missing_ok=True)
        source.unlink(missing_ok=True)


def svg_of(chromium: str, figure: go.Figure) -> str:
    """A figure as the SVG that plotly's save button gives; VgrooveError where that fails."""
    size = f"{{format:'svg',width:{figure.layout.width},height:{figure.layout.height}}}"
    plot = f"Plotly.newPlot('figure',{figure.to_json()})"
    script = f"{plot}.then(g=>Plotly.toImage(g,{size})).then(u=>{{document.body.textContent=u}})"
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "figure.html"
        scripts = f"<script>{get_plotlyjs()}</script><script>{script}</script>"
        source.write_text(
            f"<!doctype html><meta charset=utf-8><div id=figure></div>{scripts}", encoding="utf-8"
        )
        command = [
            chromium,
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            f"--virtual-time-budget={FIGURE_SCRIPTS_MS}",
            "--dump-dom",
            source.as_uri(),
        ]
        try:
            dom = subprocess.run(
                command, capture_output=True, text=True, timeout=CHROMIUM_LIMIT_S, check=True
            ).stdout
        except (OSError, subprocess.SubprocessError) as error:
            raise VgrooveError(f"{chromium} drew no figure: {error}") from error
    found = re.search(r"data:image/svg\+xml,([^<\s]+)", dom)
    if found is None:
        raise VgrooveError(f"{chromium} drew no figure: its page holds none")
    return unquote(html.unescape(found[1])) + "\n"
