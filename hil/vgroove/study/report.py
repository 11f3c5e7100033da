"""What every study hands over, and how it is written: tables as CSV, one JSON, one page, a picture
of it.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vgroove.chromium import draw, find_chromium
from vgroove.errors import VgrooveError
from vgroove.output import check_outputs, write_text
from vgroove.page import Page, Picture, Table


@dataclass(frozen=True)
class Study:
    """A finished study; `data` is its JSON, `lines` what it found in sentences."""

    name: str
    title: str
    lines: Sequence[str]
    tables: Sequence[Table]
    pictures: Sequence[Picture]
    data: dict[str, Any] = field(default_factory=dict)

    def page(self) -> Page:
        """Pictures, then tables."""
        return Page(self.name, self.title, self.lines, [*self.pictures, *self.tables])


def joined(title: str, parts: Sequence[Study]) -> Study:
    """Studies of one name as one."""
    return Study(
        parts[0].name,
        title,
        [line for p in parts for line in p.lines],
        [t for p in parts for t in p.tables],
        [f for p in parts for f in p.pictures],
        {key: value for p in parts for key, value in p.data.items()},
    )


@dataclass(frozen=True)
class Places:
    """Where a study's files go; prepared, and tried, before the work."""

    folder: Path
    json_path: Path
    chromium: str | None

    def file(self, name: str) -> Path:
        """A file in the folder."""
        return self.folder / name


def prepare(name: str, folder: Path, json_path: Path | None, png: bool) -> Places:
    """Make the folder and see that the files can be written; VgrooveError otherwise."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise VgrooveError(f"{folder}: this folder cannot be made: {error.strerror}") from error
    places = Places(folder, json_path or folder / f"{name}.json", find_chromium() if png else None)
    check_outputs(
        [places.json_path, places.file(f"{name}.html"), places.file(f"{name}.png") if png else None]
    )
    return places


def write(study: Study, places: Places) -> list[Path]:
    """Every file of the study; a file is whole or not there."""
    written = [places.json_path, places.file(f"{study.name}.html")]
    write_text(
        written[0],
        json.dumps({"study": study.name, **study.data}, indent=1, allow_nan=False) + "\n",
    )
    write_text(written[1], study.page().as_html())
    for table in study.tables:
        written.append(places.file(f"{study.name}_{table.name}.csv"))
        write_text(written[-1], table.as_csv())
    if places.chromium:
        written.append(places.file(f"{study.name}.png"))
        draw(places.chromium, study.page().as_html(bar=False), written[-1], study.page().height())
    return written
