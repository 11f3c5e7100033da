"""Windows of a hammering log: stretches of rows that last several impact cycles, and the band in
which the cycle's frequency is searched.
"""

from dataclasses import dataclass

import numpy as np

from vgroove.gap.residual.impact.harmonics import fundamental_hz


@dataclass(frozen=True)
class WindowRules:
    """How a log is cut into windows; chosen on simulated runs."""

    cycles: float = 4.0  # length of a window, in cycles of the log
    search_s: float = 0.25  # length of the stretches in which the log's frequency is searched
    least_hz: float = 12.0  # impact rates of hand tools: 12 to 80 blows a second
    most_hz: float = 80.0
    # band in which the frequency of each stretch is searched again, in usual frequencies of the log
    around_usual: tuple[float, float] = (0.6, 1.6)
    band: float = 0.3  # largest relative difference between the frequencies of model and log
    min_rows: int = 40  # rows of a window: the harmonic model has up to 11 numbers
    min_windows: int = 8


RULES = WindowRules()


@dataclass(frozen=True)
class CycleWindows:
    """Windows of one log: first row (W,) of each, rows a window, interval between rows in s, the
    band in Hz (W, 2) of the cycle's frequency, and whether each (W,) holds an impact cycle.
    """

    first: np.ndarray
    rows: int
    row_s: float
    band_hz: np.ndarray
    periodic: np.ndarray

    @property
    def count(self) -> int:
        """Number of windows."""
        return len(self.first)

    @property
    def centre(self) -> np.ndarray:
        """Row (W,) at the centre of each window."""
        return self.first + self.rows // 2

    @property
    def cycle_rows(self) -> int:
        """Usual number of rows of a cycle."""
        return round(1.0 / (float(np.median(self.band_hz)) * self.row_s))

    def cut(self, values: np.ndarray) -> np.ndarray:
        """Values (..., rows of the log) as windows (..., W, L)."""
        return values[..., self.first[:, None] + np.arange(self.rows)]


def cut_windows(
    signals: np.ndarray, weight: np.ndarray, row_s: float, driven: np.ndarray
) -> "CycleWindows | None":
    """Windows over the rows in which the tool is driven, from signals (S, rows) without missing
    samples, their weights (S,) and a mask (rows,); None for a log too short.
    """
    rows = np.flatnonzero(driven)
    length = max(RULES.min_rows, round(RULES.search_s / row_s))
    if len(rows) < RULES.min_windows * RULES.min_rows:
        return None
    begin, end = int(rows[0]), int(rows[-1]) + 1
    first = np.arange(begin, max(begin + 1, end - length + 1), length // 2)
    wide = CycleWindows(first, min(length, end - begin), row_s, *_whole_band(len(first)))
    stretches = wide.cut(signals)
    found = fundamental_hz(stretches, weight, row_s, wide.band_hz)
    # a change of the duty may look like a slow cycle: searched again near the usual frequency
    near = np.tile(np.median(found) * np.array(RULES.around_usual), (len(found), 1))
    found = fundamental_hz(stretches, weight, row_s, near)
    period_s = float(np.median(1.0 / found))
    # a short log gets its least number of windows, though of fewer cycles
    most = np.count_nonzero(driven) // (RULES.min_windows + 1)
    size = max(RULES.min_rows, min(round(RULES.cycles * period_s / row_s), most))
    first = np.arange(begin, end - size + 1, size)
    # the run-down after a release depends on the phase of the hammer at the release
    first = first[driven[first[:, None] + np.arange(size)].all(axis=1)]
    if len(first) < RULES.min_windows:
        return None
    centre = np.interp(first + 0.5 * size, wide.centre, found)
    band = centre[:, None] * np.array([1.0 - RULES.band, 1.0 + RULES.band])
    return CycleWindows(first, size, row_s, band, np.zeros(len(first), bool))


def _whole_band(count: int) -> tuple[np.ndarray, np.ndarray]:
    """The band of all impact rates, of windows without a known cycle."""
    return np.tile([RULES.least_hz, RULES.most_hz], (count, 1)), np.zeros(count, bool)
