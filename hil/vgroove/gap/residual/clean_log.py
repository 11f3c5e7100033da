"""A cleaned log with its rig, from which the parts of a measured run are made."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from vgroove.gap.cleaning.clock import correct_time_stamps
from vgroove.gap.cleaning.dead_samples import remove_dead_samples
from vgroove.gap.cleaning.logging_interval import logging_interval_s
from vgroove.gap.cleaning.long_logs import is_thinned, without_thinned
from vgroove.gap.cleaning.lost_rows import insert_lost_rows
from vgroove.gap.cleaning.missing_values import has_values, hold_last_value
from vgroove.gap.cleaning.sensor_noise import SensorNoise, common_noise, noise_of
from vgroove.gap.hall_edges.stamp_check import stamp_contradictions
from vgroove.gap.residual.impact.missing_rows import with_even_rows
from vgroove.gap.residual.restarts import restart_interval_s, usual_restart_s
from vgroove.rig import Rig


@dataclass(frozen=True)
class CleanLog:
    """Times (rows,) in s and columns (rows,), nan where a sample is missing; noise: that of each
    measured column; warnings collects sentences for the user while the log is prepared;
    compares_angle: whether the angle of an encoder itself is compared (angle_comparison.py);
    requested_restart_s: time in s between restarts of the model (None: the usual one).
    """

    log: Any
    rig: Rig
    time_s: np.ndarray
    columns: dict[str, np.ndarray]
    noise: Mapping[str, SensorNoise]
    source: str
    warnings: list[str]
    compares_angle: bool = False
    requested_restart_s: float | None = None

    @property
    def kind(self) -> str:
        """The column that drives the model."""
        return self.rig.input["kind"]

    @property
    def pulses_per_rev(self) -> int:
        """Edges of the Hall wheel a motor turn; 0 without one."""
        return self.rig.sensors.get("hall_pulses_per_rev", 0)

    @property
    def thinned(self) -> np.ndarray:
        """Mask (rows,) of the rows that the model skips (cleaning/long_logs.py)."""
        return is_thinned(self.columns, len(self.time_s))

    @cached_property
    def interval_s(self) -> float:
        """Usual time in s between two observations of the logger where nothing is thinned."""
        return logging_interval_s(without_thinned(self.time_s, self.thinned))

    @property
    def restart_s(self) -> float:
        """Time in s between restarts of the model."""
        drives_speed = self.kind == "current_a" and self.has_values("speed_rpm")
        usual_s = usual_restart_s(drives_speed, float(np.ptp(self.time_s)))
        return restart_interval_s(self.interval_s, self.requested_restart_s or usual_s)

    def has_values(self, column: str) -> bool:
        """Whether a column holds any value."""
        return has_values(self.columns, column)

    def warn(self, sentence: str) -> None:
        """Add a sentence about this log for the user."""
        self.warnings.append(f"{self.source}: {sentence}")

    def warn_of_dead_sensor(self, column: str, measured: np.ndarray) -> None:
        """Warn of a column, whose measured values (n,) are compared, that does not change while the
        command does.
        """
        if np.ptp(measured) == 0.0 and np.ptp(hold_last_value(self.columns[self.kind])) > 0.0:
            self.warnings.append(
                f"the column {column} reads {measured[0]:.4g} throughout: is its sensor connected?"
            )


def clean_log(log: Any, rig: Rig, restart_s: float | None = None) -> CleanLog:
    """A log (time_s, columns, source, warnings) without dead samples, on an even clock, with rows
    where the logger lost some. restart_s: requested time between restarts of the model.
    """
    log = remove_dead_samples(log, rig)
    log = correct_time_stamps(log, stamp_contradictions(log, rig))
    if rig.mechanism["kind"] == "impact":
        log = with_even_rows(log, rig.input["kind"])
    log = insert_lost_rows(log, rig)
    columns = {name: np.asarray(values, dtype=float) for name, values in log.columns.items()}
    time_s = np.asarray(log.time_s, dtype=float)
    noise = noise_of(rig, time_s, columns)
    return CleanLog(
        log,
        rig,
        time_s,
        columns,
        noise,
        log.source,
        list(log.warnings),
        requested_restart_s=restart_s,
    )


def with_common_noise(logs: Sequence[CleanLog]) -> list[CleanLog]:
    """The cleaned logs of one tool, their noise replaced by that of common_noise()."""
    noise = common_noise([log.noise for log in logs])
    return [replace(log, noise=each) for log, each in zip(logs, noise, strict=True)]
