"""Errors of the current and speed sensors of a batch of parameter sets: what lies between true and
measured states.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

FILTER, DELAY, MEAN = range(3)  # index of the word in the catalogue's form of speed_lag
SENSOR_EFFECTS = (
    "current_gain.relative",
    "speed_gain.relative",
    "current_offset.offset_a",
    "current_lag.time_constant_s",
    "speed_lag.time_constant_s",
)


@dataclass(frozen=True)
class SensorErrors:
    """Sensor errors of parameter sets (B,); two columns are current and speed."""

    gain: np.ndarray  # (B, 2)
    offset: np.ndarray  # (B, 2), A and rad/s
    lag_s: np.ndarray  # (B, 2) time constants of first-order filters y' = (x - y) / lag
    form: np.ndarray  # (B,) of the speed sensor's lag: FILTER, DELAY or MEAN
    clock: np.ndarray  # (B,) seconds of the logger in a second of the tool
    limit_a: np.ndarray | float = np.inf  # (B,) current at which the sensor clips

    @staticmethod
    def of(theta: np.ndarray, index: Callable[[str], int]) -> "SensorErrors":
        """Sensor errors of parameter vectors (B, P); index gives the column of a parameter."""
        at = {name: theta[:, index(f"effects.{name}")] for name in SENSOR_EFFECTS}
        gains = [1.0 + at["current_gain.relative"], 1.0 + at["speed_gain.relative"]]
        offsets = [at["current_offset.offset_a"], np.zeros(len(theta))]
        lags = [at["current_lag.time_constant_s"], at["speed_lag.time_constant_s"]]
        command_clock = theta[:, index("effects.clock_skew.command_clock")] != 0.0
        skew = theta[:, index("effects.clock_skew.relative")]
        return SensorErrors(
            np.stack(gains, axis=1),
            np.stack(offsets, axis=1),
            np.stack(lags, axis=1),
            theta[:, index("effects.speed_lag.lag_form")].astype(int),
            1.0 + np.where(command_clock, 0.0, skew),
            theta[:, index("effects.current_saturation.limit_a")],
        )
