"""Makes firmware/controllers/torque_map.c with the plant: the voltage level and the motor current
that belong to each torque (docs/controllers/torque.md).

`python -m vgroove.study.torque_map firmware/controllers/torque_map.c`

The slopes of the fit differ from those on which the controller is evaluated. The tool is controlled
as by the firmware: sensors with the resolution of the board, a command that acts one tick later,
and the filters of torque.c.
"""

import itertools
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vgroove import _core
from vgroove.reference.joints import REFERENCE_JOINTS
from vgroove.reference.rigs import reference_rig, with_load
from vgroove.rig import Rig

FIRST_NM, LAST_NM = 40, 120  # rows of the map, 1 N m each
TICK_S = 1e-3
SUPPLY_LSB_V = 0.025  # resolution of the supply in the firmware
RUN_V = 5.5  # level of the run-up
LEVEL_STEP_V = 0.04
# Seconds after the level is reached at which the current is measured, and seconds from then on
# until the slip torque is settled. Below SLOW_BELOW_V the current is measured as soon as the
# filters have settled: it depends little on the torque above about 55 N m, and later soft joints
# have gained so much torque that their current is that of hard ones.
MEASURE_S, SETTLE_S = 1.2, 2.8
SLOW_BELOW_V, SLOW_MEASURE_S, SLOW_SETTLE_S = 7.0, 0.6, 4.4
MEAN_TICKS = 100  # the measured current is a mean over several blows
# Smaller targets are below the slip torque that the weakest blows over the lugs lead to: they have
# a raised level only.
LEAST_HELD_NM = 58
# In the C table in place of a current: none is valid, since the target is below LEAST_HELD_NM.
NEVER = 255
# N m/rad, of the slip torque that a level leads to
HARD_SLOPES = (130.0, 200.0, 330.0, 500.0, 800.0)
# (supply in V, winding resistance over its nominal value) of the tools of the hard and soft joints
HELD_TOOLS = ((18.5, 1.0), (16.9, 1.08), (20.1, 0.92))
RAISED_TOOLS = ((18.5, 1.0), (17.0, 1.07), (20.0, 0.93))
# N m/rad; softer joints get the raised level. Where lugs have begun to be hit once a joint gains
# little in the settling time and much on the raised level.
SLOW_DIVIDING_SLOPE, DIVIDING_SLOPE, ONCE_DIVIDING_SLOPE = 88.0, 100.0, 75.0
ONCE_V = (9.56, 10.3)
# Levels between which the number of hits of a lug changes (from three to two, from two to one),
# back and forth: the current does not determine the torque. No row gets such a level.
CHANGING_V = ((6.74, 7.06), (9.18, 9.54))
# The dividing current is at least this far below the least current of a hard joint, since irregular
# blows scatter it.
DIVIDING_MARGIN_A = 0.1
SOFT_SLOPES = (50.0, 58.0, 68.0, 80.0, 94.0, 110.0, 130.0)
# (raised level in V, first and last row in N m): levels at which the current determines the torque
# and a single blow adds little
RAISED_V = ((5.6, 40, 57), (8.6, 58, 81), (10.0, 82, 93), (12.7, 94, 105), (13.6, 106, 120))
# Seconds on the raised level until its current is valid, as in torque.c; the points of the fit
# begin then. Without them the transient of the filters is part of the fit.
RAISED_VALID_S, LEAD_VALID_S = 0.3, 0.15
# Added to the stop currents of the lowest level, since noise makes the filtered current pass a
# limit early
EARLY_A = 0.03


LEAD_ABOVE_V = 11.0  # the lag of the filters is compensated, as in torque.c


