"""Logs of a hammering tool and a rig as normalised residuals of cycle statistics, batched over
parameter sets: what Problem is for a drivetrain without impact mechanism.

The start angle of the hammer is a nuisance parameter of each log, and so are the values of a log's
own joint: columns of theta behind the plant's. Where a run may end in different limit cycles, the
start angle that follows the log best is compared with it (profile likelihood). Standard deviations
are those of the log's own scatter and of the start angles.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from vgroove.gap.residual.impact.cycle_phase import sector_name, shape_shares
from vgroove.gap.residual.impact.roll_outs import (
    PARAMETERS,
    clipped_cost,
    model_columns,
    run_up_means,
    simulate,
    simulate_statistics,
)
from vgroove.gap.residual.impact.start_angle import profiled_starts, with_starts
from vgroove.gap.residual.problem import UNFINISHED_RESIDUAL, PortionLimits, Problem, Traces
from vgroove.gap.residual.restart_angles import RestartAngles

KEPT_BYTES = 64_000_000  # of residual vectors of parameter sets that were simulated
OF_LOG = ", log "  # in the name of a value that one log has for itself


@dataclass(frozen=True)
class OwnValue:
    """A value that each log has for itself: column of theta, column of the plant's parameters that
    it replaces, its name, and its relative standard deviation (0: known).
    """

    column: int
    replaces: int
    name: str
    tolerance: float


@dataclass(frozen=True)
class ImpactProblem(Problem):
    """Cycle statistics of logs as a measured problem. own: of each log its own values; starts: of
    each log further start angles in rad that its end depends on; load_kinds: kinds of the joints of
    all logs.
    """

    own: tuple[tuple[OwnValue, ...], ...] = ()
    starts: tuple[np.ndarray, ...] = ()
    load_kinds: frozenset[str] = frozenset()

    portion: ClassVar[PortionLimits] = PortionLimits(sets=8)
    # impacts amplify small changes: slopes over short steps are those of single blows
    difference_factor: ClassVar[float] = 4.0
    sigma_is_bound: ClassVar[bool] = True
    is_whitened: ClassVar[bool] = True
    has_lanes: ClassVar[bool] = False

    @cached_property
    def _kept(self) -> dict[bytes, np.ndarray]:
        """Residuals (n,) of the parameter sets that were simulated last, by their bytes."""
        return {}

    def residuals(self, theta: np.ndarray, angles: RestartAngles | None = None) -> np.ndarray:
        """As Problem.residuals(), which the angles do not change here: a set that a fit meets again
        is not simulated again.
        """
        theta = np.ascontiguousarray(np.atleast_2d(theta), dtype=float)
        keys, kept = [one.tobytes() for one in theta], self._kept
        new = {key: place for place, key in enumerate(keys) if key not in kept}
        if new:
            found = super().residuals(theta[list(new.values())], angles)
            kept.update((key, row.copy()) for key, row in zip(new, found, strict=True))
        for key in keys:
            kept[key] = kept.pop(key)  # to the end: the sets that were used first are dropped
        rows = np.stack([kept[key] for key in keys])
        while len(kept) * self.n * rows.itemsize > KEPT_BYTES:
            del kept[next(iter(kept))]
        return rows

    @cached_property
    def parameters(self) -> list[str]:
        """Names of the columns of theta."""
        return [*PARAMETERS, *(value.name for values in self.own for value in values)]

    @property
    def tolerance(self) -> dict[str, float]:
        """Relative standard deviations of the nuisance parameters."""
        own = {value.name: value.tolerance for values in self.own for value in values}
        replaced = {PARAMETERS[v.replaces] for values in self.own for v in values}
        shared = {n: s for n, s in self.rig.tolerance.items() if n not in replaced}
        return shared | {name: sigma for name, sigma in own.items() if sigma > 0.0}

    def of_log(self, j: int, theta: np.ndarray) -> np.ndarray:
        """The plant's parameters (B, P) for log j, from theta (B, P + own)."""
        plant = theta[:, : len(PARAMETERS)].copy()
        for value in self.own[j]:
            plant[:, value.replaces] = theta[:, value.column]
        return plant

    @cached_property
    def angles(self) -> RestartAngles:
        """No restarts: each log is simulated from its start."""
        return RestartAngles(tuple(np.zeros(0) for _ in self.runs))

    def with_angles(self, angles: RestartAngles) -> "ImpactProblem":
        """The problem itself."""
        return self

    @property
    def missed_edges(self) -> tuple[float, float]:
        """Missed edges are not counted in cycle statistics."""
        return 0.0, 0.0

    def _fill(self, out: np.ndarray, places: np.ndarray, theta: np.ndarray) -> None:
        """Write the residuals of theta (b, P) to the rows `places` (b,) of out (B, n)."""
        found = [run.residuals(self._statistics(j, theta)) for j, run in enumerate(self.runs)]
        every = np.concatenate(found, axis=1)
        out[places] = np.where(np.isfinite(every), every, UNFINISHED_RESIDUAL)

    def models(self, theta: np.ndarray) -> np.ndarray:
        """Judged statistics (B, n) of the model in their units."""
        found = [self._statistics(j, theta)[:, run.judged] for j, run in enumerate(self.runs)]
        return np.concatenate(found, axis=1)

    def _statistics(self, j: int, theta: np.ndarray) -> np.ndarray:
        """Statistics (B, n of the log) of log j: the run-up from the start angle that it shows for
        each parameter set, the cycles from the same angles for all sets, of these from the one that
        follows the log best: cycles that depend on the start must not follow its every change.
        """
        run = self.runs[j]
        plant = self.of_log(j, np.ascontiguousarray(np.atleast_2d(theta), dtype=float))
        every = [simulate_statistics(run, plant)]
        for start in self.starts[j]:
            every.append(simulate_statistics(run, with_starts(plant, start)))
        statistics = np.stack(every)
        if run.early is not None:
            statistics[..., run.is_run_up] = run_up_means(run, self.from_run_up(j, theta))
        best = np.argmin(clipped_cost(run, statistics), axis=0)
        return statistics[best, np.arange(len(plant))]

    def from_run_up(self, j: int, theta: np.ndarray) -> np.ndarray:
        """The plant's parameters (B, P) for log j, with the start angle that its run-up shows."""
        run = self.runs[j]
        plant = self.of_log(j, np.ascontiguousarray(np.atleast_2d(theta), dtype=float))
        return plant if run.early is None else with_starts(plant, profiled_starts(run, plant))

    def power_by_regime(self, residual: np.ndarray, power: np.ndarray) -> dict[str, float]:
        """Sum of a quantity (n,), such as the squared residuals (n,), over each regime; that of the
        shape of the cycle over each quarter of the cycle (cycle_phase.py).
        """
        found = dict.fromkeys(self.regimes, 0.0)
        for j, run in enumerate(self.runs):
            mine = np.flatnonzero(self.log == j)
            shares = shape_shares(run, residual[mine])
            for number in np.unique(self.regime[mine]):
                name, rows = self.regimes[number], self.regime[mine] == number
                parts = power[mine][rows] @ shares[rows]
                if np.isnan(parts).any():
                    found[name] += float(power[mine][rows].sum())
                    continue
                for sector, part in enumerate(parts.tolist()):
                    named = f"{name}, {sector_name(sector, run.reader.reference)}"
                    found[named] = found.get(named, 0.0) + part
        return found

    def motor_angles(self, theta: np.ndarray) -> list[np.ndarray]:
        """Angle (rows,) in rad of the motor in each log, for theta (P,)."""
        return [
            simulate(run, self.from_run_up(j, theta))["angle_rad"][0]
            for j, run in enumerate(self.runs)
        ]

    def simulated_columns(self) -> dict[str, np.ndarray]:
        """What the sensors of the rig's model would log in the first log (rows,), by judged column,
        from the start angle that follows the log best.
        """
        run, plant = self.runs[0], self.from_run_up(0, self.theta0)
        return {name: rows[0] for name, rows in model_columns(run, simulate(run, plant)).items()}

    def iso18571(
        self, residual: np.ndarray, mask: np.ndarray | None = None
    ) -> dict[str, float | None]:
        """No rating: statistics of windows are no curves."""
        return {signal.column: None for signal in self.signals}

    def traces(self, theta: np.ndarray) -> list[Traces]:
        """For plots, per log: statistic -> (time_s, measured, model), parts of a shape one after
        the other.
        """
        model = self.models(theta)[0]
        found: list[Traces] = []
        for j in range(len(self.runs)):
            table: dict[str, Any] = {}
            for k, signal in enumerate(self.signals):
                mine = (self.log == j) & (self.signal == k)
                if mine.any():
                    table[signal.column] = (self.time_s[mine], self.measured[mine], model[mine])
            found.append(table)
        return found
