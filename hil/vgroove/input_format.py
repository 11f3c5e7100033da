"""The generated tables of docs/input_format.md: columns of a log and keys of a rig."""

import re

from vgroove.log import COLUMN_LABELS, COLUMN_UNITS
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


def column_table() -> list[str]:
    """Rows of a Markdown table of the columns: name, unit, quantity."""
    rows = ["| column | unit | quantity |", "| --- | --- | --- |", "| `time_s` | s | time |"]
    return rows + [
        f"| `{name}` | {COLUMN_UNITS[name] or '1'} | {COLUMN_LABELS[name]} |" for name in COLUMNS
    ]


def tables() -> dict[str, list[str]]:
    """The generated tables by the name of their marker."""
    found = {"columns": column_table()}
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
    """The page with each table between its markers `<!-- table NAME -->` and `<!-- end -->`."""
    for name, rows in tables().items():
        text = "\n".join(rows)
        pattern = rf"(<!-- table {name} -->\n).*?(\n<!-- end -->)"
        page = re.sub(pattern, lambda m, text=text: m[1] + text + m[2], page, flags=re.S)
    return page
