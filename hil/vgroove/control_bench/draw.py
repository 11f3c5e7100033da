"""Drawn cells of the controllers' bench: every value from a continuous range, by Latin hypercube
sampling; the two halves are drawn with different seeds.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum, unique
from typing import Any

import numpy as np
import scipy  # its parts load when they are first used

from vgroove.control_bench.sets import SETS
from vgroove.rig import Rig

SEEDS = {"tune": 7101, "report": 7202}  # of the Latin hypercube of each half
NOMINAL, OFF = "nominal tool", "tool off"
STRATA = (NOMINAL, OFF)
TOOL_SHARE = 0.05  # largest deviation of a value of a tool that is off
TOOL_VALUES = (
    "motor.torque_constant_nm_per_a",
    "motor.resistance_ohm",
    "supply.resistance_ohm",
    "mechanism.spring_rate_n_per_m",
    "mechanism.spring_preload_n",
    "mechanism.hammer_inertia_kg_m2",
)
GROOVE_FRICTION = 0.01  # largest coefficient of a tool that is off; the nominal tool has 0
SUPPLY_V = (16.0, 20.5)
TRIGGER = (0.6, 1.0)
# Angle in rad from the hammer's lug to the anvil's at the start: the whole gap between two lugs.
# The anvil's lugs are alike, thus this is every position that a turn has.
START_RAD = (-2.14, 0.0)
TAIL = 0.05  # the adverse quantile that stands beside each mean


@unique
class DrawnPart(IntEnum):
    """Parts of the bench with drawn values; the number gives each part its own draws."""

    TORQUE = 1
    SYNC = 2
    TORQUE_ADAPTED = 3
    SCREWING = 4
    VIBRATION = 5
    BLOWS = 6


@dataclass(frozen=True)
class Span:
    """A range of a value; drawn uniformly, or uniformly in the logarithm."""

    low: float
    high: float
    logarithmic: bool = False

    def at(self, share: np.ndarray) -> np.ndarray:
        """Values (n,) at shares (n,) of 0..1 of the range."""
        if self.logarithmic:
            return self.low * (self.high / self.low) ** share
        return self.low + (self.high - self.low) * share


# Values that every part draws.
DRIVE = {
    "supply_v": Span(*SUPPLY_V),
    "trigger": Span(*TRIGGER),
    "start_rad": Span(*START_RAD),
}
TOOL = {name: Span(1.0 - TOOL_SHARE, 1.0 + TOOL_SHARE) for name in TOOL_VALUES}
TOOL |= {"groove_friction": Span(0.0, GROOVE_FRICTION)}


def drawn(spans: Mapping[str, Span], count: int, seeds: Sequence[int]) -> list[dict[str, float]]:
    """`count` draws of all values by Latin hypercube sampling (McKay, Beckman and Conover 1979):
    each of `count` equal parts of each range holds one draw.
    """
    sampler = scipy.stats.qmc.LatinHypercube(len(spans), rng=np.random.default_rng(list(seeds)))
    shares = sampler.random(count)
    columns = [span.at(shares[:, n]) for n, span in enumerate(spans.values())]
    return [dict(zip(spans, map(float, row), strict=True)) for row in zip(*columns, strict=True)]


def drawn_cells(part: DrawnPart, spans: Mapping[str, Span], count: int) -> list[dict[str, Any]]:
    """`count` cells for each half and stratum; `tool` holds the shares of TOOL_VALUES, and is empty
    for the nominal tool.
    """
    found = []
    for half in SETS:
        for n, stratum in enumerate(STRATA):
            tool_spans = TOOL if stratum == OFF else {}
            seeds = (SEEDS[half], part, n)
            for k, values in enumerate(drawn({**DRIVE, **spans, **tool_spans}, count, seeds)):
                tool = {name: values.pop(name) for name in tool_spans}
                seed = int(np.random.default_rng([*seeds, k]).integers(1, 2**31))
                cell = {"set": half, "stratum": stratum, **values, "tool": tool, "seed": seed}
                found.append(cell)
    return found


def seeds_line() -> str:
    """The seeds of the halves, as a sentence."""
    seeds = ", ".join(f"{half} {SEEDS[half]}" for half in SETS)
    return f"Latin hypercube sampling, seeds: {seeds}."


def drawn_tool(rig: Rig, cell: Mapping[str, Any]) -> Rig:
    """The rig with the start angle, the supply and the tool's values of a cell."""
    tool = cell["tool"]
    values = {name: rig.value(name) * tool[name] for name in TOOL_VALUES if name in tool}
    values |= {
        "supply.voltage_v": cell["supply_v"],
        "mechanism.hammer_start_rad": cell["start_rad"],
    }
    rig = rig.with_values(values)
    if not tool:
        return rig
    return rig.with_effects({"groove_friction": {"coefficient": tool["groove_friction"]}})


def failure_interval(failures: int, count: int) -> tuple[float, float]:
    """95 % interval of the share of failures (Clopper and Pearson 1934); (0, 1) without runs."""
    if count == 0:
        return 0.0, 1.0
    found = scipy.stats.binomtest(failures, count).proportion_ci(0.95)
    return float(found.low), float(found.high)
