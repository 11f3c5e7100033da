"""The torque map of a tool (torque_map.py) in the forms of the firmware
(firmware/controllers/torque_map.h): bytes in flash, and the C file of the reference tool.

`python -m vgroove.adapt.torque_map_file firmware/controllers/torque_map.c`
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np

from vgroove.adapt.torque_map import BASE_V, LEVEL_STEP_V, RUN_V, tables
from vgroove.progress import share_bar
from vgroove.reference.rigs import reference_rig
from vgroove.rig import Rig

RUN_STEP_V = 0.02
MEMBER_TYPES = {
    "stop_a_q8": "<i2",
    "level_40mv": "u1",
    "settled_a_q4": "u1",
    "raised_40mv": "u1",
    "run_20mv": "u1",
}
# In the C table in place of a current: none is valid, since the target is below LEAST_HELD_NM.
NEVER = 255


def member_values(table: dict[str, np.ndarray], run_v: float) -> dict[str, np.ndarray]:
    """Integers of the members of TorqueMap in their order, (rows,), the last one (1,). The name of
    a member states its unit. table: columns of torque_map.tables(), in V and A; run_v: level of
    the run-up in V.
    """
    columns = {
        "stop_a_q8": np.round(table["stop"] * 256),
        "level_40mv": np.round((np.nan_to_num(table["level"], nan=BASE_V) - BASE_V) / LEVEL_STEP_V),
        "settled_a_q4": np.round(np.nan_to_num((table["settled"] - 12.0) * 16, nan=NEVER)),
        "raised_40mv": np.round((table["raised"] - BASE_V) / LEVEL_STEP_V),
        "run_20mv": np.round((np.array([run_v]) - BASE_V) / RUN_STEP_V),
    }
    return {name: values.astype(MEMBER_TYPES[name]) for name, values in columns.items()}


def flash_bytes(map_members: dict[str, np.ndarray]) -> bytes:
    """The map as it lies in flash (little endian, no padding)."""
    return b"".join(
        values.astype(MEMBER_TYPES[name]).tobytes() for name, values in map_members.items()
    )


def _initializer(name: str, values: np.ndarray) -> str:
    if len(values) == 1:
        return f"    .{name} = {values[0]},"
    cells = ["NEVER" if name == "settled_a_q4" and v == NEVER else str(v) for v in values]
    lines = [", ".join(cells[n : n + 12]) for n in range(0, len(cells), 12)]
    return f"    .{name} =\n        {{" + ",\n         ".join(lines) + "},"


def c_source(map_members: dict[str, np.ndarray]) -> str:
    """Text of firmware/controllers/torque_map.c from the integers of the members."""
    return TEMPLATE.format(
        members="\n".join(_initializer(name, values) for name, values in map_members.items())
    )


TEMPLATE = """\
// Tables of torque_map.h, computed by hil/vgroove/adapt/torque_map.py: edit that, not this.
#include "controllers/torque_map.h"

#define BASE_MV 5000
#define STEP_MV 40
#define RUN_STEP_MV 20
#define LEAST_A_Q8 (12 * 256)
#define NEVER 255u  // no current: the target is too low for a joint to settle at its level

// clang-format off
FLASH_CONST TorqueMap torque_map FLASH_TABLE = {{
{members}
}};
// clang-format on

int16_t torque_map_run_mv(void) {{
    return (int16_t)(BASE_MV + FLASH_U8(&torque_map.run_20mv) * RUN_STEP_MV);
}}

int16_t torque_map_level_mv(uint8_t row) {{
    return (int16_t)(BASE_MV + FLASH_U8(&torque_map.level_40mv[row]) * STEP_MV);
}}

int16_t torque_map_settled_a_q8(uint8_t row) {{
    const uint8_t settled = FLASH_U8(&torque_map.settled_a_q4[row]);
    return settled == NEVER ? TORQUE_MAP_NEVER : (int16_t)(LEAST_A_Q8 + settled * 16);
}}

int16_t torque_map_raised_mv(uint8_t row) {{
    return (int16_t)(BASE_MV + FLASH_U8(&torque_map.raised_40mv[row]) * STEP_MV);
}}

int16_t torque_map_stop_a_q8(uint8_t row) {{
    return FLASH_I16(&torque_map.stop_a_q8[row]);
}}
"""


def torque_map(rig: Rig, scale: float, **options: Any) -> dict[str, np.ndarray]:
    """The members of the map of a rig whose levels are `scale` times those of the reference tool;
    the options are those of `tables`.
    """
    return member_values(tables(rig, scale, **options), scale * RUN_V)


def main() -> None:
    """Write the file named on the command line."""
    with share_bar("torque map") as bar:
        found = torque_map(reference_rig(), 1.0, progress=bar.move_to)
    Path(sys.argv[1]).write_text(c_source(found), encoding="utf-8")


if __name__ == "__main__":
    main()
