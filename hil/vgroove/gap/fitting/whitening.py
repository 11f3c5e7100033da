"""Prewhitening: removes the correlation in time from residuals. An error of the model lasts for
many rows, which are therefore not independent evidence.

Each series of residuals is filtered by the prediction error filter of an autoregressive model of
what the best fit leaves (G. E. P. Box and G. M. Jenkins, Time Series Analysis, 1970). Least squares
of filtered residuals are generalised least squares.
"""

from dataclasses import dataclass

import numpy as np

MAX_ORDER = 32  # of the autoregressive models: rows that predict the next one
ROWS_PER_NUMBER = 10  # fewest rows of a series for each number of its model
MIN_POWER = 1e-12  # that a further row leaves at least, as a share: keeps it above 0


@dataclass(frozen=True)
class Whitening:
    """Prediction error filters of the series of a problem's residuals. rows: the rows of each
    series in the order of time; taps: its filter, which leaves the power of white noise as it is.
    """

    rows: tuple[np.ndarray, ...]
    taps: tuple[np.ndarray, ...]

    def apply(self, residuals: np.ndarray) -> np.ndarray:
        """Residuals (n,) or (B, n) filtered; rows of no series are kept."""
        out = np.array(residuals, dtype=float)
        for rows, taps in zip(self.rows, self.taps, strict=True):
            if len(taps) > 1 and out.size:
                series = out[..., rows].reshape(-1, len(rows))
                filtered = [np.convolve(one, taps)[: len(rows)] for one in series]
                out[..., rows] = np.reshape(filtered, (*out.shape[:-1], len(rows)))
        return out


def whitening_of(series: tuple[np.ndarray, ...], residual: np.ndarray) -> Whitening:
    """The filters of a fit's residuals (n,). series: rows of each."""
    return Whitening(series, tuple(prediction_error_filter(residual[rows]) for rows in series))


def prediction_error_filter(value: np.ndarray) -> np.ndarray:
    """Taps (1 + order,), of power 1, of the prediction error filter of a series (m,), by the
    recursion of Levinson and Durbin; the order is that of the least criterion of Schwarz.

    The ends of a series disturb its autocovariances: of one whose innovations are a thousandth of
    its power they leave a correlation of 0.1 to 0.25 between neighbouring rows.
    """
    count = len(value)
    best = taps = np.ones(1)
    if not value.any():
        return best
    most = min(MAX_ORDER, count // ROWS_PER_NUMBER)
    covariance = autocovariance(value, most + 1)
    power, least = float(covariance[0]), 0.0
    for order in range(1, most + 1):
        reflection = -float(taps @ covariance[order:0:-1]) / power
        padded = np.append(taps, 0.0)
        taps = padded + reflection * padded[::-1]
        power *= max(1.0 - reflection**2, MIN_POWER)
        criterion = count * np.log(power / covariance[0]) + order * np.log(count)
        if criterion < least:
            best, least = taps, criterion
    return best / np.linalg.norm(best)


def autocovariance(value: np.ndarray, lags: int) -> np.ndarray:
    """Sums of the products of a series (m,) with itself, shifted by 0, 1, .. rows (lags,)."""
    power = np.abs(np.fft.rfft(value, 2 * len(value))) ** 2
    return np.fft.irfft(power)[:lags]
