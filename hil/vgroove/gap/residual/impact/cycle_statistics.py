"""Statistics of the impact cycle in each window of a log, and their standard deviations: period,
and of each judged column its level, rise, shape (harmonics at the phase of a reference signal) and
scatter.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vgroove.gap.catalogue.statistics import (
    HARMONICS,
    LEVEL,
    PERIOD,
    RISE,
    SCATTER,
    SHAPE,
    STATISTICS,
)
from vgroove.gap.cleaning.sensor_noise import MAD_TO_SIGMA
from vgroove.gap.residual.impact.cycle_windows import CycleWindows
from vgroove.gap.residual.impact.harmonics import (
    HarmonicFit,
    fit_harmonics,
    fundamental_hz,
    phase_at_centre,
    straight_line,
)
from vgroove.units import TURN_RAD

REFERENCES = ("current_a", "speed_rpm", "hammer_mm")  # columns whose fundamental may give the phase
NOISE_LEFT = 0.88  # RMS of unit white noise after interpolated(), over all places between rows
SAMPLED = ("hammer_mm", "anvil_angle_rad")  # columns that are no means over the row
MIN_CYCLES = 2.5  # of a window, which is about four cycles of the log long
MIN_SIGNAL = 3.0  # standard deviations by which the fundamental of a cycle stands out
MAX_RISE = 2.0  # rise of the reference over a window with a cycle, in amplitudes of its fundamental
MIN_AMPLITUDE = 1e-9  # of the reference harmonic: avoids a division by 0


@dataclass(frozen=True)
class StatisticPart:
    """One number of the statistics vector: the judged signal that it belongs to, its unit, the
    column it is made from and the kind of statistic, and of a shape the harmonic and whether it is
    the part in phase or across.
    """

    signal: str
    unit: str
    column: str
    kind: str
    harmonic: int = 0
    across: bool = False


def statistic_parts(columns: Sequence[str], reference: str) -> tuple[StatisticPart, ...]:
    """The numbers that describe a window of these columns."""
    parts = [StatisticPart(PERIOD, "s", "", PERIOD)]
    for column in columns:
        one = STATISTICS[column]
        for kind in one.names:
            unit = f"{one.unit}/s" if kind == RISE else one.unit
            parts.append(StatisticPart(f"{column}.{kind}", unit, column, kind))
        for h in range(1, one.harmonics + 1):
            for across in (False, True):
                if not (across and h == 1 and column == reference):
                    signal = f"{column}.{SHAPE}"
                    parts.append(StatisticPart(signal, one.unit, column, SHAPE, h, across))
    return tuple(parts)


@dataclass(frozen=True)
class CycleReader:
    """Turns columns of a log, or of its simulation, into statistics: its windows, its columns with
    the standard deviation of their noise, the column that gives the phase, the parts, and the
    windows (S, W) of each column that lack samples.
    """

    windows: CycleWindows
    noise: dict[str, float]
    reference: str
    parts: tuple[StatisticPart, ...]
    incomplete: np.ndarray

    @property
    def columns(self) -> tuple[str, ...]:
        """The judged columns."""
        return tuple(self.noise)

    @property
    def weight(self) -> np.ndarray:
        """Inverse variances (S,) of the columns' noise."""
        return np.array([1.0 / sigma**2 for sigma in self.noise.values()])

    def fit(self, values: dict[str, np.ndarray]) -> HarmonicFit:
        """Harmonic fit of columns (B, rows), windows of one set after the other. Each window is
        moved to the nearest place at which the reference's fundamental has its maximum at the
        window's centre, so that windows of a log and of its simulation hold equal phases; levels
        are those at the centre of the window that was not moved.
        """
        windows, columns = self.windows, np.stack([values[name] for name in self.columns])
        sets, weight, row_s = columns.shape[1], self.weight, windows.row_s
        flat = columns.reshape(len(columns), -1)
        offset = np.repeat(columns.shape[2] * np.arange(sets), windows.count)
        first = np.tile(windows.first, sets)
        signals = windows.cut(columns).reshape(len(columns), -1, windows.rows)
        hz = fundamental_hz(signals, weight, row_s, np.tile(windows.band_hz, (sets, 1)))
        reference = self.columns.index(self.reference)
        phase = phase_at_centre(signals[reference], hz, row_s)
        cycle = np.tile(windows.periodic, sets)
        shift = np.where(cycle, phase / (TURN_RAD * hz * row_s), 0.0)
        moved = np.clip(first - shift, 1.0, columns.shape[2] - windows.rows - 3.0)
        signals = interpolated(flat, offset + moved, windows.rows)
        found = fit_harmonics(signals, weight, row_s, hz, HARMONICS)
        level = found.level - found.slope_per_s * ((moved - first) * row_s)
        mean, slope = straight_line(signals, row_s)
        return replace(
            found,
            level=np.where(cycle, level, mean),
            slope_per_s=np.where(cycle, found.slope_per_s, slope),
        )

    def statistics(self, fit: HarmonicFit, add_noise: bool) -> np.ndarray:
        """Values (B, W, K) of the parts; add_noise: of a simulation, whose scatter lacks the
        sensors' noise.
        """
        turn = self._turn(fit)
        values = [self._value(part, fit, turn, add_noise) for part in self.parts]
        return np.stack(values, axis=1).reshape(-1, self.windows.count, len(self.parts))

    def _turn(self, fit: HarmonicFit) -> np.ndarray:
        """Unit numbers (N,) that rotate the reference's fundamental to phase 0; nan where the
        simulation left the range of numbers.
        """
        first = fit.amplitude[self.columns.index(self.reference), :, 0]
        with np.errstate(invalid="ignore"):
            return np.conj(first) / np.maximum(np.abs(first), MIN_AMPLITUDE)

    def _value(
        self, part: StatisticPart, fit: HarmonicFit, turn: np.ndarray, add_noise: bool
    ) -> np.ndarray:
        if part.kind == PERIOD:
            return 1.0 / fit.frequency_hz
        k = self.columns.index(part.column)
        if part.kind == SHAPE:
            rotated = fit.amplitude[k, :, part.harmonic - 1] * turn**part.harmonic
            return rotated.imag if part.across else rotated.real
        if part.kind == SCATTER:
            noise = NOISE_LEFT * self.noise[part.column] if add_noise else 0.0
            return np.hypot(fit.scatter[k], noise)
        return fit.level[k] if part.kind == LEVEL else fit.slope_per_s[k]

    def variances(self, fit: HarmonicFit) -> np.ndarray:
        """Variances (W, K) of a log's statistics: those that the harmonic fit's remainder gives, in
        proportion to the scatter between the windows, and at least those of the sensors' noise;
        infinite for what describes a cycle in windows without one, and where samples are missing.
        """
        noise = np.array(list(self.noise.values()))[:, None]
        least, incomplete = self.noise_variances(fit), self._incomplete_parts()
        left = self._variances(fit, np.maximum(fit.scatter, noise) ** 2)
        values = np.where(incomplete, np.nan, self.statistics(fit, False)[0])
        usual = median_of_known(np.where(incomplete, np.nan, left))
        ratio = scatter_between_windows(values) / usual
        ratio = np.where(np.isfinite(ratio), ratio, 1.0)
        # values at the rows' ends, whose place in the cycle may be the same in all windows
        sampled = np.array([part.column in SAMPLED for part in self.parts])
        ratio = np.where(sampled, np.maximum(ratio, 1.0), ratio)
        found = np.maximum(left * ratio, least)
        of_cycle = np.array([part.kind not in (LEVEL, RISE) for part in self.parts])
        found[np.ix_(~self.windows.periodic, of_cycle)] = np.inf
        found[incomplete] = np.inf
        return found

    def _incomplete_parts(self) -> np.ndarray:
        """Whether each statistic (W, K) cannot be judged in a window because samples are missing
        there: in its own column; of a shape, also in the column that gives the phase; of the
        period, in every column that could give it.
        """
        of = dict(zip(self.columns, self.incomplete, strict=True))
        period = np.logical_and.reduce([of[name] for name in REFERENCES if name in of])
        found = []
        for part in self.parts:
            missing = period if part.kind == PERIOD else of[part.column]
            found.append(missing | of[self.reference] if part.kind == SHAPE else missing)
        return np.stack(found, axis=1)

    def noise_variances(self, fit: HarmonicFit) -> np.ndarray:
        """Variances (W, K) of a log's statistics that white noise of the columns gives."""
        noise = np.array(list(self.noise.values()))[:, None]
        return self._variances(fit, np.broadcast_to(noise**2, fit.scatter.shape))

    def _variances(self, fit: HarmonicFit, power: np.ndarray) -> np.ndarray:
        """Variances (W, K) for white noise of power (S, W) in the columns."""
        rows, length_s = self.windows.rows, self.windows.rows * self.windows.row_s
        reference = self.columns.index(self.reference)
        first = np.maximum(np.abs(fit.amplitude[reference, :, 0]), MIN_AMPLITUDE)
        phase = 2.0 * power[reference] / (rows * first**2)
        found = []
        for part in self.parts:
            if part.kind == PERIOD:
                information = (fit.frequency_information / power).sum(axis=0)
                found.append(1.0 / (np.maximum(information, 1e-12) * fit.frequency_hz**4))
                continue
            k = self.columns.index(part.column)
            if part.kind == SHAPE:
                size = np.abs(fit.amplitude[k, :, part.harmonic - 1]) * part.harmonic
                found.append(2.0 * power[k] / rows + phase * size**2)
            else:
                factor = {LEVEL: 1.0, RISE: 12.0 / length_s**2, SCATTER: 0.5}[part.kind]
                found.append(factor * power[k] / rows)
        return np.stack(found, axis=1)


