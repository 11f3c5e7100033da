"""A measured command without most of its noise and with all of its steps, ramps and roundings, and
what noise is left in it.
"""

from dataclasses import dataclass

import numpy as np

from vgroove.gap.cleaning.sensor_noise import command_noise_sigma

MOST_REACH = 500  # samples on each side of one that is calmed
TOGETHER = 4  # pairs of samples that may bend the window together
BEND = 4.0  # sigmas by which they bend it for sure
STEP_BACK = 4  # pairs before a bend that may belong to it
STILL = 3.0  # sigmas by which a command that stands still may seem to move across a window
FEWEST_ROWS = 50  # that stand still, or move, to tell what scatters there
LASTING = (1, 8, 32)  # rows over which the command's own scatter may last
LEAST_AVERAGED = 5  # samples in a mean beside which a scatter shows


@dataclass(frozen=True)
class DenoisedCommand:
    """A command (rows,) and 1 sigma of what is wrong with it: noise_v in a mean of so many samples
    (averaged), which lasts for as many rows, and fast_v, from row to row; both (rows,) or a number.
    """

    values: np.ndarray
    noise_v: float = 0.0
    averaged: np.ndarray | float = 1.0
    fast_v: np.ndarray | float = 0.0


def denoise_command(values: np.ndarray) -> DenoisedCommand:
    """Each sample (n,) as the mean of the widest window around it that does not bend, as many on
    both sides: straight lines stay.

    What scatters more on ramps than at rest is the command's own rounding and stays, as far as
    noise lets it be seen. Where nothing is at rest to tell them apart half of the scatter stays:
    wrong by half, whichever it is.
    """
    scatter = command_noise_sigma(values)
    if scatter == 0.0:
        return DenoisedCommand(values)
    mean, averaged = straight_means(values, scatter)
    rest = values - mean
    wide = averaged >= LEAST_AVERAGED
    moves = moving(mean, averaged, scatter)
    if np.count_nonzero(wide & ~moves) < FEWEST_ROWS:
        return DenoisedCommand(mean + 0.5 * rest, 0.0, 1.0, 0.5 * scatter)
    noise_v = float(np.sqrt(np.mean(rest[wide & ~moves] ** 2)))
    mine = wide & moves
    own = max(0.0, power(rest, mine) - noise_v**2) if np.count_nonzero(mine) >= FEWEST_ROWS else 0.0
    real = np.where(moves, own / (own + noise_v**2), 0.0)
    return DenoisedCommand(mean + real * rest, noise_v, averaged, np.sqrt(real) * noise_v)


def straight_means(values: np.ndarray, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Means (n,) over the widest window around each sample that does not bend, and the number of
    samples (n,) in each.
    """
    n, reach, grows = (
        len(values),
        np.zeros(len(values), dtype=int),
        np.ones(len(values), dtype=bool),
    )
    most = min(MOST_REACH, (n - 1) // 2)
    total = np.concatenate([[0.0], np.cumsum(values)])
    for k in range(1, most + 1):
        at = np.flatnonzero(grows[k : n - k]) + k
        if not len(at):
            break
        bent = np.zeros(len(at), dtype=bool)
        for pairs in {1, min(k, TOGETHER)}:
            inner = 2 * (k - pairs) + 1
            inside = total[at + k - pairs + 1] - total[at - k + pairs]
            outside = total[at + k + 1] - total[at - k] - inside
            bent |= np.abs(outside / (2 * pairs) - inside / inner) > BEND * sigma * np.sqrt(
                0.5 / pairs + 1.0 / inner
            )
        grows[at[bent]] = False
        reach[at[bent]] = max(0, k - 1 - STEP_BACK)
        reach[at[~bent]] = k
    row = np.arange(n)
    return (total[row + reach + 1] - total[row - reach]) / (2 * reach + 1), 2 * reach + 1


def moving(mean: np.ndarray, averaged: np.ndarray, sigma: float) -> np.ndarray:
    """Whether the command (n,) moves around each sample: more across the half of its window than
    its noise.
    """
    reach = np.minimum(averaged // 2, np.minimum(np.arange(len(mean)), np.arange(len(mean))[::-1]))
    half = np.maximum(reach // 2, 1)
    row = np.arange(len(mean))
    across = mean[np.minimum(row + half, len(mean) - 1)] - mean[np.maximum(row - half, 0)]
    return np.abs(across) > STILL * sigma * np.sqrt(2.0 / averaged)


def power(rest: np.ndarray, rows: np.ndarray) -> float:
    """Power of what scatters (n,) at rows (mask), as of the white noise that is as strong where it
    is slow: steps that last add up.
    """
    slow = [np.convolve(rest, np.full(length, length**-0.5), mode="same") for length in LASTING]
    return max(float(np.mean(part[rows] ** 2)) for part in slow)