@dataclass
class Tool:
    """Plant and sensors of the board at 1 kHz: pitch of the Hall edges, state at the last tick,
    time and period of the last edge, measured values, bridge voltage of the last tick.
    """

    plant: _core.ImpactPlant
    pitch_rad: float = np.pi / 2  # four edges a turn
    phase_rad: float = 0.3
    time_s: float = 0.0
    angle_rad: float = 0.0
    rate_rad_s: float = 0.0
    edge_s: float = -1.0
    period_s: float = 0.0
    speed_rad_s: float = 0.0
    current_a: float = 0.0
    supply_v: float = 18.5
    given_v: float = 0.0
    duty: float = 0.0

    def tick(self, duty: float) -> None:
        """Advance a tick with the last duty; the new duty acts in the next tick."""
        row = self.plant.advance(TICK_S, self.duty)
        self.time_s += TICK_S
        self._edges(row.angle_rad, row.speed_rad_s)
        self.current_a = row.current_a
        self.supply_v = round(row.supply_v / SUPPLY_LSB_V) * SUPPLY_LSB_V
        self.given_v, self.duty = self.duty * self.supply_v, duty

    def _edges(self, angle_rad: float, rate_rad_s: float) -> None:
        first = int(np.floor((self.angle_rad + self.phase_rad) / self.pitch_rad)) + 1
        last = int(np.floor((angle_rad + self.phase_rad) / self.pitch_rad))
        for edge in range(first, last + 1):
            at = self.time_s - TICK_S * (
                1.0 - self._share(edge * self.pitch_rad - self.phase_rad, angle_rad, rate_rad_s)
            )
            self.period_s, self.edge_s = at - self.edge_s, at
        self.angle_rad, self.rate_rad_s = angle_rad, rate_rad_s
        if self.period_s > 0:
            pitch = self.pitch_rad / max(self.period_s, self.time_s - self.edge_s)
            self.speed_rad_s = pitch if last >= first else min(self.speed_rad_s, pitch)

    def _share(self, target: float, angle_rad: float, rate_rad_s: float) -> float:
        """Part of the tick at which the angle, a cubic by angles and speeds, passes the target."""
        low, high = 0.0, 1.0
        for _ in range(12):
            h = 0.5 * (low + high)
            value = self.angle_rad * (2 * h**3 - 3 * h * h + 1) + angle_rad * (3 * h * h - 2 * h**3)
            value += TICK_S * (
                self.rate_rad_s * (h**3 - 2 * h * h + h) + rate_rad_s * (h**3 - h * h)
            )
            low, high = (h, high) if value < target else (low, h)
        return low


@dataclass
class Level:
    """The filters and the voltage level of torque.c for the nominal motor of `rig`. excess_v and
    taken_v: voltage beyond that of the nominal motor (back-EMF plus winding drop), low-pass
    filtered once and twice; quick_a, current_a, slow_a: current, filtered once, twice and three
    times.
    """

    rig: Rig
    goal_v: float = RUN_V
    level_v: float = 0.0
    taken_v: float = -0.25
    excess_v: float = -0.25
    quick_a: float = 0.0
    current_a: float = 0.0
    slow_a: float = 0.0
    ticks: int = 0

    def tick(self, tool: Tool) -> None:
        """One tick: filter the measurements, move the level, command the duty."""
        k, resistance = (
            self.rig.motor[key] for key in ("torque_constant_nm_per_a", "resistance_ohm")
        )
        self.ticks += 1
        self.quick_a += (tool.current_a - self.quick_a) / 32
        self.current_a += (self.quick_a - self.current_a) / 32
        self.slow_a += (self.current_a - self.slow_a) / 64
        motor_v = k * tool.speed_rad_s + resistance * tool.current_a
        self.excess_v += (tool.given_v - motor_v - self.excess_v) / 64
        if self.ticks > 100:
            self.taken_v += (self.excess_v - self.taken_v) / 128
        rate = 0.03 if self.goal_v == RUN_V else 0.008
        self.level_v = self.goal_v if self.level_v >= self.goal_v - rate else self.level_v + rate
        tool.tick(min(max((self.level_v + self.taken_v) / tool.supply_v, 0.0), 1.0))

    @property
    def arrived(self) -> bool:
        """Whether the level has reached its goal."""
        return self.level_v == self.goal_v

    def map_current_a(self, raised_v: float) -> float:
        """The filtered current over which the map is made, as in torque.c."""
        if raised_v < LEAD_ABOVE_V:
            return self.current_a if 8.0 < raised_v < 9.2 else self.slow_a
        return self.current_a + 0.75 * (self.current_a - self.slow_a)


