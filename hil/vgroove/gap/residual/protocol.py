"""What the fit, the search and the verdict need of a measured problem: the protocol that
residual.problem.Problem and the test double of the unit tests implement.
"""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from vgroove.gap.residual.measured_run import MeasuredRun
from vgroove.gap.residual.restart_angles import RestartAngles
from vgroove.rig import Rig


class MeasuredSignal(Protocol):
    """One judged column over all logs; sigma is the median over its samples, in its unit."""

    @property
    def column(self) -> str: ...
    @property
    def unit(self) -> str: ...
    @property
    def sigma(self) -> float: ...


class MeasuredProblem(Protocol):
    """Logs and a rig as n normalised residuals that depend on a parameter vector theta (P,).

    A measured problem is immutable. What a search estimates besides theta, the angles at restarts,
    is passed to `residuals`.
    """

    # --- the fit ---
    @property
    def theta0(self) -> np.ndarray:
        """Parameter vector (P,) of the rig."""
        ...

    @property
    def n(self) -> int:
        """Number of residuals over all logs."""
        ...

    @property
    def fold(self) -> np.ndarray:
        """Number (n,) of the fold that tests each row; a number may be without rows."""
        ...

    @property
    def folds(self) -> Sequence[tuple[np.ndarray, np.ndarray]]:
        """Masks (n,) of the rows that each fold that has rows trains on and tests."""
        ...

    @property
    def angles(self) -> RestartAngles:
        """Motor angles at the restarts as the problem was loaded."""
        ...

    @property
    def difference_factor(self) -> float:
        """Factor by which the steps of finite differences are multiplied: above 1 for a model that
        amplifies small changes of its parameters, as impacts do.
        """
        ...

    @property
    def sigma_is_bound(self) -> bool:
        """Whether the standard deviations are upper bounds, as the scatter over unknown start
        angles is.
        """
        ...

    @property
    def is_whitened(self) -> bool:
        """Whether the residuals are whitened by the covariance of statistics; False for residuals
        of rows.
        """
        ...

    @property
    def has_lanes(self) -> bool:
        """Whether a few parameter sets are simulated together in the time of one (SIMD lanes): a
        fit then simulates the slopes after a step together with the step.
        """
        ...

    def index(self, name: str) -> int:
        """Column of a parameter in theta."""
        ...

    def residuals(self, theta: np.ndarray, angles: RestartAngles | None = None) -> np.ndarray:
        """Residuals (measured - model) / sigma (B, n) for theta (B, P) or (P,). The model restarts
        at these angles (default: as loaded).
        """
        ...

    # --- the search ---
    @property
    def rig(self) -> Rig: ...
    @property
    def runs(self) -> Sequence[MeasuredRun]: ...
    @property
    def restart_s(self) -> float:
        """Time between restarts in s."""
        ...

    @property
    def log(self) -> np.ndarray:
        """Index (n,) of each residual's log."""
        ...

    @property
    def row(self) -> np.ndarray:
        """Row (n,) of its log at which each residual ends."""
        ...

    @property
    def time_s(self) -> np.ndarray:
        """Time (n,) in s at which each residual ends."""
        ...

    @property
    def censored(self) -> np.ndarray:
        """Whether each residual (n,) is that of a censored sample (channels.Channel.censored)."""
        ...

    @property
    def block(self) -> np.ndarray:
        """Number (n,) of each residual's block of its log, from 1."""
        ...

    @property
    def judged(self) -> np.ndarray:
        """Whether each residual (n,) counts in the reported gap."""
        ...

    @property
    def missed_edges(self) -> tuple[float, float]:
        """Two numbers of Hall edges over all speed columns: the estimated number of missed edges,
        and the number of all edges, missed ones included.
        """
        ...

    def gap(self, residual: np.ndarray, mask: np.ndarray | None = None) -> float:
        """RMS of residuals (n,) over a mask (default: judged), each clipped at the clip of its
        signal.
        """
        ...

    def floor(self, mask: np.ndarray | None = None) -> float:
        """The gap that sensor noise alone leaves."""
        ...

    # --- the verdict ---
    @property
    def signals(self) -> Sequence[MeasuredSignal]: ...
    @property
    def signal(self) -> np.ndarray:
        """Index (n,) of each residual's signal."""
        ...

    @property
    def regimes(self) -> Sequence[str]:
        """Names of the regimes of motion."""
        ...

    @property
    def regime(self) -> np.ndarray:
        """Index (n,) of each residual's regime."""
        ...

    def power_by_regime(self, residual: np.ndarray, power: np.ndarray) -> dict[str, float]:
        """Sum of a quantity (n,), such as the squared residuals, over the residuals of each regime.
        residual (n,): the residuals themselves, which determine the place of the quantity in the
        cycle.
        """
        ...

    @property
    def held_out_s(self) -> Sequence[Sequence[Sequence[float]]]:
        """Judged stretches [from, to] in s, per log."""
        ...

    @property
    def clip(self) -> np.ndarray:
        """Sigmas (signals,) at which the residuals of a gap are clipped."""
        ...

    def squared(self, residual: np.ndarray) -> np.ndarray:
        """Clipped squares of residuals (n,); nan where a censored one does not count."""
        ...

    def rms_by_signal(self, mask: np.ndarray | None = None) -> dict[str, float]:
        """RMS of each measured signal in its unit."""
        ...

    def gap_by_signal(
        self, residual: np.ndarray, mask: np.ndarray | None = None
    ) -> dict[str, float]:
        """RMS error of each signal in its unit, not clipped."""
        ...

    def floor_by_signal(self, mask: np.ndarray | None = None) -> dict[str, float]:
        """RMS that sensor noise alone leaves in each signal, in its unit."""
        ...

    def iso18571(
        self, residual: np.ndarray, mask: np.ndarray | None = None
    ) -> dict[str, float | None]:
        """ISO/TS 18571 rating 0..1 of each signal; None where it cannot be rated."""
        ...
