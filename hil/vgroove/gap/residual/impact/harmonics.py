"""Fits a level, a slope and the harmonics of one common fundamental frequency to windows of several
signals: the impact cycle of a hammering tool, without knowledge of its blow times.

Method: nonlinear least squares of a harmonic model (B. G. Quinn and E. J. Hannan, The Estimation
and Tracking of Frequency, 2001, chapter 5), started at the maximum of the summed periodograms.
"""

from dataclasses import dataclass

import numpy as np

from vgroove.units import TURN_RAD

ROUNDS = 2  # Gauss-Newton rounds of the frequency; the start is within a tenth of a bin
BINS_AROUND = 0.3  # largest change of the start frequency, in 1 / length of a window
PADDING = 10  # points of the periodogram per row
SUMMED_HARMONICS = 3  # harmonics whose powers find the fundamental
RIDGE = 1e-9  # of the normal equations, relative to the number of rows


@dataclass(frozen=True)
class HarmonicFit:
    """The fit of N windows of S signals with H harmonics.

    frequency_hz (N,); level, slope_per_s, scatter (S, N): value at the window's centre, rate, and
    RMS of what the model leaves; amplitude (S, N, H): complex amplitudes, the signal being the real
    part of amplitude exp(i 2 pi h f t) with t = 0 at the window's centre; frequency_information
    (S, N): inverse variance in 1/Hz^2 of the frequency from each signal, for a scatter of 1.
    """

    frequency_hz: np.ndarray
    level: np.ndarray
    slope_per_s: np.ndarray
    scatter: np.ndarray
    amplitude: np.ndarray
    frequency_information: np.ndarray


def centred_times(rows: int, row_s: float) -> np.ndarray:
    """Times (L,) in s of a window's rows from its centre."""
    return row_s * (np.arange(rows) - 0.5 * (rows - 1))


