"""The motor level of torque control (firmware/controllers/torque.c) on the plant of a tool: the
voltage of a motor at its speed and current, held against supply and losses.

The tool is controlled as by the firmware: sensors with the resolution of the board, a command that
acts one tick later, and the filters of torque.c.
"""

from dataclasses import dataclass

import numpy as np

from vgroove import _core
from vgroove.reference.joints import REFERENCE_JOINTS
from vgroove.reference.rigs import reference_rig, with_load
from vgroove.rig import Rig
from vgroove.units import TURN_RAD

TICK_S = 1e-3
SUPPLY_LSB_V = 0.025  # resolution of the supply in the firmware
LEAD_ABOVE_V = 11.0  # the lag of the filters is compensated, as in torque.c
SUPPLY_V = 18.5


@dataclass
class Tool:
    """Plant and sensors of the board at 1 kHz: pitch of the Hall edges, state at the last tick,
    time and period of the last edge, measured values, bridge voltage of the last tick.
    """

    plant: _core.ImpactPlant
    pitch_rad: float
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


def motor_of(rig: Rig) -> tuple[float, float]:
    """Torque constant in N m/A and winding resistance in ohm. torque.c computes with those of the
    reference tool.
    """
    return rig.motor["torque_constant_nm_per_a"], rig.motor["resistance_ohm"]


@dataclass
class Level:
    """The filters and the voltage level of torque.c. motor: torque constant in N m/A and resistance
    in ohm of which the level is the voltage. excess_v and taken_v: voltage beyond that of this
    motor (back-EMF plus winding drop), low-pass filtered once and twice; quick_a, current_a,
    slow_a: current, filtered once, twice and three times.
    """

    goal_v: float
    motor: tuple[float, float]
    running: bool = True  # on the run-up
    level_v: float = 0.0
    taken_v: float = -0.25
    excess_v: float = -0.25
    quick_a: float = 0.0
    current_a: float = 0.0
    slow_a: float = 0.0
    ticks: int = 0

    def tick(self, tool: Tool) -> None:
        """One tick: filter the measurements, move the level, command the duty."""
        k, resistance = self.motor
        self.ticks += 1
        self.quick_a += (tool.current_a - self.quick_a) / 32
        self.current_a += (self.quick_a - self.current_a) / 32
        self.slow_a += (self.current_a - self.slow_a) / 64
        motor_v = k * tool.speed_rad_s + resistance * tool.current_a
        self.excess_v += (tool.given_v - motor_v - self.excess_v) / 64
        if self.ticks > 100:
            self.taken_v += (self.excess_v - self.taken_v) / 128
        rate = 0.03 if self.running else 0.008
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
    """One joint, from rest to blows on the level of the run-up: until the filtered current reaches
    9 A, for at most 1.5 s. slope: of the joint, N m/rad; tool: supply in V and winding resistance
    over the rig's; motor: of the level, by default that of the firmware.
    """

    def __init__(
        self,
        rig: Rig,
        slope: float,
        run_v: float,
        tool: tuple[float, float] = (SUPPLY_V, 1.0),
        motor: tuple[float, float] | None = None,
    ) -> None:
        supply_v, resistance = tool
        values = {
            "supply.voltage_v": supply_v,
            "motor.resistance_ohm": rig.motor["resistance_ohm"] * resistance,
        }
        self.load = {**REFERENCE_JOINTS["hard_joint"].load, "slip_slope_nm_per_rad": slope}
        here = with_load(rig, self.load, values)
        plant = _core.ImpactPlant(here.parameters(), "hard_joint")
        pitch_rad = TURN_RAD / rig.sensors["hall_pulses_per_rev"]
        self.tool = Tool(plant, pitch_rad, supply_v=supply_v)
        self.level, self.slope = Level(run_v, motor or motor_of(reference_rig())), slope
        while self.level.ticks < 100 or (self.level.current_a < 9.0 and self.level.ticks < 1500):
            self.level.tick(self.tool)

    @property
    def torque_nm(self) -> float:
        """Slip torque of the joint."""
        return self.load["run_torque_nm"] + self.slope * self.tool.plant.head_rad

    def go(self, level_v: float, seconds: float) -> None:
        """Move to a level and remain on it for `seconds`."""
        self.level.goal_v, self.level.running = level_v, False
        while not self.level.arrived:
            self.level.tick(self.tool)
        for _ in range(round(seconds * 1000)):
            self.level.tick(self.tool)