class Run:
    """One joint, from rest to blows on the level RUN_V: until the filtered current reaches 9 A, for
    at most 1.5 s.
    """

    def __init__(
        self, rig: Rig, slope: float, supply_v: float = 18.5, resistance: float = 1.0
    ) -> None:
        values = {
            "supply.voltage_v": supply_v,
            "motor.resistance_ohm": rig.motor["resistance_ohm"] * resistance,
        }
        self.load = {**REFERENCE_JOINTS["hard_joint"].load, "slip_slope_nm_per_rad": slope}
        here = with_load(rig, self.load, values)
        self.tool = Tool(_core.ImpactPlant(here.parameters(), "hard_joint"), supply_v=supply_v)
        self.level, self.slope = Level(rig), slope
        while self.level.ticks < 100 or (self.level.current_a < 9.0 and self.level.ticks < 1500):
            self.level.tick(self.tool)

    @property
    def torque_nm(self) -> float:
        """Slip torque of the joint."""
        return self.load["run_torque_nm"] + self.slope * self.tool.plant.head_rad

    def go(self, level_v: float, seconds: float) -> None:
        """Move to a level and remain on it for `seconds`."""
        self.level.goal_v = level_v
        while not self.level.arrived:
            self.level.tick(self.tool)
        for _ in range(round(seconds * 1000)):
            self.level.tick(self.tool)


def measured_a(run: Run, level_v: float) -> float:
    """The slow current on a level at the time of the controller's decision, a mean over
    MEAN_TICKS.
    """
    run.go(level_v, (SLOW_MEASURE_S if level_v < SLOW_BELOW_V else MEASURE_S) - 0.05)
    current = 0.0
    for _ in range(MEAN_TICKS):
        run.level.tick(run.tool)
        current += run.level.slow_a / MEAN_TICKS
    return current


