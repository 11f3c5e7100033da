"""Removes most of the noise of a measured command and keeps its steps, ramps and quantisation;
states the noise that is left.
"""

from dataclasses import dataclass

import numpy as np

from vgroove.gap.cleaning.sensor_noise import command_noise_sigma, resolution_of


@dataclass(frozen=True)
class DenoiseLimits:
    """Limits of the adaptive mean, chosen on the tuning half of the blind set; sigma is the
    standard deviation of the command's noise.
    """

    max_reach: int = 500  # samples: largest half width of a window
    tested_pairs: int = 4  # outermost pairs of samples that are compared with the window inside
    bend_sigma: float = 4.0  # difference of that comparison at which the window stops growing
    back_pairs: int = 4  # pairs before the detected bend that may belong to it
    moving_sigma: float = 3.0  # change across a window, in its sigma, above which the command moves
    min_rows: int = 50  # rows of constant, or of moving, command needed to estimate their scatter
    min_averaged: int = 5  # samples in a mean from which on its residual shows the scatter
    # rows over which the scatter of the command itself may be correlated
    correlated_rows: tuple[int, ...] = (1, 8, 32)
    unknown_share: float = 0.5  # share of the scatter that is kept where noise and command mix


LIMITS = DenoiseLimits()


@dataclass(frozen=True)
class DenoisedCommand:
    """A command (n,) and the standard deviation of its remaining error, in the command's unit.

    noise_v: noise of one logged sample; the mean of that noise over `averaged` samples (n,) is an
    error that is common to as many rows. fast_v: independent error of each row, (n,) or a number.
    The suffix _v holds for a voltage as input.
    """

    values: np.ndarray
    noise_v: float = 0.0
    averaged: np.ndarray | float = 1.0
    fast_v: np.ndarray | float = 0.0


def denoise_command(values: np.ndarray) -> DenoisedCommand:
    """The command (n,) with each sample replaced by the mean of the widest symmetric window around
    it that holds a straight line, which such a mean does not change.

    Scatter that is larger on ramps than at a constant command is the command's own (quantisation);
    the share of it that exceeds the noise is kept (a Wiener gain): all of it where a constant
    command has none, as at the limit of a controller. Where too few rows have a constant command to
    measure the noise, half of the scatter is kept, with an error of the other half.
    """
    sigma = command_noise_sigma(values)
    if sigma == 0.0:
        return DenoisedCommand(values)
    mean, averaged = straight_means(values, sigma)
    residual = values - mean
    wide = averaged >= LIMITS.min_averaged
    moves = is_moving(mean, averaged, sigma)
    if np.count_nonzero(wide & ~moves) < LIMITS.min_rows:
        share = LIMITS.unknown_share
        return DenoisedCommand(mean + share * residual, 0.0, 1.0, share * sigma)
    noise_v = float(np.sqrt(np.mean(residual[wide & ~moves] ** 2)))
    if noise_v <= 0.5 * resolution_of(values):
        return DenoisedCommand(values)
    on_ramps, own = wide & moves, 0.0
    if np.count_nonzero(on_ramps) >= LIMITS.min_rows:
        own = max(0.0, scatter_power(residual, on_ramps) - noise_v**2)
    gain = np.where(moves, own / (own + noise_v**2), 0.0)
    return DenoisedCommand(mean + gain * residual, noise_v, averaged, np.sqrt(gain) * noise_v)


def straight_means(values: np.ndarray, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Means (n,) over the widest symmetric window around each sample that holds a straight line,
    and the number of samples (n,) in each; sigma: noise of one sample.

    Windows grow sample by sample. One stops where the mean of its outermost pairs differs from the
    mean inside by more than bend_sigma (one pair, then tested_pairs, so that weak bends show too).
    """
    n = len(values)
    reach, grows = np.zeros(n, dtype=int), np.ones(n, dtype=bool)
    total = np.concatenate([[0.0], np.cumsum(values)])
    for k in range(1, min(LIMITS.max_reach, (n - 1) // 2) + 1):
        at = np.flatnonzero(grows[k : n - k]) + k
        if not len(at):
            break
        bent = _is_bent(total, at, k, sigma)
        grows[at[bent]] = False
        reach[at[bent]] = max(0, k - 1 - LIMITS.back_pairs)
        reach[at[~bent]] = k
    row = np.arange(n)
    return (total[row + reach + 1] - total[row - reach]) / (2 * reach + 1), 2 * reach + 1


def _is_bent(total: np.ndarray, at: np.ndarray, k: int, sigma: float) -> np.ndarray:
    """Whether the window of half width k around each of the rows at (m,) bends; total (n + 1,):
    cumulated sum of the command.
    """
    bent = np.zeros(len(at), dtype=bool)
    for pairs in {1, min(k, LIMITS.tested_pairs)}:
        inner = 2 * (k - pairs) + 1
        inside = total[at + k - pairs + 1] - total[at - k + pairs]
        outside = total[at + k + 1] - total[at - k] - inside
        limit = LIMITS.bend_sigma * sigma * np.sqrt(0.5 / pairs + 1.0 / inner)
        bent |= np.abs(outside / (2 * pairs) - inside / inner) > limit
    return bent


def is_moving(mean: np.ndarray, averaged: np.ndarray, sigma: float) -> np.ndarray:
    """Whether the command moves around each sample (n,): its mean changes across half of the window
    by more than the noise of two means explains.
    """
    reach = np.minimum(averaged // 2, np.minimum(np.arange(len(mean)), np.arange(len(mean))[::-1]))
    half = np.maximum(reach // 2, 1)
    row = np.arange(len(mean))
    across = mean[np.minimum(row + half, len(mean) - 1)] - mean[np.maximum(row - half, 0)]
    return np.abs(across) > LIMITS.moving_sigma * sigma * np.sqrt(2.0 / averaged)


def scatter_power(residual: np.ndarray, rows: np.ndarray) -> float:
    """Variance of the white noise that has as much power at low frequencies as the residual
    (n,) has in the rows (mask, (n,)): the largest over the block lengths correlated_rows.
    """
    slow = [
        np.convolve(residual, np.full(length, length**-0.5), mode="same")
        for length in LIMITS.correlated_rows
    ]
    return max(float(np.mean(part[rows] ** 2)) for part in slow)
