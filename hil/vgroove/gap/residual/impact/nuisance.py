"""Nuisance directions: how the statistics respond to what is not determined by a log. A residual is
judged under the covariance 1 + A A', A (n, m) the responses to one standard deviation of each
nuisance, in standard deviations of the statistics: what a nuisance explains is no gap, all else
keeps the sharpness of its own noise.
"""

from dataclasses import dataclass

import numpy as np

from vgroove.gap.residual.immutable import freeze_arrays

MIN_RESPONSE = 1e-3  # standard deviations; smaller responses change nothing


@dataclass(frozen=True)
class NuisanceDirections:
    """Orthonormal directions (n, m) and the share (m,) of a residual along each that remains."""

    directions: np.ndarray
    remains: np.ndarray

    def __post_init__(self) -> None:
        freeze_arrays(self)

    @classmethod
    def of(cls, responses: np.ndarray) -> "NuisanceDirections":
        """Those of responses (n, m)."""
        directions, size, _ = np.linalg.svd(responses, full_matrices=False)
        kept = size > MIN_RESPONSE
        return cls(np.ascontiguousarray(directions[:, kept]), 1.0 / np.sqrt(1.0 + size[kept] ** 2))

    def of_rows(self, rows: np.ndarray) -> "NuisanceDirections":
        """The directions of a part of the statistics alone, which `rows` (n,) marks: those of the
        covariance of that part.
        """
        return self.of(self.directions[rows] * np.sqrt(1.0 / self.remains**2 - 1.0))

    def whitened(self, residual: np.ndarray) -> np.ndarray:
        """Residuals (..., n) times the symmetric inverse root of the covariance, so that each still
        belongs to its own statistic.
        """
        # One scalar product at a time: the rounding of a matrix product depends on the number of
        # residuals.
        residual = np.ascontiguousarray(residual)
        along = np.vecdot(residual[..., None, :], np.ascontiguousarray(self.directions.T))
        return residual - np.vecdot((along * (1.0 - self.remains))[..., None, :], self.directions)


def whitened(residual: np.ndarray, nuisance: NuisanceDirections | None) -> np.ndarray:
    """Residuals (..., n) without what nuisances explain, where there are any."""
    return residual if nuisance is None else nuisance.whitened(residual)
