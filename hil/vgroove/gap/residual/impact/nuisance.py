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
        return cls(directions[:, kept], 1.0 / np.sqrt(1.0 + size[kept] ** 2))

    def whitened(self, residual: np.ndarray) -> np.ndarray:
        """Residuals (..., n) times the symmetric inverse root of the covariance, so that each still
        belongs to its own statistic.
        """
        along = residual @ self.directions
        return residual - (along * (1.0 - self.remains)) @ self.directions.T
