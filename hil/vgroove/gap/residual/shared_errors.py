"""Errors that several samples of a channel share: the unknown speed after a breakaway, the unknown
state from which the model restarts. Residuals that contain them are correlated; they are whitened.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import block_diag, csr_array

from vgroove.gap.residual.immutable import freeze_arrays


@dataclass(frozen=True)
class SharedErrors:
    """Independent errors of groups of samples. group (m,): number of the group of each sample, in
    order of time; loadings (m, K): change of the sample by one standard deviation of each of K
    errors of its group, in standard deviations of the sample; unknown (m,): change by one further
    error of which nothing is known, in the same unit (None: there is none).
    """

    group: np.ndarray
    loadings: np.ndarray
    unknown: np.ndarray | None = None

    def __post_init__(self) -> None:
        freeze_arrays(self)

    def select(self, keep: np.ndarray) -> "SharedErrors":
        """The errors of the samples of a mask (m,)."""
        unknown = None if self.unknown is None else self.unknown[keep]
        return SharedErrors(self.group[keep], self.loadings[keep], unknown)

    def projections(self) -> tuple[csr_array, csr_array]:
        """Sparse matrices (k, m) and (m, k) whose product turns residuals into the part of them
        that is attributed to the shared errors.
        """
        first = np.flatnonzero(np.diff(self.group, prepend=self.group[:1] - 1))
        parts = _slices(first, len(self.group))
        bases, shares = zip(*(self._directions(part) for part in parts), strict=True)
        onto = csr_array(block_diag([basis.T for basis in bases]))
        return onto, csr_array(onto.T.multiply(np.concatenate(shares)))

    def _directions(self, part: slice) -> tuple[np.ndarray, np.ndarray]:
        """Orthonormal directions (n, k) of the errors of a group of samples, and the share (k,) of
        a residual along each that is attributed to them.
        """
        if self.unknown is None:
            return _symmetric_root(self.loadings[part])
        first = (self.unknown[part] / np.linalg.norm(self.unknown[part]))[:, None]
        rest = self.loadings[part] - first * (first.T @ self.loadings[part])
        basis, share = _symmetric_root(rest)
        return np.hstack([first, basis]), np.append(1.0, share)


def _slices(first: np.ndarray, count: int) -> list[slice]:
    return [slice(a, b) for a, b in zip(first, np.append(first[1:], count), strict=True)]


def _symmetric_root(loadings: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions U (n, k) and shares 1 - 1 / sqrt(1 + s^2): for residuals r of covariance 1 + S S'
    with loadings S = U diag(s) V', r - U diag(share) U' r has covariance 1.
    """
    basis, size, _ = np.linalg.svd(loadings, full_matrices=False)
    return basis, 1.0 - 1.0 / np.sqrt(1.0 + size**2)
