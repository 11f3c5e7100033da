"""Statistics of the impact cycle that the diagnosis of a hammering tool judges, as columns of a
verdict: the blow period, and of each column of a log its level, rise, shape and scatter.
"""

from dataclasses import dataclass

PERIOD = "blow_period_s"
LEVEL, RISE, SHAPE, SCATTER = "level", "rise", "shape", "scatter"


@dataclass(frozen=True)
class ColumnStatistics:
    """Which statistics a column gives: names besides its shape, and the harmonics of its shape."""

    unit: str
    names: tuple[str, ...]
    harmonics: int


# The torque at the anvil is no statistic: rows of 1 kHz hold a blow of 0.3 ms by chance. The angle
# of the anvil adds up the roughness of the joint: its rise, not its level, is one.
STATISTICS = {
    "current_a": ColumnStatistics("A", (LEVEL, RISE, SCATTER), 4),
    "speed_rpm": ColumnStatistics("rpm", (LEVEL, RISE), 3),
    "supply_v": ColumnStatistics("V", (LEVEL, RISE), 2),
    "hammer_mm": ColumnStatistics("mm", (LEVEL,), 3),
    "anvil_angle_rad": ColumnStatistics("rad", (RISE,), 0),
}
HARMONICS = max(one.harmonics for one in STATISTICS.values())
