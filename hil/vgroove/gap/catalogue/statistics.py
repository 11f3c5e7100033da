"""Statistics of the impact cycle that the diagnosis of a hammering tool judges, as columns of a
verdict: the blow period, and of each column of a log its level, rise, shape and scatter, and its
means over short spans of the run-up.
"""

from dataclasses import dataclass

PERIOD = "blow_period_s"
LEVEL, RISE, SHAPE, SCATTER = "level", "rise", "shape", "scatter"
RUN_UP = "run_up"


@dataclass(frozen=True)
class ColumnStatistics:
    """Which statistics a column gives: names besides its shape, the harmonics of its shape, and
    whether its means in the run-up are judged.
    """

    unit: str
    names: tuple[str, ...]
    harmonics: int
    run_up: bool = False


# The torque at the anvil is no statistic: rows of 1 kHz hold a blow of 0.3 ms by chance. The angle
# of the anvil adds up the roughness of the joint: its rise, not its level, is one.
STATISTICS = {
    "current_a": ColumnStatistics("A", (LEVEL, RISE, SCATTER), 4, True),
    "speed_rpm": ColumnStatistics("rpm", (LEVEL, RISE), 3, True),
    "supply_v": ColumnStatistics("V", (LEVEL, RISE), 2, True),
    "hammer_mm": ColumnStatistics("mm", (LEVEL,), 3),
    "anvil_angle_rad": ColumnStatistics("rad", (RISE,), 0),
}
HARMONICS = max(one.harmonics for one in STATISTICS.values())
