"""Torque control of tools of their own: the nominal tool, tools that are off with the map of the
nominal tool, and the same tools with their own map (`vgroove adapt`), on the same drawn drives.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vgroove.adapt.level_scale import level_scale
from vgroove.adapt.torque_map_file import flash_bytes, torque_map
from vgroove.control_bench import torque_drawn
from vgroove.control_bench.draw import DRIVE, NOMINAL, SEEDS, TOOL, DrawnPart, drawn, drawn_tool
from vgroove.control_bench.jobs import Figures, Job, Variant
from vgroove.control_bench.runs import reference
from vgroove.control_bench.sets import SETS

TOOLS = 18  # of a half: a map takes more than a minute of processor time
UNADAPTED, ADAPTED = "tool off, unadapted", "tool off, adapted"
STRATA = (NOMINAL, UNADAPTED, ADAPTED)
MAP = Variant("torque map")


def tools(half: str) -> list[dict[str, float]]:
    """The tools of a half: shares of the nominal values, and the friction of the grooves."""
    return drawn(TOOL, TOOLS, (SEEDS[half], DrawnPart.TORQUE_ADAPTED, 0))


def cells(draws: int = torque_drawn.DRAWS) -> list[dict[str, Any]]:
    """`draws` drives of each target in each half, each in all of STRATA; the tools take turns."""
    found = []
    count = draws * len(torque_drawn.TARGETS_NM)
    for half in SETS:
        seeds = (SEEDS[half], DrawnPart.TORQUE_ADAPTED, 1)
        own = tools(half)
        order = np.random.default_rng(list(seeds)).permutation(count) % TOOLS
        for k, values in enumerate(drawn({**DRIVE, **torque_drawn.SPANS}, count, seeds)):
            values["target_nm"] = float(int(values["target_nm"]))
            seed = int(np.random.default_rng([*seeds, k]).integers(1, 2**31))
            for stratum in STRATA:
                tool = {} if stratum == NOMINAL else own[order[k]]
                cell = {"set": half, "stratum": stratum, **values, "tool": tool, "seed": seed}
                found.append(cell)
    return found


def map_work(variant: Variant, *, tool: Mapping[str, float]) -> Figures:
    """The torque map of a tool as hexadecimal digits, and the scale of its levels."""
    del variant
    nominal = reference()
    start = {"supply_v": nominal.value("supply.voltage_v"), "start_rad": 0.0}
    rig = drawn_tool(nominal, {**start, "tool": tool})
    scale = level_scale(rig).level
    return {"scale": scale, "map": flash_bytes(torque_map(rig, scale, workers=1)[0]).hex()}


def map_jobs(chosen: Sequence[dict[str, Any]]) -> list[Job]:
    """One map for each tool of the adapted cells."""
    found: list[Job] = []
    for cell in chosen:
        job = Job(map_work, MAP, {"tool": cell["tool"]})
        if cell["stratum"] == ADAPTED and job not in found:
            found.append(job)
    return found


def work(variant: Variant, *, map_hex: str | None, **cell: Any) -> Figures:
    """One drive, with the map of the firmware or another one."""
    torque_map = None if map_hex is None else bytes.fromhex(map_hex)
    return torque_drawn.work(variant, adapted=torque_drawn.Adapted(torque_map), **cell)


def jobs(chosen: Sequence[dict[str, Any]], maps: Sequence[Figures]) -> list[Job]:
    """One drive a cell; maps: the rows of `map_jobs`."""

    def map_hex(cell: Mapping[str, Any]) -> str | None:
        if cell["stratum"] != ADAPTED:
            return None
        return next(row["map"] for row in maps if row["tool"] == cell["tool"])

    return [
        Job(work, torque_drawn.CONTROLLER, {**cell, "map_hex": map_hex(cell)}) for cell in chosen
    ]
