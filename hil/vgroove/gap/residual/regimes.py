"""Regimes of motion of each row of a log, by which a gap is located."""

from dataclasses import dataclass

import numpy as np

from vgroove.gap.residual.moving_mean import moving_mean


@dataclass(frozen=True)
class RegimeLimits:
    """Limits of the regimes, as shares of the top speed; chosen for reports. An established effect
    has the same size in all regimes that show it (verdict/consistency.py).
    """

    smoothing_s: float = 0.02  # moving mean of the speed, at least min_rows long
    min_rows: int = 3
    bands: float = 4.0  # approximate number of bands of steady speed up to the top speed
    standstill: float = 0.01  # a lower speed is standstill
    start: float = 0.15  # speeding up at a lower speed is a start
    changing_per_s: float = 0.3  # a larger rate, 1/s, is speeding up or braking


REGIMES = RegimeLimits()
CHANGING = ("standstill", "start", "speeding up", "braking", "reversal")
STANDSTILL, START, SPEEDING_UP, BRAKING, REVERSAL, STEADY = range(6)


def regimes_of(
    time_s: np.ndarray, speed: np.ndarray, command: np.ndarray
) -> tuple[np.ndarray, list[str]]:
    """Regime (rows,) of each row and the regimes' names, from speeds and commands (rows,):
    standstill, start, speeding up, braking, reversal, and steady in bands of speed.
    """
    size = np.abs(speed)
    top = float(np.max(size))
    if top == 0.0:
        return np.zeros(len(time_s), dtype=int), ["whole log"]
    width = max(REGIMES.min_rows, int(round(REGIMES.smoothing_s / np.median(np.diff(time_s)))))
    rate = np.gradient(moving_mean(speed, width | 1), time_s)
    band = _round_up(top / REGIMES.bands)
    names = [f"steady, {k * band:g}-{(k + 1) * band:g} rad/s" for k in range(int(top // band) + 1)]
    regime = STEADY + (size // band).astype(int)
    changing, growing = np.abs(rate) > REGIMES.changing_per_s * top, rate * np.sign(speed) > 0.0
    regime[changing & growing] = SPEEDING_UP
    regime[changing & ~growing] = BRAKING
    regime[changing & growing & (size < REGIMES.start * top)] = START
    regime[(command * speed < 0.0) & (size > REGIMES.standstill * top)] = REVERSAL
    regime[size <= REGIMES.standstill * top] = STANDSTILL
    return regime, [*CHANGING, *names]


def _round_up(band: float) -> float:
    """A number rounded up to one significant digit."""
    digits = 10.0 ** np.floor(np.log10(band))
    return float(np.ceil(band / digits) * digits)
