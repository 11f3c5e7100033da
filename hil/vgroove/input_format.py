"""The generated tables of docs/input_format.md: columns of a log and keys of a rig."""

import re

from vgroove.log import COLUMN_LABELS, COLUMN_UNITS, READERS
from vgroove.log.units_of_columns import UNITS, own_unit
from vgroove.rig_keys import KINDS, SECTIONS
from vgroove.rig_template import BASE, MEANINGS, TEMPLATES, key_table

COLUMNS = (
    "duty",
    "voltage_v",
    "supply_v",
    "current_a",
    "speed_rpm",
    "position_rad",
    "load_nm",
    "coast",
)
FILES = {
    ".csv": "text: a header with the names, a row a sample",
    ".csv.gz": "the same, compressed by gzip",
    ".mf4": "channels, in one or more channel groups; or CAN frames of a board",
    ".blf": "CAN frames of a board ([telemetry.md](telemetry.md))",
    ".asc": "CAN frames of a board ([telemetry.md](telemetry.md))",
    ".mat": "vectors and structs of vectors; version 7.3 needs h5py",
    ".parquet": "columns; needs pyarrow",
}


def column_table() -> list[str]:
    """Rows of a Markdown table of the columns: name, unit, quantity."""
    rows = ["| column | unit | quantity |", "| --- | --- | --- |", "| `time_s` | s | time |"]
    return rows + [
        f"| `{name}` | {COLUMN_UNITS[name] or '1'} | {COLUMN_LABELS[name]} |" for name in COLUMNS
    ]


def unit_table() -> list[str]:
    """Rows of a Markdown table of the units that a column may be written in."""
    rows = ["| columns | units |", "| --- | --- |"]
    for unit, others in UNITS.items():
        names = [f"`{name}`" for name in ("time_s", *COLUMNS) if own_unit(name) == unit]
        if names:
            written = ", ".join(f"`{other}`" for other in others if other)
            rows.append(f"| {', '.join(names)} | {written} |")
    return rows


def file_table() -> list[str]:
    """Rows of a Markdown table of the endings of log files."""
    rows = ["| ending | what is read |", "| --- | --- |"]
    return rows + [f"| `{ending}` | {FILES[ending]} |" for ending in READERS]


def tables() -> dict[str, list[str]]:
    """The generated tables by the name of their marker."""
    found = {"columns": column_table(), "units": unit_table(), "files": file_table()}
    for section in (*BASE, "sensors"):
        found[section] = key_table(section, SECTIONS[section])
    found["mechanism"] = key_table("mechanism", _described("mechanism", ("impact",)))
    found["load"] = key_table("load", _described("load", tuple(t[1] for t in TEMPLATES.values())))
    return found


def _described(section: str, kinds: tuple[str, ...]) -> dict:
    """Keys of kinds of a section that have a meaning in the template."""
    keys = {name: key for kind in kinds for name, key in KINDS[section][kind].items()}
    return {name: key for name, key in keys.items() if f"{section}.{name}" in MEANINGS}


def with_tables(page: str) -> str:
    """The page with each table between its markers `<!-- table NAME -->` and `<!-- end -->`; a test
    compares docs/input_format.md with it.
    """
    for name, rows in tables().items():
        text = "\n".join(rows)
        pattern = rf"(<!-- table {name} -->\n).*?(\n<!-- end -->)"
        page = re.sub(pattern, lambda m, text=text: m[1] + text + m[2], page, flags=re.S)
    return page
