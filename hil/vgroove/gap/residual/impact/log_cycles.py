"""The cycles of a hammering log: its judged columns and their noise, its windows, and the reader
of their statistics.
"""

from dataclasses import replace

import numpy as np

from vgroove.errors import VgrooveError
from vgroove.gap.catalogue.statistics import STATISTICS
from vgroove.gap.cleaning.missing_values import (
    has_values,
    hold_last_value,
    interpolate_missing,
)
from vgroove.gap.cleaning.sensor_noise import NOISE_KEYS, high_frequency_sigma
from vgroove.gap.residual.clean_log import CleanLog
from vgroove.gap.residual.impact.cycle_statistics import (
    NOISE_LEFT,
    REFERENCES,
    CycleReader,
    is_periodic,
    median_of_known,
    statistic_parts,
)
from vgroove.gap.residual.impact.cycle_windows import RULES, CycleWindows, cut_windows
from vgroove.gap.residual.impact.missing_rows import incomplete_windows
from vgroove.rig import Rig

SENSED = ("current_a", "speed_rpm", "supply_v")
MIN_SIGMA = 1e-9  # of a column without noise


def read_cycles(clean: CleanLog, command: np.ndarray) -> tuple[dict[str, np.ndarray], CycleReader]:
    """The judged columns (rows,) of a log by name, with missing samples interpolated, and what
    computes the statistics of their cycles. command: (rows,). VgrooveError where no column can be
    judged.
    """
    values = judged_columns(clean)
    if not {"current_a", "speed_rpm"} & set(values):
        raise VgrooveError(
            f"{clean.source}: nothing to judge: the log of an impact tool needs a column "
            "current_a or speed_rpm"
        )
    noise = {name: column_noise(clean, name, values[name]) for name in values}
    windows = windows_of(clean, command, values, noise)
    incomplete = np.stack([incomplete_windows(windows, clean.columns[name]) for name in values])
    return values, reader_of(clean, windows, values, noise, incomplete)


def judged_columns(log: CleanLog) -> dict[str, np.ndarray]:
    """Columns (rows,) of which statistics are judged, missing samples interpolated."""
    bus = log.rig.bus_is_measured
    names = [n for n in STATISTICS if has_values(log.columns, n) and not (bus and n == "supply_v")]
    return {name: interpolate_missing(log.time_s, log.columns[name]) for name in names}


def column_noise(log: CleanLog, name: str, values: np.ndarray) -> float:
    """Standard deviation of a column's noise, in its unit."""
    if name in SENSED:
        return log.noise[name].sigma
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
            f"{log.source}: too short to judge: {np.count_nonzero(driven)} rows under command, one "
            f"every {1e3 * row_s:.3g} ms. A log of an impact tool needs at least "
            f"{RULES.min_windows} windows, each of {RULES.cycles:g} blows and {RULES.min_rows} rows"
        )
    return windows


def reader_of(
    log: CleanLog,
    windows: CycleWindows,
    values: dict[str, np.ndarray],
    noise: dict[str, float],
    incomplete: np.ndarray,
) -> CycleReader:
    """What computes the statistics of windows. Their phase is that of the fundamental of one
    column, the one in which it is largest against the rest; incomplete (S, W): windows of each
    column that lack samples.
    """
    names = tuple(values)
    trial = CycleReader(windows, noise, names[0], (), incomplete)
    fit = trial.fit({name: column[None] for name, column in values.items()})
    scatter = np.where(incomplete, np.nan, fit.scatter)
    size = np.where(incomplete, np.nan, np.abs(fit.amplitude[:, :, 0]))
    left, clearest = median_of_known(scatter.T), median_of_known(size.T)
    clear = {
        name: float(clearest[k] / left[k])
        for k, name in enumerate(names)
        if name in REFERENCES and left[k] > 0.0
    }
    if not clear:
        raise VgrooveError(
            f"{log.source}: nothing to judge: no value changes, or too many samples are missing, "
            f"in {', '.join(n for n in REFERENCES if n in names)}"
        )
    reference = max(clear, key=lambda n: clear[n])
    found = {name: is_periodic(fit, names.index(name), windows) for name in clear}
    other = np.logical_or.reduce([found[name] for name in clear])
    periodic = np.where(incomplete[names.index(reference)], other, found[reference])
    windows = replace(windows, periodic=periodic)
    noise = noise_of_cycles(log.rig, noise, names, scatter[:, windows.periodic])
    return CycleReader(windows, noise, reference, statistic_parts(names, reference), incomplete)


def noise_of_cycles(
    rig: Rig, noise: dict[str, float], names: tuple[str, ...], scatter: np.ndarray
) -> dict[str, float]:
    """Standard deviation of the noise of each column. One that the rig does not state was estimated
    from the high frequencies of the log, which the impact cycle has as well; it is therefore
    limited to the scatter (S, W) that the harmonic fit leaves, nan where it is not known.
    """
    stated = {name for name in names if NOISE_KEYS.get(name) in rig.sensors}
    found = dict(noise)
    for name, left in zip(names, scatter, strict=True):
        if name not in stated and np.isfinite(left).any():
            found[name] = max(MIN_SIGMA, min(noise[name], float(np.nanmedian(left)) / NOISE_LEFT))
    return found
