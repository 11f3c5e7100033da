"""`vgroove adapt`: setpoints and torque map of a tool, and drives on the plant that check them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from vgroove.adapt.level_control import motor_of
from vgroove.adapt.level_scale import LevelScale, level_scale
from vgroove.adapt.setpoints import (
    beyond_controllers,
    beyond_range,
    check_tool,
    default_value,
    needed_setpoints,
    stored_values,
)
from vgroove.adapt.torque_map_file import flash_bytes, torque_map
from vgroove.control_bench import torque_drawn
from vgroove.control_bench.draw import DRIVE, drawn
from vgroove.control_bench.jobs import Figures, Job, Variant, run_jobs
from vgroove.eeprom_image import parameter
from vgroove.html_page import Table, table_from_dicts
from vgroove.progress import Tick
from vgroove.rig import Rig

SCHEMA = "vgroove.adapt/1"
BUILT_IN, ADAPTED = "map of the firmware", "map of this tool"
CHECK_SEED = 8101
PARAMETERS = [
    ("parameter", "name"),
    ("unit", "unit"),
    ("reference tool", "reference"),
    ("this tool", "value"),
]
CHECK = [
    ("", "variant"),
    ("drives", "runs"),
    ("reported as reached", "reached"),
    ("mean error", "mean_error"),
    ("std", "std"),
    ("worst", "worst"),
    ("reached, error > 3 %", "beyond_goal"),
    ("misses not reported", "missed_reported_reached"),
]


@dataclass(frozen=True)
class Adaptation:
    """What was computed for a tool. levels: its levels as voltages of the firmware's motor;
    motor_levels: as voltages of its own motor. parameters: physical values; torque_map: members of
    the firmware's TorqueMap; warnings: what the board cannot hold as the tool needs it.
    """

    levels: LevelScale
    motor_levels: LevelScale
    parameters: dict[str, float]
    torque_map: dict[str, Any]
    warnings: tuple[str, ...] = ()

    @property
    def flash_bytes(self) -> bytes:
        """The map as it lies in flash."""
        return flash_bytes(self.torque_map)

    @property
    def sentence(self) -> str:
        """How the tool's levels compare with those of the reference tool."""
        return (
            f"Levels {self.levels.level:.4g} times those of the reference tool (as voltages of its "
            f"own motor {self.motor_levels.level:.4g} times), "
            f"currents {self.levels.current:.4g} times."
        )

    def parameter_rows(self) -> list[Figures]:
        """Name, unit, default and value of each parameter."""
        return [
            {
                "name": parameter(name).name,
                "unit": parameter(name).unit,
                "reference": default_value(name),
                "value": value,
            }
            for name, value in self.parameters.items()
        ]

    def as_dict(self) -> dict[str, Any]:
        """For the JSON."""
        return {
            "schema": SCHEMA,
            "levels": vars(self.levels),
            "motor_levels": vars(self.motor_levels),
            "warnings": list(self.warnings),
            "parameters": self.parameter_rows(),
            "torque_map": {name: values.tolist() for name, values in self.torque_map.items()},
        }


def adapt(rig: Rig, progress: Callable[[float], None] | None = None) -> Adaptation:
    """The setpoints and the torque map of a tool; about a minute on two cores. progress: called
    with the share that is done. VgrooveError for a tool that is no impact driver, or too far off
    the reference tool.
    """
    check_tool(rig)
    levels, motor_levels = level_scale(rig), level_scale(rig, motor_of(rig))
    found, of_map = torque_map(rig, levels.level, progress=progress)
    needed = needed_setpoints(rig, motor_levels)
    warnings = (*of_map, *beyond_range(needed), *beyond_controllers(needed))
    return Adaptation(levels, motor_levels, stored_values(needed), found, warnings)


def check(rig: Rig, found: Adaptation, drives: int, tick: Tick) -> list[Figures]:
    """`drives` tightenings to drawn targets on drawn joints with the map and the parameters of the
    firmware and as many with the tool's own: the figures of torque_drawn.compare.
    """
    cells = drawn({**DRIVE, **torque_drawn.SPANS}, drives, (CHECK_SEED,))
    compared = []
    own = torque_drawn.Adapted(found.flash_bytes, found.parameters)
    for name, adapted in ((BUILT_IN, torque_drawn.NOT_ADAPTED), (ADAPTED, own)):
        jobs = [
            Job(
                torque_drawn.work,
                Variant(name, torque_drawn.CONTROLLER.mode),
                {
                    **cell,
                    "target_nm": float(int(cell["target_nm"])),
                    "tool": {},
                    "seed": CHECK_SEED + number,
                    "base": rig,
                    "adapted": adapted,
                },
            )
            for number, cell in enumerate(cells)
        ]
        rows = run_jobs(jobs, tick, "drives on the plant")
        compared.append({"variant": name, **torque_drawn.compare(rows)})
    return compared


def adapt_tables(found: Adaptation, compared: list[Figures]) -> list[Table]:
    """Parameters and check as tables."""
    tables = [table_from_dicts("parameters", "Parameters", PARAMETERS, found.parameter_rows())]
    if compared:
        tables.append(
            table_from_dicts("check", "Torque control on the plant of this rig", CHECK, compared)
        )
    return tables