def held(rig: Rig, levels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For each level (n,): the settled torques of hard joints (n, joints), and the current that
    divides hard from soft joints (n,).
    """
    torque, current = (
        np.zeros((len(levels), len(HARD_SLOPES) * len(HELD_TOOLS))),
        np.zeros(len(levels)),
    )
    for n, level in enumerate(levels):
        hard_a = []
        for m, (slope, tool) in enumerate(itertools.product(HARD_SLOPES, HELD_TOOLS)):
            run = Run(rig, slope, *tool)
            hard_a.append(measured_a(run, level))
            run.go(level, (SLOW_SETTLE_S if level < SLOW_BELOW_V else SETTLE_S) - 0.05)
            torque[n, m] = run.torque_nm
        soft_a = measured_a(Run(rig, dividing_slope(level)), level)
        current[n] = min(soft_a, min(hard_a) - DIVIDING_MARGIN_A)
    return torque, current


def dividing_slope(level_v: float) -> float:
    """Slope in N m/rad between the joints that settle on a level and those that are raised."""
    if level_v < SLOW_BELOW_V:
        return SLOW_DIVIDING_SLOPE
    return ONCE_DIVIDING_SLOPE if ONCE_V[0] <= level_v < ONCE_V[1] else DIVIDING_SLOPE


def choose_levels(torque: np.ndarray) -> np.ndarray:
    """Index (targets,) of the level for each torque from LEAST_HELD_NM on: the level whose largest
    error over all joints (levels, joints) is least, the neighbouring levels weighted by half.
    """
    targets = np.arange(LEAST_HELD_NM, LAST_NM + 1)
    wrong = np.abs(torque[None] - targets[:, None, None]).max(axis=2)
    wide = np.pad(wrong, ((0, 0), (1, 1)), mode="edge")
    return np.argmin(wrong + 0.5 * (wide[:, 2:] + wide[:, :-2]), axis=1)


def raised(rig: Rig, level_v: float, first_nm: int, last_nm: int, before_v: float) -> np.ndarray:
    """Current in A on a raised level at each torque first_nm..last_nm: a cubic through the points
    of all soft joints, each joint with the same weight.
    """
    points = []
    for slope, tool in itertools.product(SOFT_SLOPES, RAISED_TOOLS):
        run = Run(rig, slope, *tool)
        if before_v > RUN_V:
            run.go(before_v, MEASURE_S)
        run.go(level_v, RAISED_VALID_S if level_v < LEAD_ABOVE_V else LEAD_VALID_S)
        one = raised_points(run, level_v, first_nm, last_nm)
        if len(one) > 40:
            thinned = np.array(one)[:: max(len(one) // 200, 1)]
            points.append(np.column_stack([thinned, np.full(len(thinned), len(thinned) ** -0.5)]))
    t, current, weight = np.concatenate(points).T
    fit = np.polynomial.Polynomial.fit(t, current, 3, w=weight)
    early_a = EARLY_A if level_v < RUN_V + 0.5 else 0.0
    return np.maximum.accumulate(fit(np.arange(first_nm, last_nm + 1))) + early_a


def raised_points(
    run: Run, level_v: float, first_nm: int, last_nm: int
) -> list[tuple[float, float]]:
    """(torque in N m, current in A) of each tick while the torque passes first_nm..last_nm, with 3
    and 4 N m more at the ends, for at most 9 s from rest.
    """
    points = []
    while run.torque_nm < last_nm + 4 and run.tool.time_s < 9.0:
        run.level.tick(run.tool)
        if run.torque_nm > first_nm - 3:
            points.append((run.torque_nm, run.level.map_current_a(level_v)))
    return points


def tables(rig: Rig) -> dict[str, np.ndarray]:
    """Columns level, settled, raised, stop (rows,), in V and A; NaN where a row has no level."""
    targets = np.arange(FIRST_NM, LAST_NM + 1)
    levels = np.round(np.arange(5.4, 11.84, LEVEL_STEP_V) / LEVEL_STEP_V) * LEVEL_STEP_V
    levels = levels[[not any(low < v < high for low, high in CHANGING_V) for v in levels]]
    torque, dividing = held(rig, levels)
    chosen = choose_levels(torque)
    low = np.full(LEAST_HELD_NM - FIRST_NM, np.nan)
    result = {
        "level": np.concatenate([low, levels[chosen]]),
        "settled": np.concatenate([low, dividing[chosen]]),
    }
    result["raised"], result["stop"] = np.zeros(len(targets)), np.zeros(len(targets))
    for level_v, first_nm, last_nm in RAISED_V:
        rows = slice(first_nm - FIRST_NM, last_nm + 1 - FIRST_NM)
        before_v = np.nan_to_num(result["level"][rows]).mean()
        result["raised"][rows] = level_v
        result["stop"][rows] = raised(rig, level_v, first_nm, last_nm, before_v)
    return result


def _bytes(name: str, values: np.ndarray, kind: str) -> str:
    cells = ["NEVER" if v == NEVER else str(int(v)) for v in values]
    lines = [", ".join(cells[n : n + 12]) for n in range(0, len(cells), 12)]
    return (
        f"static const {kind} {name}[TORQUE_MAP_ROWS] FLASH_TABLE = {{\n    "
        + ",\n    ".join(lines)
        + "};\n"
    )


def source(table: dict[str, np.ndarray]) -> str:
    """The text of the C file."""
    level = np.round((np.nan_to_num(table["level"], nan=5.0) - 5.0) / LEVEL_STEP_V)
    settled = np.round(np.nan_to_num((table["settled"] - 12.0) * 16, nan=NEVER))
    lifted = np.round((table["raised"] - 5.0) / LEVEL_STEP_V)
    stop = np.round(table["stop"] * 256)
    return TEMPLATE.format(
        level=_bytes("level_40mv", level, "uint8_t"),
        settled=_bytes("settled_a_q4", settled, "uint8_t"),
        raised=_bytes("raised_40mv", lifted, "uint8_t"),
        stop=_bytes("stop_a_q8", stop, "int16_t"),
    )


TEMPLATE = """\
// Tables of torque_map.h; generated by hil/vgroove/study/torque_map.py: edit that, not this.
#include "controllers/torque_map.h"

#include "core/flash.h"

#define LEAST_MV 5000
#define STEP_MV 40
#define LEAST_A_Q8 (12 * 256)
#define NEVER 255u  // no current: the target is too low for a joint to settle at its level

// clang-format off
{level}
// Current above LEAST_A_Q8 in 1/16 A.
{settled}
{raised}
{stop}// clang-format on

int16_t torque_map_level_mv(uint8_t row) {{
    return (int16_t)(LEAST_MV + FLASH_U8(&level_40mv[row]) * STEP_MV);
}}

int16_t torque_map_settled_a_q8(uint8_t row) {{
    const uint8_t settled = FLASH_U8(&settled_a_q4[row]);
    return settled == NEVER ? TORQUE_MAP_NEVER : (int16_t)(LEAST_A_Q8 + settled * 16);
}}

int16_t torque_map_raised_mv(uint8_t row) {{
    return (int16_t)(LEAST_MV + FLASH_U8(&raised_40mv[row]) * STEP_MV);
}}

int16_t torque_map_stop_a_q8(uint8_t row) {{
    return FLASH_I16(&stop_a_q8[row]);
}}
"""


def main() -> None:
    """Write the file named on the command line."""
    Path(sys.argv[1]).write_text(source(tables(reference_rig())), encoding="utf-8")


if __name__ == "__main__":
    main()