def interpolated(values: np.ndarray, first: np.ndarray, rows: int) -> np.ndarray:
    """Windows (S, N, L) of values (S, n) that begin at places first (N,) between rows, by cubic
    Lagrange interpolation: windows moved by whole rows would make the statistics jump. nan where
    the place is.
    """
    whole = np.floor(np.nan_to_num(first, nan=1.0)).astype(int)
    f = (first - whole)[:, None]
    weights = (
        -f * (f - 1.0) * (f - 2.0) / 6.0,
        (f + 1.0) * (f - 1.0) * (f - 2.0) / 2.0,
        -(f + 1.0) * f * (f - 2.0) / 2.0,
        (f + 1.0) * f * (f - 1.0) / 6.0,
    )
    at = whole[:, None] + np.arange(rows)
    return sum(weight * values[:, at + k] for k, weight in enumerate(weights, -1))


def is_periodic(fit: HarmonicFit, reference: int, windows: CycleWindows) -> np.ndarray:
    """Whether the impact cycle dominates each window (W,) of a log: the reference's fundamental is
    clear, larger than its rise over the window (a run-up to the first blow has no cycle), and
    repeats often enough in this window and in one beside it.
    """
    length_s = windows.rows * windows.row_s
    size = np.abs(fit.amplitude[reference, :, 0])
    error = fit.scatter[reference] * np.sqrt(2.0 / windows.rows)
    rise = np.abs(fit.slope_per_s[reference]) * length_s
    found = (size > MIN_SIGNAL * error) & (MAX_RISE * size > rise)
    found &= fit.frequency_hz * length_s > MIN_CYCLES
    beside = np.concatenate([[False], found, [False]])
    return found & (beside[:-2] | beside[2:])


def scatter_between_windows(values: np.ndarray) -> np.ndarray:
    """Variance (K,) of statistics (W, K), nan where unknown, between neighbouring windows,
    robustly from second differences, which a trend along the joint does not enter.
    """
    second = values[:-2] - 2.0 * values[1:-1] + values[2:]
    return (MAD_TO_SIGMA * median_of_known(np.abs(second))) ** 2 / 6.0


def median_of_known(values: np.ndarray) -> np.ndarray:
    """Median (K,) over the first axis of values (m, K) that are not nan; nan where all are."""
    known = np.isfinite(values).any(axis=0)
    return np.where(known, np.nanmedian(np.where(known, values, 0.0), axis=0), np.nan)
