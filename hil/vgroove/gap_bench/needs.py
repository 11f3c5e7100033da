"""The table of docs/gap_bench.md, which effects need which sensor and which excitation, written
from the figures of the bench.
"""

from typing import Any

from vgroove.page import Table

COLUMNS = {
    "input": (("duty", "duty"), ("voltage_v", "voltage"), ("current_a", "current")),
    "bus": (("modelled", "bus judged"), ("measured", "bus drives"), ("absent", "no bus")),
    "speed from": (
        ("hall", "Hall"),
        ("encoder", "encoder"),
        ("tachometer", "tacho"),
        ("angle", "angle"),
    ),
    "direction": (("one way", "one way"), ("both ways", "both ways")),
    "load": (("free", "free"), ("loaded", "loaded")),
    "command": (("steps", "steps"), ("smooth", "smooth")),
}


def needs_table(needs: dict[str, dict[str, Any]]) -> str:
    """Rows of effects, columns of what the log holds: right answers / cases; a dot where no case
    was run.
    """
    heads = [word for group in COLUMNS.values() for _, word in group]
    rows = [
        [
            f"`{effect}`",
            *(
                cell_text(groups.get(name, {}).get(key))
                for name, group in COLUMNS.items()
                for key, _ in group
            ),
        ]
        for effect, groups in needs.items()
    ]
    return Table("needs", "", ["effect", *heads], rows).as_markdown()


def cell_text(cell: dict[str, int] | None) -> str:
    return f"{cell['hits']}/{cell['of']}" if cell else "."
