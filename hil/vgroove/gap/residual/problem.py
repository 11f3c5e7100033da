"""Logs and a rig as normalised residuals, batched over parameter sets: the function that every fit
and every figure of the diagnosis is computed from.

    problem = load_problem(logs, rig, threads=2)            (residual/loading.py)
    problem.residuals(theta)    (B, P) -> (B, n): (measured - model) / sigma, not clipped, finite
    problem.theta0              (P,) the rig's own values
    problem.folds               masks (n,) of training and test rows; each residual is tested once
    problem.gap(residual, mask) RMS of the residuals, each clipped at the clip of its signal
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from vgroove import _core
from vgroove.errors import VgrooveError
from vgroove.gap.residual import agreement
from vgroove.gap.residual.batches import split_by_structure
from vgroove.gap.residual.channels import (
    CLOCK,
    DROPS_EDGES,
    Simulation,
    SpanChannel,
    add_encoder,
)
from vgroove.gap.residual.immutable import freeze_arrays
from vgroove.gap.residual.measured_run import MeasuredRun
from vgroove.gap.residual.restart_angles import RestartAngles
from vgroove.gap.residual.sensor_filters import correct_filters
from vgroove.gap.residual.sensors import SensorErrors
from vgroove.gap.residual.speed_ripple import add_speed_ripple
from vgroove.rig import Rig
from vgroove.units import RPM_PER_RAD_S

UNFINISHED_RESIDUAL = 1e6  # sigma; of rows that the plant does not reach within its step budget


@dataclass(frozen=True)
class PortionLimits:
    """What a thread simulates at once, so that the data stay in the processor's cache: parameter
    sets, and rows of all their logs.
    """

    sets: int = 48
    rows: int = 200_000


Traces = dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class SignalInfo:
    """One judged column over all logs: unit, median sigma in that unit, whether it is made from
    edges or compared by magnitude; noise_is_known: whether sigma is that of a resolution which the
    rig states.
    """

    column: str
    unit: str
    sigma: float
    edges: bool
    magnitude: bool
    note: str
    noise_is_known: bool = False


@dataclass(frozen=True)
class Problem:
    """Logs and a rig as n residuals that depend on a parameter vector; immutable."""

    rig: Rig
    runs: tuple[MeasuredRun, ...]
    theta0: np.ndarray  # (P,) the rig's parameters
    restart_s: float  # time between restarts of the model
    threads: int
    signals: tuple[SignalInfo, ...]
    regimes: tuple[str, ...]
    signal: np.ndarray  # (n,) index of each residual's signal
    log: np.ndarray  # (n,) index of its log
    row: np.ndarray  # (n,) row of the log at which it ends
    time_s: np.ndarray  # (n,)
    measured: np.ndarray  # (n,) in the signal's unit
    sigma: np.ndarray  # (n,) standard deviation in the signal's unit
    censored: np.ndarray  # (n,) whether it is only an upper bound (see Channel.censored)
    block: np.ndarray  # (n,) number of its block, from 1 in each log
    regime: np.ndarray  # (n,) index of its regime of motion
    fold: np.ndarray  # (n,) the fold that tests it
    judged: np.ndarray  # (n,) whether it counts in the gap: docs/spec/gap.md, section 5
    warnings: tuple[str, ...]
    clip: np.ndarray  # (signals,) sigmas at which the residuals of a gap are clipped
    # of a hammering tool, else 0: angle by which the joint's head turns in the longest log, and the
    # largest torque of the joint, both of the rig's simulation
    head_rad: float = 0.0
    joint_nm: float = 0.0

    parameters = list(_core.PARAMETERS)
    portion: ClassVar[PortionLimits] = PortionLimits()
    difference_factor: ClassVar[float] = 1.0  # of the steps of the finite differences of a fit
    sigma_is_bound: ClassVar[bool] = False
    is_whitened: ClassVar[bool] = False
    has_lanes: ClassVar[bool] = True

    def __post_init__(self) -> None:
        freeze_arrays(self)

    @property
    def n(self) -> int:
        """Number of residuals over all logs."""
        return len(self.signal)

    @property
    def logs(self) -> list[Any]:
        """The logs, in the order of the indices in `log`."""
        return [run.log for run in self.runs]

    @cached_property
    def folds(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Masks (train, test) of each fold."""
        return [(self.fold != k, self.fold == k) for k in np.unique(self.fold)]

    @cached_property
    def angles(self) -> RestartAngles:
        """Motor angles at the restarts of every log."""
        return RestartAngles(tuple(run.restarts.angle_rad for run in self.runs))

    @property
    def tolerance(self) -> dict[str, float]:
        """Relative standard deviations, by name in `parameters`, of the nuisance parameters."""
        return self.rig.tolerance

    def with_angles(self, angles: RestartAngles) -> "Problem":
        """The problem whose model restarts at these motor angles."""
        if angles is self.angles:
            return self
        pairs = zip(self.runs, angles.by_log, strict=True)
        runs = (replace(run, restarts=run.restarts.with_angle(angle)) for run, angle in pairs)
        return replace(self, runs=tuple(runs))

    @property
    def held_out_s(self) -> list[list[list[float]]]:
        """Judged stretches [from, to] in seconds, a list per log."""
        return [run.blocks.stretches() for run in self.runs]

    def index(self, name: str) -> int:
        """Column of a parameter in theta; VgrooveError for one that the plant does not have."""
        try:
            return self.parameters.index(name)
        except ValueError as error:
            raise VgrooveError(f"the plant has no parameter {name}") from error

    @property
    def missed_edges(self) -> tuple[float, float]:
        """Two numbers of Hall edges over all speed columns that are made from edges: the estimated
        number of missed edges, and the number of all edges, missed ones included.
        """
        channels = [
            c
            for run in self.runs
            for c in run.channels
            if isinstance(c, SpanChannel) and c.missed is not None
        ]
        missed = sum(float(c.missed[~c.censored].sum()) for c in channels)
        return missed, missed + sum(np.count_nonzero(~c.censored) for c in channels)

    @property
    def missed_share(self) -> float:
        """Share of the edges that the speed columns missed: an estimate of hall_dropout's
        probability.
        """
        missed, edges = self.missed_edges
        return missed / max(1.0, edges)

    def simulate(
        self, theta: np.ndarray, unfinished: str = "nan", threads: int = 1
    ) -> list[Simulation]:
        """Simulation of every log with its restarts: arrays (B, rows) of _core.simulate_log, CLOCK,
        DROPS_EDGES and the encoder's angle and speed.
        """
        theta = np.ascontiguousarray(np.atleast_2d(theta), dtype=float)
        errors, found = SensorErrors.of(theta, self.index), []
        drops_edges = theta[:, self.index("effects.hall_dropout.probability")] > 0.0
        for run in self.runs:
            states = add_speed_ripple(self, run, theta, run.restarts.states(errors))
            simulation = _core.simulate_log(
                run.drive, theta, run.restarts.rows, states, threads=threads, unfinished=unfinished
            )
            simulation[CLOCK], simulation[DROPS_EDGES] = errors.clock, drops_edges
            if np.any(errors.lag_s > 0.0):
                correct_filters(simulation, np.asarray(run.log.time_s), run.restarts, errors)
            add_encoder(simulation, errors)
            found.append(simulation)
        return found

    def motor_angles(self, theta: np.ndarray) -> list[np.ndarray]:
        """Angle (rows,) in rad of the motor in each log, simulated with theta (P,)."""
        return [simulation["angle_rad"][0] for simulation in self.simulate(theta)]

    def simulated_columns(self) -> dict[str, np.ndarray]:
        """What the sensors of the rig's model would log in the first log (rows,), by column."""
        rows = self.simulate(self.theta0)[0]
        return {
            "current_a": rows["current_a"][0],
            "supply_v": rows["supply_v"][0],
            "speed_rpm": rows["speed_measured_rad_s"][0] * RPM_PER_RAD_S,
            "position_rad": rows["angle_measured_rad"][0],
        }

    def models(self, theta: np.ndarray) -> np.ndarray:
        """What the measurement is compared with (B, n), in the signals' units: the model with the
        estimated shared offsets of Channel.compared.
        """
        parts = []
        for run, simulation in zip(self.runs, self.simulate(theta), strict=True):
            parts += [channel.compared(simulation) for channel in run.channels]
        return np.concatenate(parts, axis=1)

    def residuals(self, theta: np.ndarray, angles: RestartAngles | None = None) -> np.ndarray:
        """(measured - model) / sigma (B, n) for theta (B, P) or (P,), not clipped, finite
        (UNFINISHED_RESIDUAL where the simulation fails); the model restarts at these motor angles
        (default: the problem's own).

        Portions of the batch, sets of equal structure together, run in parallel: the simulation
        and its comparison with the measurement.
        """
        problem = self if angles is None else self.with_angles(angles)
        theta = np.atleast_2d(theta)
        out, rows = np.empty((len(theta), self.n)), sum(len(log.time_s) for log in self.logs)
        share = -(-len(theta) // self.threads)
        size = max(1, min(self.portion.sets, self.portion.rows // rows, share))
        effects = [name.startswith("effects.") for name in self.parameters]
        parts = split_by_structure((theta != self.theta0)[:, effects], size)
        with ThreadPoolExecutor(self.threads) as pool:
            list(pool.map(lambda part: problem._fill(out, part, theta[part]), parts))
        return out

    def _fill(self, out: np.ndarray, places: np.ndarray, theta: np.ndarray) -> None:
        """Write the residuals of theta (b, P) to the rows `places` (b,) of out (B, n)."""
        first = 0
        for run, simulation in zip(self.runs, self.simulate(theta), strict=True):
            for channel in run.channels:
                rows = slice(first, first := first + len(channel.row))
                for place, model in zip(places, channel.compared(simulation), strict=True):
                    np.subtract(channel.measured, model, out=out[place, rows])
                    np.divide(out[place, rows], channel.sigma, out=out[place, rows])
        for place in places:
            residual = out[place]
            if not np.isfinite(residual.sum()):
                residual[~np.isfinite(residual)] = UNFINISHED_RESIDUAL

    def squared(self, residual: np.ndarray) -> np.ndarray:
        """Clipped squares of residuals, same shape; nan where a censored residual does not count
        because the model respects its bound.
        """
        return np.minimum(self.squared_unclipped(residual), np.square(self.clip)[self.signal])

    def squared_unclipped(self, residual: np.ndarray) -> np.ndarray:
        """Squares as squared() states them, without the clip."""
        return np.where(self.censored & (residual == 0.0), np.nan, np.square(residual))

    def power_by_regime(self, residual: np.ndarray, power: np.ndarray) -> dict[str, float]:
        """Sum of a quantity (n,), such as the squared residuals, over the residuals of each regime.
        residual (n,): the residuals themselves, which determine the place of the quantity in the
        cycle of a hammering tool.
        """
        sums = np.bincount(self.regime, weights=power, minlength=len(self.regimes))
        return dict(zip(self.regimes, sums.tolist(), strict=True))

    def gap(self, residual: np.ndarray, mask: np.ndarray | None = None) -> Any:
        """RMS over the mask (default: judged) of clipped residuals (n,) -> float, or (B, n) ->
        (B,); 0 where nothing counts.
        """
        mask = self.judged if mask is None else mask
        square = self.squared(residual)[..., mask]
        counted = np.isfinite(square)
        total = np.where(counted, square, 0.0).sum(axis=-1)
        value = np.sqrt(total / np.maximum(counted.sum(axis=-1), 1))
        return float(value) if np.ndim(value) == 0 else value

    def gap_by_signal(
        self, residual: np.ndarray, mask: np.ndarray | None = None
    ) -> dict[str, float]:
        """RMS error of each signal in its unit, not clipped; residual (n,)."""
        mask = self.judged if mask is None else mask
        square = self.squared_unclipped(residual) * self.sigma**2
        chosen = [mask & (self.signal == k) & np.isfinite(square) for k in range(len(self.signals))]
        return {
            s.column: float(np.sqrt(square[m].mean())) if m.any() else 0.0
            for s, m in zip(self.signals, chosen, strict=True)
        }

    def rms_by_signal(self, mask: np.ndarray | None = None) -> dict[str, float]:
        """RMS of each measured signal in its unit over the rows that count in a gap; of an angle
        that is compared itself, from its first value in each log: its zero is any.
        """
        mask = (self.judged if mask is None else mask) & ~self.censored
        found = {}
        for k, signal in enumerate(self.signals):
            rows = np.flatnonzero(mask & (self.signal == k))
            values = self.measured[rows]
            if signal.unit == "rad" and len(rows):
                _, first, log = np.unique(self.log[rows], return_index=True, return_inverse=True)
                values = values - values[first][log]
            found[signal.column] = float(np.sqrt(np.mean(values**2))) if len(rows) else 0.0
        return found

    def floor_by_signal(self, mask: np.ndarray | None = None) -> dict[str, float]:
        """RMS that sensor noise alone leaves in each signal, in its unit."""
        return self.gap_by_signal(np.ones(self.n), mask)

    def floor(self, mask: np.ndarray | None = None) -> float:
        """The gap that sensor noise alone leaves: 1, as residuals are in sigmas of the sensors."""
        return 1.0

    def iso18571(
        self, residual: np.ndarray, mask: np.ndarray | None = None
    ) -> dict[str, float | None]:
        """ISO/TS 18571 overall rating 0..1 of each signal over the mask, logs weighted by their
        samples; None where a signal is too short or flat to rate.
        """
        mask = (self.judged if mask is None else mask) & ~self.censored
        model = self.measured - residual * self.sigma
        ratings: dict[str, float | None] = {}
        for k, signal in enumerate(self.signals):
            parts = [mask & (self.signal == k) & (self.log == j) for j in range(len(self.runs))]
            rated = [
                agreement.iso18571(self.time_s[m], self.measured[m], model[m])
                for m in parts
                if m.any()
            ]
            ratings[signal.column] = agreement.mean_rating(rated)
        return ratings

    def traces(self, theta: np.ndarray) -> list[Traces]:
        """For plots, per log: column -> (time_s, measured, model) in units; censored rows are left
        out.
        """
        model = self.models(np.atleast_2d(theta)[:1])[0]
        found = []
        for j in range(len(self.runs)):
            mine = (self.log == j) & ~self.censored
            masks = {s.column: mine & (self.signal == k) for k, s in enumerate(self.signals)}
            found.append(
                {
                    c: (self.time_s[m], self.measured[m], model[m])
                    for c, m in masks.items()
                    if m.any()
                }
            )
        return found
