"""Errors that several samples of a channel share: the unknown speed after a breakaway, the unknown
state from which the model restarts. Residuals that contain them are correlated; they are whitened.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import block_diag, csr_array

from vgroove.gap.residual.immutable import freeze_arrays


@dataclass(frozen=True)
class SharedErrors:
    """Random errors, each common to all samples of one group, such as an unknown start speed.

    group (m,): number of the group of each sample; the samples of a group follow one another.
    loadings (m, K): how much one standard deviation of each of the group's K independent errors
    changes the sample, in standard deviations of the sample's own noise. unknown (m,): the same for
    a further error whose size is completely unknown, by a unit of that error (None: there is none).
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
        starts = np.flatnonzero(np.diff(self.group)) + 1
        groups = np.split(np.arange(len(self.group)), starts)
        bases, shares = zip(*(self._directions(samples) for samples in groups), strict=True)
        onto = csr_array(block_diag([basis.T for basis in bases]))
        return onto, csr_array(onto.T.multiply(np.concatenate(shares)))

    def _directions(self, samples: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """For a group of samples, given by their places (n,): orthonormal directions (n, k) in
        which its shared errors move the residuals, and for each direction the share (k,) of a
        residual along it that is attributed to these errors.
        """
        if self.unknown is None:
            return _symmetric_root(self.loadings[samples])
        first = (self.unknown[samples] / np.linalg.norm(self.unknown[samples]))[:, None]
        rest = self.loadings[samples] - first * (first.T @ self.loadings[samples])
        basis, share = _symmetric_root(rest)
        return np.hstack([first, basis]), np.append(1.0, share)


def _symmetric_root(loadings: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions U (n, k) and shares (k,) that whiten residuals r (n,) with loadings S (n, K): if r
    has the covariance matrix I + S S', then r - U diag(shares) U' r has the covariance matrix I.

    With the singular value decomposition S = U diag(s) V', share = 1 - 1 / sqrt(1 + s^2).
    """
    basis, size, _ = np.linalg.svd(loadings, full_matrices=False)
    return basis, 1.0 - 1.0 / np.sqrt(1.0 + size**2)
