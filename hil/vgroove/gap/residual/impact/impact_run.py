"""Prepares one log of a hammering tool: the plant's input, the windows of its impact cycles, and
their measured statistics with standard deviations.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vgroove import _core
from vgroove.errors import VgrooveError
from vgroove.gap.catalogue.statistics import STATISTICS
from vgroove.gap.cleaning.missing_values import (
    has_values,
    hold_last_value,
    interpolate_missing,
)
from vgroove.gap.cleaning.sensor_noise import column_sigma, high_frequency_sigma
from vgroove.gap.hall_edges.edge_periods import MIN_COUNTING_PULSES
from vgroove.gap.residual.blocks import FoldBlocks, cut_blocks
from vgroove.gap.residual.clean_log import CleanLog, clean_log
from vgroove.gap.residual.immutable import freeze_arrays
from vgroove.gap.residual.impact.cycle_statistics import (
    REFERENCES,
    CycleReader,
    is_periodic,
    statistic_parts,
)
from vgroove.gap.residual.impact.cycle_windows import RULES, CycleWindows, cut_windows
from vgroove.gap.residual.inputs import read_input
from vgroove.rig import Rig

PLACES = ("first third of the run", "second third of the run", "last third of the run")
SENSED = ("current_a", "speed_rpm", "supply_v")
MIN_SIGMA = 1e-9  # of a column without noise


@dataclass(frozen=True)
class ImpactRun:
    """One log prepared for the comparison of cycle statistics; immutable.

    log: cleaned; drive: the plant's input; reader: of the statistics; measured, sigma (W, K): the
    log's statistics and their standard deviations, without the scatter of start angles; pulses:
    edges a turn of a Hall sensor (0: the speed is not made from edges); timeout_s: after which it
    reads 0.
    """

    log: Any
    drive: _core.LogInput
    reader: CycleReader
    measured: np.ndarray
    sigma: np.ndarray
    blocks: FoldBlocks
    pulses: int
    timeout_s: float
    warnings: tuple[str, ...]
    edge_scale: float = 1.0  # of the edge speeds against the time stamps; not estimated here

    def __post_init__(self) -> None:
        freeze_arrays(self)

    @property
    def windows(self) -> CycleWindows:
        """The windows of the log."""
        return self.reader.windows

    def flat(self, statistics: np.ndarray) -> np.ndarray:
        """Statistics (..., W, K) as residuals are ordered (..., n), part by part; without those of
        a cycle in windows that have none.
        """
        kept = np.isfinite(self.sigma).T
        return np.swapaxes(statistics, -1, -2)[..., kept]


def prepare_impact_run(log: Any, rig: Rig) -> ImpactRun:
    """Run of a log of an impact tool; VgrooveError where nothing can be judged."""
    clean = clean_log(log, rig)
    drive = read_input(clean).columns
    values = judged_columns(clean)
    if not {"current_a", "speed_rpm"} & set(values):
        raise VgrooveError(
            f"{clean.source}: nothing to judge: the log of an impact tool needs a column "
            "current_a or speed_rpm"
        )
    noise = {name: column_noise(clean, name, values[name]) for name in values}
    windows = windows_of(clean, drive.command, values, noise)
    reader = reader_of(windows, values, noise)
    fit = reader.fit({name: column[None] for name, column in values.items()})
    measured, variance = reader.statistics(fit, False)[0], reader.variances(fit)
    pulses = rig.sensors.get("hall_pulses_per_rev", 0)
    return ImpactRun(
        clean.log,
        drive.plant(),
        reader,
        measured,
        np.sqrt(variance),
        cut_blocks(clean.time_s, np.inf),
        pulses if 0 < pulses < MIN_COUNTING_PULSES else 0,
        rig.sensors.get("hall_timeout_s", np.inf),
        tuple(clean.warnings),
    )


def judged_columns(log: CleanLog) -> dict[str, np.ndarray]:
    """Columns (rows,) of which statistics are judged, missing samples interpolated."""
    bus = log.rig.bus_is_measured
    names = [n for n in STATISTICS if has_values(log.columns, n) and not (bus and n == "supply_v")]
    return {name: interpolate_missing(log.time_s, log.columns[name]) for name in names}


def column_noise(log: CleanLog, name: str, values: np.ndarray) -> float:
    """Standard deviation of a column's noise, in its unit."""
    if name in SENSED:
        return max(column_sigma(log.rig, name, log.columns[name]), MIN_SIGMA)
    return max(high_frequency_sigma(values), MIN_SIGMA)


def windows_of(
    log: CleanLog, command: np.ndarray, values: dict[str, np.ndarray], noise: dict[str, float]
) -> CycleWindows:
    """Windows over the rows from the first to the last command; VgrooveError for a log that is too
    short.
    """
    found = [n for n in REFERENCES if n in values]
    signals = np.stack([values[n] for n in found])
    weight = np.array([1.0 / noise[n] ** 2 for n in found])
    row_s = float(np.median(np.diff(log.time_s)))
    driven = command != 0.0
    if "coast" in log.columns:
        driven &= hold_last_value(log.columns["coast"]) == 0.0
    windows = cut_windows(signals, weight, row_s, driven)
    if windows is None:
        raise VgrooveError(
            f"{log.source}: too short to judge: a log of an impact tool needs at least "
            f"{RULES.min_windows} windows of {RULES.cycles:g} blows under command"
        )
    return windows


def reader_of(
    windows: CycleWindows, values: dict[str, np.ndarray], noise: dict[str, float]
) -> CycleReader:
    """The reader whose phase comes from the column with the clearest fundamental."""
    names = tuple(values)
    trial = CycleReader(windows, noise, names[0], ())
    fit = trial.fit({name: column[None] for name, column in values.items()})
    clear = {
        name: float(np.median(np.abs(fit.amplitude[names.index(name), :, 0]) / noise_left))
        for name in REFERENCES
        if name in names and (noise_left := float(np.median(fit.scatter[names.index(name)]))) > 0.0
    }
    reference = max(clear, key=lambda n: clear[n])
    windows = replace(windows, periodic=is_periodic(fit, names.index(reference), windows))
    return CycleReader(windows, noise, reference, statistic_parts(names, reference))
