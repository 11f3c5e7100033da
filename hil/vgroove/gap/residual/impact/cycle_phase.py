"""Where in the impact cycle a shape is wrong: shares of its squared residuals by the phase of the
cycle.

The phase is 0 where the fundamental of the reference column (log_cycles.reader_of()) has its
maximum, the same in the log and in the model.
"""

import numpy as np

from vgroove.gap.catalogue.statistics import HARMONICS, SHAPE
from vgroove.gap.residual.impact.impact_run import ImpactRun
from vgroove.units import TURN_RAD

SECTORS = 4  # parts of the cycle
POINTS = 32  # of a sector, at which the waveform is squared


def sector_name(sector: int, reference: str) -> str:
    """A part of the cycle in words."""
    width = 360 // SECTORS
    return f"{width * sector} to {width * (sector + 1)} deg after the peak of {reference}"


def sector_shares(amplitude: np.ndarray) -> np.ndarray:
    """Fraction (W, SECTORS) of the mean square of periodic waveforms that lies in each quarter of
    their period. amplitude (W, H): complex amplitudes of the harmonics 1 to H of each waveform. A
    waveform that is 0 has equal fractions.
    """
    order = np.arange(1, amplitude.shape[1] + 1)
    phase = TURN_RAD * (np.arange(SECTORS * POINTS) + 0.5) / (SECTORS * POINTS)
    waveform = (amplitude @ np.exp(1j * np.outer(order, phase))).real
    power = (waveform**2).reshape(len(amplitude), SECTORS, POINTS).sum(axis=2)
    whole = power.sum(axis=1, keepdims=True)
    return np.where(whole > 0.0, power / np.where(whole > 0.0, whole, 1.0), 1.0 / SECTORS)


def shape_shares(run: ImpactRun, residual: np.ndarray) -> np.ndarray:
    """Shares (n, SECTORS) of the parts of the cycle in the squared residuals (n,) of a log's judged
    statistics, from the shape of their column in their window; nan for what is no shape.
    """
    part, window = run.part[run.judged], run.window[run.judged]
    found = np.full((len(part), SECTORS), np.nan)
    error = residual * run.sigma[run.judged]
    for column in run.reader.columns:
        amplitude = np.zeros((run.windows.count, HARMONICS), complex)
        mine = [k for k, one in enumerate(run.parts) if (one.column, one.kind) == (column, SHAPE)]
        for k in mine:
            rows, one = np.flatnonzero(part == k), run.parts[k]
            amplitude[window[rows], one.harmonic - 1] += error[rows] * (1j if one.across else 1.0)
        rows = np.flatnonzero(np.isin(part, mine))
        found[rows] = sector_shares(amplitude)[window[rows]]
    return found
