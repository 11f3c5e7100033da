"""Regimes of motion, row by row: where in a run a gap sits."""

import numpy as np


def regimes_of(
    time_s: np.ndarray, speed: np.ndarray, command: np.ndarray
) -> tuple[np.ndarray, list[str]]:
    """Regime of each row: standstill, start, speeding up, braking, reversal, and steady in bands of
    speed.
    """
    top = float(np.max(np.abs(speed)))
    if top == 0.0:
        return np.zeros(len(time_s), dtype=int), ["whole log"]
    width = max(3, int(round(0.02 / np.median(np.diff(time_s)))))
    rate = np.gradient(np.convolve(speed, np.ones(width) / width, mode="same"), time_s)
    band = top / 4.0
    digits = 10.0 ** np.floor(np.log10(band))
    band = float(np.ceil(band / digits) * digits)
    names = ["standstill", "start", "speeding up", "braking", "reversal"]
    names += [f"steady, {k * band:g}-{(k + 1) * band:g} rad/s" for k in range(int(top // band) + 1)]
    regime = 5 + (np.abs(speed) // band).astype(int)
    changing = np.abs(rate) > 0.3 * top
    growing = rate * np.sign(speed) > 0.0
    regime[changing & growing] = 2
    regime[changing & ~growing] = 3
    regime[changing & growing & (np.abs(speed) < 0.15 * top)] = 1
    regime[(command * speed < 0.0) & (np.abs(speed) > 0.01 * top)] = 4
    regime[np.abs(speed) <= 0.01 * top] = 0
    return regime, names
