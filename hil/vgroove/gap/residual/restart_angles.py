"""The motor's angle at every restart of every log: the one part of the measured states that the
search for effects estimates.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class RestartAngles:
    """Motor angle in rad at each restart: one array (S,) per log, in the order of the logs."""

    by_log: tuple[np.ndarray, ...]

    def __post_init__(self) -> None:
        for angle in self.by_log:
            angle.setflags(write=False)

    def shifted(
        self, stretch_of_restart: tuple[np.ndarray, ...], shift_rad: np.ndarray
    ) -> "RestartAngles":
        """The angles with shift_rad (stretches,) added to each stretch of restarts;
        stretch_of_restart holds the number of the stretch of each restart (S,), per log.
        """
        return RestartAngles(
            tuple(
                angle + shift_rad[stretch]
                for angle, stretch in zip(self.by_log, stretch_of_restart, strict=True)
            )
        )

    def equals(self, other: "RestartAngles") -> bool:
        """Whether both hold the same angles, bit for bit."""
        pairs = zip(self.by_log, other.by_log, strict=True)
        return all(np.array_equal(mine, its) for mine, its in pairs)