def straight_line(windows: np.ndarray, row_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Mean and slope per s (...) of a straight line through windows (..., L)."""
    t = centred_times(windows.shape[-1], row_s)
    return windows.mean(axis=-1), windows @ t / (t @ t)


def tapered(windows: np.ndarray, row_s: float) -> np.ndarray:
    """Windows (..., L) without their straight line, under a Hann taper."""
    rows = windows.shape[-1]
    level, slope = straight_line(windows, row_s)
    line = level[..., None] + slope[..., None] * centred_times(rows, row_s)
    return (windows - line) * np.hanning(rows)


def fundamental_hz(
    signals: np.ndarray, weight: np.ndarray, row_s: float, band_hz: np.ndarray
) -> np.ndarray:
    """Frequency (N,) in Hz, inside the band_hz (N, 2), at which the powers of the first harmonics
    of signals (S, N, L), weighted by weight (S,), add to the most.
    """
    size = 1 << (PADDING * signals.shape[2] - 1).bit_length()
    spectrum = np.fft.rfft(tapered(signals, row_s), size, axis=2)
    power = np.einsum("snf,s->nf", spectrum.real**2 + spectrum.imag**2, weight)
    count = power.shape[1] // SUMMED_HARMONICS
    order = range(1, SUMMED_HARMONICS + 1)
    # weights 1 / h: without them a fraction of the fundamental would be as good as itself
    total = sum(power[:, h * np.arange(count)] / h for h in order)
    hz = np.arange(count) / (size * row_s)
    outside = (hz < band_hz[:, :1]) | (hz > band_hz[:, 1:])
    total[outside] = -1.0
    top = np.clip(np.argmax(total, axis=1), 1, count - 2)
    n = np.arange(len(top))
    left, middle, right = total[n, top - 1], total[n, top], total[n, top + 1]
    curvature = np.minimum(left - 2.0 * middle + right, -1e-300)
    shift = np.clip(0.5 * (left - right) / curvature, -0.5, 0.5)
    return np.clip((top + shift) / (size * row_s), band_hz[:, 0], band_hz[:, 1])


def phase_at_centre(signal: np.ndarray, frequency: np.ndarray, row_s: float) -> np.ndarray:
    """Phase (N,) in rad of the fundamental at the centres of windows (N, L) of one signal."""
    turn = np.exp(-1j * TURN_RAD * frequency[:, None] * centred_times(signal.shape[1], row_s))
    return np.angle((tapered(signal, row_s) * turn).sum(axis=1))


def fit_harmonics(
    signals: np.ndarray, weight: np.ndarray, row_s: float, start_hz: np.ndarray, harmonics: int
) -> HarmonicFit:
    """Fit of signals (S, N, L), sampled every row_s, from start frequencies (N,); weight (S,):
    inverse variances of the signals' noise.
    """
    frequency = start_hz
    limit = BINS_AROUND / (signals.shape[2] * row_s)
    values = np.ascontiguousarray(np.moveaxis(signals, 0, 2))
    for _ in range(ROUNDS):
        step = _Window.at(values, row_s, frequency, harmonics).frequency_step(weight)
        frequency = np.clip(frequency + step, start_hz - limit, start_hz + limit)
    window = _Window.at(values, row_s, frequency, harmonics)
    freedom = max(1, values.shape[1] - window.basis.shape[2] - 1)
    scatter = np.sqrt((window.left**2).sum(axis=1) / freedom)
    cosine, sine = window.coefficients[:, 2::2], window.coefficients[:, 3::2]
    return HarmonicFit(
        frequency,
        window.coefficients[:, 0].T,
        window.coefficients[:, 1].T,
        scatter.T,
        np.moveaxis(cosine - 1j * sine, 2, 0),
        (window.across**2).sum(axis=1).T,
    )


@dataclass(frozen=True)
class _Window:
    """Linear fit of N windows at given frequencies: basis (N, L, K) of level, slope, cosines and
    sines; coefficients (N, K, S); left (N, L, S): what the fit leaves; across (N, L, S): the part
    of the model's derivative by the frequency that the basis does not contain.
    """

    basis: np.ndarray
    coefficients: np.ndarray
    left: np.ndarray
    across: np.ndarray

    @staticmethod
    def at(values: np.ndarray, row_s: float, frequency: np.ndarray, harmonics: int) -> "_Window":
        """The fit of values (N, L, S) at frequencies (N,)."""
        rows, signals = values.shape[1:]
        t = centred_times(rows, row_s)
        basis = _basis(t, frequency, harmonics)
        transposed = np.swapaxes(basis, 1, 2)
        normal = transposed @ basis
        diagonal = np.arange(basis.shape[2])
        normal[:, diagonal, diagonal] *= 1.0 + RIDGE
        coefficients = np.linalg.solve(normal, transposed @ values)
        order = np.arange(1, harmonics + 1)[:, None]
        rotated = np.zeros_like(coefficients)
        rotated[:, 2::2] = coefficients[:, 3::2] * order
        rotated[:, 3::2] = -coefficients[:, 2::2] * order
        slopes = TURN_RAD * t[:, None] * (basis @ rotated)
        inside = np.linalg.solve(normal, transposed @ slopes)
        both = basis @ np.concatenate([coefficients, inside], axis=2)
        return _Window(
            basis, coefficients, values - both[..., :signals], slopes - both[..., signals:]
        )

    def frequency_step(self, weight: np.ndarray) -> np.ndarray:
        """Gauss-Newton step (N,) of the frequency over all signals of inverse variance weight."""
        gain = (self.across * self.left).sum(axis=1) @ weight
        power = (self.across**2).sum(axis=1) @ weight
        return gain / np.maximum(power, 1e-300)


def _basis(t: np.ndarray, frequency: np.ndarray, harmonics: int) -> np.ndarray:
    """Level, slope, cosines and sines (N, L, 2 + 2 H) at times t (L,)."""
    basis = np.empty((len(frequency), len(t), 2 + 2 * harmonics))
    basis[..., 0], basis[..., 1] = 1.0, t
    turn = np.exp(1j * TURN_RAD * frequency[:, None] * t)
    power = turn.copy()
    for h in range(harmonics):
        basis[..., 2 + 2 * h], basis[..., 3 + 2 * h] = power.real, power.imag
        power *= turn
    return basis
