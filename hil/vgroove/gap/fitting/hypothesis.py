"""Hypotheses: sets of effects with the numbers that a fit estimates, their bounds and starts, and
the fitted state of one.
"""

from collections.abc import Collection
from dataclasses import dataclass, field, replace

import numpy as np

# bound of a nuisance parameter (a rig value with a tolerance), in its standard deviations
MAX_NUISANCE_SIGMAS = 3.0
# step of a forward difference, in the typical size of the number
DIFFERENCE_STEP = 0.1
# largest step for a number that stays above 0 (a stiffness, a time), as a share of the number
MAX_RELATIVE_STEP = 0.1


def log_sigma(sigma: float) -> float:
    """Standard deviation of the logarithm of a value with a relative standard deviation, under a
    log-normal prior.
    """
    return float(np.sqrt(np.log1p(sigma**2)))


def least_share(sigma: float) -> float:
    """Share of a value with a relative standard deviation at the lower bound of its fit."""
    return float(np.exp(-MAX_NUISANCE_SIGMAS * log_sigma(sigma)))


@dataclass(frozen=True)
class Coordinate:
    """One fitted number x: theta[columns] = origin + factors * (stated + x), with x taken as 0
    where |x| < least. stated: what the rig states of it, so that x is the change.

    Of a periodic effect the coordinate of role "cosine" is amplitude cos(phase) and that of role
    "sine", which follows it, amplitude sin(phase).
    """

    name: str
    columns: tuple[int, ...]
    factors: tuple[float, ...]
    origin: float
    low: float
    high: float
    step: float = DIFFERENCE_STEP
    least: float = 0.0
    stated: float = 0.0
    prior: bool = False  # a nuisance parameter under a standard normal prior
    # "plain"; "cosine" or "sine": amplitude times cos or sin of the phase; "logarithm": theta is
    # origin * exp(factor * x)
    role: str = "plain"
    physical: str = ""  # bounds that are limits of physics: "low", "high", "both"
    local: bool = False  # rows of one place alone show it: every fold keeps the value of all rows

    def ends_at_search_bound(self, x: float) -> bool:
        """Whether a value lies at a bound that only limits the search."""
        at_low = x <= self.low and self.physical not in ("low", "both")
        return at_low or (x >= self.high and self.physical not in ("high", "both"))

    def step_at(self, x: float) -> float:
        """Step of a forward difference at x."""
        if self.low > 0.0 and x != 0.0:
            return min(self.step, MAX_RELATIVE_STEP * abs(x))
        return self.step


@dataclass(frozen=True)
class Hypothesis:
    """A set of effects with one start (p,). coordinates: the effects' numbers first, the nuisance
    parameters last. fixed: columns of theta and their values that select a form of an effect.
    """

    ids: tuple[str, ...]
    coordinates: tuple[Coordinate, ...]
    start: np.ndarray
    fixed: tuple[tuple[int, float], ...] = ()

    @property
    def count(self) -> int:
        """Numbers that belong to effects."""
        return sum(not c.prior for c in self.coordinates)

    @property
    def low(self) -> np.ndarray:
        """Lower bounds (p,)."""
        return np.array([c.low for c in self.coordinates])

    @property
    def high(self) -> np.ndarray:
        """Upper bounds (p,)."""
        return np.array([c.high for c in self.coordinates])

    @property
    def local(self) -> np.ndarray:
        """Whether rows of one place alone show each coordinate (p,)."""
        return np.array([c.local for c in self.coordinates], bool)

    @property
    def prior(self) -> np.ndarray:
        """1 for coordinates under a standard normal prior (p,)."""
        return np.array([float(c.prior) for c in self.coordinates])

    def steps_at(self, x: np.ndarray) -> np.ndarray:
        """Steps (p,) of forward differences at x (p,)."""
        return np.array([c.step_at(float(v)) for c, v in zip(self.coordinates, x, strict=True)])

    def theta(self, base: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Parameter vectors (B, P) of coordinate vectors (B, p) on top of a rig's own (P,)."""
        out = np.repeat(base[None, :], len(x), axis=0)
        for column, value in self.fixed:
            out[:, column] = value
        for i, c in enumerate(self.coordinates):
            if c.role == "plain":
                value = np.where(np.abs(x[:, i]) < c.least, 0.0, x[:, i])
                # The rounded sum may be below a bound of 0, and the plant refuses a negative delay.
                value = np.clip(c.stated + value, c.stated + c.low, c.stated + c.high)
                for column, factor in zip(c.columns, c.factors, strict=True):
                    out[:, column] = c.origin + factor * value
            elif c.role == "logarithm":
                out[:, c.columns[0]] = c.origin * np.exp(c.factors[0] * x[:, i])
            elif c.role == "cosine":
                out[:, c.columns[0]] = c.factors[0] * np.hypot(x[:, i], x[:, i + 1])
                phase_column = self.coordinates[i + 1].columns[0]
                out[:, phase_column] = np.arctan2(x[:, i + 1], x[:, i])
        return out


@dataclass
class Fit:
    """A fitted hypothesis: residuals (n,) and Jacobian (n, p) at x (p,) on all rows; out_of_fold
    (n,): residuals of every row under a fit to the other folds.

    The Jacobians are in single precision, because they are many and large.
    """

    hypothesis: Hypothesis
    x: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray
    cost: float
    delta: float  # threshold of Huber's loss, in sigma
    damping: float = 1.0  # damping factor: share of the Gauss-Newton step that is tried
    out_of_fold: np.ndarray = field(default_factory=lambda: np.zeros(0))
    exact: bool = False  # out_of_fold is simulated, not predicted to first order
    # steps (folds, p) from x to the points at which it is simulated; empty unless exact
    fold_steps: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    nuisance_slopes_known: bool = False  # their columns of the Jacobian may serve at another x
    jacobian_is_at_x: bool = False
    improving: bool = True  # the last round lowered the cost by more than a converged fit gains

    @property
    def ids(self) -> tuple[str, ...]:
        """Effects of the hypothesis."""
        return self.hypothesis.ids

    def theta(self, base: np.ndarray) -> np.ndarray:
        """Parameter vector (P,) on top of the rig's own (P,)."""
        return self.hypothesis.theta(base, self.x[None, :])[0]

    def holding(self, held: Collection[int]) -> "Fit":
        """The fit without the numbers at the places `held` of x, which keep their fitted values:
        only the other numbers count in estimates to first order (covariances). The fit itself where
        `held` is empty.
        """
        if not held:
            return self
        free = [k for k in range(len(self.x)) if k not in held]
        coordinates = tuple(self.hypothesis.coordinates[k] for k in free)
        return replace(
            self,
            hypothesis=replace(self.hypothesis, coordinates=coordinates, start=self.x[free]),
            x=self.x[free],
            jacobian=self.jacobian[:, free],
            exact=False,
            fold_steps=np.zeros((0, 0)),
        )
